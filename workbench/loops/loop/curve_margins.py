"""Margins of a loop transfer that is known at single frequencies."""

from __future__ import annotations

from dataclasses import replace

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.margins import BORDER, STABLE, UNKNOWN, UNSTABLE, Margins, PhaseCrossover
from workbench.core.values.response import Response
from workbench.loops.loop.stability import ClosedLoopStability

__all__ = ["curve_margins"]


def curve_margins(
    frequency_hz: Floats, value: Complex, *, linear: Margins | None = None, stability: ClosedLoopStability | None = None
) -> Margins:
    """Return the margins of a measured loop transfer, interpolated in log gain and phase over log frequency.

    Only what lies between the lowest and the highest frequency is seen. Stability cannot be read off a curve alone. The
    closed loop's unstable poles are counted by Nyquist's criterion as against the linear loop, whose number is known:
    each crossing of the negative real axis left of -1 upwards adds two, each downwards takes two away.

    Args:
        frequency_hz: rising, shape (k,) [Hz].
        value: L there, shape (k,).
        linear: margins of the linear loop at the operating point, if known.
        stability: of that loop.
    """
    found = Response(frequency_hz, value).margins()
    verdict, words = _verdict(found.phase_crossovers, frequency_hz, linear, stability)
    disk = found.disk if verdict in (STABLE, UNKNOWN) else None
    return replace(found, verdict=verdict, words=words, disk=disk)


def _verdict(
    phase: tuple[PhaseCrossover, ...],
    frequency_hz: Floats,
    linear: Margins | None,
    stability: ClosedLoopStability | None,
) -> tuple[str, str]:
    why = _why_unknown(frequency_hz, linear, stability)
    count = (
        0
        if why or linear is None or stability is None
        else stability.unstable + 2 * (_turns(phase) - _turns(linear.phase_crossovers))
    )
    if count < 0:
        why = "its open loop differs from the linear one"
    if why:
        return UNKNOWN, f"whether the quasi-linear loop is stable is not known: {why}"
    if count:
        return UNSTABLE, f"the quasi-linear loop has {count} unstable poles; the margins are then meaningless"
    return STABLE, "the quasi-linear loop is stable, by Nyquist's criterion from the linear one"


def _why_unknown(frequency_hz: Floats, linear: Margins | None, stability: ClosedLoopStability | None) -> str:
    """Return why poles cannot be counted; empty if they can."""
    if len(frequency_hz) < 2:
        return "fewer than two points have a value"
    if linear is None or stability is None:
        return "there is no linear loop to start from"
    if stability.verdict == BORDER:
        return stability.words
    left = [c.frequency_hz for c in linear.phase_crossovers if c.factor < 1.0]
    if any(not frequency_hz.min() <= f <= frequency_hz.max() for f in left):
        return "the band leaves out phase crossovers of the linear loop"
    return ""


def _turns(crossovers: tuple[PhaseCrossover, ...]) -> int:
    """Return crossings left of -1: upwards less downwards."""
    return sum(1 if c.upwards else -1 for c in crossovers if c.factor < 1.0)
