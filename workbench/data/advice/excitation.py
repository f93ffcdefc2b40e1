"""To which order do the inputs excite persistently?

A signal is persistently exciting of order r when its covariance matrix of size r × r is regular: r is the number of
lines in its spectrum, both signs counted (L. Ljung, System Identification, 2nd ed., section 13.2). The constant part
is taken out before, so it does not count.

The lines are counted in the spectrum of the whole record: a covariance matrix of a signal in a narrow band is all
but singular long before its order is reached. The window leaves no leakage that could pass for a line.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import linalg, ndimage

from workbench.core.values.arrays import Floats
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import DataStudy
from workbench.data.long_arx import lagged
from workbench.data.spectra.window import shape_of

__all__ = ["excited_orders", "is_single_sine", "judge_excitation"]

_HIGHEST = 50  # orders counted
_FAINT_DB = -46.0  # lines so far below the strongest do not count: half a per cent in amplitude
_LINE_WIDTH = 4.0  # frequency bins; neighbours closer than that are one region of the spectrum
_FEW_CHANGES = 3  # levels changed so rarely: a step or a pulse, which excites by its transient
_DEPENDENT = 1e-3  # of an input's size is its own
_LAGS = 10


def excited_orders(study: DataStudy) -> int | None:
    """Return the order of persistent excitation of the inputs jointly; None: at least as high as was counted.

    0 where an input is constant or a linear combination of others.
    """
    orders = [_order_of(study.u[:, j]) for j in range(study.experiment.n_inputs)]
    if 0 in orders or _dependent(study) is not None:
        return 0
    known = [r for r in orders if r is not None]
    return min(known) if known else None


def is_single_sine(study: DataStudy) -> bool:
    """Return whether an input is constant or one sine."""
    return any((_order_of(u) or math.inf) <= 2 for u in study.u.T)


def judge_excitation(study: DataStudy) -> Finding:
    """Judge the order of persistent excitation against the order of the model, where that is known."""
    names = study.experiment.input_names
    orders = excited_orders(study)
    single = {n: _order_of(study.u[:, j]) for j, n in enumerate(names)}
    values: dict[str, Any] = {"orders": orders, "counted_to": _HIGHEST, "by_input": single}
    still = [n for j, n in enumerate(names) if j not in study.varying_inputs]
    if still:
        return Finding("excitation", "poor", f"{still[0]} is constant", "excite it, or leave it out", values)
    dependent = _dependent(study)
    if dependent is not None:
        evidence = f"{names[dependent]} follows linearly from the other inputs"
        return Finding(
            "excitation", "poor", evidence, "give each input a sequence of its own, or leave one out", values
        )
    rare = [n for j, n in enumerate(names) if _changes(study.u[:, j]) <= _FEW_CHANGES]
    if rare:
        evidence = f"{rare[0]} changes at most {_FEW_CHANGES} times: only the transient is informative"
        return Finding("excitation", "watch", evidence, "use a PRBS or a multisine", values)
    if orders is None:
        return Finding("excitation", "good", f"persistent of order {_HIGHEST} or more", "", values)
    return _few_lines(orders, study.order, values)


def _few_lines(orders: int, order: int | None, values: dict[str, Any]) -> Finding:
    evidence = f"persistent of order {orders} ({orders // 2} lines in the spectrum, with both signs)"
    needed = 2 * (order or 4) + 1
    if orders >= needed:
        return Finding("excitation", "good", evidence, "", values)
    advice = "use a PRBS or more sines: a model of order n needs 2n + 1 orders where there is noise"
    verdict = "poor" if orders <= 2 or (order or 0) > orders else "watch"
    return Finding("excitation", verdict, evidence, advice, values)


def _order_of(u: Floats) -> int | None:
    """Return twice the number of lines in the spectrum of one input; None: `_HIGHEST` or more, or few steps."""
    if np.ptp(u) <= 1e-12 * np.max(np.abs(u), initial=0.0):
        return 0
    if _changes(u) <= _FEW_CHANGES:
        return None  # a transient: lines do not describe it
    power = np.abs(np.fft.rfft(_tapered(u))) ** 2
    # What lies within the main lobe of 0 Hz is the rest of the constant part.
    power[:2] = 0.0
    regions, count = ndimage.label(power > 10.0 ** (0.1 * _FAINT_DB) * power.max())
    widths = ndimage.sum_labels(np.ones(len(power)), regions, np.arange(1, count + 1))
    # One line is 7 bins wide at this level, each further one that merges with it adds its distance.
    lines = float(np.sum(np.maximum(1.0, 1.0 + np.floor((widths - 7.0) / _LINE_WIDTH))))
    return None if 2.0 * lines >= _HIGHEST else int(2.0 * lines)


def _tapered(u: Floats) -> Floats:
    """Return u times the window, its mean and trend taken out: a trend would be a line next to 0 Hz.

    The straight line is weighed by the window: without, a sine of a few periods would leave one of its own.
    """
    window = shape_of("blackmanharris", len(u))
    line = np.stack([np.ones(len(u)), np.linspace(-1.0, 1.0, len(u))])
    tapered: Floats = window * (u - np.linalg.solve(line * window @ line.T, line * window @ u) @ line)
    return tapered


def _dependent(study: DataStudy) -> int | None:
    """Return the first input that the others, some samples before and after, explain; None: each is its own."""
    n, m = study.u.shape
    if m == 1 or len(study.varying_inputs) < m or n < 4 * (2 * _LAGS + 1) * m:
        return None
    for j in range(1, m):
        others = lagged(study.u[:, :j], 0, 2 * _LAGS, 2 * _LAGS)
        target = study.u[_LAGS : n - _LAGS, j]
        theta = linalg.lstsq(others, target, cond=1e-9, lapack_driver="gelsy")[0]
        if np.std(target - others @ theta) < _DEPENDENT * np.std(target):
            return j
    return None


def _changes(u: Floats) -> int:
    return int(np.count_nonzero(np.abs(np.diff(u)) > 1e-9 * np.ptp(u)))
