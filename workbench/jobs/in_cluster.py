"""What runs in a worker of a Dask cluster: batches of tasks, each in a worker process of the workbench as elsewhere."""

from __future__ import annotations

import hashlib
import io
import pickle
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from workbench.errors import InputError, LostError
from workbench.fmi.ended import end_now
from workbench.jobs.options import Limits
from workbench.jobs.pool import Pool
from workbench.jobs.runner import Lost
from workbench.jobs.version import stamp
from workbench.jobs.worker_main import Task
from workbench.model.base import Model, Recipe

__all__ = ["Batch", "BatchReply", "do_batch", "proof", "take_apart", "the_same"]

_APART = 1 << 15  # bytes that are longer travel by themselves
_LOOK = 1.0  # [s] between two looks whether somebody still waits for the result
_ASK = 5.0  # [s] between two questions to the scheduler whether somebody does


@dataclass(frozen=True)
class Batch:
    """Work for one task of the scheduler.

    Attributes:
        recipe: of the model, as `take_apart` gave it.
        archives: SHA-256 of what was taken apart from it.
        task: is done for each of the jobs.
        jobs: arguments.
        limits: of each.
    """

    recipe: bytes
    archives: tuple[str, ...]
    task: Task
    jobs: tuple[Any, ...]
    limits: Limits


@dataclass(frozen=True)
class BatchReply:
    """What came of a batch.

    Attributes:
        found: for each job the items that it yielded, each pickled; empty: none was begun.
        lost: number of the job → how its process was lost.
        error: that ended the batch; None: all of it was done.
        seconds: that it took.
        printed: by the FMU.
        stray: bytes that it wrote into what is not its own.
        afterwards: what went wrong when all was told.
    """

    found: tuple[tuple[bytes, ...], ...] = ()
    lost: Mapping[int, LostError] = field(default_factory=dict)
    error: Exception | None = None
    seconds: float = 0.0
    printed: str = ""
    stray: int = 0
    afterwards: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Some:
    """Jobs that a worker process does without being asked for each: number → job."""

    task: Task
    jobs: Mapping[int, Any]


@dataclass(frozen=True)
class _PickledItem:
    """What a job yielded, pickled: this worker only passes it on."""

    number: int
    value: bytes


@dataclass(frozen=True)
class _Over:
    """A job has yielded all; when it is `ended`, its FMU has, too."""

    number: int
    ended: bool


def _perform(model: Model | None, some: _Some) -> Iterator[_PickledItem | _Over]:
    for number, job in some.jobs.items():
        for value in some.task(model, job):
            yield _PickledItem(number, pickle.dumps(value, pickle.HIGHEST_PROTOCOL))
        yield _Over(number, ended=False)
        end_now()  # if the FMU crashes now, that costs nothing
        yield _Over(number, ended=True)


def proof() -> tuple[str, ...]:
    """Return the state of the workbench in this worker."""
    return tuple(stamp())


def the_same(archive: bytes) -> bytes:
    """Return what was sent: as a task, so that the scheduler sends it again when its holders are lost."""
    return archive


def do_batch(wanted: tuple[str, ...], packed: bytes, *archives: bytes) -> tuple[tuple[str, ...], bytes]:
    """Do a batch if this worker's workbench is in the right state.

    Args:
        wanted: state of the workbench of whoever sends it.
        packed: the batch, pickled; nothing of it is touched if the states differ.
        archives: what was taken apart from its recipe.

    Returns:
        State of the workbench in this worker, and the `BatchReply`, pickled; nothing if the states differ.
    """
    own = proof()
    if own != wanted:
        return own, b""
    begin = time.perf_counter()
    try:
        batch: Batch = pickle.loads(packed)  # noqa: S301 - of the same workbench
    except (AttributeError, ImportError) as unknown:
        return own, _packed(
            BatchReply(error=InputError(f"the cluster does not know what the program itself defines: {unknown}"))
        )
    recipe = _put_together(batch.recipe, dict(zip(batch.archives, archives, strict=True)))
    pool = _pool(recipe, batch.limits)
    pool.stopped, pool.printed, pool.stray, pool.afterwards = False, "", 0, []
    result: list[list[bytes]] = [[] for _ in batch.jobs]
    lost: dict[int, LostError] = {}
    error: Exception | None = None
    left = dict(enumerate(batch.jobs))
    try:
        while left:
            _do_some(pool, batch, left, result, lost)
    except Exception as raised:  # noqa: BLE001 - it is raised where the batch came from
        error = raised
    except KeyboardInterrupt:
        error = InputError("nobody waits for the result")
    seconds = time.perf_counter() - begin
    done = BatchReply(
        found=tuple(map(tuple, result)), lost=lost, error=error, seconds=seconds, printed=pool.printed,
        stray=pool.stray, afterwards=tuple(pool.afterwards),
    )  # fmt: skip
    return own, _packed(done)


