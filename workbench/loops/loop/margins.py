"""Margins of a loop: of a linear model exact over all frequencies, of a measured curve as far as it is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.margins import (
    BORDER,
    STABLE,
    UNKNOWN,
    UNSTABLE,
    GainCrossover,
    Margins,
    PhaseCrossover,
    disk_of,
)
from workbench.core.values.response import Response
from workbench.loops.loop.stability import ClosedLoopStability, stability_of
from workbench.loops.nyquist.level_crossings import gain_crossings, real_crossings, scan

__all__ = ["curve_margins", "margins_of", "peak", "withheld"]


def margins_of(loop: LinearPart, *, peaks: bool = True) -> Margins:
    """Return the margins of a loop transfer L, exact over all frequencies.

    Sampled: up to the Nyquist frequency; the delay margin is that of a delay in whole samples read as a real number.

    Args:
        loop: L for negative feedback, closed loop 1/(1 + L).
        peaks: whether to find the peaks of |S| and |T| and the disk margin, too, which takes longest; NaN without.

    Raises:
        InputError: the closed loop has no solution (L is -1 at infinite frequency).

    Source: K. J. Åström, R. M. Murray, Feedback Systems, 2nd ed., section 10.3; disk margins: P. Seiler, A. Packard,
    P. Gahinet, An introduction to disk margins, IEEE Control Systems 40 (2020).
    """
    result = stability_of(loop)
    s, t = loop.sensitivity(), loop.complementary()
    on_border = result.verdict == BORDER
    at_s, at_t = ((math.inf if on_border else math.nan, math.nan),) * 2
    if peaks and not on_border:
        at_s, at_t = peak(s), peak(t)
    return Margins(
        verdict=result.verdict,
        words=result.words,
        phase_crossovers=tuple(_phase_crossovers(loop)),
        gain_crossovers=tuple(GainCrossover.of(f, loop.at(f)) for f in gain_crossings(loop)),
        disk=disk_of(*peak(_difference(s))) if peaks and result.stable else None,
        peak_sensitivity=at_s[0],
        peak_sensitivity_hz=at_s[1],
        peak_complementary=at_t[0],
        peak_complementary_hz=at_t[1],
        direct=0.0 if loop.dt > 0.0 else abs(loop.d),
    )


def withheld(stability: ClosedLoopStability) -> Margins:
    """Return margins that are not known, of a closed loop of which perhaps is known whether it is stable."""
    return Margins(
        verdict=stability.verdict, words=stability.words, phase_crossovers=(), gain_crossovers=(), disk=None,
        peak_sensitivity=math.nan, peak_sensitivity_hz=math.nan, peak_complementary=math.nan,
        peak_complementary_hz=math.nan, everywhere=False,
    )  # fmt: skip


def _difference(s: LinearPart) -> LinearPart:
    """Return S - T = 2 S - 1."""
    return replace(s, C=2.0 * s.C, D=2.0 * s.D - 1.0)


def _phase_crossovers(loop: LinearPart) -> list[PhaseCrossover]:
    inner = sorted([f for f in real_crossings(loop) if _negative(loop.at(f))])
    result = [PhaseCrossover(f, 1.0 / abs(loop.at(f)), _upwards(loop, f)) for f in inner]
    for end in (0.0, loop.highest_hz):
        value = loop.at(end)
        # Where L only tends to 0 no gain reaches the border.
        if _negative(value) and abs(value) > 1e-12 * _size(loop, inner):
            result.append(PhaseCrossover(end, 1.0 / abs(value)))
    return sorted(result, key=lambda c: c.frequency_hz)


def _negative(value: complex) -> bool:
    return bool(np.isfinite(value)) and value.real < 0.0 and math.isfinite(1.0 / abs(value)) and abs(value) < 1e15


def _upwards(loop: LinearPart, frequency: float) -> bool:
    return loop.at(frequency * (1.0 + 1e-6)).imag > loop.at(frequency * (1.0 - 1e-6)).imag


def _size(loop: LinearPart, frequencies: Sequence[float]) -> float:
    return max((abs(loop.at(f)) for f in frequencies), default=1.0)


# -- the largest gain of a transfer function over frequency ----------------------------------------

_CLOSE = 1e-10  # relative: how exactly the peak is found
_ROUNDS = 30


def peak(f: LinearPart) -> tuple[float, float]:
    """Return max |F(jω)| over all frequencies and where it lies [Hz] (infinity: at no finite frequency).

    A level just above the largest value known is drawn; where F crosses it, the middles of the crossings are higher,
    and so on until nothing crosses any more (N. A. Bruinsma, M. Steinbuch, A fast algorithm to compute the H∞-norm of
    a transfer function matrix, 1990). For a stable F that is its H∞ norm.

    Args:
        f: transfer function without poles on the imaginary axis (or unit circle).
    """
    ends = np.array([0.0, f.highest_hz])
    best, where = _largest(f, np.concatenate([ends, scan(f)]))
    for _ in range(_ROUNDS):
        level = best * (1.0 + _CLOSE)
        if not 0.0 < level < np.inf:
            break
        crossed = np.array(gain_crossings(f.scaled(1.0 / level)))
        if len(crossed) < 2:
            break
        value, at = _largest(f, np.sqrt(crossed[1:] * crossed[:-1]))
        if value <= best:
            break
        best, where = value, at
    return best, where


def _largest(f: LinearPart, frequencies: Floats) -> tuple[float, float]:
    sizes = np.abs(f.response(frequencies))
    sizes = np.where(np.isnan(sizes), -np.inf, sizes)
    k = int(np.argmax(sizes))
    return float(sizes[k]), float(frequencies[k])


# -- a loop transfer that is known at single frequencies -------------------------------------------


def curve_margins(
    frequency_hz: Floats, value: Complex, *, linear: Margins | None = None,
    stability: ClosedLoopStability | None = None, doubt: str = "",
) -> Margins:  # fmt: skip
    """Return the margins of a measured loop transfer, interpolated in log gain and phase over log frequency.

    Only what lies between the lowest and the highest frequency is seen. Stability cannot be read off a curve alone. The
    closed loop's unstable poles are counted by Nyquist's criterion as against the linear loop, whose number is known:
    each crossing of the negative real axis left of -1 upwards adds two, each downwards takes two away. Where that does
    not tell, the verdict is "unknown", and so are margins and peaks (NaN).

    Args:
        frequency_hz: rising, shape (k,) [Hz].
        value: L there, shape (k,).
        linear: margins of the linear loop at the operating point, if known.
        stability: of that loop.
        doubt: why the values do not tell on which side of -1 the curve passes; empty: they do.
    """
    result = Response(frequency_hz, value).margins()
    why = doubt or _why_unknown(frequency_hz, linear, stability)
    verdict, words = _verdict(result.phase_crossovers, linear, stability, why)
    if verdict == UNKNOWN:
        result = replace(
            result, peak_sensitivity=math.nan, peak_sensitivity_hz=math.nan, peak_complementary=math.nan,
            peak_complementary_hz=math.nan,
        )  # fmt: skip
    return replace(result, verdict=verdict, words=words, disk=result.disk if verdict == STABLE else None)


def _verdict(
    phase: tuple[PhaseCrossover, ...], linear: Margins | None, stability: ClosedLoopStability | None, why: str
) -> tuple[str, str]:
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
