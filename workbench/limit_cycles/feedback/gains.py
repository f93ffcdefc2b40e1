"""The gains at which a pole reaches the border of stability, the intervals between, and poles that no gain moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.linear import Linear, LinearPart
from workbench.core.values.poles import ON_BORDER, growth_rates, sides
from workbench.errors import InputError
from workbench.loops.nyquist.crossings import SAME, axis_crossings
from workbench.point.lin.delay_roots import count_right_of
from workbench.point.lin.result import DelayFreePart

__all__ = [
    "CriticalGain",
    "Interval",
    "count_poles",
    "crossings",
    "fixed_modes",
    "intervals",
    "stable_gains",
    "with_delays",
]

_BESIDE = 1e-6  # of an interval: so near its ends the poles are counted where there are delays
_WITHIN = (0.03, 0.5, 0.97)  # where in an interval the poles are counted
_OUTSIDE = (1.05, 2.0, 30.0)  # times the last crossing, where it is open on one side


@dataclass(frozen=True, kw_only=True)
class CriticalGain(RecordPart):
    """A gain at which a pole of the closed loop stands on the border of stability: 1 = g·G(jω).

    Attributes:
        gain: g.
        frequency_hz: of that pole [Hz]; 0: a real one; infinite: it comes back from infinity, at g = 1/D.
        real: G there, a real number, 1/g; infinite where G has a pole there and g is 0.
        unstable_below: poles beyond the border with a gain a little below.
        unstable_above: the same a little above.
        residual: distance of the nearest pole of the closed loop from jω over its size: what rounding leaves; NaN: not
            evaluated.
    """

    gain: float
    frequency_hz: float = field(metadata=entry(null=math.inf))
    real: float = field(metadata=entry(null=math.inf))
    unstable_below: int
    unstable_above: int
    residual: float = math.nan


@dataclass(frozen=True)
class Interval:
    """Gains between two neighbouring crossings.

    Attributes:
        low, high: the ends; infinite: no crossing beyond.
        unstable: poles beyond the border of stability for each gain in it.
        border: poles on the border for each gain in it.
        certain: the same poles were counted at several places in it.
    """

    low: float
    high: float
    unstable: int
    border: int
    certain: bool = True

    @property
    def stable(self) -> bool:
        """Whether all poles decay."""
        return self.unstable == 0 and self.border == 0


def crossings(plant: LinearPart) -> tuple[CriticalGain, ...]:
    """Return all gains at which a pole of A + B g (1 − gD)⁻¹ C reaches the border of stability, rising.

    A pole stands at jω where 1 = g·G(jω), so where G is real. These ω come from the eigenvalues of a pencil, the zeros
    of G(s) − G(−s), between which Im G keeps its sign; each is refined to rounding. Then there are ω = 0 (and half the
    sampling frequency), g = 1/D, at which a pole passes through infinity, and g = 0 for open-loop poles on the border.
    The poles on both sides are counted by eigenvalues.

    Poles that the feedback does not move stay where they are and give no crossing (`fixed_modes` finds them).

    Args:
        plant: G.

    Source: Boyd, Balakrishnan & Kabamba 1989 (for the pencil); Franklin, Powell & Emami-Naeini, Feedback Control of
    Dynamic Systems, chapter 5.
    """
    places = sorted((1.0 / c.real, c.frequency, c.real) for c in axis_crossings(plant))
    counted = intervals(plant, [gain for gain, *_ in places])
    ends = np.array([i.high for i in counted[:-1]])
    result = []
    for gain, frequency, real in places:
        end = int(np.argmin(np.abs(ends - gain)))  # gains that differ by rounding share an end
        below, above = counted[end], counted[end + 1]
        if gain != 0.0 and below.border and (below.unstable, below.border) == (above.unstable, above.border):
            continue  # undamped, poles stand on the border for each gain, and no gain is their crossing
        result.append(
            CriticalGain(
                gain=gain,
                frequency_hz=frequency,
                real=real,
                unstable_below=below.unstable,
                unstable_above=above.unstable,
                residual=_residual(plant, gain, frequency),
            )
        )
    return tuple(result)


def _residual(plant: LinearPart, gain: float, frequency: float) -> float:
    """Return how far from the border the pole is that should stand on it, relative to its size."""
    if not plant.solvable(gain) or math.isinf(frequency) or not len(plant.A):
        return math.nan
    poles = plant.poles_at(gain)
    s = 2j * math.pi * frequency
    wanted = np.exp(s * plant.dt) if plant.dt > 0.0 else s
    size = max(float(np.median(np.abs(p))) for p in (poles, plant.poles))
    scale = max(abs(wanted), 1e-3 * size, 1e-300)
    return float(np.abs(poles - wanted).min() / scale)


def intervals(plant: LinearPart, gains: Sequence[float]) -> list[Interval]:
    """Return the intervals of gains between crossings, with the poles counted inside each.

    Args:
        plant: G.
        gains: where crossings are, rising.
    """
    ends = [-math.inf, *dict.fromkeys(gains), math.inf]
    merged = [ends[0]]
    for gain in ends[1:]:
        if not (math.isfinite(gain) and math.isfinite(merged[-1]) and math.isclose(gain, merged[-1], rel_tol=SAME)):
            merged.append(gain)
    return [_counted(plant, low, high) for low, high in pairwise(merged)]


def count_poles(plant: LinearPart, gain: float) -> tuple[int, int]:
    """Return how many poles lie beyond the border of stability with u = g·y, and how many on it.

    Args:
        plant: G.
        gain: g.
    """
    closed = plant.closed(gain)
    # As crossings are found: in balanced units entries that are rounding only would count as exact ones.
    rounding = 10.0 * np.finfo(float).eps * float(np.linalg.norm(closed)) if len(closed) else 0.0
    beyond, on = sides(np.linalg.eigvals(closed), plant.dt, relative=ON_BORDER, rounding=rounding)
    return int(np.sum(beyond)), int(np.sum(on))


def with_delays(parts: Sequence[Interval], delayed: DelayFreePart) -> list[Interval]:
    """Return intervals with the poles counted anew, transport delays as they are.

    Where the count changes within one, it is cut to where no pole is beyond the border; else it has the most.

    Args:
        parts: of Padé approximations.
        delayed: G with its delays taken out.
    """
    return [_recounted(part, delayed) for part in parts]


def _recounted(part: Interval, delayed: DelayFreePart) -> Interval:
    ends = [part.low, part.high]
    near = [g + _BESIDE * (other - g) for g, other in (ends, ends[::-1])] if np.isfinite(ends).all() else []
    gains = sorted([*_inside(part.low, part.high), *near])
    counts = [_right_of_axis(delayed, g) for g in gains]
    good = [k for k, count in enumerate(counts) if count == 0.0]
    if not good or len(good) == len(counts):
        known = [int(c) for c in counts if math.isfinite(c)]
        unsure = len(known) < len(counts)
        return replace(
            part, unstable=max(known, default=part.unstable), border=max(part.border, int(unsure)),
            certain=part.certain and len(set(counts)) == 1,
        )  # fmt: skip
    first, last = good[0], good[-1]
    low = _edge(delayed, gains[first], gains[first - 1]) if first else part.low
    high = _edge(delayed, gains[last], gains[last + 1]) if last + 1 < len(gains) else part.high
    return replace(part, low=low, high=high, unstable=0, border=0, certain=len(good) == last - first + 1)


def _right_of_axis(delayed: DelayFreePart, gain: float) -> float:
    try:
        closed = Linear(delayed.A, delayed.B, delayed.C, delayed.D).with_feedback(gain)
    except InputError:
        return math.nan
    return count_right_of(DelayFreePart(closed.A, closed.B, closed.C, closed.D, delayed.times)).number


def _edge(delayed: DelayFreePart, good: float, bad: float) -> float:
    """Return the last gain known to be stable on the way from one that is to one that is not."""
    while abs(bad - good) > _BESIDE * (abs(bad) + abs(good)):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if _right_of_axis(delayed, middle) == 0.0 else (good, middle)
    return good


def _counted(plant: LinearPart, low: float, high: float) -> Interval:
    counts = [count_poles(plant, g) for g in _inside(low, high) if plant.solvable(g)]
    # Near the ends a pole may count as on the border; the count that most places give is that of the interval.
    unstable, border = max(counts, key=lambda c: (counts.count(c), -c[1]))
    return Interval(low, high, unstable, border, all(c[0] <= unstable <= sum(c) for c in counts))


def _inside(low: float, high: float) -> list[float]:
    """Return some gains inside an interval."""
    if math.isfinite(low) and math.isfinite(high):
        return [low + part * (high - low) for part in _WITHIN]
    if math.isfinite(low):
        return [low + (abs(low) or 1.0) * (times - 1.0) for times in _OUTSIDE]
    if math.isfinite(high):
        return [high - (abs(high) or 1.0) * (times - 1.0) for times in _OUTSIDE]
    return [-1.0, 0.0, 1.0]


def stable_gains(result: Sequence[Interval], limits: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    """Return the intervals of gains for which all poles decay, within limits.

    Where a pole reaches the border and turns back, two of them touch: they are not joined, that gain is not stable.

    Args:
        result: from `intervals`.
        limits: lowest and highest gain looked at.
    """
    inside = [(max(i.low, limits[0]), min(i.high, limits[1])) for i in result if i.stable]
    return tuple((low, high) for low, high in inside if low < high)


# -- poles that no gain moves ------------------------------------------------------------------

_STAYS = 1e-7  # relative movement over the gains that counts as none


def fixed_modes(plant: LinearPart, gains: Sequence[float]) -> tuple[complex, ...]:
    """Return the open-loop poles that do not decay and that no gain moves [1/s] (in z if sampled); upper half-plane.

    With one of them no gain stabilises the system. Poles that move by less than 1e-7 of their size count as fixed: so
    weakly coupled a pole asks for gains that nobody would use.

    Args:
        plant: G.
        gains: some, from all intervals between crossings.
    """
    open_loop = plant.poles
    size = np.ones(len(open_loop)) if plant.dt > 0.0 else np.maximum(np.abs(open_loop), 1e-6)
    border = ON_BORDER / plant.dt if plant.dt > 0.0 else ON_BORDER * size
    candidates = [
        (complex(p), float(s))
        for p, s, rate, near in zip(
            open_loop, size, growth_rates(open_loop, plant.dt), np.broadcast_to(border, size.shape), strict=True
        )
        if p.imag >= 0.0 and rate > -near
    ]
    if not candidates:
        return ()
    moved = [plant.poles_at(g) for g in gains if plant.solvable(g) and g != 0.0]
    fixed = [p for p, s in candidates if all(np.abs(m - p).min() < _STAYS * s for m in moved)]
    return tuple(sorted(fixed, key=lambda p: (p.imag, p.real)))
