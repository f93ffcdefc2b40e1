"""Poles of the closed loop along the gain, each followed, and how fast the slowest decays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment, minimize_scalar

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.poles import continuous, damped_frequency_hz
from workbench.limit_cycles.feedback.gains import CriticalGain

__all__ = ["Fastest", "Locus", "fastest", "locus", "shown_gains"]

_POINTS = 121
_MOST = 500
_STEP = 0.02  # movement between neighbours, over the pole's size, above which a gain is added between them
_CLOSEST = 1e-5  # of the range: gains no closer
_SCAN = 60


@dataclass(frozen=True, eq=False)
class Locus:
    """Poles over the gain.

    Attributes:
        gains: rising, shape (k,).
        poles: one column for each pole followed, shape (k, n) [1/s]; of sampled systems ln(z)/dt.
        growth: growth rate of the slowest pole, shape (k,) [1/s].
    """

    gains: Floats
    poles: Complex
    growth: Floats


@dataclass(frozen=True)
class Fastest:
    """The gain of a stable interval with which the slowest oscillation decays fastest.

    Attributes:
        gain: g.
        growth: of that oscillation [1/s], negative.
        frequency_hz: of it, damped [Hz].
        slowest: growth of the slowest pole of all at that gain, oscillating or not [1/s].
    """

    gain: float
    growth: float
    frequency_hz: float
    slowest: float


def shown_gains(
    stable: Sequence[tuple[float, float]], crossings: Sequence[CriticalGain], limits: tuple[float, float]
) -> tuple[float, float]:
    """Return the range of gains worth a picture: limits where they are finite, else 0 and what lies around it.

    Args:
        stable: stable intervals.
        crossings: all.
        limits: asked for.
    """
    ends = [g for pair in stable for g in pair if np.isfinite(g)]
    if not ends:
        sizes = sorted(abs(c.gain) for c in crossings if c.gain)
        ends = [s * c for s in sizes[:4][-1:] for c in (-1.0, 1.0)] if sizes else [-1.0, 1.0]
    low, high = min(0.0, *ends), max(0.0, *ends)
    width = high - low
    if any(np.isinf(g) and g < 0.0 for g, _ in stable):
        low -= 2.0 * width
    if any(np.isinf(g) for _, g in stable):
        high += 2.0 * width
    low, high = low - 0.15 * width, high + 0.15 * width
    return (
        limits[0] if np.isfinite(limits[0]) else min(low, limits[1] - width),
        limits[1] if np.isfinite(limits[1]) else max(high, limits[0] + width),
    )


def locus(plant: LinearPart, low: float, high: float, *, also: Sequence[float] = ()) -> Locus:
    """Return the poles over a range of gains, dense where they move fast.

    Args:
        plant: G.
        low: lowest gain.
        high: highest gain.
        also: further gains in it.
    """
    gains = [g for g in np.unique([*np.linspace(low, high, _POINTS), *also]).tolist() if low <= g <= high]
    gains = [g for g in gains if plant.solvable(g)]
    poles = {g: _rates(plant, g) for g in gains}
    while len(gains) < _MOST:
        matched = _followed([poles[g] for g in gains])
        size = np.maximum(np.abs(matched[1:]), 0.05 * float(np.median(np.abs(matched))) + 1e-300)
        moved = (np.abs(np.diff(matched, axis=0)) / size).max(axis=1, initial=0.0)
        apart = np.diff(gains)
        wide = np.flatnonzero((moved > _STEP) & (apart > _CLOSEST * (high - low)))
        worst = wide[np.argsort(-moved[wide])][: min(60, _MOST - len(gains))]
        if not len(worst):
            break
        fresh = [0.5 * (gains[i] + gains[i + 1]) for i in worst.tolist()]
        poles |= {g: _rates(plant, g) for g in fresh if plant.solvable(g)}
        gains = sorted(poles)
    matched = _followed([poles[g] for g in gains])
    return Locus(np.array(gains), matched, np.asarray(matched.real.max(axis=1, initial=-np.inf), dtype=np.float64))


def _rates(plant: LinearPart, gain: float) -> Complex:
    return continuous(plant.poles_at(gain), plant.dt)


def _followed(rows: Sequence[Complex]) -> Complex:
    """Return rows of poles with each pole in one column."""
    result = [rows[0]]
    for row in rows[1:]:
        # A pole goes on as it went, if it went anywhere.
        guess = result[-1]
        cost = np.abs(guess[:, None] - row[None, :])
        _, order = linear_sum_assignment(cost)
        result.append(row[order])
    return np.array(result, dtype=np.complex128)


def fastest(plant: LinearPart, low: float, high: float) -> Fastest | None:
    """Return the gain between two others at which the slowest oscillation decays fastest; None: nothing oscillates.

    Poles with a damping ratio below 0.7 oscillate. Slow real poles, which a short motion hardly shows, are left out;
    the result names the slowest pole beside. The rate has kinks where another pole becomes the slowest: the best of a
    scan is refined.

    Args:
        plant: G.
        low: finite.
        high: finite.
    """
    scan = np.linspace(low, high, _SCAN + 2)[1:-1]
    growth = [_oscillation(plant, g)[0] for g in scan.tolist()]
    best = int(np.argmin(growth))
    if not np.isfinite(growth[best]):
        return None
    step = float(scan[1] - scan[0])
    none = 1.0 + max(g for g in growth if np.isfinite(g))
    result = minimize_scalar(
        lambda g: min(_oscillation(plant, g)[0], none),
        bounds=(float(scan[best]) - step, float(scan[best]) + step),
        method="bounded",
        options={"xatol": 1e-9 * (high - low)},
    )
    gain = float(result.x) if result.fun < growth[best] else float(scan[best])
    rate, frequency = _oscillation(plant, gain)
    return Fastest(gain, rate, frequency, plant.growth(gain))


def _oscillation(plant: LinearPart, gain: float) -> tuple[float, float]:
    """Return growth [1/s] and damped frequency [Hz] of the slowest oscillating pole; infinite growth: there is none."""
    rates = _rates(plant, gain)
    swinging = rates[np.abs(rates.imag) > np.abs(rates.real)]
    if not len(swinging):
        return np.inf, 0.0
    slowest = swinging[int(np.argmax(swinging.real))]
    return float(slowest.real), float(damped_frequency_hz(slowest))
