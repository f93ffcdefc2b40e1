"""Worker processes: how many are started, and that they end, whatever ends those who started them."""

from __future__ import annotations

import errno
import gc
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import workbench as wb
from tests.platforms import posix_signals
from tests.programs import ended, start
from tests.worker_tasks import obey
from workbench.cli.app import run
from workbench.core.machine.scratch import scratch_folder
from workbench.jobs import worker_process as process
from workbench.jobs.limits import Room, memory_limit_works
from workbench.jobs.options import Limits
from workbench.jobs.pool import Pool
from workbench.jobs.runner import Lost, Reply
from workbench.jobs.worker_process import WorkerProcess

linux = pytest.mark.skipif(not memory_limit_works(), reason="this platform enforces no memory limit")
pytestmark = pytest.mark.usefixtures("started_workers")


ORPHANS = """
import workbench as wb
from collections import deque
from tests.programs import ended, start
from tests.worker_tasks import obey
from workbench.jobs.options import Limits
from workbench.jobs.pool import Pool
model = wb.load("fmu:FirstOrderLag")
pool = Pool(model.recipe, jobs=2, limits=Limits())
for event in pool.run(obey, deque([("sleep", 0.0, 100.0), ("say", 1), ("endless_in_c",)])):
    print(model.recipe.folder, *(w.pid for w in pool._workers), flush=True)
"""


@posix_signals
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_their_parent_whatever_ends_it(how: signal.Signals) -> None:
    # The script has no `if __name__ == "__main__"`: a worker does not run it again.
    process = start(["-c", ORPHANS])
    assert process.stdout is not None
    lines = [process.stdout.readline().split() for _ in range(3)]
    process.send_signal(how)
    process.communicate()
    folder, *pids = lines[-1]
    assert len(pids) == 2
    assert all(ended(int(p)) for p in pids)
    assert not Path(folder).exists()


@posix_signals
def test_a_worker_ends_with_its_parent_though_its_code_holds_the_lock_of_python() -> None:
    """As the code of an FMU that embeds Python may."""
    process = start(["-c", ORPHANS.replace("endless_in_c", "endless_with_lock")])
    assert process.stdout is not None
    lines = [process.stdout.readline().split() for _ in range(3)]
    process.kill()
    process.communicate()
    assert all(ended(int(p)) for p in lines[-1][1:])


STARTING = """
from collections import deque
import workbench as wb
from tests.worker_tasks import obey
from workbench.jobs.options import Limits
from workbench.jobs.pool import Pool
with wb.load("fmu:FirstOrderLag") as model, Pool(model.recipe, jobs=1, limits=Limits(timeout=TIME)) as pool:
    for event in pool.run(obey, deque([("start",)])):
        print(getattr(event, "value", "lost"), flush=True)
"""


@posix_signals
@pytest.mark.parametrize("time", ["1.0", "1000.0"], ids=["time limit", "killed"])
def test_what_an_fmu_starts_ends_with_its_worker(time: str) -> None:
    process = start(["-c", STARTING.replace("TIME", time)])
    assert process.stdout is not None
    child = int(process.stdout.readline())
    if time == "1000.0":
        process.kill()
    else:
        assert process.stdout.readline() == "lost\n"
    process.communicate()
    assert ended(child)


@pytest.mark.skipif(not hasattr(os, "waitid"), reason="without it a process that has ended no longer tells its group")
def test_what_an_fmu_starts_ends_with_its_crash() -> None:
    with wb.load("fmu:FirstOrderLag") as model, Pool(model.recipe, jobs=1, limits=Limits()) as pool:
        started, crash = pool.run(obey, deque([("start", "segfault")]))
        assert isinstance(started, Reply)
        assert isinstance(crash, Lost)
        assert crash.kind == "crashed"
    assert ended(started.value)


@linux
def test_a_stopped_worker_ends_with_its_parent_and_what_its_fmu_has_started() -> None:
    process = start(
        [
            "-c",
            STARTING.replace("TIME", "1000.0").replace(
                "getattr(event", "*(w.pid for w in pool._workers), getattr(event"
            ),
        ]
    )
    assert process.stdout is not None
    pids = [int(word) for word in process.stdout.readline().split()]
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    process.kill()
    process.communicate()
    assert len(pids) == 2
    assert all(ended(pid) for pid in pids)


