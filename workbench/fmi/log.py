"""The log lines of all FMUs, caught and never printed.

FMPy's proxy, which formats variadic messages, knows one Python callback per process. So there is
one for FMI 1.0 and 2.0 each, kept for ever, that hands the line to the instance it names.
"""

from __future__ import annotations

import ctypes
import weakref
from collections import deque
from typing import Any

from workbench.errors import one_line
from workbench.fmi.fmpy_access import add_logger_proxy, fmi1, fmi2, fmi3

__all__ = ["InstanceLog", "callbacks1", "callbacks2", "log_callback3", "open_log"]

_LEVELS = ("ok", "warning", "discard", "error", "fatal", "pending")
_KEPT = 200
_SHOWN = 3  # in a message


class InstanceLog:
    """The last lines one instance logged.

    Attributes:
        key: unique name of the instance, known to the FMU as its instance name.
        lines: "level: message", oldest first.
    """

    def __init__(self, key: str) -> None:
        self.key = key
        self.lines: deque[str] = deque(maxlen=_KEPT)

    def add(self, status: int, message: bytes | None) -> None:
        level = _LEVELS[status] if 0 <= status < len(_LEVELS) else f"status {status}"
        text = one_line((message or b"").decode("utf-8", "replace"))
        self.lines.append(f"{level}: {text}")

    def tail(self) -> str:
        """Return the last lines of weight as the end of a message; empty if there are none."""
        heavy = [line for line in self.lines if not line.startswith("ok")]
        chosen = list(dict.fromkeys(heavy or self.lines))[-_SHOWN:]
        return "; its log: " + " | ".join(chosen) if chosen else ""


_logs: weakref.WeakValueDictionary[str, InstanceLog] = weakref.WeakValueDictionary()
_serial = 0


def open_log(model: str) -> InstanceLog:
    """Return a new log under a name that is unique in this process."""
    global _serial  # noqa: PLW0603  one counter for the whole process is the point
    _serial += 1
    log = InstanceLog(f"{model}_{_serial}")
    _logs[log.key] = log
    return log


def _receive(_owner: Any, name: bytes | None, status: int, _category: bytes | None, message: bytes | None) -> None:
    key = (name or b"").decode("utf-8", "replace")
    log = _logs.get(key)
    if log is None and len(_logs) == 1:  # some FMUs log under a name of their own
        log = next(iter(_logs.values()), None)
    if log is not None:
        log.add(status, message)


def _address(kind: Any, function: Any) -> Any:
    """Return C's own function as a callback: around an object, ctypes would go through Python at each call."""
    return kind(ctypes.cast(function, ctypes.c_void_p).value)


def _callbacks(module: Any, prefix: str) -> Any:
    structure = getattr(module, f"{prefix}CallbackFunctions")()
    structure.logger = getattr(module, f"{prefix}CallbackLoggerTYPE")(_receive)
    structure.allocateMemory = _address(getattr(module, f"{prefix}CallbackAllocateMemoryTYPE"), module.calloc)
    structure.freeMemory = _address(getattr(module, f"{prefix}CallbackFreeMemoryTYPE"), module.free)
    _kept.append((structure, structure.logger, structure.allocateMemory, structure.freeMemory))
    if add_logger_proxy is not None:
        add_logger_proxy(fmi1.byref(structure))
    return structure


_kept: list[Any] = []  # C code holds their addresses until the process ends
callbacks1: Any = _callbacks(fmi1, "fmi1")
callbacks2: Any = _callbacks(fmi2, "fmi2")


def log_callback3(log: InstanceLog) -> Any:
    """Return an FMI 3.0 log callback that writes to `log`; the caller keeps it alive."""

    def receive(_owner: Any, status: int, _category: bytes | None, message: bytes | None) -> None:
        log.add(status, message)

    return fmi3.fmi3LogMessageCallback(receive)
