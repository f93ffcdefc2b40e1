"""One worker process, seen from the parent, and those that wait for more work."""

from __future__ import annotations

import atexit
import math
import os
import pickle
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module
from typing import Any

from workbench.core.machine.locks import forkable_lock
from workbench.core.machine.scratch import remove, scratch_folder
from workbench.errors import InputError, WorkbenchError
from workbench.jobs.answers import MOST, Records
from workbench.jobs.channel import HUNG_UP, LONGEST, MARK_BYTES, Channel, pickled, unpickled
from workbench.jobs.end_signals import ENDING
from workbench.jobs.limits import cores, went_beyond
from workbench.jobs.options import Limits
from workbench.jobs.process_copy import ProcessCopy, can_copy
from workbench.jobs.worker_main import STOP, Task
from workbench.model.base import Recipe

__all__ = ["AFTERWARDS", "WorkerProcess", "allow_copy", "keep", "kept", "prepare"]

# A process whose channel is closed is gone after at most so long [s].
_DYING = 5.0
_PAUSE = 0.005

# Time for a worker to import what a task needs, whatever the time limit of the FMU [s].
_IMPORTS = 60.0

# When all its results are there, an FMU ends its run and is freed within this time [s].
AFTERWARDS = 30.0

# Time for a process that exceeded its memory to say so [s].
_SILENT = 5.0

# Of what an FMU prints, this much is shown; the file is emptied when it is longer [byte].
_LAST_WORDS = 1 << 16
_LOG = 1 << 26

_START = (
    "import sys; sys.path[:] = {path!r}; {orphaned}{first}from workbench.core.machine.cycles import seldom; seldom(); "
    "from workbench.jobs.worker_main import main; main({link!r}, *{rest!r})"
)

# When its parent dies, the system continues a worker (Linux): one that is stopped could not see that. Not a signal that
# ends it, for what watches the parent also removes files and ends the processes that the FMU has started; and the
# system also sends it when the thread that began the worker ends, which then changes nothing. PR_SET_PDEATHSIG is 1.
_ORPHANED = (
    f"import ctypes; ctypes.CDLL(None).prctl(1, ctypes.c_ulong({int(signal.SIGCONT)})); "
    if sys.platform == "linux"
    else ""
)
_CONFINED = "from workbench.jobs.confine import confine; confine({folder!r}); "  # before a library begins a thread


