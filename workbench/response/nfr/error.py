"""The error of a periodic response that was extrapolated, or averaged, from a run of a few periods."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.response.nfr.beats import BEGIN, Beat
from workbench.response.nfr.prior_knowledge import LinearSineResponse, Twin
from workbench.response.nfr.transient import MOST_MODES, Limit, directions, levelled, multipliers, ramp, weigh
from workbench.response.periodic.fourier import NOTHING, Period, fundamental

__all__ = [
    "BELIEVED",
    "MARGIN",
    "PER_PERIOD",
    "ROUNDING",
    "Evidence",
    "below_scale",
    "beyond",
    "buried",
    "error_of_limit",
    "error_of_mean",
    "follows",
    "of_integration",
    "quadrature",
    "relative_to_true",
    "wanders",
]

# One period's integration at a relative tolerance ε turns the multipliers by less than this many ε: the
# largest of 30 resonances with both solvers at 1e-4 … 1e-8 was 73.
_INTEGRATION = 100.0

# Those periods had up to so many steps: light modes much faster than the sine make thousands of a period.
_STEPS = 300.0

# The integration gets the sum of terms that cancel wrong by less than so many relative tolerances of the terms: the
# largest of 48 runs at 12 zeros of transmission, with both solvers at 1e-6 and 1e-8, was 17.
_CANCELLED = 20.0

# In a period the integration moves a state by so many times the tolerance of its size at most; see `_INTEGRATION`.
PER_PERIOD = 30.0

# What rounding leaves of the sums over a period and of terms that cancel, relative to the largest.
ROUNDING = 2e-14

# From two periods alone nothing is known of the multipliers: the slowest mode is assumed to need this many.
_UNKNOWN = 1000.0

# The newest changes show the slowest multiplier, and the last step what another one would change, only so well.
MARGIN = 2.0

# A linear model whose periods are the measured ones to this part of the response describes the resonance, too.
_ALIKE = 0.1

# An error of an extrapolated response above this is a guess: of 200 such errors of lightly damped plants without a
# linear model 37 % held.
BELIEVED = 0.02

# One older change checks a multiplier that nothing else does, and so many more where they are.
_CHECKS = 2

# The mean of a transient that is known is known to this.
_CLEAR = 1.2

# Periods that wander have von Neumann's ratio above this; of fewer than so many nothing is said.
_ROUGH, _FEWEST_WANDERING = 0.5, 4

# From this harmonic on the tail tells of jumps and kinks.
_TAIL = 6


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of a point besides its periods.

    Attributes:
        twin: the linear model under the same sine; None: there is none.
        beat: rhythm of the forcing and the model's sampling; None: it does not sample, or at several rates, or
            that is not known.
        sampled: whether the model is known to sample, at whatever rates.
        rtol: relative tolerance of the integration; 0: nothing is integrated, or not by the workbench.
        rows: samples per period.
        rough: what edges between two rows may put into a coefficient [unit of the output].
    """

    twin: Twin | None = None
    beat: Beat | None = None
    sampled: bool = False
    rtol: float = 0.0
    rows: int = 200
    rough: float = 0.0

    def over(self, period: Period) -> Evidence:
        """Return the same for a period: the errors of its steps add up as a random walk, until forgotten."""
        memory = 1.0 if self.twin is None else self.twin.forced.memory
        rtol = self.rtol * math.sqrt(max(1.0, memory * period.steps / _STEPS))
        return replace(self, rtol=rtol, rough=period.rough)

    def floor(self, drive: float, largest: float) -> float:
        """Return the fundamental of the output below which it counts as none [unit of the output].

        That is rounding of the output, and of the terms that the linear model adds up to the output, and the
        integration error of these terms where the linear model has no response.

        Args:
            drive: amplitude of the forced input.
            largest: largest magnitude of the output, [unit of the output].
        """
        if self.twin is None:
            return NOTHING * largest
        terms = drive * self.twin.forced.terms
        return max(NOTHING * max(largest, terms), _CANCELLED * self.rtol * terms if self.twin.forced.vanishes else 0.0)


