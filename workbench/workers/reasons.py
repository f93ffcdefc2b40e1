"""Why a worker is gone, in one line."""

from __future__ import annotations

import signal
import sys

from workbench.core.where import Limits

__all__ = ["died", "out_of_memory", "timed_out"]

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
