"""What the loops in Python do with the forced inputs of a session."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.session.forcing import Forcing

__all__ = ["discrete_differ", "moved_to", "next_break", "ramp", "write_continuous", "write_moved"]


def next_break(forcing: Forcing, t: float) -> float:
    """Return the first time > t [s] at which a signal or its slope jumps."""
    return min((s.next_break(t) for s in forcing.signals.values()), default=math.inf)


def moved_to(forcing: Forcing, t: float) -> list[float]:
    """Return the continuous inputs at t, and the others as they are."""
    inputs = zip(forcing.inputs(), forcing.written, strict=True)
    return [s(t) + b if v.is_continuous_input else written for (v, s, b), written in inputs]


def write_continuous(forcing: Forcing, t: float) -> None:
    """Write the inputs that may change in continuous time."""
    if forcing.continuous.variables:
        _write(forcing, moved_to(forcing, t))


def write_moved(forcing: Forcing, values: Sequence[float]) -> None:
    """Write the continuous inputs where one of them differs from what the FMU sees."""
    if any(values[i] != forcing.written[i] for i in _continuous(forcing)):
        _write(forcing, values)


def _write(forcing: Forcing, values: Sequence[float]) -> None:
    forcing.continuous.write([values[i] for i in _continuous(forcing)])
    forcing.written = list(values)


def _continuous(forcing: Forcing) -> list[int]:
    return [i for i, (v, _, _) in enumerate(forcing.inputs()) if v.is_continuous_input]


def discrete_differ(forcing: Forcing, values: Sequence[float]) -> bool:
    """Whether an input that may change at events only has another value now."""
    held = set(range(len(values))) - set(_continuous(forcing))
    return any(values[i] != forcing.written[i] for i in held)


def ramp(forcing: Forcing, t: float, end: float) -> tuple[list[float], list[float]]:
    """Return the continuous inputs' mean slopes over (t, end) [1/s], and all inputs before `end`."""
    left = end if next_break(forcing, t) > end else math.nextafter(end, -math.inf)
    values = moved_to(forcing, left)
    return [(values[i] - forcing.written[i]) / (end - t) for i in _continuous(forcing)], values