def error_of_limit(limit: Limit, drive: float, largest: float, evidence: Evidence) -> float:
    """Return the error of an extrapolated response, relative to the true one.

    What is left of the transient changes the response by the defect δ in the next period and so, with the
    slowest multiplier μ, by δ/|1 − μ| in all periods to come. μ is found as the weights are, from the newest
    differences, with one mode more than were removed: what these leave unexplained may be slower than they.
    In a nonlinear model a transient a·μ^k also moves the response itself, by its power |a|²·|μ|^(2k) to second order,
    which is slower than a mode that turns: see `slowness_of_products`.
    A sampler's beat has multipliers e^(jnθ), known and on the unit circle: what it changes in a period may be little of
    what it changes in a whole beat.
    Where the linear model goes through the same periods, the weights applied to its transient, which is
    known, give their error directly; what tells the two sequences apart is weighed at worst.

    To that are added the integration, which turns the multipliers by some 100 relative tolerances and moves
    the response by 1/|1 − μ| of that, more so where the terms that the output is the sum of cancel, and the
    trapezoidal rule at jumps and kinks.

    Args:
        limit: the extrapolation.
        drive: amplitude of the forced input.
        largest: largest magnitude of the output, [unit of the output].
        evidence: what else is known.
    """
    size = abs(fundamental(limit.harmonics))
    if size == 0.0:
        return math.inf
    slowest = max(
        slowness(limit, evidence.twin),
        slowness_of_products(limit),
        1.0 if evidence.beat is None else evidence.beat.slowness,
    )
    measured = MARGIN * max(limit.defect, _unchecked(limit, sampled=evidence.sampled)) * slowest
    transient, slow = measured, slowness(limit, None)
    if evidence.twin is not None:
        known, apart = _by_twin(limit, drive, evidence.twin)
        transient = min(known + apart, max(measured, known))
        if apart <= _ALIKE:
            slow = 1.0 + evidence.twin.forced.sensitivity
    forced = None if evidence.twin is None else evidence.twin.forced
    integration = of_integration(forced, evidence.rtol, slow, drive=drive, size=size, largest=largest)
    return relative_to_true(transient + integration + quadrature(limit.harmonics, evidence))


def of_integration(
    forced: LinearSineResponse | None, rtol: float, slow: float, *, drive: float, size: float, largest: float
) -> float:
    """Return what integration and rounding get wrong of a response, relative to it.

    The multipliers turn, terms that cancel leave their errors, and states may move by less than the solver looks at.

    Args:
        forced: the linear model under the sine; None: not known, nor then the last two parts.
        rtol: relative tolerance of the integration.
        slow: 1/|1 − μ| for the slowest multiplier μ that the response shows.
        drive: amplitude of the forced input.
        size: of the output's fundamental [its unit].
        largest: largest magnitude of the output [its unit].
    """
    result = _INTEGRATION * rtol * slow * max(1.0, largest / size)
    return result + _cancelled(forced, rtol, drive, size) + below_scale(forced, rtol, size)


def below_scale(forced: LinearSineResponse | None, rtol: float, size: float) -> float:
    """Return the error of a response of that size where the states move by less than what the solver looks at."""
    return 0.0 if forced is None else PER_PERIOD * rtol * forced.smallest / size


def _cancelled(forced: LinearSineResponse | None, rtol: float, drive: float, size: float) -> float:
    """Return what integration and rounding leave of terms that cancel, relative to a response of that size."""
    return 0.0 if forced is None else _CANCELLED * max(rtol, ROUNDING) * max(0.0, drive * forced.terms / size - 1.0)


def _unchecked(limit: Limit, *, sampled: bool) -> float:
    """Return what the weights leave of changes that they were not made from, where nothing else checks them.

    Where all harmonics change in proportion, they are one number only, and one mode explains any two changes. A beat
    may look like a decay in a few changes, in all harmonics.
    """
    n, changes = limit.weights.size, limit.changes
    if n == 1 or (directions(changes[: 2 * n - 2]) > 1 and not sampled):
        return 0.0
    older = range(n - 1, min(n + _CHECKS, len(changes) - n + 1))
    if not older:
        return math.inf
    left = max(float(np.linalg.norm((limit.weights @ changes[i : i + n])[1:])) for i in older)
    return left / abs(fundamental(limit.harmonics))


def _by_twin(limit: Limit, drive: float, twin: Twin) -> tuple[float, float]:
    """Return the error of the weights on the twin's transient, and what tells the twin from the model, weighed."""
    count, n = len(limit.periods), limit.weights.size
    free = drive * twin.free(count)
    size = abs(fundamental(limit.harmonics))
    # The newest period may happen to lie where the error passes through zero.
    ends = range(count, max(n, count - 3), -1)
    errors = [abs(fundamental(weigh(free[:end], limit.weights))) for end in ends]
    weight = float(np.sum(np.abs(limit.weights)))
    return MARGIN * max(errors) / size, weight * _apart(limit, drive, twin, n + 1) / size


