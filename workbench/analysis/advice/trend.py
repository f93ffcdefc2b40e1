"""Is there an offset or a drift that the inputs do not explain?

The identified model is linear around an operating point; the operating point has to be taken out first. A drift is
tested as a further, linearly growing input of the long equation.
"""

from __future__ import annotations

import numpy as np

from workbench.analysis.advice.result import Finding
from workbench.analysis.advice.study import DataStudy
from workbench.session.base import Floats

__all__ = ["drifts", "judge_trend"]

_LARGE = 0.3  # of a standard deviation over the whole record
_OFFSET = 0.05  # of a standard deviation
_SIGNIFICANT = 8.0  # standard deviations, which twelve blocks leave uncertain


def drifts(study: DataStudy) -> tuple[Floats, Floats]:
    """Return the change over the record that no input explains, and its standard deviation, shape (p,) each."""
    start = min(study.memory, len(study.u) // 4)
    rest = study.y[start:] - study.explained[start:]
    clock = np.linspace(-0.5, 0.5, len(rest))
    rest = rest - rest.mean(axis=0)
    size = clock @ rest / (clock @ clock)
    left = rest - clock[:, None] * size
    return np.asarray(size), np.asarray(_long_run(left) / np.sqrt(clock @ clock))


def judge_trend(study: DataStudy) -> Finding:
    """Judge offsets and drifts of the outputs."""
    data = study.experiment
    size, error = drifts(study)
    relative = np.abs(size) / study.spread
    real = [i for i in study.varying_outputs if relative[i] > _LARGE and abs(size[i]) > _SIGNIFICANT * error[i]]
    means = np.hstack([data.u.mean(axis=0), data.y.mean(axis=0)])
    spreads = np.hstack([np.std(data.u, axis=0), np.std(data.y, axis=0)])
    names = (*data.input_names, *data.output_names)
    off = [n for n, m, s in zip(names, means, spreads, strict=True) if abs(m) > _OFFSET * s > 0.0]
    values = {"drift": dict(zip(data.output_names, size.tolist(), strict=True)), "offsets": off}
    if real:
        worst = max(real, key=lambda i: relative[i])
        evidence = f"{data.output_names[worst]} drifts by {size[worst]:.3g} over the record, whatever the inputs do"
        return Finding("trend", "watch", evidence, "remove it with detrend(kind='linear')", values)
    if off:
        return Finding(
            "trend", "good", f"no drift; {', '.join(off)} with an offset, which is removed before fitting", "", values
        )
    return Finding("trend", "good", "no drift, no offset", "", values)


def _long_run(x: Floats) -> Floats:
    """Return √(spectral density at 0) of each column, by means of blocks, so that slow noise counts in full."""
    blocks = 12
    length = len(x) // blocks
    means = x[: blocks * length].reshape(blocks, length, -1).mean(axis=1)
    return np.asarray(np.std(means, axis=0, ddof=1) * np.sqrt(length))
