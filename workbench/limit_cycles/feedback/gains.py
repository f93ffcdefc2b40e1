"""The gains at which a pole reaches the border of stability, the intervals between, and poles that no gain moves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.modal import poles_of
from workbench.core.values.poles import growth_rates, sides
from workbench.loops.nyquist.level_crossings import real_crossings

__all__ = ["CriticalGain", "Interval", "count_poles", "crossings", "fixed_modes", "intervals", "stable_gains"]

_ON_BORDER = 1e-8  # a pole so near the border, relative to its size (to 1 where sampled), counts as on it
_SAME = 1e-9  # relative difference of two gains that are one
_INSIDE = -5.0  # ln |z| of discrete poles that are far inside the unit circle
_ZERO = 1e-10  # |G| below this part of its size elsewhere is a zero of G, which no finite gain belongs to
_BESIDE = (0.6, 1.7)  # times the size of a pole
_NEAR = 1e-5  # of the slowest pole: so near 0 a pole there would dominate G, if G had it
_AXIS = 1e-9  # relative distance of an open-loop pole from the border that counts as on it
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


@dataclass(frozen=True)
class _Candidate:
    gain: float
    frequency: float
    real: float


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
    places = _distinct(sorted(_places(plant), key=lambda p: (p.gain, p.frequency)))
    counted = intervals(plant, [p.gain for p in places])
    ends = np.array([i.high for i in counted[:-1]])
    found = []
    for place in places:
        end = int(np.argmin(np.abs(ends - place.gain)))  # gains that differ by rounding share an end
        below, above = counted[end], counted[end + 1]
        if place.gain != 0.0 and below.border and (below.unstable, below.border) == (above.unstable, above.border):
            continue  # undamped, poles stand on the border for each gain, and no gain is their crossing
        found.append(
            CriticalGain(
                gain=place.gain,
                frequency_hz=place.frequency,
                real=place.real,
                unstable_below=below.unstable,
                unstable_above=above.unstable,
                residual=_residual(plant, place),
            )
        )
    return tuple(found)


def _places(plant: LinearPart) -> Iterator[_Candidate]:
    poles = _border_poles(plant)
    size = _size(plant)
    near_zero = _NEAR * float(_sizes(plant).min()) if np.any(poles == 0.0) else 0.0
    for frequency in real_crossings(plant):
        value = plant.at(frequency)
        beside = frequency > near_zero and not np.any(np.abs(poles - frequency) < 1e-7 * frequency)
        if abs(value) > _ZERO * size and beside:
            yield _Candidate(1.0 / value.real, frequency, value.real)
    ends = [0.0, plant.highest_hz] if plant.dt > 0.0 else [0.0]
    for frequency in ends:
        value = _at_zero(plant, near_zero) if frequency == 0.0 and near_zero else plant.at(frequency)
        on_pole = frequency > 0.0 and np.any(np.abs(poles - frequency) < 1e-12)
        if np.isfinite(value) and abs(value) > _ZERO * size and not on_pole:
            yield _Candidate(1.0 / value.real, frequency, value.real)
    if plant.d != 0.0:
        yield _Candidate(1.0 / plant.d, math.inf, plant.d)
    for frequency in np.unique(poles).tolist():
        yield _Candidate(0.0, frequency, math.inf)


def _sizes(plant: LinearPart) -> Floats:
    """Return the sizes of the open-loop poles that are not 0, and one of its own [Hz]."""
    poles = poles_of(plant.A, dt=plant.dt)
    rates = np.abs(poles.value[np.abs(poles.value) > 10.0 * poles.uncertain])
    own = 1.0 if plant.dt == 0.0 else 0.3 * math.pi / plant.dt
    return np.append(rates, own) / (2.0 * math.pi)


def _at_zero(plant: LinearPart, near: float) -> complex:
    """Return G(0) of a system with poles at 0 where u does not reach them or y does not see them; else infinity."""
    values = [plant.at(f) for f in (near, 0.1 * near)]
    alike = abs(values[0] - values[1]) <= 1e-3 * abs(values[0])
    return complex(values[0].real) if alike else complex(math.inf)


def _border_poles(plant: LinearPart) -> Floats:
    """Return the frequencies of the open-loop poles on the border, as far as rounding lets them be known [Hz]."""
    poles = poles_of(plant.A, dt=plant.dt)
    # Its balancing takes entries that are rounding only for exact ones: hence the second bound.
    rounding = 100.0 * np.finfo(float).eps * float(np.linalg.norm(plant.A)) if len(plant.A) else 0.0
    value, uncertain = poles.value, np.maximum(5.0 * poles.uncertain, rounding / (plant.dt or 1.0))
    size = np.full(len(value), 1.0 / plant.dt) if plant.dt > 0.0 else np.abs(value)
    near = np.abs(value.real) <= _AXIS * size + uncertain
    found = np.where(value.imag > _AXIS + uncertain, value.imag, 0.0)
    if plant.dt > 0.0:
        near &= value.real * plant.dt > _INSIDE  # the bound is one of |z|, and its logarithm near z = 0 wide
        found = np.where(found > math.pi / plant.dt - uncertain, math.pi / plant.dt, found)
    kept: list[float] = []
    for turn, apart in zip(found[near].tolist(), uncertain[near].tolist(), strict=True):
        if all(abs(turn - other) > 2.0 * apart for other in kept):
            kept.append(turn)
    return np.array(kept) / (2.0 * math.pi)


def _size(plant: LinearPart) -> float:
    """Return how large G is where it is large, beside its poles: on the border G is as large as rounding makes it."""
    f = np.concatenate([factor * _sizes(plant) for factor in _BESIDE])
    value = np.abs(plant.response(f[f < plant.highest_hz]))
    value = value[np.isfinite(value)]
    return max(float(np.median(value)) if len(value) else 0.0, abs(plant.d), 1e-300)


def _distinct(places: Sequence[_Candidate]) -> list[_Candidate]:
    kept: list[_Candidate] = []
    for place in places:
        near = [p for p in kept if _close(p.gain, place.gain) and _close(p.frequency, place.frequency)]
        if not near:
            kept.append(place)
    return kept


def _close(a: float, b: float) -> bool:
    return a == b or abs(a - b) <= _SAME * max(abs(a), abs(b))


def _residual(plant: LinearPart, place: _Candidate) -> float:
    """Return how far from the border the pole is that should stand on it, relative to its size."""
    if not plant.solvable(place.gain) or math.isinf(place.frequency) or not len(plant.A):
        return math.nan
    poles = plant.poles_at(place.gain)
    s = 2j * math.pi * place.frequency
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
        if not (math.isfinite(gain) and math.isfinite(merged[-1]) and _close(gain, merged[-1])):
            merged.append(gain)
    return [_counted(plant, low, high) for low, high in pairwise(merged)]


def count_poles(plant: LinearPart, gain: float) -> tuple[int, int]:
    """Return how many poles lie beyond the border of stability with u = g·y, and how many on it.

    Args:
        plant: G.
        gain: g.
    """
    closed = plant.closed(gain)
    rounding = 10.0 * np.finfo(float).eps * float(np.linalg.norm(closed)) if len(closed) else 0.0
    beyond, on = sides(np.linalg.eigvals(closed), plant.dt, relative=_ON_BORDER, rounding=rounding)
    return int(np.sum(beyond)), int(np.sum(on))


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


def stable_gains(found: Sequence[Interval], limits: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    """Return the intervals of gains for which all poles decay, within limits.

    Where a pole reaches the border and turns back, two of them touch: they are not joined, that gain is not stable.

    Args:
        found: from `intervals`.
        limits: lowest and highest gain looked at.
    """
    inside = [(max(i.low, limits[0]), min(i.high, limits[1])) for i in found if i.stable]
    return tuple((low, high) for low, high in inside if low < high)


# -- poles that no gain moves ------------------------------------------------------------------

_STAYS = 1e-7  # relative movement over the gains that counts as none
_BORDER = 1e-8


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
    border = _BORDER / plant.dt if plant.dt > 0.0 else _BORDER * size
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
