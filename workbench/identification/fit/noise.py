"""What is known of the noise in a response that comes without errors, and the order that it allows.

What no smooth response explains is noise: its size follows from what the fit leaves, and its course over frequency from
the scatter between neighbours. With σ = r s(f), s given and r unknown but for a least value, minus twice the logarithm
of the likelihood of N real numbers and the Bayesian criterion of f fitted ones are

    N log r² + 2 Σ log s² + S/r² + f log N · N/(N − f − 2),        S = Σ 2 |misfit|²/s²,    r² = S/N or the least value.

The last factor counts that r is not known: without it, orders that leave hardly a number free win by chance (C. M.
Hurvich and C.-L. Tsai, Biometrika 76, 1989, for Akaike's criterion; here of Schwarz's). Noise in proportion to the gain
and noise of a size that the scatter shows are both tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.identification.fit.matrix import Points, StateSpaceFit
from workbench.identification.fit.rational import Rational

__all__ = ["ResponseNoise", "course", "judged"]


_BESIDE = 2  # neighbours on either side, through which a cubic predicts a value
_FLOORS = 10.0 ** np.arange(-8.0, 2.0, 0.5)  # squares of noise that stays, over that of the largest gain


@dataclass(frozen=True, eq=False)
class ResponseNoise:
    """What several orders say of the noise.

    Attributes:
        criterion: shape (o,), of each order; smallest is best.
        scale: shape (o,), r of each order, the numbers fitted allowed for.
        free: shape (o,), numbers that are left to chance.
    """

    criterion: Floats
    scale: Floats
    free: Floats


def judged(tried: Sequence[Rational | StateSpaceFit], points: Points, floor: Floats) -> ResponseNoise:
    """Return the criterion of each order, the size of the noise being unknown.

    Args:
        tried: one for each order.
        points: with s as σ.
        floor: shape (k,), no σ is below.
    """
    count = 2.0 * len(points.s)
    squares, fitted = (np.array([getattr(fit, name) for fit in tried]) for name in ("cost", "freedom"))
    squares = 2.0 * squares
    least = float(np.max((floor / points.sigma) ** 2))
    size = np.maximum(squares / count, least)
    spare = count - fitted - 2.0
    penalty = np.where(spare > 0.0, fitted * np.log(count) * count / np.maximum(spare, 1.0), np.inf)
    criterion = count * np.log(size) + 2.0 * np.sum(np.log(points.sigma**2)) + squares / size + penalty
    scale = np.sqrt(np.maximum(squares / np.maximum(count - fitted, 1.0), least))
    return ResponseNoise(criterion, scale, count - fitted)


def course(frequency_hz: Floats, value: Complex) -> Floats | None:
    """Return the size of the noise over frequency, up to a factor, shape (k,), from the scatter of neighbours.

    s² = |G|² + c, with c such that the scatter varies least over frequency: the logarithm of what a cubic through the
    neighbours leaves, over what noise of that course would leave.

    Args:
        frequency_hz: shape (k,), rising.
        value: shape (k,).

    Returns:
        None: there are too few values, or noise is in proportion to the gain.
    """
    k = len(value)
    if k < 4 * _BESIDE:
        return None
    x, left, weight = np.log(frequency_hz), [], []
    for at in range(_BESIDE, k - _BESIDE):
        beside = np.r_[at - _BESIDE : at, at + 1 : at + 1 + _BESIDE]
        row = np.zeros(k)
        row[at], row[beside] = 1.0, -_through(x[beside] - x[at])
        left.append(abs(row @ value) ** 2)
        weight.append(row**2)
    squares = np.abs(value) ** 2
    scatter, expected = np.log(np.array(left) + 1e-300), np.array(weight)
    floors = np.append(0.0, _FLOORS * squares.max())
    varies = [float(np.var(scatter - np.log(expected @ (squares + c)))) for c in floors]
    best = int(np.argmin(varies))
    return None if best == 0 else np.asarray(np.sqrt(squares + floors[best]))


def _through(x: Floats) -> Floats:
    """Return the weights of values at x in the value at 0 of the polynomial through them (Lagrange)."""
    return np.array([np.prod([b / (b - a) for b in np.delete(x, j)]) for j, a in enumerate(x)])
