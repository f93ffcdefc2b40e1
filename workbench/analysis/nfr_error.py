"""The error of a periodic response that was extrapolated, or averaged, from a run of a few periods."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.analysis.harmonics import fundamental
from workbench.analysis.nfr_beats import Beat
from workbench.analysis.nfr_linear import Twin
from workbench.analysis.transient import Limit, multipliers, weigh
from workbench.session.base import Floats

__all__ = ["INTEGRATION", "Evidence", "beyond", "error_of_limit", "error_of_mean", "relative_to_true"]

# One period's integration at a relative tolerance ε turns the multipliers by less than this many ε: the
# largest of 30 resonances with both solvers at 1e-4 … 1e-8 was 73.
INTEGRATION = 100.0

# From two periods alone nothing is known of the multipliers: the slowest mode is assumed to need this many.
_UNKNOWN = 1000.0

# The newest changes show the slowest multiplier only so well.
_MARGIN = 2.0

# A linear model whose periods are the measured ones to this part of the response describes the resonance, too.
_ALIKE = 0.1

# An extrapolated response that is known no better is no mark to measure from.
_USELESS = 0.1

# One older change checks a multiplier that nothing else does, and so many more where they are.
_CHECKS = 2

# Changes that differ in direction by less than this are one.
_ONE = 1e-6

# The mean of a transient that is known is known to this.
_CLEAR = 1.2

# Decaying modes that are looked for in periods that wander.
_MOST_MODES = 5

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
    """

    twin: Twin | None = None
    beat: Beat | None = None
    sampled: bool = False
    rtol: float = 0.0
    rows: int = 200


def error_of_limit(limit: Limit, drive: float, largest: float, evidence: Evidence) -> float:
    """Return the error of an extrapolated response, relative to the true one.

    What is left of the transient changes the response by the defect δ in the next period and so, with the
    slowest multiplier μ, by δ/|1 − μ| in all periods to come. μ is found as the weights are, from the newest
    differences, with one mode more than were removed: what these leave unexplained may be slower than they.
    Where the linear model goes through the same periods, the weights applied to its transient, which is
    known, give their error directly; what tells the two sequences apart is weighed at worst.

    To that are added the integration, which turns the multipliers by some 100 relative tolerances and moves
    the response by 1/|1 − μ| of that, and the trapezoidal rule at jumps and kinks.

    Args:
        limit: the extrapolation.
        drive: amplitude of the forced input.
        largest: largest magnitude of the output, [unit of the output].
        evidence: what else is known.
    """
    size = abs(fundamental(limit.harmonics))
    if size == 0.0:
        return math.inf
    measured = _MARGIN * max(limit.defect, _unchecked(limit)) * slowness(limit, evidence.twin)
    transient, slow = measured, slowness(limit, None)
    if evidence.twin is not None:
        known, apart = _by_twin(limit, drive, evidence.twin)
        transient = min(known + apart, max(measured, known))
        if apart <= _ALIKE:
            slow = 1.0 + evidence.twin.sensitivity
    integration = INTEGRATION * evidence.rtol * slow * max(1.0, largest / size)
    return relative_to_true(transient + integration + quadrature(limit.harmonics, evidence.rows))


def _unchecked(limit: Limit) -> float:
    """Return what the weights leave of a change that they were not made from, where nothing else checks them.

    Where all harmonics change in proportion, they are one harmonic only, and m modes explain any 2m changes. Different
    modes differ in their harmonics, so that several in proportion are an accident.
    """
    n, changes = limit.weights.size, limit.changes
    if n == 1 or np.linalg.matrix_rank(changes[: 2 * n - 2], tol=_ONE * float(np.linalg.norm(changes[0]))) > 1:
        return 0.0
    if n > 2 or len(changes) < 3:
        return math.inf
    older = range(1, min(2 + _CHECKS, len(changes) - 1))
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
    return _MARGIN * max(errors) / size, weight * _apart(limit, drive, twin, n + 1) / size


def _apart(limit: Limit, drive: float, twin: Twin, newest: int) -> float:
    """Return the largest distance of the fundamentals of model and twin in the newest periods [unit of the output]."""
    free = drive * twin.free(len(limit.periods))
    foretold = free[:, 1] + 1j * free[:, 2] + drive * twin.response
    return float(np.max(np.abs(limit.periods[:, 1] + 1j * limit.periods[:, 2] - foretold)[-newest:]))


