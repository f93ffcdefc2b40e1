"""What a worker may use: time for each result, and memory."""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from workbench.errors import InputError

__all__ = ["DEFAULT_TIMEOUT", "Limits", "memory_limit_works", "restrict_memory"]

# Long enough for any point that anybody waits for; short enough that a night's sweep survives a hang.
DEFAULT_TIMEOUT = 3600.0

_MB = 1_000_000


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one result may cost.

    Attributes:
        timeout: longest time without a result [s]; None or inf: any.
        memory: how much the FMU may allocate, on top of the worker's own [MB]; None: any.

    Raises:
        InputError: a limit that is not positive.
    """

    timeout: float | None = DEFAULT_TIMEOUT
    memory: float | None = None

    def __post_init__(self) -> None:
        for name, value, unit in (("timeout", self.timeout, "s"), ("memory limit", self.memory, "MB")):
            if value is not None and not value > 0.0:
                raise InputError(f"{name}: {value:g} {unit} is not a positive number")


def memory_limit_works() -> bool:
    """Whether this platform enforces a limit of the address space (Windows and macOS do not)."""
    return find_spec("resource") is not None and Path("/proc/self/statm").exists()


def restrict_memory(limit: float | None) -> None:
    """Let this process allocate at most `limit` [MB] more than it has now; nothing where that is impossible."""
    if limit is None or math.isinf(limit) or not memory_limit_works():
        return
    import resource  # noqa: PLC0415 - not on every platform

    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = pages * resource.getpagesize() + int(limit * _MB)
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))
