"""Do the inputs react to the outputs?

In open loop the inputs know nothing of past prediction errors. So the part of u that its own past does not foretell
must not correlate with earlier residuals of the long equation. The residuals are white and, in open loop,
independent of the whole input; then the correlations are normal whatever the input is
(L. Ljung, System Identification, 2nd ed., sections 13.4 and 16.6).

Feedback without any noise cannot be seen so: there are no errors to react to.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg, stats

from workbench.analysis.advice.result import Finding
from workbench.analysis.advice.study import Study
from workbench.analysis.long_arx import lagged
from workbench.session.base import Floats

__all__ = ["judge_feedback", "reactions"]

_LAGS = 10
_CERTAIN = 1e-5  # probability of a false alarm
_LEAST_SHARE = 0.01  # of the unforeseen input that past errors explain


def reactions(study: Study) -> tuple[Floats, float, float]:
    """Return correlations of each input with past residuals, the probability of open loop, and the share explained.

    The correlations have shape (lags, m, p): [τ − 1, j, i] of input j with residual i, τ samples before; the
    probability is the smallest over the inputs and outputs, times their number.
    """
    e = study.arx.residual[:, study.varying_outputs]
    u = study.u[study.arx.lags :, study.varying_inputs]
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
            probability, share = min(probability, p * u.shape[1] * e.shape[1]), max(share, s)
    return correlation, min(probability, 1.0), share


def judge_feedback(study: Study) -> Finding:
    """Judge whether the inputs react to earlier residuals."""
    if not study.varying_inputs or not study.varying_outputs:
        return Finding("feedback", "unknown", "nothing moves")
    if study.arx.exact:
        return Finding("feedback", "unknown", "there is no noise that an input could react to")
    correlation, probability, share = reactions(study)
    values = {"probability_open_loop": probability, "share_of_input": share, "correlation": correlation.tolist()}
    if probability < _CERTAIN and share > _LEAST_SHARE:
        _, j, _ = np.unravel_index(int(np.argmax(np.abs(correlation))), correlation.shape)
        name = study.experiment.input_names[study.varying_inputs[int(j)]]
        evidence = f"{name} reacts to earlier disturbances of the outputs ({100 * share:.1f} % of what is new in it)"
        advice = "open the loop or add a known excitation; simulation-based and MOESP fits will be biased"
        return Finding("feedback", "poor", evidence, advice, values)
    return Finding("feedback", "good", "the inputs do not react to the outputs' disturbances", "", values)


def _unforeseen(u: Floats, column: int) -> Floats | None:
    """Return the part of an input that the past of all does not foretell; None where it foretells everything."""
    lags = max(2, min(20, len(u) // (8 * u.shape[1])))
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
    return r, float(stats.chi2.sf(statistic, len(r))), float(statistic / len(v))
