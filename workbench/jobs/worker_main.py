"""What runs in a worker process: open models as they are needed, and do tasks until the parent hangs up."""

from __future__ import annotations

import ctypes
import errno
import math
import os
import pickle
import select
import shutil
import signal
import socket
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

from workbench.core.machine.arithmetic import Arithmetic
from workbench.core.machine.scratch import remove_if_dead
from workbench.errors import FmuError, LostError, WorkbenchError
from workbench.fmi.ended import end_later, end_now
from workbench.jobs.answers import in_records
from workbench.jobs.channel import HUNG_UP, MARK_BYTES, Channel, pickled
from workbench.jobs.confine import confined
from workbench.jobs.end_signals import ENDING
from workbench.jobs.limits import MemoryWatch, Room
from workbench.jobs.options import DEFAULT_TIMEOUT, Limits
from workbench.jobs.process_state import arithmetic, libc, only_handlers, state
from workbench.jobs.process_state import limits as allowances
from workbench.kernel.library import kernel, why_kernel_missing

if TYPE_CHECKING:
    from workbench.model.base import Model, Recipe

__all__ = [
    "BEGUN",
    "BUG",
    "DONE",
    "ERROR",
    "FOREIGN",
    "ITEM",
    "MEMORY",
    "OPENED",
    "READY",
    "STOP",
    "TOLD",
    "Task",
    "inside",
    "main",
    "tell",
    "wanted_stop",
]

# Kinds of messages to the parent, each followed by its content; that of READY: whether it is for this model only from
# now on.
READY, BEGUN, OPENED, ITEM, TOLD, DONE = "ready", "begun", "opened", "item", "told", "done"
ERROR, MEMORY, FOREIGN, BUG = "error", "memory", "foreign", "bug"

# From the parent, in place of an order: end the task in work soon, with what there is.
STOP = None

Task = Callable[[Any, Any], Iterator[Any]]

# Longest time that a worker without a parent may take to clean up [s].
_FAREWELL = 5.0

# A process may still hold its lock for this time after its pipe has ended [s].
_PARTING = 0.5

# The recipe of a task that has no model.
_NO_MODEL = pickle.dumps(None, pickle.HIGHEST_PROTOCOL)

# Interval at which the worker looks whether its parent is still the same process [s].
_PATIENCE = 1.0

# So many models stay open from one task to the next.
_MODELS = 4

# So many instances wait for the end of the task to be terminated and freed; more where there is room.
_ENDED = 16

_STANDARD_INPUT = 0

# No file that it writes is longer [byte].
_FILE = 4 << 30
_LINE_BUFFERED = 1  # _IOLBF where it is not 0 and not 2


class _WorkerState:
    """The state of this process.

    Attributes:
        channel: to the parent; None: this is not a worker process.
        limits: of the task in work.
        opened: recipe, pickled → the model that stays open.
        state: of the process, as it was when the task began, see `jobs.process_state`.
        process: number of this process; a copy of it that an FMU has made by fork has another.
    """

    channel: Channel | None = None
    limits = Limits(timeout=None)
    opened: ClassVar[OrderedDict[bytes, Model]] = OrderedDict()
    state: ClassVar[dict[str, object]] = {}
    process = 0


def tell(item: Any, *, finished: bool) -> None:  # noqa: ANN401 - any task's
    """Send an item of the task in work before it yields one.

    Args:
        item: as `Runner.run` gives it.
        finished: whether it is a result, after which the time limit begins again.
    """
    if _WorkerState.channel is not None:
        _WorkerState.channel.send((ITEM if finished else TOLD, item))


def inside(limits: Limits) -> bool:
    """Return whether this is a worker process under limits as strict as these, or one that can begin no other.

    Args:
        limits: that are wanted; the time limit that everything has by default was not asked for.
    """
    if confined():
        return True
    if _WorkerState.channel is None or limits.confine:
        return False
    own = _WorkerState.limits
    longest = math.inf if limits.timeout in {None, DEFAULT_TIMEOUT} else limits.timeout
    return all(
        wanted in {None, math.inf} or (given is not None and given <= wanted)
        for wanted, given in ((limits.memory, own.memory), (longest, own.timeout))
    )


def wanted_stop() -> bool:
    """Return whether the parent asked for the end of the task in work; it sends nothing else meanwhile."""
    channel = _WorkerState.channel
    _end_copy()
    return channel is not None and STOP in list(channel.receive())


