"""Responses that do not repeat from period to period but in another rhythm: sampling beats and subharmonics."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.response.periodic.fourier import fundamental

__all__ = ["BEAT", "BEGIN", "Beat", "mean_over_beats", "repeats_every", "spread_words"]

BEAT = "sampling and forcing beat"

# Harmonics of the beat and decaying modes that are fitted, not to the first periods, where quick modes are alive.
_MOST_HARMONICS, _MODES, BEGIN = 4, 2, 2

# Multipliers of decaying modes: time constants of a quarter of a period to a hundred.
_MULTIPLIERS = np.exp(-(10.0 ** np.linspace(-2.0, 0.6, 40)))

# Decays that differ by less are one; so are columns of the fit.
_DISTINCT, _RANK = 1e-12, 1e-9

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
    """

    def __init__(self, frequency: float, dt: float) -> None:
        turns = 1.0 / (frequency * dt)
        self.angle = 2.0 * math.pi * (turns - round(turns))
        # Twice the forcing against the nearest multiple of the sampling rate; 0 is the forcing's own image.
        nearest = max(1, round(2.0 * frequency * dt))
        apart = abs(2.0 * frequency * dt - nearest)
        self.length = frequency * dt / apart if apart > 1e-9 else math.inf

    def seen_in(self, count: int) -> bool:
        """Whether so many periods show the rhythm: once the slow image, once all phases of the samples."""
        return max(self.length, self.turn) <= count

    @property
    def turn(self) -> float:
        """Periods in which the phase of the samples turns once: 1 where it is the same in each."""
        return 2.0 * math.pi / abs(self.angle) if abs(self.angle) > _SAME else 1.0

    @property
    def common(self) -> int | None:
        """Periods of the forcing after which the samples fall on the same phases again: 1 … 8; None: more."""
        back = (n for n in range(1, _LONGEST + 1) if abs(math.remainder(n * self.angle, 2.0 * math.pi)) <= _SAME)
        return next(back, None)

    def words(self, spread: float, count: int, *, known: bool) -> str:
        """Return why periods under this rhythm have not settled.

        Args:
            spread: of the periods about their mean (root mean square), relative to it.
            count: number of periods measured.
            known: whether the error of their mean is.
        """
        every = f", together every {self.common} periods" if self.common else ""
        words = spread_words(spread, every)
        if known:
            return words
        beat = max(self.length, self.turn)
        seen = self.seen_in(len(_newest(np.empty(max(BEGIN + 1, count)))))
        cause = "a transient decays slowly" if seen else f"a whole beat takes {beat:.3g} periods or more"
        return f"{words}; how far off that is, is not known: {cause} (wait longer: `max_periods`)"

    @property
    def slowness(self) -> float:
        """1/|1 − e^(jnθ)| of the slowest harmonic n of the beat, at least 1."""
        return max([1.0, *(0.5 / math.sin(0.5 * angle) for angle in self.angles(_MOST_HARMONICS))])

    def angles(self, harmonics: int) -> list[float]:
        """Return the phase advances of the beat's harmonics, those left out that look like others or stand still."""
        result: list[float] = []
        for n in range(1, harmonics + 1):
            angle = abs(math.remainder(n * self.angle, 2.0 * math.pi))
            if angle > _SAME and all(abs(angle - other) > _SAME for other in result):
                result.append(angle)
        return result


def spread_words(spread: float, every: str = "") -> str:
    """Return how far the periods of a sampled model lie from their mean (root mean square, relative to it)."""
    return f"{BEAT}{every}: the periods differ from their mean by {100.0 * spread:.2g} %"


def mean_over_beats(periods: Floats, beat: Beat) -> tuple[Floats, float]:
    """Return the mean of periods that beat with a sampler and still settle, and its error relative to its fundamental.

    Least squares of a constant, of harmonics of the known beat, and of two decaying modes μ^k, whose multipliers are
    those of a grid that leave the least: a filter and a lag behind it may both be slower than a period. Exact
    for so many images and modes, where a plain mean is only so over whole beats of a response at rest. The error is
    the sum of what one mode less would change, one harmonic less, what the newest periods alone would change that
    one mode less is fitted to, and what the fit leaves, as it is magnified. Infinite where less than one beat was seen.

    Args:
        periods: shape (K, 1 + 2·orders).
        beat: the rhythm.

    Source: G. H. Golub, V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems whose
    variables separate, SIAM Journal on Numerical Analysis 10 (1973), 413-432 (the amplitudes are eliminated).
    """
    seen = periods[BEGIN:]
    newest = _newest(periods)
    harmonics = min(_MOST_HARMONICS, (len(newest) - 2 - _MODES) // 3)
    if harmonics < 1 or not beat.seen_in(len(newest)):
        return periods[-1], math.inf
    angles, fewer = beat.angles(harmonics), beat.angles(harmonics - 1)
    mean, left = _fit(seen, angles, _MODES)
    size = abs(fundamental(mean))
    if size == 0.0:
        return periods[-1], math.inf
    one, _ = _fit(seen, angles, _MODES - 1)
    others = (one - mean, _fit(seen, fewer, _MODES)[0] - mean, _fit(newest, angles, _MODES - 1)[0] - one)
    return mean, (sum(abs(fundamental(o)) for o in others) + left) / size


def _newest(periods: Floats) -> Floats:
    """Return the periods that are to show a whole beat."""
    seen = periods[BEGIN:]
    return seen[max(1, len(seen) // 4) :]


def _fit(periods: Floats, angles: Sequence[float], modes: int) -> tuple[Floats, float]:
    """Return the constant, shape (1 + 2·orders,), and the error of its fundamental by what is left unexplained."""
    count = len(periods)
    phase = np.outer(np.arange(count), angles)
    basis = np.hstack([np.ones((count, 1)), np.cos(phase), np.sin(phase)])
    decays = _MULTIPLIERS ** np.arange(count)[:, None]
    # What constant and beat do not explain, of the periods and of each decay.
    projection = np.eye(count) - basis @ np.linalg.pinv(basis, rcond=_RANK)
    chosen = _best(projection @ periods, projection @ decays, modes)
    basis = np.hstack([basis, decays[:, chosen]])
    inverse = np.linalg.pinv(basis, rcond=_RANK)
    solution = inverse @ periods
    left = np.linalg.norm((periods - basis @ solution)[:, 1:3]) / math.sqrt(max(1, count - basis.shape[1]))
    return solution[0], float(left * np.linalg.norm(inverse[0]))


def _best(left: Floats, decays: Floats, modes: int) -> list[int]:
    """Return which decays, so many together (1 or 2), leave the least of what is left."""
    gram, parts = decays.T @ decays, decays.T @ left
    square, both = np.diag(gram), parts @ parts.T
    own = np.diag(both)
    if modes == 1:
        return [int(np.argmax(own / square))]
    i, j = np.triu_indices(len(gram), 1)
    determinant = square[i] * square[j] - gram[i, j] ** 2
    explained = square[j] * own[i] + square[i] * own[j] - 2.0 * gram[i, j] * both[i, j]
    apart = determinant > _DISTINCT * square[i] * square[j]
    best = int(np.argmax(np.where(apart, explained / np.where(apart, determinant, 1.0), -1.0)))
    return [int(i[best]), int(j[best])]


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