def _apart(limit: Limit, drive: float, twin: Twin, newest: int) -> float:
    """Return the largest distance of the fundamentals of model and twin in the newest periods [unit of the output]."""
    free = drive * twin.free(len(limit.periods))
    foretold = free[:, 1] + 1j * free[:, 2] + drive * twin.forced.response
    return float(np.max(np.abs(limit.periods[:, 1] + 1j * limit.periods[:, 2] - foretold)[-newest:]))


def slowness(limit: Limit, twin: Twin | None) -> float:
    """Return 1/|1 − μ| for the slowest multiplier that the newest changes show, at least 1.

    Args:
        limit: the extrapolation.
        twin: stands in where two periods show nothing; None: 1000 does.
    """
    gaps = [
        min(abs(1.0 - mu) for mu in multipliers(limit.changes, modes))
        for modes in _looked_for(limit.modes)
        if modes >= 1 and 2 * modes <= len(limit.changes)
    ]
    if not gaps:
        return _UNKNOWN if twin is None or twin.forced.vanishes else 1.0 + twin.forced.sensitivity
    return max(1.0, 1.0 / max(min(gaps), 1e-12))


def _looked_for(removed: int) -> Iterator[int]:
    """Yield with how many modes the slowest multiplier is looked for, where so many were removed.

    Where no mode could be removed, one alone may be the mixture of a slow one with quicker ones that hide it.
    """
    yield from range(removed, removed + 2) if removed else range(1, MOST_MODES + 1)


def slowness_of_products(limit: Limit) -> float:
    """Return 1/(1 − |μ|²) for the slowest of the multipliers that were removed, at least 1.

    With the transient still alive, a nonlinear model is another one: a spring is stiffer or softer while it also swings
    freely. The shift of the forced response goes with the power of the free motion, so its multiplier μ·μ* is real,
    and decays within 1/(1 − |μ|²) periods, without turning. The weights, which were made for μ, leave of it what the
    defect shows of one period. For real positive μ this is quicker than the mode itself.

    Source: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, 4.1 (free and forced terms in the same equation).
    """
    if limit.modes == 0:
        return 1.0
    largest = max(abs(mu) for mu in multipliers(limit.changes, limit.modes))
    return max(1.0, 1.0 / max(1.0 - largest**2, 1e-12))


def quadrature(harmonics: Floats, evidence: Evidence) -> float:
    """Return the error of the trapezoidal rule at jumps and kinks, relative to the fundamental.

    A step of the slope by κ [per rad] between two rows costs up to h²κ/12, with h = 2π/rows, and leaves harmonics of
    2κ/(πn²); so κ is bounded by the largest n²·|c(n)| of the measured tail. An edge that begins and ends between two
    rows looks like a jump in the tail, and costs up to half a row of its height: what the rows' fourth differences say.
    For a smooth output both are next to nothing.
    """
    amplitudes = np.hypot(harmonics[1::2], harmonics[2::2])
    if len(amplitudes) < _TAIL or amplitudes[0] == 0.0:
        return 0.0
    orders = np.arange(_TAIL, len(amplitudes) + 1)
    kink = 0.5 * math.pi * float(np.max(orders**2 * amplitudes[_TAIL - 1 :])) / float(amplitudes[0])
    return max((2.0 * math.pi / evidence.rows) ** 2 / 12.0 * kink, evidence.rough / float(amplitudes[0]))


def beyond(limit: Limit) -> float:
    """Return how many times larger the extrapolated response is than any that was measured."""
    reached = float(np.max(np.hypot(limit.periods[:, 1], limit.periods[:, 2])))
    return abs(fundamental(limit.harmonics)) / reached if reached > 0.0 else math.inf


