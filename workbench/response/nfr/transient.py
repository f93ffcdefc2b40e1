"""Remove a decaying transient from a sequence of nearly periodic periods."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = [
    "MOST_MODES",
    "Limit",
    "directions",
    "drift",
    "levelled",
    "multipliers",
    "ramp",
    "remove_transient",
    "rise_of",
    "weigh",
]

# Decaying modes that are looked for together: two pairs of complex poles.
MOST_MODES = 4

# A multiplier is known to about this many times the unexplained part of the newest difference,
# and a mode that loses less than this in a period is not seen to decay in any number we wait for.
_UNCERTAINTY, _LEAST_LOSS = 3.0, 1e-4

# By so much the changes may exceed what the slowest multiplier lets remain of the first ones (several modes
# may partly cancel each other at first).
_SLACK = 1.3

# Differences smaller than this part of the response do not steer the prediction.
_RIDGE = 1e-6

# Changes that differ in direction by less than this are one.
_ONE = 1e-6

# Of fewer rises, or where they differ by more than this part, nothing is called a drift.
_FEWEST_RISES, _STEADY = 3, 0.02

# In-phase part of the fundamental of a ramp that rises by −1 in a period.
_RAMP = 1.0 / math.pi

_ALONE = np.ones(1)


@dataclass(frozen=True, eq=False)
class Limit:
    """What a sequence of periods tends to.

    Attributes:
        periods: the periods, shape (K, 1 + 2·orders).
        defect: how far the periodic response is from repeating itself, relative to its fundamental:
            root of the sum of squares over the harmonics' changes in one period.
        weights: by which the last periods, newest first, are weighed; one more than the decaying modes that
            they remove.
        changes: from period to period, newest first, the columns that decided, shape (K − 1, compared).
    """

    periods: Floats
    defect: float
    weights: Floats
    changes: Floats

    @property
    def modes(self) -> int:
        """Number of decaying modes that were removed."""
        return self.weights.size - 1

    @property
    def harmonics(self) -> Floats:
        """Fourier coefficients of the periodic response, laid out as in `Period`."""
        return weigh(self.periods, self.weights)


def remove_transient(periods: Floats, *, compared: int | None = None) -> Limit:
    """Return the periodic response that successive periods tend to.

    Around a stable periodic response the periods obey h(k) = h∞ + Σ v(i)·μ(i)^k, with one
    Floquet multiplier μ for each mode that is still alive: e^(λT) for a pole λ of a linear model
    and a period T. The differences d(k) = h(k+1) − h(k) have no constant part, so each is
    predicted from the m before it,

        d(k) + Σ c(j)·d(k−j) = 0,    the roots of the polynomial 1, c(1) … c(m) being the μ,

    and the same weights, divided by their sum, applied to the periods give h∞ (minimal polynomial
    extrapolation, exact once m counts the modes that are alive). The c are the least-squares
    solution over all harmonics of the last m differences: 2m differences are asked for, as many as
    one harmonic alone would need, so that the other harmonics are a check. What the prediction leaves
    unexplained, divided by the same sum, is the `defect`: by so much would the extrapolated response
    still change in one period. m = 0 is the last period itself. All m that the
    periods allow are tried; the smallest defect wins.

    A multiplier on or outside the unit circle is not a transient, and one that is not clearly inside is not
    taken for one: a sampled model whose rate is nearly commensurate with the forcing alternates from period to period
    (near −1, or a complex pair near the circle) and never settles. Clearly means by three times the
    part ρ of the newest difference that the prediction leaves unexplained, since the multipliers
    are known about as well as that; and by 1e-4 at least.

    The multipliers come from the newest differences alone. A transient has been decaying since the first
    period, so the changes themselves must have shrunk as the slowest multiplier says, root mean square over
    the last third against the first: a beat that happens to look like a decay for some periods has not.

    Modes much slower than the period (multiplier near 1) look like a ramp: they move the mean by
    the same amount in each period and leave −δ/(πn) in the n-th in-phase part. The part of the
    change that is a ramp is therefore taken out of the harmonics directly, which does not need
    the mode's (then badly known) multiplier, and the defect counts the harmonics without the mean. The mean
    itself of such a mode, and of an integrator, stays as measured.

    Not for periods that wander without decay (beats between a sampled model and the forcing,
    noise): the defect then stays large, which is the sign to believe a plain mean.

    Args:
        periods: shape (K, 1 + 2·orders), K ≥ 2, the harmonics of successive periods.
        compared: only so many columns, from the left, decide about weights and defect; None: all.

    Source: A. Sidi, Vector Extrapolation Methods with Applications, SIAM 2017, chapter 2
    (the method); M. Farkas, Periodic Motions, Springer 1994, chapter 2 (the multipliers).
    """
    seen = periods[:, :compared]
    defect, weights = min(_candidates(seen), key=itemgetter(0))
    return Limit(periods, defect, weights, _changes(seen))


def _changes(periods: Floats) -> Floats:
    """Return the differences of successive periods, newest first."""
    return periods[-1:0:-1] - periods[-2::-1]


def multipliers(changes: Floats, modes: int) -> Sequence[complex]:
    """Return the multipliers of the modes that best predict the newest changes, inside the unit circle or not.

    Args:
        changes: newest first, twice as many as modes at least.
        modes: number of modes, at least 1.
    """
    result: list[complex] = np.roots(_prediction(changes, modes, 0.0)).tolist()
    return result


def _candidates(periods: Floats) -> Iterator[tuple[float, Floats]]:
    """Yield (defect, weights) for no mode, one mode, and so on; called for each period."""
    changes = _changes(periods)
    scale = abs(complex(periods[-1, 1], periods[-1, 2]))
    newest = _size(changes[0])
    yield _defect(changes[:1], periods[-1]), _ALONE
    if newest == 0.0:
        return
    shrinkage = _Shrinkage.of(changes)
    for modes in range(1, min(MOST_MODES, len(changes) // 2, (periods.shape[1] - 1) // 2) + 1):
        if modes > 1 and directions(changes[: 2 * modes]) < modes:
            break
        polynomial = _prediction(changes, modes, _RIDGE * scale)
        unexplained = polynomial @ changes[: modes + 1]
        if shrinkage.agrees(polynomial, _size(unexplained) / newest):
            weights = polynomial / polynomial.sum()
            # The same weights must cancel each of the last changes that the prediction was made from.
            left = [weights @ changes[i : i + modes + 1] for i in range(modes)]
            yield _defect(left, weights @ periods[: -modes - 2 : -1]), weights


def directions(changes: Floats) -> int:
    """Return in how many directions the harmonics change.

    Modes differ in their harmonics, so that there are no more of them; one number alone, any 2m values of which m
    modes explain, has one.
    """
    return int(np.linalg.matrix_rank(changes, tol=_ONE * float(np.linalg.norm(changes[0]))))


def _defect(left: Sequence[Floats] | Floats, harmonics: Floats) -> float:
    """Return the largest of the changes that are left, without that of the mean, relative to the fundamental.

    Args:
        left: by what the response still changes in a period, newest first.
        harmonics: of the response; its ramp, which is the newest change of the mean, is not yet taken out.
    """
    in_phase = float(harmonics[1]) + float(left[0][0]) * _RAMP
    scale = math.hypot(in_phase, float(harmonics[2]))
    return max(_size(change[1:]) for change in left) / scale if scale > 0.0 else math.inf


@dataclass(frozen=True)
class _Shrinkage:
    """By how much the changes themselves have shrunk.

    Attributes:
        early, late: root of the sum of squares of the first and of the last third of the changes.
        periods: from the one to the other.
    """

    early: float
    late: float
    periods: int

    @classmethod
    def of(cls, changes: Floats) -> _Shrinkage:
        """Return that of all changes, newest first."""
        third = max(1, len(changes) // 3)
        return cls(_size(changes[-third:]), _size(changes[:third]), len(changes) - third)

    def agrees(self, polynomial: Floats, unexplained: float) -> bool:
        """Whether all multipliers are clearly inside the unit circle and the changes shrank as they say."""
        slowest = float(np.abs(np.roots(polynomial)).max(initial=0.0))
        margin = max(_UNCERTAINTY * unexplained, _LEAST_LOSS)
        return slowest <= 1.0 - margin and self.late <= _SLACK * self.early * slowest**self.periods


def _size(values: Floats) -> float:
    """Return the root of the sum of squares."""
    return math.sqrt(np.vdot(values, values))


def _prediction(changes: Floats, modes: int, ridge: float) -> Floats:
    """Coefficients 1, c(1) … c(m), newest first, that predict each of the last m changes from the m before it."""
    earlier = [changes[i + 1 : i + 1 + modes].ravel() for i in range(modes)]
    matrix = np.vstack([np.column_stack(earlier), ridge * np.eye(modes)])
    right = np.concatenate([-changes[:modes].ravel(), np.zeros(modes)])
    c, *_ = np.linalg.lstsq(matrix, right, rcond=None)
    return np.concatenate([[1.0], c])


def _slope(periods: Floats) -> float:
    """Return by how much the mean rises from period to period: a straight line through those of the newest half.

    Args:
        periods: shape (K, 1 + 2·orders).
    """
    means = periods[max(0, len(periods) // 2 - 1) :, 0]
    k = np.arange(len(means)) - 0.5 * (len(means) - 1)
    return float(k @ means / (k @ k)) if len(means) > 1 else 0.0


def ramp(periods: Floats) -> float:
    """Return what a rise of the mean may have put into the fundamental."""
    return abs(_slope(periods)) * _RAMP


def drift(periods: Floats) -> float:
    """Return that, where the mean rises alike in each of the newest half of the periods; else 0.

    Args:
        periods: shape (K, 1 + 2·orders).
    """
    rise, rises = _slope(periods), np.diff(periods[max(0, len(periods) // 2 - 1) :, 0])
    return rise if len(rises) >= _FEWEST_RISES and np.all(np.abs(rises - rise) <= _STEADY * abs(rise)) else 0.0


def levelled(periods: Floats) -> Floats:
    """Return the periods without their drift: they have the mean of the last one.

    Args:
        periods: shape (K, 1 + 2·orders).
    """
    rise, result = drift(periods), periods.copy()
    result[:, 0] -= rise * np.arange(1.0 - len(periods), 1.0)
    return _without_ramp(result, rise)


def rise_of(periods: Floats, weights: Floats) -> float:
    """Return by how much the mean rises in a period, the last ones weighed, newest first."""
    return float(weights @ (periods[-1 : -weights.size - 1 : -1, 0] - periods[-2 : -weights.size - 2 : -1, 0]))


def _without_ramp(harmonics: Floats, rise: float) -> Floats:
    """Take out of the in-phase parts, in place, what a ramp that rises by so much in a period leaves there."""
    harmonics[..., 1::2] += rise * _RAMP / np.arange(1.0, (harmonics.shape[-1] + 1) // 2)
    return harmonics


def weigh(periods: Floats, weights: Floats) -> Floats:
    """Weigh the last periods, newest first, and take out what a ramp leaves in the in-phase parts."""
    newest_first = periods[::-1]
    n = weights.size
    harmonics: Floats = weights @ newest_first[:n]
    return _without_ramp(harmonics, rise_of(periods, weights))