def main(link: int | None, parent: int, scratch: str, modules: Sequence[str]) -> None:
    """Serve one parent; ends the process.

    Args:
        link: descriptor of the socket that brings the mark of the channel's frames, then orders, and takes messages
            (kind, content); None: standard input tells (Windows).
        parent: its process number.
        scratch: folder for all temporary files, which the parent removes.
        modules: that the first task will need, as far as they are known.
    """
    end = socket.socket(fileno=link) if link is not None else socket.fromshare(sys.stdin.buffer.read())  # type: ignore[attr-defined]
    end.set_inheritable(False)
    _behave()
    _end_at_once()
    end_later(_ENDED, Room())
    lifeline = _lifeline()
    tempfile.tempdir = os.environ["TMPDIR"] = scratch
    watcher = threading.Thread(target=_watch_parent, args=(lifeline, parent, scratch), daemon=True)
    watcher.start()
    if not why_kernel_missing():  # also while code that hangs keeps Python from running
        arguments = (lifeline, parent, int(1000 * _FAREWELL))
        threading.Thread(target=kernel().kernel_end_with, args=arguments, daemon=True).start()
    _WorkerState.process = os.getpid()
    mark = end.recv(MARK_BYTES, socket.MSG_WAITALL)
    channel = _WorkerState.channel = Channel(end, mark, dumps=_packed)
    for module in modules:
        import_module(module)
    _WorkerState.state, usual = state(), Arithmetic()
    try:
        channel.send((READY, False))
        for order in _orders(channel):
            channel.send(_done(channel, *order))
            _make_room()  # before it is seen what has changed: the end of an FMU is no part of another one's task
            end_now()
            _flush()
            usual.put_back()
            before, after = _WorkerState.state, state()
            bound = before != after and only_handlers(before, after) and order[1] != _NO_MODEL
            channel.send((READY, bound))
            if before != after and not bound:
                os._exit(0)  # what the FMU has changed shall not reach the next: the parent starts another process
    except OSError:  # the connection is gone: the parent is, or the FMU has closed it
        _tell_hung_up(scratch)
    except MemoryError:  # while something was told; what the task had is free by now, and this is smaller
        channel.send(_failure(MemoryError()))
        os._exit(0)
    watcher.join(_FAREWELL)  # the parent hung up: if it is dead, the watcher cleans up and ends this process
    os._exit(0)  # without unloading libraries, which may crash then


def _orders(channel: Channel) -> Iterator[Any]:
    """Yield what the parent asks for until it hangs up."""
    while not channel.ended:
        select.select([channel], [], [])
        yield from (order for order in channel.receive() if order is not STOP)  # it was asked to stop what is done


def _done(channel: Channel, folder: str, recipe: bytes, work: bytes, limits: Limits) -> tuple[str, Any]:
    """Do one task, sending its items; return the last message.

    Args:
        channel: to the parent.
        folder: the parent's working directory.
        recipe: of the model, pickled; of None: the task has no model.
        work: task and argument, pickled.
        limits: of the task.
    """
    watch, _WorkerState.limits = MemoryWatch(None), limits
    try:
        os.chdir(folder)
        try:
            task, argument = pickle.loads(work)  # noqa: S301 - of the parent
        except (AttributeError, ImportError) as error:
            return FOREIGN, str(error)
        channel.send((BEGUN, None))  # what was to be imported is: time limits are for the FMU
        _WorkerState.state = state()
        model = _model(recipe)
        watch = MemoryWatch(limits.memory)
        if watch.most is not None:
            _WorkerState.state["RLIMIT_AS"] = allowances()["RLIMIT_AS"]
        end_later(_ENDED, Room(watch.most))
        channel.send((OPENED, watch.most))
        for item in task(model, argument):
            if watch.exceeded():
                return MEMORY, None
            channel.send((ITEM, item))
    except BrokenPipeError:
        raise
    except (Exception, GeneratorExit) as error:  # noqa: BLE001 - the parent raises it
        return (MEMORY, None) if watch.exceeded() else _failure(error)
    finally:
        _flush()
    return DONE, arithmetic() != _WorkerState.state.get("arithmetic")


def _failure(error: BaseException) -> tuple[str, Any]:
    """Return the message that tells what a task has raised; what is not an error of the workbench is a bug of ours."""
    lowered = _lowered()
    if isinstance(error, WorkbenchError) and not (lowered and type(error) is FmuError):
        return ERROR, error
    if lowered:
        return ERROR, LostError(
            f"the FMU lowered the limits of its process ({', '.join(lowered)}), in which the workbench cannot go on: "
            f"{(str(error) or type(error).__name__).splitlines()[0]}"
        )
    if isinstance(error, MemoryError):
        return MEMORY, None
    if isinstance(error, OSError) and error.errno in {errno.EMFILE, errno.ENFILE}:
        return ERROR, LostError("the FMU has used up the files that its process may open: it closes none of them")
    return BUG, traceback.format_exc()


def _lowered() -> list[str]:
    """Return the limits of this process that are not what they were when the task began."""
    return [name for name, allowed in allowances().items() if allowed != _WorkerState.state.get(name)]


