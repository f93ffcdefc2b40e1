"""One worker process, seen from the parent."""

from __future__ import annotations

import atexit
import multiprocessing
import pickle
import shutil
import signal
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from types import ModuleType
from typing import Any

from workbench.core.where import Limits
from workbench.endings import ENDING
from workbench.model.recipe import Recipe
from workbench.workers.child import STOP, Task, work

__all__ = ["WorkerProcess"]

# Longest time until a process whose pipe is closed is gone [s].
_DYING = 5.0

_spawning = threading.Lock()


class WorkerProcess:
    """A process that holds one model and does one task at a time.

    Attributes:
        index: of the task in work; None: idle or not yet ready.
        ready: whether it takes a task.
        deadline: when the present task must have shown a result (`time.monotonic`); None: never.
    """

    def __init__(self, recipe: Recipe, limits: Limits) -> None:
        self._limits = limits
        self.index: int | None = None
        self.ready = False
        self.deadline: float | None = None
        # Spawned, not forked: the same on all platforms, and no thread or library of the parent is copied half way.
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._scratch = tempfile.mkdtemp(prefix="fmi-workbench-worker-")
        self._process = context.Process(target=work, args=(theirs, recipe, limits, self._scratch), daemon=True)
        with _without_main(), _without_interrupts():
            self._process.start()
        _alive.add(self)
        theirs.close()

    @property
    def sentinel(self) -> int:
        """Becomes ready, for `multiprocessing.connection.wait`, when the process ends."""
        return self._process.sentinel

    @property
    def pid(self) -> int | None:
        """Number of the process."""
        return self._process.pid

    def begin(self, index: int, task: Task, argument: Any) -> None:  # noqa: ANN401 - any task's
        """Send a task; a worker that is dead shows it at the next `receive`."""
        self.index, self.ready = index, False
        self.restart_clock()
        try:
            self.pipe.send((task, argument))
        except OSError:
            return

    def end_soon(self) -> None:
        """Ask for the end of the present task."""
        with suppress(OSError):
            self.pipe.send(STOP)

    def restart_clock(self) -> None:
        """Give the present task its full time again."""
        self.deadline = None if self._limits.timeout is None else time.monotonic() + self._limits.timeout

    def receive(self) -> tuple[str, Any] | None:
        """Return the next message, or None if the process is dead or talks nonsense."""
        try:
            kind, content = self.pipe.recv()
        except (EOFError, OSError, pickle.UnpicklingError, ValueError, TypeError, AttributeError, ImportError):
            return None
        return kind, content

    def reap(self) -> int | None:
        """Wait for a process that is dying; return its exit code."""
        self._process.join(_DYING)
        return self.kill()

    def kill(self) -> int | None:
        """End the process by force if it still runs; return its exit code. At most once."""
        _alive.discard(self)
        self._process.kill()
        self._process.join()
        code = self._process.exitcode
        self.pipe.close()
        self._process.close()
        shutil.rmtree(self._scratch, ignore_errors=True)
        return code


@contextmanager
def _without_main() -> Iterator[None]:
    """Hide the program's main module while a process is spawned.

    Spawning imports it again in the child: a user's script without `if __name__ == "__main__"` would
    measure again there, and the command line would load what a worker does not need. The worker's function is
    found by the name of its module.
    """
    with _spawning:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Hold back signals that ask to end while a process is spawned: the child never hears them, the parent afterwards.

    The terminal sends Ctrl-C to all its processes; one that is still importing would end with a traceback.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        # Started by the first process otherwise, in the middle of which it lets Ctrl-C through again.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# At its end multiprocessing asks processes to terminate, which a worker leaves to its parent, and waits for them. What
# is registered later is done earlier.
_alive: weakref.WeakSet[WorkerProcess] = weakref.WeakSet()


@atexit.register
def _end_all() -> None:
    for worker in list(_alive):
        worker.kill()