def test_a_script_that_leaves_its_workers_to_themselves_ends() -> None:
    process = start(["-c", ORPHANS.replace("flush=True)", "flush=True)\n    import sys; sys.exit(4)")])
    process.communicate()
    assert process.returncode == 4


def test_a_script_without_a_guard_runs_once(tmp_path: Path) -> None:
    script = tmp_path / "plain.py"
    script.write_text(ORPHANS.replace('("sleep", 0.0, 100.0), ("say", 1), ("endless_in_c",)', '("say", 1)'))
    process = start([str(script)])
    out, err = process.communicate()
    assert (process.returncode, len(out.splitlines()), err) == (0, 1, "")


def owned() -> tuple[Any, ...]:
    """Return what a worker that fails to start could leave behind."""
    gc.collect()
    folder = scratch_folder("first").parent
    files = sorted(p.name for p in folder.iterdir() if not p.name.startswith("first"))
    return sorted(Path("/proc/self/fd").iterdir())[:-1], files, len(process._alive), threading.active_count()


@linux
@pytest.mark.parametrize("name", ["subprocess.Popen", "socket.socketpair", "pathlib.Path.open"])
def test_a_worker_that_cannot_be_started_is_one_line_and_leaves_nothing(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    before = owned()
    with monkeypatch.context() as patched:
        patched.setattr(name, fails)
        with pytest.raises(wb.WorkbenchError, match="a worker process cannot be started: Too many open files"):
            WorkerProcess()
    assert owned() == before


@linux
def test_an_fmu_that_writes_into_every_file_does_not_wait_for_a_worker_that_its_own_began() -> None:
    """Nobody reads what is written into a lifeline: a pipe that is full would hold the FMU for ever."""
    worker = WorkerProcess()
    pipes = {opened for opened in _open_files(worker.pid).values() if opened.name.startswith("pipe:")}
    lifelines = [number for number, opened in _open_files(os.getpid()).items() if opened in pipes]
    assert lifelines
    for file in lifelines:
        assert not os.get_blocking(file)
        with pytest.raises(BlockingIOError):
            os.write(file, bytes(1 << 20)) and os.write(file, b"further")
    worker.kill()


def _open_files(pid: int) -> dict[int, Path]:
    """Return what a process has open, by its number; it may close something meanwhile."""
    result = {}
    for file in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):
            result[int(file.name)] = file.readlink()
    return result


# -- stopping and copies made by fork ---------------------------------------------------------


STOPPED = """
import os, signal, sys, threading
from collections import deque
import workbench as wb
from tests.worker_tasks import obey
from workbench.jobs.options import Limits
from workbench.jobs.pool import Pool
from workbench.jobs.channel import Channel

model = wb.load("fmu:FirstOrderLag")
pool = Pool(model.recipe, jobs=1, limits=Limits())
signal.signal(signal.SIGTERM, lambda *_: pool.end_soon())
events = pool.run(obey, deque([("say", 0), ("sleep", 0.0, 100.0)]))
print(next(events).value)

class Link:  # asked to end in the middle of sending
    def __init__(self, link): self.link = link
    def fileno(self): return self.link.fileno()
    def recv(self, *a): return self.link.recv(*a)
    def recv_into(self, *a): return self.link.recv_into(*a)
    def close(self): self.link.close()
    def send(self, piece):
        os.kill(os.getpid(), signal.SIGTERM)
        return self.link.send(piece)

channel = pool._workers[0].channel
channel._link = Link(channel._link)
try:
    print([e.value for e in events])
except KeyboardInterrupt:
    print("ended")
"""


@posix_signals
def test_a_signal_in_the_middle_of_sending_ends_it_in_good_order() -> None:
    """Its handler sends nothing itself, and takes no lock."""
    process = start(["-c", STOPPED])
    out, err = process.communicate(timeout=60)
    assert (out.split(), err) == (["0", "ended"], "")


