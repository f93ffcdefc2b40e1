"""Worker processes: what crashes, hangs or eats memory costs its own job only."""

from __future__ import annotations

import os
import select
import signal
import threading
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import workbench as wb
from tests.platforms import posix_signals
from tests.programs import ended
from tests.worker_tasks import obey
from workbench.cli.app import run
from workbench.core.records.option import recast
from workbench.jobs.end_signals import ENDING
from workbench.jobs.limits import memory_limit_works
from workbench.jobs.options import Limits, Worker
from workbench.jobs.pool import Pool, died
from workbench.jobs.runner import Lost, Reply
from workbench.jobs.worker_main import DONE, ERROR, ITEM, READY
from workbench.jobs.worker_process import WorkerProcess

ROOT = Path(__file__).resolve().parent.parent
linux = pytest.mark.skipif(not memory_limit_works(), reason="this platform enforces no memory limit")
pytestmark = pytest.mark.usefixtures("started_workers")

Outcome = dict[tuple[Any, ...], list[Any]]


@pytest.fixture(scope="module")
def model() -> Iterator[wb.DescribedModel]:
    with wb.load("fmu:FirstOrderLag") as loaded:
        yield loaded


def do(model: wb.DescribedModel, *jobs: tuple[Any, ...], workers: int = 2, limits: Limits | None = None) -> Outcome:
    """Run jobs; return what came of each: its items, and the reason if it was lost."""
    found: Outcome = {job: [] for job in jobs}
    with Pool(model.recipe, jobs=workers, limits=limits or Limits()) as pool:
        for event in pool.run(obey, deque(jobs)):
            found[event.job].append(event.value if isinstance(event, Reply) else event.reason)
    return found


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "Z" not in Path(f"/proc/{pid}/stat").read_text().split() if Path("/proc/self/stat").exists() else True


def test_jobs_run_on_the_model_in_other_processes(model: wb.DescribedModel) -> None:
    found = do(model, ("say", 1, 2, 3), ("name",), ("say",))
    assert found["say", 1, 2, 3] == [1, 2, 3]
    assert found["say",] == []
    name, outputs, pid = found["name",][0]
    assert (name, outputs) == ("FirstOrderLag", ["y"])
    assert pid != os.getpid()


@posix_signals
def test_a_crash_costs_its_own_job_only(model: wb.DescribedModel) -> None:
    say = [("say", k) for k in range(4)]
    bad: list[tuple[Any, ...]] = [("segfault",), ("signal", int(signal.SIGABRT)), ("exit", 3)]
    found = do(model, say[0], bad[0], say[1], bad[1], say[2], bad[2], say[3])
    assert [found[s] for s in say] == [[0], [1], [2], [3]]
    assert found[bad[0]] == ["the FMU crashed: segmentation fault (SIGSEGV)"]
    assert found[bad[1]] == ["before", "the FMU aborted its process (SIGABRT)"]
    assert found[bad[2]] == ["the FMU ended its process (exit code 3)"]


