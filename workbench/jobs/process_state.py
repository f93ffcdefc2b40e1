"""What of its process an FMU may change for those after it: arithmetic, limits, signals, environment and more."""

from __future__ import annotations

import ctypes
import locale
import os
import signal
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import ClassVar

from workbench.jobs.limits import status
from workbench.kernel.library import kernel, why_kernel_missing

__all__ = ["arithmetic", "libc", "limits", "only_handlers", "state"]

# Of this much of what a process may have, files or mappings, nothing is left for others.
_MANY = 0.5

# As long as the address space has grown by less, the mappings are not counted again: 16384 of one page each [kB].
_GROWN = 1 << 16

# Of /proc/self/status: as the C library, too, may have set them, not only Python.
_TOLD = ("Umask", "SigBlk", "SigIgn", "SigCgt")
_HANDLED = "SigCgt"
_ASK = 0xFFFFFFFF  # personality(2): change nothing


class _Mappings:
    """The last count.

    Attributes:
        size: of the address space then [kB].
        many: whether they were.
    """

    size: ClassVar[int] = 0
    many: ClassVar[bool] = False


@cache
def libc() -> ctypes.CDLL:
    """Return the C library; to look for it takes longer than what is called."""
    return ctypes.CDLL(None)


def arithmetic() -> int:
    """Return how the processor rounds, treats denormal numbers and traps; comparable within this process."""
    if not why_kernel_missing():
        return int(kernel().kernel_arithmetic())
    return int(getattr(libc(), "fegetround", int)())


def limits() -> dict[str, tuple[int, int]]:
    """Return what the system allows this process, by the names of `resource`; empty on Windows."""
    if sys.platform == "win32":
        return {}
    import resource  # noqa: PLC0415 - not on Windows

    return {name: resource.getrlimit(getattr(resource, name)) for name in dir(resource) if name.startswith("RLIMIT_")}


def state() -> dict[str, object]:
    """Return what an FMU may change for those after it, by name; what cannot be read is as if it had changed.

    Not seen are handlers that take the place of others, timers of POSIX, and mappings that were split.
    """
    if sys.platform == "win32":
        return {"arithmetic": arithmetic()}
    allowed = limits()
    timers = signal.ITIMER_REAL, signal.ITIMER_VIRTUAL, signal.ITIMER_PROF
    return {
        **allowed,
        **_signals(),
        "arithmetic": arithmetic(),
        "files": _many_files(allowed["RLIMIT_NOFILE"][0]),
        "timers": [any(signal.getitimer(timer)) for timer in timers],
        "environment": _environment(),
        "locale": locale.setlocale(locale.LC_ALL),
        "personality": getattr(libc(), "personality", int)(_ASK if sys.platform == "linux" else 0),
        "priority": os.getpriority(os.PRIO_PROCESS, 0),
    }


def only_handlers(before: dict[str, object], after: dict[str, object]) -> bool:
    """Return whether two states differ in the signals that have handlers, and in nothing else.

    A run-time system in an FMU that has set some needs them as long as its code is there; an FMU after it shall not
    have them.
    """
    return {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)} == {_HANDLED}


def _many_files(most: int) -> bool:
    try:
        return len(list(Path("/dev/fd").iterdir())) > _MANY * most
    except OSError:
        return True


def _signals() -> dict[str, object]:
    """Return the permissions that new files lack, what is done about signals, and whether mappings are used up."""
    now = status()
    if not now:  # not Linux
        os.umask(mask := os.umask(0o077))
        return {"Umask": mask, "SigBlk": signal.pthread_sigmask(signal.SIG_BLOCK, ())}
    return {**{name: now.get(name) for name in _TOLD}, "mappings": _many_mappings(int(now["VmSize"].split()[0]))}


def _many_mappings(size: int) -> bool:
    """Return whether the process has used up its mappings; to count them takes milliseconds.

    Args:
        size: of its address space [kB].
    """
    if abs(size - _Mappings.size) > _GROWN:
        most, count = 0.0, 0
        with suppress(OSError):
            most = float(Path("/proc/sys/vm/max_map_count").read_text(encoding="ascii"))
            count = Path("/proc/self/maps").read_bytes().count(b"\n")
        _Mappings.size, _Mappings.many = size, count > _MANY * most
    return _Mappings.many


def _environment() -> object:
    """Return the environment as the C library has it: `os.environ` does not see what others set."""
    result: list[bytes] = []
    try:
        texts = ctypes.POINTER(ctypes.c_char_p).in_dll(libc(), "environ")
        while (text := texts[len(result)]) is not None:
            result.append(text)
    except ValueError:  # this system has no such name, or somebody has cleared it
        return dict(os.environ)
    return result
