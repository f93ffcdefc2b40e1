"""The worst-case gain: bounded over every part of the ranges, and found at a parameter set."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import Linear
from workbench.loops.mu.blocks import MuBlock
from workbench.loops.mu.peak import Peak, peak
from workbench.loops.mu.upper import upper_bound
from workbench.loops.robust.family import Place, UncertainFamily
from workbench.loops.robust.result import WorstGain
from workbench.loops.robust.uncertain import UncertainModel
from workbench.loops.robust.worst import is_unstable, promising

__all__ = ["gain_curve", "worst_gain"]

# Relative: how near the peaks of linear models are found, to compare them, and to tell them where they are no more than
# largest singular values.
_CLOSE, _SHARP = 0.005, 1e-6
_GRID = 60  # frequencies at which parameter sets are compared
_SHOWN = 200  # and of the curves


def worst_gain(
    family: UncertainFamily, whole: UncertainModel, parts: Sequence[UncertainModel], performance: Sequence[int],
    band: tuple[float, float] | None,
) -> WorstGain:  # fmt: skip
    """Return the bounds of the largest gain over frequencies and parameters.

    Args:
        family: of linear models with inputs and outputs.
        whole: over the ranges.
        parts: of the ranges over which stability is proved; empty: it is not, and nothing is proved of the gain.
        performance: sizes of the blocks that the gain is measured with: one of all inputs and outputs, or each alone.
        band: lowest and highest frequency [Hz]; None: all.
    """
    limits = band or (0.0, math.inf)
    grid = _frequencies(whole.centre, limits, _GRID)
    middle = family.at([(0.0,) * len(family.parameters)])[0]
    upper = max((peak(*part.with_performance(performance), limits).level for part in parts), default=math.inf)

    def badness(matrix: Floats) -> float:
        linear = _linear(matrix, whole)
        gain = math.inf if is_unstable(linear) else float(gain_curve(linear, grid, performance).max())
        return gain / (1.0 + gain) if math.isfinite(gain) else 1.0  # rises as it does, and has differences everywhere

    places: list[Place] = [whole.box.place(share.tolist()) for share in promising(whole, badness)]
    places.append((0.0,) * len(family.parameters))
    found = [(_peak(m, performance, limits), place) for m, place in zip(family.at(places), places, strict=True) if m]
    _, where = max(found, key=lambda pair: pair[0].level)
    (worst,) = family.at([where])
    close = _SHARP if len(performance) == 1 else _CLOSE
    best, nominal = (_peak(m, performance, limits, close=close) for m in (worst, middle))
    shown = _frequencies(whole.centre, limits, _SHOWN)
    lower = best.level / (1.0 + close) if math.isfinite(best.level) else best.level
    return WorstGain(
        nominal=nominal.level,
        lower=lower,
        upper=max(upper, lower),
        frequency_hz=best.frequency_hz,
        parameters=family.values(where),
        band_hz=limits,
        shown_hz=shown,
        nominal_curve=gain_curve(middle, shown, performance),
        worst_curve=gain_curve(worst, shown, performance),
    )


def gain_curve(linear: Linear | None, frequency_hz: Floats, performance: Sequence[int]) -> Floats:
    """Return the gain over frequency, shape (k,): the largest singular value, or µ where channels are separate.

    Args:
        linear: the model; None: it is not known.
        frequency_hz: shape (k,) [Hz].
        performance: sizes of the blocks.
    """
    if linear is None:
        return np.full(len(frequency_hz), np.nan)
    response = linear.response(frequency_hz)
    if len(performance) == 1:
        return np.asarray(np.linalg.norm(response, 2, axis=(1, 2)))
    blocks = [MuBlock(size=k) for k in performance]
    return np.array([upper_bound(m, blocks).bound for m in response])


def _peak(
    linear: Linear | None, performance: Sequence[int], limits: tuple[float, float], *, close: float = _CLOSE
) -> Peak:
    if linear is None:
        return Peak(0.0, math.nan, 0)
    if is_unstable(linear):
        return Peak(math.inf, math.nan, 0)
    return peak(_squared(linear, sum(performance)), [MuBlock(size=k) for k in performance], limits, close=close)


def _squared(linear: Linear, size: int) -> Linear:
    """Return the model with inputs and outputs filled up by those that do nothing."""
    n = len(linear.A)
    b, c, d = np.zeros((n, size)), np.zeros((size, n)), np.zeros((size, size))
    outputs, inputs = linear.D.shape
    b[:, :inputs], c[:outputs], d[:outputs, :inputs] = linear.B, linear.C, linear.D
    return Linear(linear.A, b, c, d, dt=linear.dt)


def _linear(matrix: Floats, whole: UncertainModel) -> Linear:
    n = whole.states
    return Linear(matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:], dt=whole.dt)


def _frequencies(linear: Linear, limits: tuple[float, float], count: int) -> Floats:
    """Return frequencies that show a model, with its natural ones, rising [Hz]."""
    natural = np.abs(linear.continuous_poles) / (2.0 * math.pi)
    natural = natural[(natural > 1e-9 * natural.max(initial=0.0)) & np.isfinite(natural)]
    top = linear.highest_hz * (1.0 - 1e-6) if linear.dt > 0.0 else math.inf
    low, high = (natural.min(initial=1.0) / 10.0, natural.max(initial=1.0) * 10.0) if len(natural) else (0.1, 10.0)
    low, high = (
        max(limits[0], low if limits[0] == 0.0 else 0.0),
        min(limits[1], high if limits[1] == math.inf else math.inf),
    )
    high = min(high, top)
    inside = natural[(natural > low) & (natural < high)]
    return np.unique(np.concatenate([np.geomspace(max(low, 1e-6 * high), high, count), inside]))
