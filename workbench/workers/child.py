"""What runs in a worker process: open the model once, do tasks until the parent hangs up."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any

from workbench.core.where import Limits
from workbench.endings import ENDING
from workbench.errors import WorkbenchError
from workbench.kernel.library import kernel, why_kernel_missing
from workbench.workers.limits import MemoryWatch

if TYPE_CHECKING:
    from workbench.model.base import Model
    from workbench.model.recipe import Recipe

__all__ = ["BUG", "DONE", "ERROR", "ITEM", "MEMORY", "READY", "STOP", "TOLD", "Task", "tell", "wanted_stop", "work"]

# Kinds of messages to the parent, each followed by its content.
READY, ITEM, TOLD, DONE, ERROR, MEMORY, BUG = "ready", "item", "told", "done", "error", "memory", "bug"

# From the parent, in place of a task: end the task in work soon, with what there is.
STOP = (None, None)

Task = Callable[["Model", Any], Iterator[Any]]

# Longest time that a worker without a parent may take to clean up [s].
_FAREWELL = 5.0

# Interval at which the worker looks whether its parent is still the same process [s].
_PATIENCE = 1.0

_STANDARD_OUTPUT, _STANDARD_ERROR = 1, 2


_pipes: list[Connection] = []  # to the parent: the one of this process


def tell(item: Any) -> None:  # noqa: ANN401 - any task's
    """Send an item of the task in work before it yields one; it is not a result, and the time limit goes on.

    Args:
        item: as `Runner.run` gives it.
    """
    for pipe in _pipes:
        pipe.send((TOLD, item))


def wanted_stop() -> bool:
    """Return whether the parent asked for the end of the task in work; it sends nothing else meanwhile."""
    return any(pipe.poll() and pipe.recv() == STOP for pipe in _pipes)


def work(pipe: Connection, recipe: Recipe, limits: Limits, scratch: str) -> None:
    """Serve one parent; ends the process.

    Args:
        pipe: brings pairs of a task and its argument, takes messages (kind, content).
        recipe: of the model.
        limits: the memory limit is set here, the time limit is the parent's affair.
        scratch: folder for all temporary files, which the parent removes.
    """
    _behave()
    tempfile.tempdir = os.environ["TMPDIR"] = scratch
    watcher = threading.Thread(target=_watch_parent, args=(recipe, scratch), daemon=True)
    watcher.start()
    _end_in_any_case()
    with suppress(EOFError, BrokenPipeError, ConnectionError):
        _serve(pipe, recipe, limits)
    # The parent hung up: if it is dead, the watcher cleans up and ends this process.
    watcher.join(_FAREWELL)
    os._exit(0)


def _serve(pipe: Connection, recipe: Recipe, limits: Limits) -> None:
    try:
        model = recipe.open()
    except WorkbenchError as error:
        pipe.send((ERROR, error))
        return
    memory = MemoryWatch(limits.memory)
    with model:
        pipe.send((READY, None))
        _pipes.append(pipe)
        while True:
            task, argument = pipe.recv()
            if task is not None:  # else it was asked to stop what is done already
                pipe.send(_do(task(model, argument), pipe, memory))


def _do(items: Iterator[Any], pipe: Connection, memory: MemoryWatch) -> tuple[str, Any]:
    """Do one task, sending its items; return the last message."""
    try:
        for item in items:
            if memory.exceeded():
                return MEMORY, None
            pipe.send((ITEM, item))
    except WorkbenchError as error:
        return ERROR, error
    except MemoryError:
        return MEMORY, None
    except (EOFError, OSError):
        raise
    except Exception:  # noqa: BLE001 - a bug of ours; the parent raises it
        return BUG, traceback.format_exc()
    return DONE, None


def _behave() -> None:
    """Leave the signals that ask to end to the parent, standard output to the result, and no core dumps or dialogs."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    os.dup2(_STANDARD_ERROR, _STANDARD_OUTPUT)
    if sys.platform == "win32":
        import ctypes  # noqa: PLC0415 - Windows only

        # SEM_FAILCRITICALERRORS | SEM_NOGPFAULTERRORBOX | SEM_NOOPENFILEERRORBOX
        ctypes.windll.kernel32.SetErrorMode(0x0001 | 0x0002 | 0x8000)
        return
    import resource  # noqa: PLC0415 - not on Windows

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _watch_parent(recipe: Recipe, scratch: str) -> None:
    """Clean up and end this process when the parent is gone, also while the FMU's code runs."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        while os.getppid() == parent.pid and not wait([parent.sentinel], _PATIENCE):
            pass
        recipe.abandon()
        shutil.rmtree(scratch, ignore_errors=True)
    os._exit(1)


def _end_in_any_case() -> None:
    """End this process a little later when the parent is gone, also while code that hangs keeps Python from running."""
    parent = multiprocessing.parent_process()
    if parent is None or why_kernel_missing():
        return
    arguments = (parent.sentinel, parent.pid, int(1000 * _FAREWELL))
    threading.Thread(target=kernel().kernel_end_with, args=arguments, daemon=True).start()
