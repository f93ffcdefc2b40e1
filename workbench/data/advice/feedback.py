"""Do the inputs react to the outputs?

In open loop the inputs know nothing of past prediction errors. So the part of u that its own past does not foretell
must not correlate with earlier residuals of the long equation. The residuals are white and, in open loop,
independent of the whole input; then the correlations are normal whatever the input is. Slow disturbances show better
in the whole of what the inputs do not explain, one sample before: that is tested besides
(L. Ljung, System Identification, 2nd ed., sections 13.4 and 16.6).

Without noise feedback cannot be seen in this way: there are no errors to react to. Nor can a reaction within the
sample, such as that of a digital controller that turns y[k] into u[k] at once, where the noise is white: it looks like
a direct feedthrough of the plant. It is told from one only if the plant is known to have none, or if the input is fixed
by its first values, as the sequence of a shift register is; else the verdict is "unknown".
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import linalg, special

from workbench.core.values.arrays import Floats
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import CHANCE, DataStudy
from workbench.data.long_arx import lagged

__all__ = ["from_shift_register", "judge_feedback", "linear_complexity"]

_LAGS = 10
_LEAST_SHARE = 0.005  # of the unforeseen input that past errors explain
_ADVICE = (
    "open the loop, or identify with closed_loop=direct, or with the name of a recorded reference; "
    "simulation-based and MOESP fits are biased"
)
_SPAN = 100  # lags over which correlations of the input with itself count


def reactions(study: DataStudy) -> tuple[Floats, float, float]:
    """Return correlations of each input with past residuals, the probability of open loop, and the share explained.

    The correlations have shape (lags, m, p): [τ − 1, j, i] of input j with residual i, τ samples before; the
    probability is the smallest over the inputs and outputs, times their number.
    """
    first = study.arx.lags
    e = study.arx.residual[:, study.varying_outputs]
    rest = (study.y - study.explained)[first:, study.varying_outputs]
    u = study.u[first:, study.varying_inputs]
    correlation = np.zeros((_LAGS, u.shape[1], e.shape[1]))
    probability, share = 1.0, 0.0
    for j in range(u.shape[1]):
        v = _unforeseen(u, j)
        if v is None:
            continue
        start = len(u) - len(v)
        for i in range(e.shape[1]):
            past = lagged(e[:, [i]], 1, _LAGS, start)
            correlation[:, j, i], p, s = _react(v, past)
            slow = _react_slowly(v, rest[start - 1 : -1, i])
            pairs = 2.0 * u.shape[1] * e.shape[1]
            probability = min(probability, pairs * p, pairs * slow[0])
            share = max(share, s, slow[1])
    return correlation, min(probability, 1.0), share


def judge_feedback(study: DataStudy) -> Finding:
    """Judge whether the inputs react to earlier residuals."""
    if not study.varying_inputs or not study.varying_outputs:
        return Finding("feedback", "unknown", "nothing moves")
    if study.arx.exact:
        return Finding("feedback", "unknown", "there is no noise that an input could react to")
    correlation, probability, share = reactions(study)
    at_once, together = _within_sample(study)
    values = {
        "probability_open_loop": probability, "share_of_input": share, "correlation": correlation.tolist(),
        "probability_nothing_at_once": at_once, "share_at_once": together,
    }  # fmt: skip
    if probability < CHANCE and share > _LEAST_SHARE:
        _, j, _ = np.unravel_index(int(np.argmax(np.abs(correlation))), correlation.shape)
        name = study.experiment.input_names[study.varying_inputs[int(j)]]
        evidence = f"{name} reacts to earlier disturbances of the outputs ({100 * share:.1f} % of what is new in it)"
        return Finding("feedback", "poor", evidence, _ADVICE, values)
    if at_once < CHANCE and together > _LEAST_SHARE:
        return _judge_at_once(study, values)
    return Finding("feedback", "good", "the inputs do not react to the outputs' disturbances", "", values)


def _judge_at_once(study: DataStudy, values: dict[str, Any]) -> Finding:
    """Judge inputs and outputs that move together within a sample."""
    if not study.feedthrough:
        evidence = "inputs and outputs move together within a sample, and the plant has no direct feedthrough"
        return Finding("feedback", "poor", evidence, _ADVICE, values)
    if all(from_shift_register(study.u[:, j]) for j in study.varying_inputs):
        evidence = "the inputs are pseudo-random binary sequences, which do not react to anything"
        return Finding("feedback", "good", evidence, "", values)
    evidence = (
        "inputs and outputs move together within a sample: a direct feedthrough of the plant, or a controller that "
        "reacts at once; these data cannot tell"
    )
    advice = "if the plant has no direct feedthrough, say so (`feedthrough=False`)"
    return Finding("feedback", "unknown", evidence, advice, values)


def _within_sample(study: DataStudy) -> tuple[float, float]:
    """Return how well inputs and outputs go together beyond what the past of both tells.

    The probability that nothing connects them within the sample, times the number of pairs, and the largest square of
    their correlation.
    """
    lags = study.arx.lags
    u, y = study.u[:, study.varying_inputs], study.y[:, study.varying_outputs]
    past = np.hstack([lagged(y, 1, lags, lags), lagged(u, 1, lags, lags)])
    now = np.hstack([y, u])[lags:]
    left = now - past @ linalg.lstsq(past, now, cond=1e-11, lapack_driver="gelsy")[0]
    spread, size = np.std(left, axis=0), np.std(now, axis=0)
    alive = spread > 1e-4 * size  # an input that its past foretells has nothing of its own
    normal = np.where(alive, left / np.where(alive, spread, 1.0), 0.0)
    together = float(np.max((normal[:, : y.shape[1]].T @ normal[:, y.shape[1] :] / len(normal)) ** 2))
    pairs = y.shape[1] * u.shape[1]
    return min(1.0, pairs * float(special.chdtrc(1, together * (len(normal) - past.shape[1])))), together


def _unforeseen(u: Floats, column: int) -> Floats | None:
    """Return the part of an input that the past of all does not foretell; None: nothing, or too short a record."""
    lags = max(_LAGS, min(20, len(u) // (8 * u.shape[1])))
    if len(u) < 3 * lags * (1 + u.shape[1]):
        return None
    past = lagged(u, 1, lags, lags)
    target = u[lags:, column]
    theta = linalg.lstsq(past, target, cond=1e-9, lapack_driver="gelsy")[0]
    v = np.asarray(target - past @ theta)
    return v if np.std(v) > 1e-4 * np.std(target) else None


def _react(v: Floats, past: Floats) -> tuple[Floats, float, float]:
    """Return the correlations with the past errors, their probability by chance and the share they explain."""
    past = past - past.mean(axis=0)
    v = v - v.mean()
    # The sums Σ v e are normal with the covariance that v's own correlation gives them.
    size = np.sqrt(np.sum(v**2) * np.sum(past**2, axis=0))
    r = past.T @ v / np.maximum(size, 1e-300)
    own = np.array([v[lag:] @ v[: len(v) - lag] for lag in range(len(r))]) / (v @ v)
    covariance = linalg.toeplitz(own) / len(v)
    statistic = float(r @ linalg.solve(covariance + 1e-9 * np.eye(len(r)) / len(v), r, assume_a="pos"))
    return r, float(special.chdtrc(len(r), statistic)), float(statistic / len(v))


def _react_slowly(v: Floats, before: Floats) -> tuple[float, float]:
    """Return probability and share for the unexplained output one sample before, which gathers slow disturbances.

    Of two independent signals the sum Σ v w has the variance n Σ R_v R_w.
    """
    v, w = v - v.mean(), before - before.mean()
    size = np.sqrt((v @ v) * (w @ w))
    if size <= 0.0:
        return 1.0, 0.0
    r = float(v @ w / size)
    lags = range(1, min(_SPAN, len(v) // 4))
    both = [(v[k:] @ v[:-k]) * (w[k:] @ w[:-k]) / size**2 for k in lags]
    variance = max(1.0 + 2.0 * sum(both), 0.3) / len(v)
    return float(special.chdtrc(1, r**2 / variance)), r**2


# -- is a two-level signal the sequence of a shift register ---------------------------------------

# Such a sequence is fixed by its first few values: it can react to nothing. The Berlekamp-Massey algorithm finds the
# shortest linear recurrence modulo 2 that gives the whole of it; its order is about half the length of what chance or
# a controller makes, and small for a pseudo-random binary sequence, also one that is held or sampled at another rate.
# A limit cycle of a relay repeats itself too, but not by a recurrence that is short against its period: with two
# switches a period the order is half the period or more. Source: J. L. Massey, Shift-register synthesis and BCH
# decoding, IEEE Trans. Inf. Theory 15 (1969).
_SAME = 1e-6  # of the range: levels closer than that are one
_CONFIRMED = 64  # samples beyond those that fix the recurrence; chance confirms them once in 2⁶⁴
_PER_PERIOD = 1 / 3  # of the period: most that the order of the recurrence may be


def from_shift_register(u: Floats) -> bool:
    """Return whether a signal is a sequence of two levels that a short recurrence gives as a whole.

    Args:
        u: shape (n,).
    """
    low, high = float(np.min(u)), float(np.max(u))
    upper = np.abs(u - high) <= _SAME * (high - low)
    if not high > low or not np.all(upper | (np.abs(u - low) <= _SAME * (high - low))):
        return False
    bits = upper.astype(np.uint8)
    order = linear_complexity(bits.tolist())
    return 2 * order + _CONFIRMED <= len(bits) and order <= _PER_PERIOD * _period(bits)


def linear_complexity(bits: list[int]) -> int:
    """Return the order of the shortest linear recurrence modulo 2 that gives a sequence of 0 and 1.

    Args:
        bits: the sequence.
    """
    recurrence, earlier, order, since, past = 1, 1, 0, 1, 0  # polynomials as integers, one bit a coefficient
    for count, bit in enumerate(bits):
        past = past << 1 | bit
        if not (recurrence & past).bit_count() & 1:
            since += 1
            continue
        corrected = recurrence ^ earlier << since
        if 2 * order <= count:
            order, earlier, since = count + 1 - order, recurrence, 1
        else:
            since += 1
        recurrence = corrected
    return order


def _period(bits: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> int:
    """Return after how many samples the sequence repeats itself; its length if it does not."""
    for shift in range(1, len(bits) - _CONFIRMED):
        if np.array_equal(bits[shift:], bits[:-shift]):
            return shift
    return len(bits)