def _do_some(
    pool: Pool, batch: Batch, left: dict[int, Any], result: list[list[bytes]], lost: dict[int, LostError]
) -> None:
    """Do jobs until all are done or one is lost; they leave `left`.

    Raises:
        WorkbenchError: raised by a job.
    """
    # Memory is counted from the beginning of a task.
    some = dict(left) if batch.limits.memory is None else dict([next(iter(left.items()))])
    current: int | None = None
    for event in pool.run(_perform, deque([_Some(batch.task, some)])):
        if isinstance(event, Lost):
            number = next(iter(left)) if current is None else current
            if current is None:
                lost[number] = event.error
            left.pop(number)
        elif isinstance(event.value, _PickledItem):
            result[event.value.number].append(event.value.value)
        elif event.value.ended:
            left.pop(event.value.number)
            current = None
        else:
            current = event.value.number


def _packed(done: BatchReply) -> bytes:
    return pickle.dumps(done, pickle.HIGHEST_PROTOCOL)


# -- the worker process ------------------------------------------------------------------------

_thread = threading.local()


class _Awaited(Pool):
    """One worker process, which ends when nobody waits for what it does."""

    def __init__(self, recipe: Recipe | None, limits: Limits) -> None:
        super().__init__(recipe, jobs=1, limits=limits)
        self._looked = self._asked = time.monotonic()

    def _raise_if_stopped(self) -> None:
        now = time.monotonic()
        if now > self._looked + _LOOK:
            self._looked = now
            self.stopped = _released() or (now > self._asked + _ASK and self._unknown())
        super()._raise_if_stopped()

    def _unknown(self) -> bool:
        """Return whether the scheduler has forgotten the task: a task that moved meanwhile does not hear of its end."""
        self._asked = time.monotonic()
        worker = import_module("distributed.worker")
        ask = import_module("distributed.utils").sync
        with suppress(Exception):  # not in a worker, or the scheduler does not answer, which is not for a job to judge
            own, key = worker.get_worker(), worker.thread_state.key
            known = ask(own.loop, own.scheduler.get_task_status, keys=[key], callback_timeout=_ASK)
            return known[key] is None
        return False


def _pool(recipe: Recipe | None, limits: Limits) -> Pool:
    """Return the worker process of this thread, the one of its last batch where that was of the same model."""
    key = pickle.dumps((recipe, limits))
    kept: tuple[bytes, Pool] | None = getattr(_thread, "kept", None)
    if kept is not None and kept[0] == key:
        return kept[1]
    if kept is not None:
        kept[1].close()
    pool = _Awaited(recipe, limits)
    _thread.kept = key, pool
    return pool


def _released() -> bool:
    """Return whether the scheduler does not want the task of this thread any more."""
    worker = import_module("distributed.worker")
    try:
        state = worker.get_worker().state.tasks.get(worker.thread_state.key)
    except (AttributeError, ValueError):  # not in a worker, or one that keeps its books otherwise
        return False
    return state is None or state.state in ("cancelled", "released", "forgotten")


# -- recipes without the FMUs in them ----------------------------------------------------------


class _PickledApart(pickle.Pickler):
    """Pickles everything but long bytes, which it keeps by their hash."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.archives: dict[str, bytes] = {}

    def persistent_id(self, obj: Any) -> str | None:  # noqa: ANN401 - anything that is pickled
        if not isinstance(obj, bytes) or len(obj) < _APART:
            return None
        key = hashlib.sha256(obj).hexdigest()
        self.archives[key] = obj
        return key


class _Together(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, archives: Mapping[str, bytes]) -> None:
        super().__init__(file)
        self._archives = archives

    def persistent_load(self, pid: Any) -> bytes:  # noqa: ANN401 - as `pickle` has it
        return self._archives[pid]


def take_apart(recipe: Recipe | None) -> tuple[bytes, Mapping[str, bytes]]:
    """Return a recipe pickled without its FMUs, and these, SHA-256 → archive.

    Args:
        recipe: of the model; None: there is none.
    """
    file = io.BytesIO()
    packer = _PickledApart(file)
    packer.dump(None if recipe is None else recipe.packed())
    return file.getvalue(), packer.archives


def _put_together(packed: bytes, archives: Mapping[str, bytes]) -> Recipe | None:
    recipe: Recipe | None = _Together(io.BytesIO(packed), archives).load()
    return None if recipe is None else recipe.settled()
