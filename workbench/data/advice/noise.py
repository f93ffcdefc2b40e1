"""How much of each output do the inputs explain?

The output of the long linear equation, run by the inputs alone, against what is left. What is left is noise,
nonlinear distortion and unmeasured inputs together; `linearity` tells which.
"""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import DataStudy

__all__ = ["judge_noise", "signal_to_rest_db"]

_GOOD_DB = 20.0
_POOR_DB = 10.0
_BEST_DB = 200.0


def signal_to_rest_db(study: DataStudy) -> Floats:
    """Return 10·log10 of explained over unexplained variance of each output, shape (p,) [dB]."""
    start = min(study.memory, len(study.u) // 4)
    signal = study.explained[start:]
    rest = study.y[start:] - signal
    rest = rest - rest.mean(axis=0)
    ratio = np.var(signal, axis=0) / np.maximum(np.mean(rest**2, axis=0), 1e-300)
    with np.errstate(divide="ignore"):
        return np.asarray(np.clip(10.0 * np.log10(ratio), -_BEST_DB, _BEST_DB))


def judge_noise(study: DataStudy) -> Finding:
    """Judge the worst output's ratio of explained to unexplained variance."""
    if not study.varying_outputs:
        return Finding("noise", "poor", "no output moves", "raise the amplitude, check the columns")
    level = signal_to_rest_db(study)
    names = study.experiment.output_names
    values = {name: float(v) for name, v in zip(names, level, strict=True)}
    worst = min(study.varying_outputs, key=lambda i: level[i])
    if level[worst] >= 80.0:
        return Finding("noise", "good", "a linear model explains the outputs almost completely", "", values)
    evidence = f"ratio of explained to unexplained, {names[worst]}: {level[worst]:.1f} dB"
    if level[worst] >= _GOOD_DB:
        return Finding("noise", "good", evidence, "", values)
    advice = "raise the amplitude or record longer where it is noise, lower the amplitude where it is distortion"
    return Finding("noise", "watch" if level[worst] >= _POOR_DB else "poor", evidence, advice, values)