def _model(packed: bytes) -> Model | None:
    """Return the open model of a recipe."""
    if packed not in _WorkerState.opened:
        recipe: Recipe | None = pickle.loads(packed)  # noqa: S301 - of the parent
        if recipe is None:
            return None
        _WorkerState.opened[packed] = recipe.open()
        _end_at_once()
    _WorkerState.opened.move_to_end(packed)
    return _WorkerState.opened[packed]


def _make_room() -> None:
    """Close the models that were not used for longest."""
    while len(_WorkerState.opened) > _MODELS:
        _WorkerState.opened.popitem(last=False)[1].close()


# -- the process -------------------------------------------------------------------------------


def _behave() -> None:
    """Leave the signals that ask to end to the parent; no core dumps or dialogs."""
    warnings.simplefilter("ignore")  # what libraries of Python say here would be taken for the FMU's words
    os.environ.setdefault("KMP_DUPLICATE_LIB_OK", "True")  # as threadpoolctl does later: no FMU has changed it
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)  # so that processes which an FMU starts hear them
    if sys.platform == "win32":
        # SEM_FAILCRITICALERRORS | SEM_NOGPFAULTERRORBOX | SEM_NOOPENFILEERRORBOX
        ctypes.windll.kernel32.SetErrorMode(0x0001 | 0x0002 | 0x8000)
        return
    import resource  # noqa: PLC0415 - not on Windows

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)  # whatever prints without end does not fill the disk
    resource.setrlimit(resource.RLIMIT_FSIZE, (_FILE if hard == resource.RLIM_INFINITY else min(_FILE, hard), hard))
    with suppress(ValueError):  # what an FMU prints is not lost with it; the name is that of GNU and musl
        libc().setvbuf(ctypes.c_void_p.in_dll(libc(), "stdout"), None, _LINE_BUFFERED, ctypes.c_size_t(0))


def _packed(item: object) -> list[bytes | memoryview]:
    """Pickle what is sent to the parent."""
    _end_copy()
    return [in_records(item)] if confined() else pickled(item)


def _end_copy() -> None:
    """End this process if it is a copy that the FMU has made by fork: there is one answer, that of the original."""
    if os.getpid() != _WorkerState.process:
        os._exit(0)


def _tell_hung_up(scratch: str) -> None:
    """Leave word for the parent that the connection to it was closed here; an exit code could be the FMU's."""
    with suppress(OSError):
        Path(scratch, HUNG_UP).touch()


def _end_at_once() -> None:
    """Let `exit` of the FMU end the process before what Python and its libraries, still at work, do at an exit."""
    with suppress(AttributeError, OSError, TypeError):  # only GNU's library has it; without, such an end may be a crash
        libc().on_exit(ctypes.cast(libc()._exit, ctypes.c_void_p), None)  # noqa: SLF001 - C's function of that name


def _flush() -> None:
    """Let what an FMU printed be on its way."""
    _end_copy()
    if sys.platform != "win32":
        libc().fflush(None)


def _lifeline() -> int:
    """Return what tells of the end of the parent: a pipe, on Windows its process; the FMU finds an empty input."""
    if sys.platform == "win32":
        import _winapi  # noqa: PLC0415

        return _winapi.OpenProcess(0x00100000, False, os.getppid())
    lifeline = os.dup(_STANDARD_INPUT)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, _STANDARD_INPUT)
    os.close(nothing)
    return lifeline


def _watch_parent(lifeline: int, parent: int, scratch: str) -> None:
    """Clean up and end this process when the parent is gone, also while the FMU's code runs."""
    if not _wait_for_end(lifeline, parent):
        _tell_hung_up(scratch)
        _end_group()
    shutil.rmtree(scratch, ignore_errors=True)
    # All that was the parent's own, where it is gone; else it, or a copy of it made by fork, has let go of this worker.
    until = time.monotonic() + _PARTING
    while not remove_if_dead(Path(scratch).parent) and Path(scratch).parent.is_dir() and time.monotonic() < until:
        time.sleep(_PARTING / 10)
    _end_group()


def _end_group() -> NoReturn:
    """End this process with those that the FMU has started."""
    if os.name == "posix" and os.getpgrp() == os.getpid():
        os.killpg(os.getpid(), signal.SIGKILL)
    os._exit(1)


def _wait_for_end(lifeline: int, parent: int) -> bool:
    """Wait for the end of the parent; False: the FMU has closed what would tell of it."""
    if sys.platform == "win32":
        import _winapi  # noqa: PLC0415

        _winapi.WaitForSingleObject(lifeline, _winapi.INFINITE)
        return True
    # A copy of the parent made by fork keeps the pipe open; the system names another parent then.
    ended = select.poll()
    ended.register(lifeline, 0)  # no event but its end: an FMU of the parent may write what it wants into it
    while os.getppid() == parent:
        for _, event in ended.poll(1000.0 * _PATIENCE):
            return not event & select.POLLNVAL
    return True
