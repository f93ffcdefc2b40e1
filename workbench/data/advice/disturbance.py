"""Is there a periodic disturbance in what the inputs do not explain?

The lines of the unexplained part's periodogram are compared with the level around them: without a periodic part each
is that level times an exponentially distributed number, so the highest of n exceeds x times the level with
probability n·exp(−x) (P. J. Brockwell and R. A. Davis, Time Series, 2nd ed., section 10.3).
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from workbench.core.values.arrays import Floats
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import DataStudy

__all__ = ["judge_disturbance", "strongest_line"]

_HIGH = 40.0  # times the level around: by chance once in 10¹⁴ with 2000 lines, with a margin for an uncertain level
_AROUND = 41  # lines
_LEAST_SHARE = 0.05  # of the unexplained variance
_SLOW = 8  # periods in the record: fewer are a drift
_VISIBLE = 1e-6  # of the output's variance


def strongest_line(rest: Floats, dt: float) -> tuple[float, float, float]:
    """Return frequency [Hz], share of the variance and height over the level around of the highest line.

    Args:
        rest: shape (n,).
        dt: sampling interval [s].
    """
    window = np.hanning(len(rest))  # so that slow parts do not leak over all lines
    power = np.abs(np.fft.rfft((rest - rest.mean()) * window))[:-1] ** 2
    power[:2] = power[2]  # what the window leaves of the mean
    total = float(np.sum(power))
    if total <= 0.0 or power.size < 2 * _AROUND:
        return 0.0, 0.0, 0.0
    level = ndimage.median_filter(power, _AROUND, mode="nearest") / np.log(2.0)
    height = power / np.maximum(level, 1e-12 * total)
    height[:_SLOW] = 0.0
    k = int(np.argmax(height))
    share = float(np.sum(power[max(k - 2, 0) : k + 3])) / total
    return k / (len(rest) * dt), share, float(height[k])


def judge_disturbance(study: DataStudy) -> Finding:
    """Judge the strongest line of what is left of each output; periodic inputs make lines of their own."""
    rest = study.y - study.explained
    start = min(study.memory, len(rest) // 4)
    lines = {
        study.experiment.output_names[i]: strongest_line(rest[start:, i], study.dt)
        for i in study.varying_outputs
        if np.var(rest[start:, i]) > _VISIBLE * study.spread[i] ** 2
    }
    values = {n: {"frequency_hz": f, "share": s, "height": h} for n, (f, s, h) in lines.items()}
    real = {n: line for n, line in lines.items() if line[2] > _HIGH and line[1] > _LEAST_SHARE}
    if not real:
        return Finding("disturbance", "good", "no periodic disturbance", "", values)
    name, (frequency, share, _) = max(real.items(), key=lambda pair: pair[1][1])
    evidence = (
        f"{name} has a line at {frequency:.4g} Hz that the inputs do not explain ({100 * share:.0f} % of the rest)"
    )
    if _periodic(study.u):
        advice = "the inputs are periodic: it may be a harmonic of them, made by a nonlinearity"
        return Finding("disturbance", "unknown", evidence, advice, values)
    return Finding("disturbance", "watch", evidence, "find its source, or filter inputs and outputs alike", values)


def _periodic(u: Floats) -> bool:
    """Return whether the inputs repeat within the record."""
    padded = np.fft.rfft(u, 2 * len(u), axis=0)
    own = np.fft.irfft(np.abs(padded) ** 2, axis=0).sum(axis=1)[: len(u)]
    overlap = np.arange(len(u), 0, -1) / len(u)
    likeness = own / (own[0] * overlap + 1e-300)
    # From the first lag at which the signal has forgotten itself.
    apart = np.flatnonzero(likeness < 0.5)
    return bool(apart.size and np.max(likeness[apart[0] : len(u) * 3 // 4], initial=0.0) > 0.9)