class WorkerProcess:
    """A process that does one task at a time, on a model that it keeps open.

    Args:
        modules: that its first task will need; they are imported meanwhile.
        confine: whether it may write in its own temporary folder only, and use no network.
        copied: whether it is a copy of this process, see `allow_copy`.

    Attributes:
        index: of the task in work; None: idle or not yet ready.
        ready: whether it takes a task.
        error: that the task in work ended with; it is raised when its FMU has ended, too, or the process has.
        opened: whether the model of the task in work is open.
        seasoned: whether it did another task before.
        bound: `Recipe.content` of its model, if its FMU has changed the process in a way that only this one may meet;
            empty: no other may follow. None: it has not.
        deadline: when the present task must have shown a result (`time.monotonic`); None: never.
        most: largest address space that the present task may have [bytes]; None: any.
        channel: to it.
    """

    def __init__(self, modules: Sequence[str] = (), *, confine: bool = False, copied: bool = False) -> None:
        self.index: int | None = None
        self.ready = self.opened = self.seasoned = False
        self.error: Exception | None = None
        self.bound: str | None = None
        self.deadline: float | None = None
        self.most: float | None = None
        self._beyond: float | None = None  # since when it is seen to have had more
        self.surroundings = _surroundings()
        self._limits = Limits()
        _current_folder()  # where it is gone some versions of Python end before they begin
        self._records = Records() if confine else None
        with ExitStack() as undo:
            try:
                folder = scratch_folder("worker")
                undo.callback(remove, folder)
                # By its descriptor: what has this name later is the affair of the FMU.
                self._log = undo.enter_context((folder / "log").open("a+b", buffering=0))
                self._said = 0  # of the log, what was taken
                ours, theirs = socket.socketpair()
                undo.callback(ours.close)
                mark = secrets.token_bytes(MARK_BYTES)
                ours.sendall(mark)  # not in the line that starts it, which every user can read
                rest = (os.getpid(), str(folder), tuple(modules))
                with theirs, _held_back():
                    first = _CONFINED.format(folder=str(folder)) if confine else ""
                    self._process = (
                        ProcessCopy(theirs, rest, self._log.fileno())
                        if copied
                        else _started(theirs, rest, self._log.fileno(), first)
                    )
                    self._folder = folder
                    self.channel = Channel(
                        ours, mark, loads=self._records or unpickled, longest=MOST if confine else LONGEST
                    )
                    undo.pop_all()
                    with _lock:
                        _alive.add(self)
            except OSError as error:
                raise WorkbenchError(f"a worker process cannot be started: {error.strerror or error}") from None

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it still runs, and is this process's own: in a copy made by fork it is not."""
        return self.surroundings[0] == os.getpid() and not self._has_ended()

    @property
    def usable(self) -> bool:
        """Whether it can take a task, now or when it is ready."""
        return self.alive and not self.channel.hung_up

    def begin(self, index: int, recipe: Recipe | None, task: Task, argument: Any, limits: Limits) -> None:  # noqa: ANN401
        """Send a task; a worker that is dead shows it later."""
        self.seasoned, self.opened = self.opened, False
        self.index, self.ready, self.error, self._limits = index, False, None, limits
        self.most = self._beyond = None
        if self._records is not None:
            self._records.renew()
        self.restart_clock(least=_IMPORTS)
        work = pickle.dumps((task, argument), pickle.HIGHEST_PROTOCOL)
        order = (_current_folder(), pickle.dumps(recipe, pickle.HIGHEST_PROTOCOL), work, limits)
        self.channel.put(*pickled(order))

    def end_soon(self) -> None:
        """Ask for the end of the present task."""
        self.channel.put(*pickled(STOP))

    def take_leave(self) -> None:
        """Let the FMU be terminated and freed: its results are there, so it has little time for that."""
        latest = time.monotonic() + AFTERWARDS
        self.deadline = latest if self.deadline is None else min(self.deadline, latest)

    def restart_clock(self, *, least: float = 0.0) -> None:
        """Give the present task its full time again, or the least that it may have."""
        given = self._limits.timeout
        self.deadline = None if given is None else time.monotonic() + max(given, least)

    @property
    def left(self) -> float:
        """Time that the present task still has [s], at least 0."""
        return math.inf if self.deadline is None else max(0.0, self.deadline - time.monotonic())

    def is_late(self) -> bool:
        """Whether the present task has had its time."""
        return self.left == 0.0

    def is_beyond_memory(self) -> bool:
        """Whether the present task went beyond its memory, and either has had its time or did not say so in a while.

        Linear algebra that gets no memory may try again and again.
        """
        if self._beyond is None and went_beyond(self.most, self.pid):
            self._beyond = time.monotonic()
        return self._beyond is not None and (self.is_late() or time.monotonic() > self._beyond + _SILENT)

    def said(self) -> str:
        """Return what was printed there since this was asked last: the last of it, if it is long."""
        try:
            size = os.fstat(self._log.fileno()).st_size
            self._log.seek(max(self._said if self._said <= size else 0, size - _LAST_WORDS))
            text = self._log.read(_LAST_WORDS) or b""
        except OSError:
            return ""
        self._said = size
        if size > _LOG:
            with suppress(OSError):
                self._log.truncate(0)
        return text.decode("utf-8", "replace")

    def reap(self) -> int | None:
        """Wait for a process that is dying; return its exit code, None where it went on and could tell nothing."""
        until = time.monotonic() + _DYING
        while not (ended := self._has_ended()) and time.monotonic() < until:
            time.sleep(_PAUSE)
        hung_up = (self._folder / HUNG_UP).exists()
        code = self.kill()
        return code if ended and not hung_up else None

    def _has_ended(self) -> bool:
        """Whether the process is at its end; where the system can, its number stays its own until `kill`."""
        if self._process.returncode is None and hasattr(os, "waitid"):  # not on macOS and Windows
            with suppress(ChildProcessError):  # somebody else took its exit code
                return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
        return self._process.poll() is not None

    def kill(self) -> int | None:
        """End the process by force, with what the FMU has started; return its exit code. At most once."""
        with _lock:
            _alive.discard(self)
        if not self._has_ended() or self._process.returncode is None:  # else its number may be another's by now
            _kill_all(self._process)
        code = self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()
        self.channel.close()
        self._log.close()
        remove(self._folder)
        return code


def _kill_all(process: subprocess.Popen[bytes] | ProcessCopy) -> None:
    """End a process by force, with those that it started and that have not left its group."""
    if os.name == "posix":
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)  # it leads a group, see `_started`
    process.kill()


