"""Tasks on executors that somebody else owns: threads, processes."""

from __future__ import annotations

import io
import zipfile
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import control
import numpy as np
import pytest

import workbench as wb
from tests.fakes import lag
from tests.platforms import posix_signals
from tests.worker_tasks import obey
from workbench.errors import LostError
from workbench.jobs.executor import OnExecutor
from workbench.jobs.options import Workers
from workbench.jobs.pool import Pool
from workbench.jobs.runner import InProcess, Lost, Reply, Runner
from workbench.jobs.runner_choice import choose
from workbench.model.load import load

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def model() -> Iterator[wb.FmuModel]:
    with load("fmu:FirstOrderLag") as loaded:
        yield loaded


def test_a_packed_recipe_needs_no_file_and_serves_every_platform(model: wb.FmuModel, tmp_path: Path) -> None:
    packed = model.recipe.packed()
    assert packed.archive is not None
    with zipfile.ZipFile(io.BytesIO(packed.archive)) as archive:
        names = set(archive.namelist())
    assert {"binaries/win64/FirstOrderLag.dll", "binaries/linux64/FirstOrderLag.so"} <= names
    elsewhere = replace(packed, folder=str(tmp_path / "missing"), source=str(tmp_path / "missing.fmu"))
    with elsewhere.open() as again, again.open_session() as session:
        assert again.source == elsewhere.source
        assert session.values(["y"]) == {"y": 0.0}
    with zipfile.ZipFile(io.BytesIO(packed.archive)) as archive:
        archive.extractall(tmp_path / "folder")
    with load(tmp_path / "folder") as unpacked, unpacked.recipe.packed().open() as again:
        assert again.description.variables == model.description.variables


def values(runner: Runner, *jobs: tuple[object, ...]) -> dict[tuple[object, ...], list[object]]:
    found: dict[tuple[object, ...], list[object]] = {job: [] for job in jobs}
    for event in runner.run(obey, deque(jobs)):
        found[event.job].append(event.value if isinstance(event, Reply) else event.reason)
    return found


SAY = [("say", k, k + 1) for k in range(10)]


def test_threads(model: wb.FmuModel) -> None:
    with ThreadPoolExecutor(2) as threads, OnExecutor(threads, model.recipe) as runner:
        assert values(runner, *SAY) == {job: [job[1], job[2]] for job in SAY}
        with pytest.raises(wb.SimulationError, match="fmi2DoStep"):
            values(runner, ("fail",))
        # The executor is not ours: it goes on.
        assert threads.submit(int, "3").result() == 3


@posix_signals
def test_processes_that_break_lose_the_rest(model: wb.FmuModel) -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        found = values(OnExecutor(processes, model.recipe), ("name",), ("exit", 3), ("say", 1))
    assert found["name",][0][:2] == ("FirstOrderLag", ["y"])  # type: ignore[index]
    assert "the executor is broken, perhaps by a crash of the FMU" in str(found["exit", 3][0])
    assert "the executor is broken" in str(found["say", 1][0])


def test_stop_cancels_what_waits(model: wb.FmuModel) -> None:
    with ThreadPoolExecutor(1) as threads:
        runner = OnExecutor(threads, model.recipe)
        events = runner.run(obey, deque([("sleep", 0.1), ("sleep", 0.2), *SAY]))
        next(events)
        runner.stop()
        with pytest.raises(KeyboardInterrupt):
            next(events)


def test_the_table_of_places(model: wb.FmuModel) -> None:
    fake = lag(1.0)  # written in Python
    with ThreadPoolExecutor(1) as threads:
        cases: list[tuple[wb.Model, Workers, type[Runner], int]] = [
            (model, Workers(), Pool, 0),
            (model, Workers(jobs=3), Pool, 0),
            (model, Workers(in_process=True), InProcess, 0),
            (model, Workers(executor=threads), OnExecutor, 0),
            (fake, Workers(), InProcess, 0),
            (fake, Workers(executor=threads), InProcess, 1),
            (fake, Workers(timeout=1.0), InProcess, 1),
        ]
        for which, workers, kind, remarks in cases:
            runner, notes = choose(which, workers)
            assert isinstance(runner, kind)
            assert len(notes) == remarks


def test_contradictions_are_refused() -> None:
    with pytest.raises(wb.InputError, match="at least 1"):
        Workers(jobs=0)
    with pytest.raises(wb.InputError, match="cannot be 2 jobs"):
        Workers(jobs=2, in_process=True)
    with pytest.raises(wb.InputError, match="choose one place"):
        Workers(in_process=True, scheduler="tcp://localhost:1")
    with pytest.raises(wb.InputError, match="own worker processes"):
        Workers(in_process=True, timeout=1.0)


def test_lost_jobs_name_the_job() -> None:
    assert Lost(("say", 1), LostError("why")).job == ("say", 1)


def test_an_executor_that_is_used_again_answers_for_the_system_it_is_asked_about() -> None:
    """Two systems of one name and with the same settings; the second was answered by the first."""
    with ThreadPoolExecutor(1) as executor:
        for tau in (1.0, 0.1):
            lag = control.tf([1.0], [tau, 1.0])
            with wb.connect({"p": lag}, inputs={"u": "p.u"}, outputs={"y": "p.y"}) as model:
                found = wb.nfr(model, "u", "y", [1.0], [1.0], executor=executor)
            assert found.response[0, 0] == pytest.approx(1.0 / (1.0 + 2j * np.pi * tau), rel=1e-3)


@pytest.mark.parametrize("analysis", ["trim", "lin", "nfr"])
def test_a_number_of_workers_is_not_where(analysis: str) -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        call = {"nfr": lambda: wb.nfr(model, "u", "y", [1.0], [1.0], workers=2)}.get(analysis)  # type: ignore[arg-type]
        with pytest.raises(wb.InputError, match=r"workers: 2 does not say where; give wb\.Workers\(timeout=60\)"):
            call() if call else getattr(wb, analysis)(model, workers=2)