class Clock:
    """In place of the module `time`: stands still but for what a test adds."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.per_look = 0.0, 0.0
        monkeypatch.setattr("workbench.jobs.pool.time", self)
        monkeypatch.setattr("workbench.jobs.worker_process.time", self)

    def monotonic(self) -> float:
        self.now += self.per_look
        return self.now


@posix_signals
def test_a_hang_is_ended_by_the_time_limit(model: wb.DescribedModel, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    with Pool(model.recipe, jobs=1, limits=Limits(timeout=0.3)) as pool:
        events = pool.run(obey, deque([("endless_in_c",), ("say", 1)]))
        assert next(events) == Reply(("endless_in_c",), "before")
        clock.per_look = 0.1
        lost = next(events)
        assert isinstance(lost, Lost)
        assert lost.job == ("endless_in_c",)
        assert isinstance(lost.error, wb.TimedOutError)
        assert lost.reason == "time limit: not finished after 0.3 s; `timeout` sets it"
        clock.per_look = 0.0
        assert list(events) == [Reply(("say", 1), 1)]


def test_the_time_limit_counts_from_item_to_item(model: wb.DescribedModel, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    with Pool(model.recipe, jobs=1, limits=Limits(timeout=0.6)) as pool:
        for event in pool.run(obey, deque([("say", 1, 2, 3)])):
            assert isinstance(event, Reply)
            clock.now += 0.5


def test_what_a_worker_imports_is_not_on_the_time_of_the_fmu(
    model: wb.DescribedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, begin = Clock(monkeypatch), WorkerProcess.begin

    def begin_slowly(worker: WorkerProcess, *order: Any) -> None:  # noqa: ANN401 - as they are
        begin(worker, *order)
        clock.now += 30.0

    monkeypatch.setattr(WorkerProcess, "begin", begin_slowly)
    with Pool(model.recipe, jobs=1, limits=Limits(timeout=0.6)) as pool:
        assert list(pool.run(obey, deque([("say", 1)]))) == [Reply(("say", 1), 1)]


def test_when_its_results_are_there_an_fmu_has_little_time_to_end(
    model: wb.DescribedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock(monkeypatch)
    with Pool(model.recipe, jobs=1, limits=Limits()) as pool:
        taken = pool._take
        # In place of an FMU that hangs in its terminate: the worker's being ready is never heard.
        monkeypatch.setattr(pool, "_take", lambda w, kind, c: () if kind == READY and w.opened else taken(w, kind, c))
        events = pool.run(obey, deque([("say", 1)]))
        assert next(events) == Reply(("say", 1), 1)
        clock.per_look = 1.0
        assert list(events) == []
    assert 30.0 < clock.now < 60.0
    said = "when all was told, time limit: the FMU had not ended its run and been freed after 30 s"
    assert pool.remarks() == [said]


def test_what_a_library_of_python_warns_of_is_not_what_the_fmu_printed(model: wb.DescribedModel) -> None:
    with Pool(model.recipe, jobs=1, limits=Limits()) as pool:
        assert list(pool.run(obey, deque([("warn",)]))) == [Reply(("warn",), "warned")]
    assert pool.remarks() == []


@linux
def test_the_memory_limit_refuses_allocations(model: wb.DescribedModel) -> None:
    jobs = [("allocate", 400), ("allocate", 250), ("allocate", 20), ("malloc", 400)]
    found = do(model, *jobs, limits=Limits(memory=200.0))
    # The first is refused; the second is granted and seen afterwards, although it was freed.
    assert found["allocate", 400] == ["memory limit: more than 200 MB needed; `memory_limit` sets it"]
    assert found["allocate", 250] == found["allocate", 400]
    assert found["allocate", 20] == [20_000_000]
    assert found["malloc", 400] == [
        "the FMU crashed: segmentation fault (SIGSEGV), perhaps by the memory limit of 200 MB"
    ]


def test_an_error_of_the_task_is_raised_here(model: wb.DescribedModel) -> None:
    with pytest.raises(wb.SimulationError, match=r"fmi2DoStep returned error \(at t = 1.5 s\)") as caught:
        do(model, ("fail",))
    assert caught.value.time == 1.5
    with pytest.raises(RuntimeError, match="KeyError"):
        do(model, ("bug",))


def test_the_queue_may_grow_meanwhile(model: wb.DescribedModel) -> None:
    jobs = deque([("say", 3)])
    seen = []
    with Pool(model.recipe, jobs=2, limits=Limits()) as pool:
        for event in pool.run(obey, jobs):
            assert isinstance(event, Reply)
            seen.append(event.value)
            if event.value:
                jobs.append(("say", event.value - 1))
    assert seen == [3, 2, 1, 0]


def test_stop_ends_a_worker_in_the_middle_of_its_job(model: wb.DescribedModel) -> None:
    pool = Pool(model.recipe, jobs=1, limits=Limits())
    events = pool.run(obey, deque([("sleep", 0.0, 100.0)]))
    assert next(events) == Reply(("sleep", 0.0, 100.0), 0.0)
    pids = [w.pid for w in pool._workers]
    pool.stop()
    with pytest.raises(KeyboardInterrupt):
        next(events)
    assert pids
    assert not any(alive(p) for p in pids)


@posix_signals
@pytest.mark.parametrize("number", ENDING)
def test_signals_that_ask_to_end_are_the_parents_affair(model: wb.DescribedModel, number: int) -> None:
    assert do(model, ("signal", number)) == {("signal", number): ["before", "still here"]}


@posix_signals
def test_ctrl_c_at_once_does_not_end_a_worker_that_still_starts(
    model: wb.DescribedModel, capfd: pytest.CaptureFixture[str]
) -> None:
    worker = WorkerProcess()
    try:
        os.kill(worker.pid, signal.SIGINT)
        select.select([worker.channel], [], [])
        assert list(worker.channel.receive()) == [(READY, False)]
        assert worker.said() == ""
    finally:
        worker.kill()
    assert capfd.readouterr().err == ""
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])  # the parent hears it again


def test_a_worker_loads_only_what_it_needs(model: wb.DescribedModel) -> None:
    found = do(model, ("modules",), limits=Limits(memory=10_000.0))  # a worker of its own
    modules = set(found["modules",][0])
    assert not modules & {"matplotlib", "typer", "rich", "control", "pytest", "scipy", "sqlite3"}


@posix_signals
def test_standard_output_belongs_to_the_result(model: wb.DescribedModel, capfd: pytest.CaptureFixture[str]) -> None:
    with Pool(model.recipe, jobs=1, limits=Limits()) as pool:
        assert list(pool.run(obey, deque([("stdout",)])))
        assert "written by the FMU" in pool.printed
    assert capfd.readouterr() == ("", "")


def test_a_model_that_cannot_be_opened_is_told(tmp_path: Path) -> None:
    with wb.load("fmu:FirstOrderLag") as loaded:
        recipe = loaded.recipe
    with Pool(recipe, jobs=1, limits=Limits()) as pool, pytest.raises(wb.WorkbenchError):
        list(pool.run(obey, deque([("say", 1)])))


@pytest.mark.parametrize(
    ("code", "platform", "text"),
    [
        (0xC0000005, "win32", "access violation"),
        (-1073741819, "win32", "access violation"),
        (3, "win32", "exit code 3"),
        (-9, "linux", "killed (SIGKILL)"),
        (-8, "linux", "arithmetic"),
        *((-n, "linux", "is my.fmu whole, was it left unchanged") for n in [getattr(signal, "SIGBUS", None)] if n),
        (-60, "linux", "signal"),
        (0, "linux", "exit code 0"),
        (None, "linux", "closed the connection"),
    ],
)
def test_reasons_name_what_happened(code: int | None, platform: str, text: str) -> None:
    assert text in str(died(code, Limits(), source="my.fmu", platform=platform))


# -- what goes wrong between requests, or in odd ways -----------------------------------------


@posix_signals
def test_a_worker_that_died_while_it_waited_costs_nothing(model: wb.DescribedModel) -> None:
    with Pool(model.recipe, jobs=1, limits=Limits()) as pool:
        for _ in range(2):  # in a pool that is still open, and the second time after a kept one
            assert list(pool.run(obey, deque([("say", 1)]))) == [Reply(("say", 1), 1)]
            (pid,) = (w.pid for w in pool._workers)
            os.kill(pid, signal.SIGKILL)
            assert ended(pid)
        assert list(pool.run(obey, deque([("say", 2)]))) == [Reply(("say", 2), 2)]
        (pid,) = (w.pid for w in pool._workers)
    os.kill(pid, signal.SIGKILL)
    assert do(model, ("say", 3), workers=1) == {("say", 3): [3]}


@posix_signals
def test_a_worker_that_an_earlier_request_broke_costs_the_next_one_nothing(model: wb.DescribedModel) -> None:
    """It dies as soon as it is asked: it cannot be seen before."""
    with Pool(model.recipe, jobs=1, limits=Limits()) as pool:
        list(pool.run(obey, deque([("say", 1)])))
        (pid,) = (w.pid for w in pool._workers)
        os.kill(pid, signal.SIGSTOP)
        events = pool.run(obey, deque([("name",)]))
        threading.Timer(0.3, os.kill, (pid, signal.SIGKILL)).start()
        (event,) = events
    assert isinstance(event, Reply)
    assert event.value[2] != pid


@posix_signals
def test_what_was_printed_last_is_part_of_the_message(model: wb.DescribedModel) -> None:
    job = ("last_words", "warming up", "the pump\x1b ran dry")
    assert do(model, ("say", 1), job, workers=1)[job] == [
        "the FMU crashed: segmentation fault (SIGSEGV); the last that it printed: the pump\\x1b ran dry"
    ]


@posix_signals
@pytest.mark.parametrize("what", ["StopIteration", "GeneratorExit", "SystemExit"])
def test_an_odd_exception_ends_nothing_in_silence(model: wb.DescribedModel, what: str) -> None:
    jobs = [("say", 1), ("raise", what), ("say", 2)]
    if what == "SystemExit":
        found = do(model, *jobs, workers=1)
        assert found[jobs[1]] == ["before", "the FMU ended its process (exit code 0)"]
        assert found[jobs[2]] == [2]
    else:
        with pytest.raises(RuntimeError, match=what):
            do(model, *jobs, workers=1)


@linux
def test_noise_in_the_channel_costs_nothing_and_a_closed_one_is_told(model: wb.DescribedModel) -> None:
    assert do(model, ("noise", "between"), ("say", 1)) == {("noise", "between"): ["after"], ("say", 1): [1]}
    found = do(model, ("noise", "closed"), ("say", 1), workers=1)
    assert found["say", 1] == [1]
    (reason,) = found["noise", "closed"]
    assert "closed the connection" in reason


def test_an_answer_that_cannot_be_made_here_is_an_error(model: wb.DescribedModel) -> None:
    found = do(model, ("odd",), ("say", 1), workers=1)
    assert found["odd",][0].startswith("its worker's answer cannot be read: ")
    assert found["say", 1] == [1]


def test_memory_that_ends_while_an_error_is_told_is_told(model: wb.DescribedModel) -> None:
    found = do(model, ("too_large",), ("say", 1), workers=1)
    before, reason = found["too_large",]
    assert before == "before"
    assert "memory" in reason
    assert "ended its process" not in reason
    assert found["say", 1] == [1]


@posix_signals
@pytest.mark.parametrize(
    "messages", [[(READY, None)], [("nothing", "of the kind")], [5], [(DONE, None), (ITEM, 5)], [(ERROR, "none")]]
)
def test_messages_in_disorder_are_one_error(model: wb.DescribedModel, messages: list[Any]) -> None:
    with Pool(model.recipe, jobs=1, limits=Limits()) as pool:
        events = pool.run(obey, deque([("sleep", 0.0, 100.0)]))
        assert next(events) == Reply(("sleep", 0.0, 100.0), 0.0)
        (worker,) = pool._workers
        worker.channel.receive = lambda: iter(messages)  # type: ignore[method-assign]
        worker.channel.dry = True
        os.kill(worker.pid, signal.SIGKILL)
        assert ended(worker.pid)
        try:
            said = [str(event) for event in events] + pool.remarks()
        except wb.LostError as error:
            said = [str(error)]
    assert len(said) == 1
    assert "its worker's answer cannot be read" in said[0]


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("-inf"), 1e300])
@pytest.mark.parametrize("name", ["timeout", "memory_limit"])
def test_limits_are_checked_where_they_are_written(
    name: str, value: float, capsys: pytest.CaptureFixture[str], model: wb.DescribedModel
) -> None:
    said = f"{name.replace('_', '.')}: .*(is not a (positive )?number|is as good as no limit)"
    for kind in (wb.Workers, Worker):
        with pytest.raises(wb.InputError, match=said):
            recast(kind, kind(), **{name: value})
    flag = f"--{name.replace('_', '-')}"
    asked = [[name, "fmu:FirstOrderLag"] for name in ("simulate", "trim", "lin", "info", "check")]
    for command in (*asked, ["run", "study:rudder_specification", "--no-store"]):
        assert run([*command, f"{flag}={value}"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"workbench: {flag}: ") or "o such option" in line
