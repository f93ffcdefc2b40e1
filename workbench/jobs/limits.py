"""What worker processes may use of this machine."""

from __future__ import annotations

import math
import os
from importlib.util import find_spec
from pathlib import Path

__all__ = ["MemoryWatch", "Room", "cores", "memory_limit_works", "status", "went_beyond"]

_MB = 1_000_000

# What a process may have more before instances that are closed are ended to make room.
_GROWTH = {"VmSize": 1 << 30, "VmRSS": 256 << 20, "Threads": 64, "files": 128}

# Allocations are refused beyond this multiple of the memory limit.
_REFUSED = 1.5


def cores() -> int:
    """Return the number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS and Windows
        return os.cpu_count() or 1


def memory_limit_works() -> bool:
    """Whether this platform enforces a limit of the address space (Windows and macOS do not)."""
    return find_spec("resource") is not None and Path("/proc/self/statm").exists()


class MemoryWatch:
    """The memory limit of this process, counted from what it has when this is made.

    The system refuses allocations beyond one and a half times the limit; many FMUs do not notice, and
    a refused allocation cannot be seen from outside. What went beyond the limit itself can, in
    the peak of the address space, also after the memory was freed.

    Args:
        limit: [MB]; None or inf: none, and none either where the platform does not enforce any.

    Attributes:
        most: largest address space that is within the limit [bytes]; None: any.
    """

    def __init__(self, limit: float | None) -> None:
        self.most: float | None = None
        if limit is None or math.isinf(limit) or not memory_limit_works():
            return
        import resource  # noqa: PLC0415 - not on every platform

        now = _address_space("VmSize")
        self.most = float(max(now + limit * _MB, _address_space("VmPeak")))
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (int(now + _REFUSED * limit * _MB), hard))

    def exceeded(self) -> bool:
        """Whether the process ever had more than the limit allows."""
        return self.most is not None and _address_space("VmPeak") > self.most


class Room:
    """Whether what nobody needs any more may stay in this process for a while, counted from what it has now.

    Args:
        most: largest address space that is within the memory limit [bytes]; None: any.
    """

    def __init__(self, most: float | None = None) -> None:
        now = _used()
        self._most = {name: count + _GROWTH[name] for name, count in now.items()}
        if now and most is not None:
            self._most["VmSize"] = min(self._most["VmSize"], int(now["VmSize"] + most) // 2)

    def __call__(self) -> bool:
        now = _used()
        return bool(self._most and now) and all(now[name] <= most for name, most in self._most.items())


def _used() -> dict[str, int]:
    """Return what this process has of what may become scarce; empty where the system does not tell (not Linux)."""
    now = status()
    if not now:
        return {}
    try:
        files = sum(1 for _ in Path("/proc/self/fd").iterdir())
    except OSError:
        return {}
    sizes = {name: int(now[name].split()[0]) * 1024 for name in ("VmSize", "VmRSS")}
    return {**sizes, "Threads": int(now["Threads"]), "files": files}


def went_beyond(most: float | None, process: int) -> bool:
    """Whether another process ever had more memory than its watch allows.

    Args:
        most: of its `MemoryWatch`.
        process: its number.
    """
    try:
        return most is not None and _address_space("VmPeak", str(process)) > most
    except KeyError:  # it is gone, or going
        return False


def _address_space(which: str, process: str = "self") -> int:
    """Size of a process's address space, now ("VmSize") or at most so far ("VmPeak") [bytes]; Linux."""
    return int(status(process)[which].split()[0]) * 1024


def status(process: str = "self") -> dict[str, str]:
    """Return what the system says of a process, by name; empty where it does not (not Linux), or the process is gone.

    Args:
        process: its number.
    """
    try:
        text = Path(f"/proc/{process}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return {}
    # An FMU names its process as it likes: a name may have line feeds of other kinds, but none of this.
    return dict(line.partition(":")[::2] for line in text.split("\n"))
