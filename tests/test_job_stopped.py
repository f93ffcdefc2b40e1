"""A simulation that is stopped on its way leaves the rows that it has: here and in a worker process."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import workbench as wb
from workbench.jobs.job import Job
from workbench.jobs.options import Worker
from workbench.requests import in_worker as one_worker
from workbench.response.simulate.request import Simulate
from workbench.response.simulate.result import SimulationResult

LONG = 1e5  # [s]: minutes of work
STEP = 0.05


def asked(stop: float, workers: Worker | None = None) -> Simulate:
    return Simulate(stop=stop, interval=STEP, inputs={"u": "sine:amplitude=1,frequency=1"}, workers=workers)


@pytest.mark.parametrize("place", [None, Worker(in_process=True), Worker()])
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_what_was_simulated_is_kept(place: Worker | None, interface: str) -> None:
    told: list[tuple[int, int]] = []

    def stop_soon(_: object, done: int, total: int) -> None:
        told.append((done, total))
        job.stop()

    job = Job(stop_soon)
    with wb.load("fmu:FirstOrderLag", interface=interface, step=STEP) as model:
        with pytest.raises(KeyboardInterrupt):
            asked(LONG, place).run(model, job)
        cut = job.partial()
        assert isinstance(cut, SimulationResult)
        end = float(cut.time[-1])
        assert 0.0 < end < LONG
        assert cut.ended_at == end
        assert told[0][1] == 100
        # The rows are those of a run that nobody stopped.
        whole = asked(end + 1.0).run(model, Job())
    n = len(cut.time) - 1
    assert np.array_equal(cut.time[:n], whole.time[:n])
    # The length of a run has a part in the solver's steps: equal within ten times its tolerance.
    assert cut["y"][:n] == pytest.approx(whole["y"][:n], abs=1e-5)


def test_progress_comes_from_the_worker() -> None:
    told: list[tuple[int, int]] = []
    with wb.load("fmu:FirstOrderLag") as model:
        here = wb.simulate(model, stop=300.0, interval=STEP, inputs={"u": 1.0})
        there = wb.simulate(
            model, stop=300.0, interval=STEP, inputs={"u": 1.0}, workers=Worker(),
            progress=lambda _, done, total: told.append((done, total)),
        )  # fmt: skip
    assert np.array_equal(here["y"], there["y"])
    assert told == sorted(told)
    assert all(0 <= done <= total == 100 for done, total in told)


def test_a_worker_tells_what_there_is_at_once_and_then_for_a_twentieth_of_its_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Parts of a second each, of which it takes 0.2 s to tell what they gave."""
    clock, told = [0.0], list[tuple[int, object]]()
    cost = 0.2

    def tell(item: one_worker._Told, *, finished: bool) -> None:
        assert finished
        told.append((item.done, item.partial))
        clock[0] += 0.0 if item.partial is None else cost

    def work(_: object, __: object, job: Job) -> str:
        for k in range(1, 41):
            clock[0] += 1.0
            job.partial = lambda k=k: f"{k} parts"  # type: ignore[misc]
            job.done("part", k, 100)
        return "ended"

    monkeypatch.setattr(one_worker, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(one_worker, "tell", tell)
    monkeypatch.setattr(one_worker, "wanted_stop", lambda: False)
    monkeypatch.setattr(one_worker, "named", lambda _: work)
    request: Any = SimpleNamespace(algorithm="", undivided=False)
    (end,) = one_worker._perform(None, one_worker._WholeRequest(request, "a record"))
    assert isinstance(end, one_worker._RequestEnded)
    assert end.record == "ended"
    assert [done for done, _ in told] == list(range(1, 41))
    given = [done for done, partial in told if partial is not None]
    assert [partial for _, partial in told if partial is not None] == [f"{k} parts" for k in given]
    assert given[0] == 1
    assert len(given) * cost == pytest.approx(0.05 * clock[0], abs=cost)
