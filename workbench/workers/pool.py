"""A pool of worker processes that outlives crashes, hangs and hunger for memory.

`concurrent.futures.ProcessPoolExecutor` is given up as broken when one of its processes dies, and has no
time limit for a task that runs; both are what third-party FMUs ask for.
"""

from __future__ import annotations

import signal
import sys
import time
from collections import deque
from collections.abc import Iterator
from multiprocessing.connection import wait
from typing import Any

from workbench.core.where import Limits
from workbench.errors import WorkbenchError
from workbench.model.recipe import Recipe
from workbench.workers.child import BUG, DONE, ERROR, ITEM, MEMORY, READY, TOLD, Task
from workbench.workers.process import WorkerProcess
from workbench.workers.runner import Lost, Reply, Runner

__all__ = ["Pool", "died", "out_of_memory", "timed_out"]

# So often is looked whether somebody wants to stop [s].
_PATIENCE = 0.1

# After this time what was asked to end is ended by force [s].
_GRACE = 5.0


class Pool(Runner):
    """Worker processes on one model.

    Args:
        recipe: of the model; each worker opens it once.
        jobs: most processes at a time.
        limits: time for each item, memory for each process.
    """

    def __init__(self, recipe: Recipe, *, jobs: int, limits: Limits) -> None:
        self._recipe, self._jobs, self._limits = recipe, jobs, limits
        self._workers: list[WorkerProcess] = []
        self._in_work: dict[int, Any] = {}
        self._begun = 0
        self._patient_until: float | None = None  # after `end_soon`

    @property
    def pids(self) -> list[int]:
        """Process numbers of the workers."""
        return [w.pid for w in self._workers if w.pid is not None]

    def run(self, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        try:
            while jobs or self._in_work:
                self._dispatch(task, jobs)
                self._raise_if_stopped()
                for worker in self._speaking():
                    # What a worker yields is taken, and the caller has it on disk, before the worker gets more.
                    yield from self._hear(worker)
                yield from self._late()
        finally:
            if self._in_work:
                self.close()

    def end_soon(self) -> None:
        if self._in_work and self._patient_until is None:
            self._patient_until = time.monotonic() + _GRACE
            for worker in self._workers:
                worker.end_soon()
        else:
            self.stop()

    def close(self) -> None:
        while self._workers:
            self._workers.pop().kill()
        self._in_work = {}

    def _raise_if_stopped(self) -> None:
        if self.stopped or (self._patient_until is not None and time.monotonic() > self._patient_until):
            raise KeyboardInterrupt

    def _dispatch(self, task: Task, jobs: deque[Any]) -> None:
        wanted = min(self._jobs, len(jobs) + len(self._in_work))
        while len(self._workers) < wanted:
            self._workers.append(WorkerProcess(self._recipe, self._limits))
        for worker in self._workers:
            if worker.ready and jobs:
                self._begun += 1
                self._in_work[self._begun] = job = jobs.popleft()
                worker.begin(self._begun, task, job)

    def _speaking(self) -> list[WorkerProcess]:
        """Wait a little; return the workers that sent something or died."""
        handles = {handle: w for w in self._workers for handle in (w.pipe, w.sentinel)}
        ready = {id(handles[handle]) for handle in wait(list(handles), _PATIENCE)}  # type: ignore[index]
        return [w for w in self._workers if id(w) in ready]

    def _hear(self, worker: WorkerProcess) -> Iterator[Reply | Lost]:
        """Take one message of a worker."""
        message = worker.receive()
        if message is None:
            yield from self._lose(worker, died(self._bury(worker), self._limits))
            return
        kind, content = message
        if kind == READY:
            worker.ready = True
        elif kind == ITEM:
            worker.restart_clock()
            yield Reply(self._in_work[worker.index or 0], content)
            worker.restart_clock()
        elif kind == TOLD:
            yield Reply(self._in_work[worker.index or 0], content)
        elif kind == DONE:
            self._free(worker)
        elif kind == MEMORY:
            # What the failed allocation left behind is unknown: a new process is safer.
            worker.kill()
            self._workers.remove(worker)
            yield from self._lose(worker, out_of_memory(self._limits))
        elif kind == ERROR:
            raise content
        elif kind == BUG:
            raise RuntimeError(f"in a worker process:\n{content}")

    def _late(self) -> Iterator[Lost]:
        """End workers whose time is up."""
        now = time.monotonic()
        for worker in list(self._workers):
            if worker.deadline is not None and now > worker.deadline and not worker.pipe.poll():
                worker.kill()
                self._workers.remove(worker)
                yield from self._lose(worker, timed_out(self._limits), late=True)

    def _bury(self, worker: WorkerProcess) -> int | None:
        self._workers.remove(worker)
        return worker.reap()

    def _free(self, worker: WorkerProcess) -> None:
        self._in_work.pop(worker.index or 0)
        worker.index, worker.deadline, worker.ready = None, None, True

    def _lose(self, worker: WorkerProcess, reason: str, *, late: bool = False) -> Iterator[Lost]:
        if worker.index is None:
            raise WorkbenchError(f"a worker process ended before it began: {reason}")
        yield Lost(self._in_work.pop(worker.index), reason, late)


# -- why a worker ended ------------------------------------------------------------------------

_SIGNALS = {
    "SIGSEGV": "the FMU crashed: segmentation fault (SIGSEGV)",
    "SIGBUS": "the FMU crashed: bus error (SIGBUS)",
    "SIGILL": "the FMU crashed: illegal instruction (SIGILL)",
    "SIGFPE": "the FMU crashed: arithmetic exception (SIGFPE)",
    "SIGABRT": "the FMU aborted its process (SIGABRT)",
    "SIGKILL": "the worker was killed (SIGKILL), perhaps by the system because memory ran out",
}

# Exit codes by which Windows tells of a crash.
_WINDOWS = {
    0xC0000005: "the FMU crashed: access violation",
    0xC0000094: "the FMU crashed: integer division by zero",
    0xC00000FD: "the FMU crashed: stack overflow",
    0xC0000374: "the FMU crashed: heap corruption",
    0xC0000409: "the FMU aborted its process (fail fast)",
}


def died(code: int | None, limits: Limits, *, platform: str = sys.platform) -> str:
    """Return why a worker ended by itself.

    Args:
        code: its exit code, −n for signal n.
        limits: what it was allowed.
        platform: as in `sys.platform`.
    """
    if platform == "win32" and (code or 0) & 0xFFFFFFFF in _WINDOWS:
        text = _WINDOWS[(code or 0) & 0xFFFFFFFF]
    elif code is not None and code < 0:
        name = _signal(-code)
        text = _SIGNALS.get(name, f"the FMU's process was ended by a signal ({name})")
    else:
        return f"the FMU ended its process (exit code {code})"
    # An allocation that was refused seldom ends otherwise, but nobody can tell afterwards.
    hint = "" if limits.memory is None else f", perhaps by the memory limit of {limits.memory:g} MB"
    return text + hint


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def timed_out(limits: Limits) -> str:
    """Return the reason for a point that took too long."""
    return f"time limit: not finished after {limits.timeout:g} s; --timeout sets it"


def out_of_memory(limits: Limits) -> str:
    """Return the reason for a point that ran out of memory without crashing."""
    if limits.memory is None:
        return "out of memory"
    return f"memory limit: more than {limits.memory:g} MB needed; --memory-limit sets it"