def _current_folder() -> str:
    try:
        return os.getcwd()  # noqa: PTH109 - a text
    except OSError as error:
        raise InputError(f"the current folder cannot be used: {error.strerror}; change to another") from None


def _surroundings() -> tuple[int, tuple[str, ...], int]:
    """Return what a process takes from its parent at its start."""
    return os.getpid(), tuple(sys.path), hash(frozenset(os.environ.items()))


def _started(
    theirs: socket.socket, rest: tuple[int, str, tuple[str, ...]], log: int, first: str
) -> subprocess.Popen[bytes]:
    """Start a process: spawned, not forked, so that no thread or library of this one is copied half way.

    Args:
        theirs: its end of the channel.
        rest: further arguments of `worker_main.main`.
        log: descriptor of the file that takes what is printed.
        first: code that runs before all else.
    """
    path = [os.path.abspath(folder) for folder in sys.path]  # noqa: PTH100 - of text
    code = _START.format(
        orphaned=_ORPHANED, path=path, first=first, link=theirs.fileno() if os.name == "posix" else None, rest=rest
    )
    flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]  # noqa: SLF001 - as multiprocessing
    process = subprocess.Popen(
        [sys.executable, *flags, "-c", code],
        stdin=subprocess.PIPE,
        stdout=log,
        stderr=log,
        pass_fds=[theirs.fileno()] if os.name == "posix" else [],
        start_new_session=True,  # the terminal sends Ctrl-C to all processes of its own session
    )
    if os.name == "posix" and process.stdin is not None:
        os.set_blocking(process.stdin.fileno(), False)  # nobody reads: an FMU that writes into it shall not wait
    elif process.stdin is not None:
        process.stdin.write(theirs.share(process.pid))  # type: ignore[attr-defined]
        process.stdin.close()
    return process


@contextmanager
def _held_back() -> Iterator[None]:
    """Hold back signals that ask to end while a process is started: it never hears them, this one does afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# -- workers that wait -------------------------------------------------------------------------

_lock = forkable_lock()
_alive: set[WorkerProcess] = set()
_idle: list[WorkerProcess] = []


class _Copying:
    """Whether the next worker that is prepared may be a copy of this process."""

    allowed = False


def allow_copy() -> bool:
    """Let the worker that is prepared first be a copy of this process; return whether one can be here.

    It saves what a start costs most: to import everything once more. For a process that does nothing but the command
    for which it was begun; others have threads, files and libraries that must not be copied half way.
    """
    _Copying.allowed = can_copy()
    return _Copying.allowed


def prepare(modules: Sequence[str]) -> None:
    """Start a worker that will soon be wanted, unless one waits.

    Args:
        modules: that it will need.
    """
    with _lock:
        waits = any(worker.usable for worker in _idle)
    if waits:
        return
    copied, _Copying.allowed = _Copying.allowed, False
    for module in modules if copied else ():
        import_module(module)
    keep(WorkerProcess(modules, copied=copied))


def kept(recipe: Recipe | None) -> WorkerProcess:
    """Return a worker that waits, first one that only this model may have, or a new one.

    Args:
        recipe: of the model that it will have; None: none.
    """
    around = _surroundings()
    with _lock:
        content = recipe.content() if recipe is not None and any(worker.bound for worker in _idle) else ""
        for bound in (content, None) if content else (None,):
            for worker in [w for w in reversed(_idle) if w.surroundings == around and w.bound == bound]:
                _idle.remove(worker)
                if worker.usable:
                    return worker
                worker.kill()
        return WorkerProcess()


def keep(worker: WorkerProcess) -> None:
    """Let an idle worker wait for more work, and end those that have waited longest if there are more than cores.

    Args:
        worker: idle, or not yet ready.
    """
    most = cores()
    with _lock:
        _idle.append(worker)
        ended, _idle[:] = _idle[:-most], _idle[-most:]
    for old in ended:
        old.kill()


def _end_all() -> None:
    with _lock:
        mine = [worker for worker in _alive if worker.surroundings[0] == os.getpid()]  # not in a copy made by fork
    for worker in mine:
        worker.kill()


def _forget() -> None:
    """In a copy of this process made by fork: the workers are those of the original, which alone hears them."""
    for worker in _alive:
        worker.channel.close()
    _alive.clear()
    _idle.clear()


atexit.register(_end_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