FORKED = """
import os, sys, threading
from collections import deque
import workbench as wb
from tests.worker_tasks import obey
from workbench.core.machine import scratch
from workbench.jobs import worker_process as process
from workbench.jobs.options import Limits
from workbench.jobs.pool import Pool

model = wb.load("fmu:FirstOrderLag")
held, free = threading.Event(), threading.Event()
def hold():
    with process._lock, scratch._beginning:
        held.set()
        free.wait()
with Pool(model.recipe, jobs=1, limits=Limits()) as pool:
    events = pool.run(obey, deque([("say", 1, 2, 3)]))
    print(next(events).value, flush=True)
    threading.Thread(target=hold, daemon=True).start()
    held.wait()
    child = os.fork()
    if child == 0:
        wb.simulate(model, stop=0.1)  # in a worker of its own
        sys.exit(7)  # closes the pool on its way
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])  # locks were held for all its life
    free.set()
    print(code, *(e.value for e in events))
    print(*(e.value for e in pool.run(obey, deque([("say", 4)]))))
"""


@posix_signals
def test_a_fork_in_the_middle_of_a_run_disturbs_neither() -> None:
    process = start(["-W", "ignore::DeprecationWarning", "-c", FORKED])  # why they hold locks
    out, err = process.communicate(timeout=60)
    assert (out.split(), err) == (["1", "7", "2", "3", "4"], "")


@pytest.mark.skipif(not memory_limit_works(), reason="the system says nothing of a process")
def test_what_the_system_says_is_read_though_the_process_has_a_name_of_several_lines() -> None:
    name = Path("/proc/self/comm")
    before = name.read_text()
    try:
        name.write_text("an\vFMU")
        assert Room()()
    finally:
        name.write_text(before.strip())


# -- no more of them than are needed ------------------------------------------------------------


@pytest.fixture(scope="module")
def model() -> Iterator[wb.DescribedModel]:
    with wb.load("fmu:FirstOrderLag") as loaded:
        yield loaded


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[WorkerProcess]:
    """Worker processes that are started; none waits."""
    process._end_all()
    process._idle.clear()
    found: list[WorkerProcess] = []
    make = WorkerProcess.__init__

    def counted(worker: WorkerProcess, module: str = "", *, confine: bool = False) -> None:
        found.append(worker)
        make(worker, module, confine=confine)

    monkeypatch.setattr(WorkerProcess, "__init__", counted)
    return found


POINT = ["nfr", "fmu:FirstOrderLag", "--input", "u", "--output", "y", "--freq", "1", "--amplitude", "1", "--jobs", "8"]


def test_no_worker_starts_where_all_is_in_the_store(
    begun: list[WorkerProcess], tmp_path: Path, model: wb.DescribedModel
) -> None:
    for measure in (
        lambda: run([*POINT, "--store", str(tmp_path / "line")]),
        lambda: wb.nfr(model, "u", "y", [1.0], [1.0], store=tmp_path / "python"),
    ):
        for most in (2, 0):  # one for the point, one for the run with zero input
            process._end_all()
            process._idle.clear()
            begun.clear()
            measure()
            assert len(begun) == most


def test_no_more_workers_start_than_there_are_tasks(begun: list[WorkerProcess], model: wb.DescribedModel) -> None:
    with Pool(model.recipe, jobs=8, limits=Limits()) as pool:
        list(pool.run(obey, deque([("say", 1), ("say", 2)])))
    assert len(begun) == 2


@posix_signals
def test_none_starts_that_is_not_used(begun: list[WorkerProcess], model: wb.DescribedModel) -> None:
    assert run([*POINT[:-2], "--scheduler", "nonsense"]) == 2
    wb.nfr(model, "u", "y", [1.0], [1.0], workers=wb.Workers(executor=ThreadPoolExecutor(1)))
    assert not begun
    assert run(["simulate", "fmu:FirstOrderLag", "--stop", "0.1", "--memory-limit=5000"]) == 0
    assert len(begun) == 1