def slowness(limit: Limit, twin: Twin | None) -> float:
    """Return 1/|1 − μ| for the slowest multiplier that the newest changes show, at least 1.

    Args:
        limit: the extrapolation.
        twin: stands in where two periods show nothing; None: 1000 does.
    """
    gaps = [
        float(np.min(np.abs(1.0 - multipliers(limit.changes, modes))))
        for modes in (limit.modes, limit.modes + 1)
        if modes >= 1 and 2 * modes <= len(limit.changes)
    ]
    if not gaps:
        return _UNKNOWN if twin is None else 1.0 + twin.sensitivity
    return max(1.0, 1.0 / max(min(gaps), 1e-12))


def quadrature(harmonics: Floats, rows: int) -> float:
    """Return the error of the trapezoidal rule at jumps and kinks, relative to the fundamental.

    A step of the slope by κ [per rad] between two rows costs up to h²κ/12, with h = 2π/rows, and leaves harmonics of
    2κ/(πn²); so κ is bounded by the largest n²·|c(n)| of the measured tail. For jumps (c(n) ~ 1/n) that is ten
    times too much, for a smooth output nothing.
    """
    amplitudes = np.hypot(harmonics[1::2], harmonics[2::2])
    if len(amplitudes) < _TAIL or amplitudes[0] == 0.0:
        return 0.0
    orders = np.arange(_TAIL, len(amplitudes) + 1)
    kink = 0.5 * math.pi * float(np.max(orders**2 * amplitudes[_TAIL - 1 :])) / float(amplitudes[0])
    return (2.0 * math.pi / rows) ** 2 / 12.0 * kink


def beyond(limit: Limit) -> float:
    """Return how many times larger the extrapolated response is than any that was measured."""
    reached = float(np.max(np.hypot(limit.periods[:, 1], limit.periods[:, 2])))
    return abs(fundamental(limit.harmonics)) / reached if reached > 0.0 else math.inf


def error_of_mean(limit: Limit, drive: float, error: float, evidence: Evidence) -> float:
    """Return the error of the mean of the last half of the periods, relative to the true response.

    Where the linear model goes through the same periods, it is the mean of its transient. Else it is not known, but for
    sampled models, whose periods wander about their mean (beats): the smaller one of the distance from the
    extrapolated response, as far as that is known, and of the distance of the means of both halves, with the standard
    error. This says nothing where the periods move so slowly that less than two radians of a beat, or two time
    constants of a decay, were seen: the error is then not known, either. (Of 116 lightly damped plants without a
    linear model these estimates held 54: several slow modes together look like fewer quick ones.)

    Args:
        limit: what the periods tend to.
        drive: amplitude of the forced input.
        error: of the limit, relative to it.
        evidence: what else is known.
    """
    half = limit.periods[len(limit.periods) // 2 :]
    z = half[:, 1] + 1j * half[:, 2]
    mean = complex(np.mean(z))
    if mean == 0.0 or len(z) < 2:
        return math.inf
    if evidence.twin is not None:
        size = drive * abs(evidence.twin.response)
        apart = _apart(limit, drive, evidence.twin, len(z))
        if apart <= _ALIKE * min(size, abs(mean)):
            left = drive * abs(fundamental(np.mean(evidence.twin.free(len(limit.periods))[-len(z) :], axis=0)))
            return (_CLEAR * left + apart * len(z)) / size
    if not evidence.sampled:
        return math.inf
    wandering = _wandering(z, slowest(limit.changes))
    extrapolated = fundamental(limit.harmonics)
    if error >= _USELESS or extrapolated == 0.0:
        return wandering
    return min(wandering, (abs(mean - extrapolated) / abs(extrapolated) + error) / (1.0 - error))


def _wandering(z: NDArray[np.complex128], slow: float) -> float:
    """Return the error of the mean of periods that wander, relative to the true one; `slow` is 1/|1 − μ|."""
    mean, count = complex(np.mean(z)), len(z)
    scatter = math.sqrt(float(np.mean(np.abs(z - mean) ** 2)))
    error = abs(complex(np.mean(z[count // 2 :]) - np.mean(z[: count // 2]))) + scatter / math.sqrt(count)
    return relative_to_true(error / abs(mean)) if slow <= 0.5 * count else math.inf


def slowest(changes: Floats) -> float:
    """Return 1/|1 − μ| for the slowest multiplier in any description of the newest changes, at least 1."""
    most = min(_MOST_MODES, len(changes) // 2)
    gaps = [float(np.min(np.abs(1.0 - multipliers(changes, modes)))) for modes in range(1, most + 1)]
    return max(1.0, 1.0 / max(min(gaps), 1e-12)) if gaps else _UNKNOWN


def relative_to_true(error: float) -> float:
    """Turn an error relative to the measured value into one relative to the true one."""
    return error / (1.0 - error) if error < 1.0 else math.inf
