"""A pool of worker processes that survives FMUs that crash, hang or exhaust the memory.

`concurrent.futures.ProcessPoolExecutor` is given up as broken when one of its processes dies, and has no
time limit for a task that runs; both are what third-party FMUs ask for.
"""

from __future__ import annotations

import selectors
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from workbench.core.records.record import fits
from workbench.errors import (
    CrashedError,
    ExitedError,
    InputError,
    LostError,
    OutOfMemoryError,
    TimedOutError,
    WorkbenchError,
)
from workbench.jobs.confine import why_not
from workbench.jobs.options import Limits
from workbench.jobs.runner import Lost, Reply, Runner, perform, yielded
from workbench.jobs.twice import ENOUGH, Sample
from workbench.jobs.worker_main import BEGUN, BUG, DONE, ERROR, FOREIGN, ITEM, MEMORY, OPENED, READY, TOLD, Task
from workbench.jobs.worker_process import AFTERWARDS, WorkerProcess, keep, kept
from workbench.model.base import Recipe

__all__ = ["Pool", "died"]

# Between two checks for a request to stop, and for a worker that died with its channel open [s].
_PATIENCE = 0.1

# What was asked to end soon is ended by force after so long [s].
_GRACE = 1.2

# Of the last line that an FMU printed, so many characters are part of the message.
_SHOWN = 200

# What is told where an FMU has changed that.
_ARITHMETIC = (
    "the FMU changed the arithmetic of its process (how numbers are rounded, or whether tiny ones count), in which the"
    " workbench computes, too: the result may not be what another arithmetic gives"
)

_UNREADABLE = "its worker's answer cannot be read"

_ERRORS: Mapping[str, Callable[[Any], Exception]] = {
    ERROR: lambda error: error if isinstance(error, WorkbenchError) else LostError(_UNREADABLE),
    FOREIGN: lambda why: InputError(f"the worker process does not know what the program itself defines: {why}"),
    BUG: lambda trace: RuntimeError(f"in a worker process:\n{trace}"),
}


