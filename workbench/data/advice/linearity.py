"""Is what a linear model leaves over noise or nonlinear distortion?

Coherence below one says that something is left over. Whether it depends on the inputs is tested by adding nonlinear
terms of the linear prediction to the long equation: under linearity they explain nothing beyond chance (J. B. Ramsey,
J. Royal Stat. Soc. B 31 (1969) 350–371, applied to dynamic models). An F test on white residuals decides.
"""

from __future__ import annotations

import numpy as np
from scipy import special

from workbench.core.values.arrays import Floats
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import CHANCE, DataStudy
from workbench.data.long_arx import LongArx, lagged

__all__ = ["distortion", "judge_linearity", "judge_noise"]

_LEAST_SHARE = 0.01  # of the residual that the nonlinear terms explain
_LOW = 0.9  # coherence
_MUCH = 0.25  # of the excited band
_LINEAR_DB = 40.0
_GOOD_DB, _POOR_DB = 20.0, 10.0


def distortion(study: DataStudy) -> tuple[float, float]:
    """Return the probability of linearity and the share of the residual that nonlinear terms explain (worst output)."""
    arx = study.arx
    worst = (1.0, 0.0)
    for i in study.varying_outputs:
        if arx.sigma[i] <= arx.floor[i]:
            continue
        result = _f_test(arx.residual[:, i], _linear_columns(study, arx), _nonlinear_columns(study, arx, i))
        worst = min(worst, result)
    return worst


def judge_noise(study: DataStudy) -> Finding:
    """Judge the worst output's ratio of explained to unexplained variance."""
    if not study.varying_outputs:
        return Finding("noise", "poor", "no output moves", "raise the amplitude, check the columns")
    level, names = study.signal_to_rest_db, study.experiment.output_names
    values = dict(zip(names, level.tolist(), strict=True))
    worst = min(study.varying_outputs, key=lambda i: level[i])
    evidence = f"ratio of explained to unexplained, {names[worst]}: {level[worst]:.1f} dB"
    if level[worst] >= _GOOD_DB:
        return Finding("noise", "good", evidence, "", values)
    advice = "raise the amplitude or record longer where it is noise, lower the amplitude where it is distortion"
    return Finding("noise", "watch" if level[worst] >= _POOR_DB else "poor", evidence, advice, values)


def judge_linearity(study: DataStudy) -> Finding:
    """Judge the coherence over the excited band, and whether noise or distortion lowers it."""
    if not study.varying_inputs or not study.varying_outputs:
        return Finding("linearity", "unknown", "nothing moves")
    low, top, middle = _coherence_of(study)
    probability, share = distortion(study)
    level = float(np.min(study.signal_to_rest_db[study.varying_outputs]))
    values = {
        "coherence_maximum": top,
        "coherence_median": middle,
        "band_below_0.9": low,
        "probability_linear": probability,
        "nonlinear_share_of_residual": share,
    }
    seen = f"coherence {middle:.2f} in the middle, below {_LOW} over {100 * low:.0f} % of the excited band"
    distorted = probability < CHANCE and share > _LEAST_SHARE
    if distorted and level < _LINEAR_DB:
        evidence = f"{seen}; nonlinear terms explain {100 * share:.0f} % of the prediction error: distortion"
        advice = "the model will hold for this amplitude only; lower it, or compare with a nonlinear frequency response"
        return Finding("linearity", "poor" if low > _MUCH or level < 15.0 else "watch", evidence, advice, values)
    if level >= _LINEAR_DB:
        tail = ", which is leakage: the response outlasts the segments" if low > _MUCH else ""
        evidence = f"a linear model leaves {level:.0f} dB less than it explains; {seen}{tail}"
        return Finding("linearity", "good", evidence, "", values)
    if low > _MUCH:
        evidence = f"{seen}; no nonlinear distortion is seen: the cause is noise, or another input"
        advice = "raise the amplitude, or record the other inputs"
        return Finding("linearity", "watch" if level < _POOR_DB else "good", evidence, advice, values)
    return Finding("linearity", "good", f"{seen}; no nonlinear distortion is seen", "", values)


def _coherence_of(study: DataStudy) -> tuple[float, float, float]:
    """Return the part of the excited band with low coherence, and its highest and middle value there."""
    values = np.min(study.coherence.multiple[study.excited][:, study.varying_outputs], axis=1)
    values = values[np.isfinite(values)]
    if not values.size:
        return 0.0, float("nan"), float("nan")
    return float(np.mean(values < _LOW)), float(values.max()), float(np.median(values))


def _linear_columns(study: DataStudy, arx: LongArx) -> Floats:
    past = lagged(study.y / study.spread, 1, arx.lags, arx.lags)
    inputs = lagged(study.u[:, study.varying_inputs], 0, arx.lags, arx.lags)
    inputs = inputs / np.maximum(np.std(inputs, axis=0), 1e-300)
    return np.hstack([np.ones((len(past), 1)), past, inputs])


def _nonlinear_columns(study: DataStudy, arx: LongArx, output: int) -> Floats:
    """Return powers and products of the prediction and its change, now and one sample ago."""
    before = study.y[arx.lags - 1 : -1, output] / study.spread[output]
    now = (study.y[arx.lags :, output] - arx.residual[:, output]) / study.spread[output]
    step = now - before
    step /= max(float(np.std(step)), 1e-300)
    terms = [now**2, now**3, now * np.abs(now), np.abs(now), step**2, step**3, step * np.abs(step), now * step]
    terms += [np.abs(step), before**2, before**3, np.sign(step)]
    return np.column_stack(terms)


def _f_test(residual: Floats, linear: Floats, nonlinear: Floats) -> tuple[float, float]:
    """Return the F test's probability and the share explained by what the nonlinear terms have of their own."""
    q, _ = np.linalg.qr(linear)
    own = nonlinear - q @ (q.T @ nonlinear)
    size = np.sqrt(np.sum(own**2, axis=0))
    own = own[:, size > 1e-6 * np.sqrt(np.sum(nonlinear**2, axis=0) + 1e-300)]
    if not own.shape[1]:
        return 1.0, 0.0
    basis, s, _ = np.linalg.svd(own / np.sqrt(np.sum(own**2, axis=0)), full_matrices=False)
    basis = basis[:, s > 1e-6]
    total = float(residual @ residual)
    explained = float(np.sum((basis.T @ residual) ** 2))
    freedom = len(residual) - linear.shape[1] - basis.shape[1]
    if freedom < 10 or total <= 0.0:
        return 1.0, 0.0
    f = (explained / basis.shape[1]) / max((total - explained) / freedom, 1e-300 * total + 1e-300)
    return float(special.fdtrc(basis.shape[1], freedom, f)), explained / total