def error_of_mean(limit: Limit, drive: float, error: float, evidence: Evidence) -> float:
    """Return the error of the mean of the last half of the periods, relative to the true response.

    Where the linear model goes through the same periods, it is the mean of its transient, which may be many times its
    response. Else the smaller one of
    two: the distance from the extrapolated response, where that is known; and, for periods that wander about their
    mean (sampling beats, noise), what `_wandering` says.

    Args:
        limit: what the periods tend to.
        drive: amplitude of the forced input.
        error: of the limit, relative to it.
        evidence: what else is known.
    """
    periods = levelled(limit.periods)
    z = periods[:, 1] + 1j * periods[:, 2]
    half = z[len(z) // 2 :]
    mean = complex(np.mean(half))
    if mean == 0.0 or len(half) < 2:
        return math.inf
    if evidence.twin is not None:
        size, left = drive * abs(evidence.twin.forced.response), _left(limit, drive, evidence.twin)
        apart = _apart(limit, drive, evidence.twin, len(half))
        if size > 0.0 and apart <= _ALIKE * min(max(size, left), abs(mean)):
            return (_CLEAR * left + apart * len(half)) / size
    forced = None if evidence.twin is None else evidence.twin.forced
    wandering = _wandering(z) + _cancelled(forced, evidence.rtol, drive, abs(mean)) + ramp(periods) / abs(mean)
    extrapolated = fundamental(limit.harmonics)
    if error > BELIEVED or extrapolated == 0.0:
        return wandering
    return min(wandering, (abs(mean - extrapolated) / abs(extrapolated) + error) / (1.0 - error))


def buried(limit: Limit, drive: float, evidence: Evidence) -> bool:
    """Return whether the linear model goes through the periods, and what they show is its transient, not its response.

    Args:
        limit: what the periods tend to.
        drive: amplitude of the forced input.
        evidence: what else is known.
    """
    if evidence.twin is None:
        return False
    left, count = _left(limit, drive, evidence.twin), len(limit.periods)
    alike = _apart(limit, drive, evidence.twin, count - count // 2) <= _ALIKE * left
    return alike and left > drive * abs(evidence.twin.forced.response)


def follows(limit: Limit, drive: float, evidence: Evidence, within: float = _ALIKE) -> bool:
    """Return whether the newest half of the periods is what the linear model does, to a part of its motion.

    Args:
        limit: what the periods tend to.
        drive: amplitude of the forced input.
        evidence: what else is known.
        within: that part.
    """
    if evidence.twin is None:
        return False
    size = max(drive * abs(evidence.twin.forced.response), _left(limit, drive, evidence.twin))
    return _apart(limit, drive, evidence.twin, len(limit.periods) // 2) <= within * size


def wanders(limit: Limit) -> bool:
    """Return whether the periods go to and fro, as independent ones do, and do not move smoothly."""
    return _is_rough(limit.periods[:, 1] + 1j * limit.periods[:, 2])


def _left(limit: Limit, drive: float, twin: Twin) -> float:
    """Return the mean of the linear model's transient over the last half of the periods [unit of the output]."""
    count = len(limit.periods)
    return drive * abs(fundamental(np.mean(twin.free(count)[count // 2 :], axis=0)))


def _wandering(z: NDArray[np.complex128]) -> float:
    """Return the error of the mean of the last half of periods that wander about it, relative to the true response.

    The sum of three: the standard error, the distance of the means of both halves of that half, and of
    the mean of the periods before. This holds for periods that do not remember the one before, and says nothing of
    slow modes, several of which together look like fewer quick ones. Both are told apart by
    von Neumann's ratio Σ|z(k+1) − z(k)|² / 2Σ|z(k) − mean|²: about 1 for independent periods, more for those that
    alternate, small for those that move smoothly. (Tried on 1700
    random plants and sequences with sampling or noise, of 20 periods each, it held in more than 95 % of each kind.)

    Args:
        z: fundamentals of all periods.

    Source: J. von Neumann, Distribution of the ratio of the mean square successive difference to the variance,
    Annals of Mathematical Statistics 12 (1941), 367-395.
    """
    half, before = np.split(z, [len(z) // 2])[::-1]
    before = before[BEGIN:]
    if len(half) < _FEWEST_WANDERING or len(before) == 0:
        return math.inf
    if not _is_rough(z):
        return math.inf
    mean, count = complex(np.mean(half)), len(half)
    scatter = math.sqrt(float(np.mean(np.abs(half - mean) ** 2)))
    error = scatter / math.sqrt(count) + abs(mean - complex(np.mean(before)))
    error += abs(complex(np.mean(half[count // 2 :]) - np.mean(half[: count // 2])))
    return relative_to_true(error / abs(mean))


def _is_rough(z: NDArray[np.complex128]) -> bool:
    """Whether von Neumann's ratio tells that periods go to and fro."""
    return min(_roughness(z[len(z) // 2 :]), _roughness(z[BEGIN:])) >= _ROUGH


def _roughness(z: NDArray[np.complex128]) -> float:
    """Return von Neumann's ratio; inf where all are the same."""
    variance = float(np.mean(np.abs(z - np.mean(z)) ** 2))
    return float(np.mean(np.abs(np.diff(z)) ** 2)) / (2.0 * variance) if variance > 0.0 else math.inf


def relative_to_true(error: float) -> float:
    """Turn an error relative to the measured value into one relative to the true one."""
    return error / (1.0 - error) if error < 1.0 else math.inf
