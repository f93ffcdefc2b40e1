"""Responses that do not repeat from period to period but in another rhythm: sampling beats and subharmonics."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.analysis.harmonics import fundamental
from workbench.session.base import Floats

__all__ = ["Beat", "mean_over_beats", "repeats_every"]

# Harmonics of the beat that are fitted, and the periods that takes at least.
_MOST_HARMONICS, _FEWEST = 4, 6

# A transient that changes the mean by so much in a third of the periods is left with less than this many times that.
_MARGIN = 2.0

# Phases that differ by less are the same [rad].
_SAME = 1e-6

# Periods that many apart agree as well as this, all harmonics together relative to what differs between neighbours.
_AGREE = 0.02

# A response that repeats every so many periods is looked for.
_LONGEST = 8


class Beat:
    """The rhythm of a forcing sine and a sampler.

    The sampled output contains f and its images f + n/dt. In successive periods T of the forcing the phases of these
    advance by n·2πT/dt, so what a period's Fourier coefficients see of them depends on k·2πT/dt, and on nothing
    else. Near half the sampling rate the image 1/dt − f is as large as the response and as slow as 2f·dt
    is near 1.

    Args:
        frequency: of the forcing [Hz].
        dt: sampling interval [s].

    Attributes:
        angle: by which that phase advances in a period [rad], −π … π.
        length: periods in which the image next to the forcing beats once; inf where it does not beat.
        aliased: whether the forcing is at or above half the sampling rate.
    """

    def __init__(self, frequency: float, dt: float) -> None:
        turns = 1.0 / (frequency * dt)
        self.angle = 2.0 * math.pi * (turns - round(turns))
        # Twice the forcing against the nearest multiple of the sampling rate; 0 is the forcing's own image.
        nearest = max(1, round(2.0 * frequency * dt))
        apart = abs(2.0 * frequency * dt - nearest)
        self.length = frequency * dt / apart if apart > 1e-9 else math.inf
        self.aliased = 2.0 * frequency * dt >= 1.0 - 1e-9

    def seen_in(self, count: int) -> bool:
        """Whether so many periods show the rhythm: once the slow image, once all phases of the samples."""
        turn = 2.0 * math.pi / abs(self.angle) if abs(self.angle) > _SAME else 1.0
        return max(self.length, turn) <= count

    def angles(self, harmonics: int) -> list[float]:
        """Return the phase advances of the beat's harmonics, those left out that look like others or stand still."""
        found: list[float] = []
        for n in range(1, harmonics + 1):
            angle = abs(math.remainder(n * self.angle, 2.0 * math.pi))
            if angle > _SAME and all(abs(angle - other) > _SAME for other in found):
                found.append(angle)
        return found


def mean_over_beats(periods: Floats, beat: Beat) -> tuple[Floats, float]:
    """Return the mean of periods that beat with a sampler, and its error relative to its fundamental.

    Least squares of a constant and of harmonics of the known beat over the last two thirds of the periods; exact for
    so many images, where a plain mean is only so over whole beats. The error is what one harmonic less would change,
    twice what an earlier third of the periods would (a transient), and what the fit leaves, as it is
    magnified. Infinite where less than one beat was seen.

    Args:
        periods: shape (K, 1 + 2·orders).
        beat: the rhythm.
    """
    count = max(_FEWEST, 2 * len(periods) // 3)
    earlier = len(periods) - max(1, count // 3)
    if count > earlier or not beat.seen_in(count):
        return periods[-1], math.inf
    most = min(_MOST_HARMONICS, (count - 2) // 3)
    newest, left = _fit(periods[-count:], beat.angles(most))
    fewer, _ = _fit(periods[-count:], beat.angles(most - 1))
    before, _ = _fit(periods[earlier - count : earlier], beat.angles(most))
    size = abs(fundamental(newest))
    if size == 0.0:
        return periods[-1], math.inf
    apart = abs(fundamental(newest - fewer)) + _MARGIN * abs(fundamental(newest - before))
    return newest, (apart + left) / size


def _fit(periods: Floats, angles: Sequence[float]) -> tuple[Floats, float]:
    """Return the constant, shape (1 + 2·orders,), and the error of its fundamental by what is left unexplained."""
    count = len(periods)
    phase = np.outer(np.arange(count), angles)
    basis = np.hstack([np.ones((count, 1)), np.cos(phase), np.sin(phase)])
    inverse = np.linalg.pinv(basis, rcond=1e-9)
    solution = inverse @ periods
    left = np.linalg.norm((periods - basis @ solution)[:, 1:3]) / math.sqrt(max(1, count - basis.shape[1]))
    return solution[0], float(left * np.linalg.norm(inverse[0]))


def repeats_every(periods: Floats) -> int | None:
    """Return after how many periods the response repeats: 2 … 8; None: it does not, or in each period.

    Args:
        periods: shape (K, 1 + 2·orders); so many are asked for that each was seen twice.
    """
    differ = _change(periods, 1)
    for every in range(2, min(_LONGEST, len(periods) // 3) + 1):
        if _change(periods, every) <= _AGREE * differ:
            return every
    return None


def _change(periods: Floats, every: int) -> float:
    """Return by how much the newest periods differ from those `every` before."""
    return float(np.linalg.norm((periods[-every:] - periods[-2 * every : -every])[:, 1:]) / math.sqrt(every))