class Pool(Runner):
    """Worker processes, kept for the next pool where nothing went wrong in them.

    Args:
        recipe: of the model, which each worker opens; None: the tasks have no model.
        jobs: most processes at a time.
        limits: time for each item, memory for each process, and whether these are confined.
        fresh: begin with processes that have done nothing yet.

    Raises:
        InputError: this system cannot confine a process.
    """

    def __init__(self, recipe: Recipe | None, *, jobs: int, limits: Limits, fresh: bool = False) -> None:
        if limits.confine and (why := why_not()):
            raise InputError(f"confine: not possible here: {why}")
        self._recipe, self._jobs, self._limits, self._fresh = recipe, jobs, limits, fresh
        self._workers: list[WorkerProcess] = []
        self._task: Task = perform  # that was run last
        self._in_work: dict[int, Any] = {}
        self._again: deque[Any] = deque()  # jobs that were not begun, for a worker that was broken before
        self._begun = self._before = 0  # jobs; before this run
        self._ending = False  # by `end_soon`
        self._patient_until: float | None = None  # after it
        self.afterwards: list[str] = []
        self._sample: Sample | None = None  # a job that is done once more, by the next
        self._twin: WorkerProcess | None = None

    @property
    def _source(self) -> str:
        """What the user named as the model."""
        return "the FMU" if self._recipe is None else self._recipe.source

    def run(self, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        self._before, self._task = self._begun, task
        try:
            while jobs or self._again or self._second() or any(w.index is not None for w in self._workers):
                self._dispatch(task, jobs)
                self._raise_if_stopped()
                for worker in self._speaking():
                    # What a worker yields is taken, and the caller has it on disk, before the worker gets more.
                    yield from self._told(self._hear(worker), worker)
                yield from self._told(self._late())
            if self._sample is not None and self.numbers is not None:
                self.afterwards += filter(None, [self._sample.remark(self.numbers)])
                self._sample = None
        finally:
            if self._in_work:
                self.close()  # in the middle of it

    def end_soon(self) -> None:
        # It is noted, no more: a signal handler is here, in the middle of whatever `run` does, as of sending.
        if self._ending or not self._in_work:
            self.stop()
        self._ending = True

    def close(self) -> None:
        while self._workers:
            worker = self._workers.pop()
            if worker.index is None and not self._limits.apart:
                keep(worker)
            else:
                worker.kill()
        self._in_work = {}

    def _tell_end(self) -> None:
        if self._ending and self._patient_until is None:
            self._patient_until = time.monotonic() + _GRACE
            for worker in self._workers:
                worker.end_soon()

    def _raise_if_stopped(self) -> None:
        self._tell_end()
        if self.stopped or (self._patient_until is not None and time.monotonic() > self._patient_until):
            raise KeyboardInterrupt

    def _dispatch(self, task: Task, jobs: deque[Any]) -> None:
        for worker in self._workers[:]:
            if worker.ready and not worker.usable:  # it ended while idle: no task is lost
                self._workers.remove(worker)
                self._note(worker)
                worker.kill()
        wanted = min(self._jobs, len(jobs) + len(self._again) + len(self._in_work))
        while len(self._workers) < wanted:
            new = self._limits.apart or self._fresh
            own = WorkerProcess(confine=self._limits.confine) if new else kept(self._recipe)
            self._workers.append(own)
        for worker in self._workers:
            if worker.ready and (queue := self._again or jobs):
                self._begun += 1
                self._in_work[self._begun] = job = queue.popleft()
                worker.begin(self._begun, self._recipe, task, job, self._limits)
                if self._sample is None and self.numbers is not None:
                    self._sample = Sample(job, worker.pid)
        if not (jobs or self._again) and (other := self._second()) is not None and self._sample is not None:
            self._begun += 1
            self._in_work[self._begun], self._sample.again, self._twin = self._sample.job, [], other
            other.begin(self._begun, self._recipe, task, self._sample.job, self._limits)

    def _second(self) -> WorkerProcess | None:
        """Return the worker that is to do the sample once more; None: none is free, or it is not worth it."""
        sample = self._sample
        if sample is None or sample.again is not None or self._begun - self._before < ENOUGH or self._ending:
            return None
        if not sample.items or any(job is sample.job for job in self._in_work.values()):
            return None
        return next((w for w in self._workers if w.ready and w.usable and w.pid != sample.pid), None)

    def _told(self, events: Iterator[Reply | Lost], worker: WorkerProcess | None = None) -> Iterator[Reply | Lost]:
        """Yield the events of all jobs except the repeated sample."""
        try:
            yield from events if self._sample is None else self._sample.passed_on(events)
        except WorkbenchError as error:
            if worker is None or worker is not self._twin or self._sample is None:
                raise
            self._sample.failed(error)

    def _speaking(self) -> list[WorkerProcess]:
        """Wait a little; return the workers that sent something or died."""
        with selectors.DefaultSelector() as waiting:
            for worker in self._workers:
                if worker.channel.ended:
                    continue
                both = selectors.EVENT_READ | (selectors.EVENT_WRITE if worker.channel.leaving else 0)
                waiting.register(worker.channel, both, worker)
            soonest = min((worker.left for worker in self._workers), default=_PATIENCE)
            ready = [(key.data, event) for key, event in waiting.select(min(_PATIENCE, soonest))]
        for worker, event in ready:
            if event & selectors.EVENT_WRITE:
                worker.channel.flush()
        speaking = {id(worker) for worker, event in ready if event & selectors.EVENT_READ}
        return [w for w in self._workers if id(w) in speaking or not w.alive]

    def _hear(self, worker: WorkerProcess) -> Iterator[Reply | Lost]:
        """Take what a worker sent."""
        dead = not worker.alive  # before the last of its messages is read
        messages = worker.channel.receive()
        while True:
            try:
                message = next(messages, None)
                kind, content = message or ("", None)
                if not isinstance(kind, str):
                    raise TypeError("it does not say what it is")
            except Exception as error:  # noqa: BLE001 - whatever can be wrong with an object that cannot be made here
                yield from self._end(worker, LostError(f"{_UNREADABLE}: {error}"))
                return
            if message is None or worker not in self._workers:  # it may have been ended meanwhile
                break
            yield from self._take(worker, kind, content)
            self._tell_end()
        if worker in self._workers and (worker.channel.ended or (dead and worker.channel.dry)):
            self._workers.remove(worker)
            last = self._note(worker)
            code = worker.reap()
            if worker.ready:  # all was told: it ended to begin anew, or while it had nothing to do
                return
            hungry = code is not None and code > 0 and any(words in last for words in _HUNGRY)
            if worker.seasoned and not worker.opened and worker.index in self._in_work:
                self._again.append(
                    self._in_work.pop(worker.index)
                )  # what it did before ended it: that is another's crash
                return
            why = out_of_memory(self._limits) if hungry else died(code, self._limits, source=self._source)
            yield from self._lose(worker, why, last)

    def _take(self, worker: WorkerProcess, kind: str, content: Any) -> Iterator[Reply | Lost]:  # noqa: ANN401
        """Take one message of a worker."""
        job = self._in_work.get(worker.index or 0)
        # A message between was lost, or this one is not its own: a confined FMU can say all that the worker can.
        between = (worker.index in self._in_work) == (kind == READY)
        checked = not between and kind in (ITEM, TOLD) and self._limits.confine
        if between or (checked and not fits(yielded(self._task, job), content)):
            yield from self._end(worker, LostError(f"{_UNREADABLE}: part of it is missing, or was not asked for"))
        elif kind == READY:
            self._free(worker, bound=content is True)
        elif kind == BEGUN:
            worker.restart_clock()
        elif kind == OPENED:
            worker.opened, worker.most = True, content if isinstance(content, float) else None
            worker.restart_clock()
        elif kind == ITEM:
            worker.restart_clock()
            yield Reply(job, content)
            worker.restart_clock()
        elif kind == TOLD:
            yield Reply(job, content)
        elif kind == MEMORY:
            # What the failed allocation left behind is unknown: a new process is safer.
            yield from self._end(worker, out_of_memory(self._limits))
        elif kind in (DONE, ERROR, FOREIGN, BUG):
            # Raised when its FMU has ended, too.
            worker.error = _ERRORS[kind](content) if kind in _ERRORS else None
            if kind == DONE and content is True:
                self.afterwards.append(_ARITHMETIC)
            self._in_work.pop(worker.index or 0, None)
            worker.take_leave()
        else:
            yield from self._end(worker, LostError(_UNREADABLE))

    def _late(self) -> Iterator[Lost]:
        """End workers whose time is up, or that are stuck without memory."""
        for worker in list(self._workers):
            if worker.index in self._in_work and worker.is_beyond_memory():
                yield from self._end(worker, out_of_memory(self._limits))
            elif worker.is_late():
                busy = worker.index is None or worker.index in self._in_work
                yield from self._end(worker, (timed_out if busy else lingered)(self._limits))

    def _end(self, worker: WorkerProcess, why: LostError) -> Iterator[Lost]:
        self._workers.remove(worker)
        last = self._note(worker)
        worker.kill()
        yield from self._lose(worker, why, last)

    def _free(self, worker: WorkerProcess, *, bound: bool) -> None:
        """Let a worker take the next task, of this model only if it is bound to it; raise the error of the last one."""
        self._note(worker)
        if bound:
            worker.bound = "" if self._recipe is None else self._recipe.content()
        worker.index, worker.deadline, worker.ready = None, None, True
        self._raise_error(worker)

    def _raise_error(self, worker: WorkerProcess) -> None:
        error, worker.error = worker.error, None
        if error is not None:
            raise error

    def _note(self, worker: WorkerProcess) -> str:
        """Take down what a worker printed, and return it."""
        said = worker.said()
        self.printed += said
        self.stray += worker.channel.stray
        worker.channel.stray = 0
        return said

    def _lose(self, worker: WorkerProcess, why: LostError, printed: str) -> Iterator[Lost]:
        if lines := printed.strip().splitlines():
            why = type(why)(f"{why}; the last that it printed: {lines[-1].strip()[:_SHOWN]}")
        if worker.index is None:
            raise WorkbenchError(f"a worker process ended before it began: {why}")
        self._raise_error(worker)
        if worker.index in self._in_work:
            yield Lost(self._in_work.pop(worker.index), why)
        else:
            self.afterwards.append(f"when all was told, {why}")


# -- why a worker is gone ----------------------------------------------------------------------

_SIGNALS = {
    "SIGSEGV": "the FMU crashed: segmentation fault (SIGSEGV)",
    "SIGBUS": (
        "the FMU crashed: bus error (SIGBUS), as when part of a file that is mapped is missing: is {source} whole, was "
        "it left unchanged while it ran, and has the disk of the temporary folder room?"
    ),
    "SIGILL": "the FMU crashed: illegal instruction (SIGILL)",
    "SIGFPE": "the FMU crashed: arithmetic exception (SIGFPE)",
    "SIGABRT": "the FMU aborted its process (SIGABRT)",
    "SIGKILL": "the worker was killed (SIGKILL), perhaps by the system because memory ran out",
}

# With these words numpy's and scipy's linear algebra, or Python itself, end a process that gets no memory.
_HUNGRY = ("OpenBLAS error: Memory allocation", "MemoryError")

# Exit codes by which Windows tells of a crash.
_WINDOWS = {
    0xC0000005: "the FMU crashed: access violation",
    0xC0000094: "the FMU crashed: integer division by zero",
    0xC00000FD: "the FMU crashed: stack overflow",
    0xC0000374: "the FMU crashed: heap corruption",
    0xC0000409: "the FMU aborted its process (fail fast)",
}


def died(code: int | None, limits: Limits, *, source: str = "the FMU", platform: str = sys.platform) -> LostError:
    """Return why a worker ended by itself.

    Args:
        code: its exit code, −n for signal n; None: it went on, or had to be ended, without a connection.
        limits: what it was allowed.
        source: what the user named as the model.
        platform: as in `sys.platform`.
    """
    if code is None:
        return LostError("the FMU closed the connection to its process, which went on")
    if platform == "win32" and code & 0xFFFFFFFF in _WINDOWS:
        text = _WINDOWS[code & 0xFFFFFFFF]
    elif code < 0:
        name = _signal(-code)
        text = _SIGNALS.get(name, f"the FMU's process was ended by a signal ({name})").format(source=source)
    else:
        return ExitedError(f"the FMU ended its process (exit code {code})")
    # An allocation that was refused seldom ends otherwise, but nobody can tell afterwards.
    hint = "" if limits.memory is None else f", perhaps by the memory limit of {limits.memory:g} MB"
    return CrashedError(text + hint)


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def lingered(limits: Limits) -> LostError:
    """Return the reason for an FMU that does not end."""
    given = AFTERWARDS if limits.timeout is None else min(AFTERWARDS, limits.timeout)
    return TimedOutError(f"time limit: the FMU had not ended its run and been freed after {given:g} s")


def timed_out(limits: Limits) -> LostError:
    """Return the reason for a point that took too long."""
    return TimedOutError(f"time limit: not finished after {limits.timeout:g} s; `timeout` sets it")


def out_of_memory(limits: Limits) -> LostError:
    """Return the reason for a point that ran out of memory without crashing."""
    if limits.memory is None:
        return OutOfMemoryError("out of memory")
    return OutOfMemoryError(f"memory limit: more than {limits.memory:g} MB needed; `memory_limit` sets it")
