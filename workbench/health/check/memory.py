"""Does memory stay free of what closed instances leave behind?"""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from workbench.fmi.ended import end_now
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu

__all__ = ["memory", "resident"]

_SESSIONS = 100
_BEFORE = 20  # sessions until allocator and caches have what they need
_ADVANCED = 10  # steps in each session
_FEWEST = 20
_BUDGET = 20.0  # [s]
_EVERY = 5  # sessions between two looks
_SWEEP = 10_000  # sessions of a long sweep

# Of growth per session [bytes]: below the first nobody runs out, beyond the second a sweep of ten thousand does.
_WATCH, _BROKEN = 16e3, 1e6


def memory(subject: CheckedFmu) -> Answer:
    """Open, initialise, advance by ten steps and close 120 sessions; watch the process's resident memory.

    The first 20 fill caches. The slope over the next 100 is the median of the slopes between all pairs of looks
    (Theil and Sen), so that one block that the allocator takes counts little; what it gives back counts as nothing.
    Watch: more than 16 kB per session; broken: more than 1 MB, which ends a sweep of ten thousand sessions (FMI: to
    free an instance frees its memory). Not applicable: the platform does not tell the resident memory.

    Source: Sen, Estimates of the regression coefficient based on Kendall's tau, J. Am. Stat. Assoc. 63 (1968).
    """
    if resident() is None:
        return Answer("not applicable", f"resident memory cannot be measured on {sys.platform}")
    looks = _looks(subject)
    slope = max(0.0, _slope(looks))
    numbers = {
        "bytes_per_session": slope,
        "sessions": [k for k, _ in looks],
        "resident_bytes": [b for _, b in looks],
    }
    text = f"{slope / 1e3:.3g} kB per session over {looks[-1][0]} sessions ({looks[-1][1] / 1e6:.0f} MB resident)"
    if slope <= _WATCH:
        return Answer("good", text, numbers=numbers)
    advice = f"{_SWEEP} sessions take {slope * _SWEEP / 1e9:.2g} GB: split sweeps, or continue them from a store"
    return Answer("broken" if slope > _BROKEN else "watch", text, advice, numbers)


def _looks(subject: CheckedFmu) -> list[tuple[int, float]]:
    """Return (sessions since the caches are full, resident bytes)."""
    gc.collect()
    _give_back()
    gc.freeze()  # what lives already need not be looked through again
    try:
        begin = time.monotonic()
        for _ in range(_BEFORE):
            _session(subject)
        # Of FMUs that take seconds to open fewer sessions must do, with a coarser slope.
        affordable = _BEFORE * _BUDGET / max(time.monotonic() - begin, 1e-9)
        return list(_watched(subject, int(min(_SESSIONS, max(_FEWEST, affordable)))))
    finally:
        gc.unfreeze()


def _give_back() -> None:
    """Give free memory back to the system: what an FMU leaks into it would not show. GNU's C library only."""
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def _watched(subject: CheckedFmu, sessions: int) -> Iterator[tuple[int, float]]:
    for k in range(sessions + 1):
        if k % _EVERY == 0:
            gc.collect()
            yield k, resident() or 0.0
        _session(subject)


def _session(subject: CheckedFmu) -> None:
    with subject.open() as session:
        session.advance(subject.start + min(_ADVANCED, subject.steps) * subject.step, signals=subject.constants())
    end_now()  # what is closed, and waits for its end, is none of what it leaves behind


def _slope(looks: list[tuple[int, float]]) -> float:
    """Return the median slope of all pairs [bytes per session]."""
    k, size = np.array(looks).T
    i, j = np.triu_indices(len(k), 1)
    return float(np.median((size[j] - size[i]) / (k[j] - k[i])))


def resident() -> float | None:
    """Return the resident memory of this process [bytes]; its peak where the present one is not told; None: neither."""
    status = Path("/proc/self/statm")
    if status.exists():
        return float(int(status.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE"))
    if find_spec("resource") is None:
        return None
    import resource  # noqa: PLC0415 - not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak if sys.platform == "darwin" else 1024 * peak)
