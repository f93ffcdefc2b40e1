"""Is there a periodic disturbance in what the inputs do not explain?

The highest line of the residual's periodogram against their mean, by Fisher's exact test for white noise
(R. A. Fisher, Proc. Royal Society A 125 (1929) 54–59; P. J. Brockwell and R. A. Davis, Time Series, section 10.2).
"""

from __future__ import annotations

import numpy as np

from workbench.analysis.advice.result import Finding
from workbench.analysis.advice.study import Study
from workbench.session.base import Floats

__all__ = ["judge_disturbance", "strongest_line"]

_CERTAIN = 1e-7
_LEAST_SHARE = 0.02  # of the residual's variance


def strongest_line(residual: Floats, dt: float) -> tuple[float, float, float]:
    """Return frequency [Hz], share of the variance and probability by chance of a residual's highest line.

    Args:
        residual: shape (n,).
        dt: sampling interval [s].
    """
    power = np.abs(np.fft.rfft(residual - residual.mean()))[1:-1] ** 2
    total = float(np.sum(power))
    if total <= 0.0 or power.size < 10:
        return 0.0, 0.0, 1.0
    k = int(np.argmax(power))
    share = float(power[k]) / total
    probability = min(1.0, power.size * (1.0 - share) ** (power.size - 1))
    return (k + 1) / (len(residual) * dt), share, float(probability)


def judge_disturbance(study: Study) -> Finding:
    """Judge the strongest line of each output's residual."""
    arx = study.arx
    lines = {}
    for i in study.varying_outputs:
        if arx.sigma[i] > arx.floor[i]:
            rest = study.y[:, i] - study.explained[:, i]
            lines[study.experiment.output_names[i]] = (strongest_line(arx.residual[:, i], study.dt), np.var(rest))
    real = {n: line for n, (line, _) in lines.items() if line[2] < _CERTAIN and line[1] > _LEAST_SHARE}
    values = {n: {"frequency_hz": f, "share": s, "probability": p} for n, ((f, s, p), _) in lines.items()}
    if not real:
        return Finding("disturbance", "good", "no periodic disturbance", "", values)
    name, (frequency, share, _) = max(real.items(), key=lambda pair: pair[1][1])
    evidence = (
        f"{name} has a line at {frequency:.4g} Hz that the inputs do not explain ({100 * share:.0f} % of the error)"
    )
    return Finding("disturbance", "watch", evidence, "find its source, or filter inputs and outputs alike", values)
