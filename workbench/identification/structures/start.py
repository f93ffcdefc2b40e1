"""Where the fit of a chain starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.prediction.innovations import Innovations, errors_of
from workbench.identification.prediction.start import plant_alone
from workbench.identification.structures.refine import PiecewiseLinearBlock, WienerHammersteinModel, line_of
from workbench.identification.structures.table import free_directions, knots_for, weights
from workbench.identification.subspace.estimate import estimate

__all__ = ["placed", "rescaled", "starts_before", "straight", "with_before", "with_behind"]

_POWERS = 3  # of the input, whose linear models start f
_EVEN = 0.05  # correlation of a block's output with its input below which it counts as even


def straight(signal: Floats, count: int) -> PiecewiseLinearBlock:
    """Return a table before the linear block that does nothing yet.

    Args:
        signal: shape (N,), its input.
        count: of knots.
    """
    knots = knots_for(signal, count)
    return PiecewiseLinearBlock(knots, knots.copy(), free_directions(*line_of(signal, knots)))


def with_before(linear: Innovations, u: Floats, y: Floats, count: int) -> WienerHammersteinModel:
    """Return a chain with a static block before the linear one, its values by least squares.

    Args:
        linear: the block.
        u: shape (N,).
        y: shape (N,).
        count: of knots.
    """
    table = straight(u, count)
    hats = weights(u, table.knots)
    bare = replace(linear, x0=np.zeros_like(linear.x0), offset=np.zeros(1))
    nothing = np.zeros((len(u), 1))
    through = -np.array([errors_of(bare, (column[:, None], nothing))[:, 0] for column in hats.T]).T
    columns = np.hstack([through @ table.free, np.ones((len(u), 1))])
    left = y - through @ table.values
    change: Floats = np.asarray(np.linalg.lstsq(columns, left, rcond=1e-10)[0], dtype=np.float64)
    values = table.values + table.free @ change[:-1]
    return WienerHammersteinModel(replace(table, values=values), replace(linear, offset=change[-1:]), None)


def starts_before(order: int, u: Floats, y: Floats, *, feedthrough: bool) -> Innovations | None:
    """Return a linear block from powers of the input as inputs of their own; None: there is none.

    Of f(u) = Σ cᵢ uⁱ all have the same A and C, and a B of rank one, whose direction is the block's.

    Args:
        order: n.
        u: shape (N,).
        y: shape (N,).
        feedthrough: D is estimated.
    """
    powers = np.array([u**k for k in range(1, _POWERS + 1)]).T
    powers = (powers - powers.mean(axis=0)) / powers.std(axis=0)
    try:
        result = estimate(powers, (y - y.mean())[:, None], 1.0, order=order, feedthrough=feedthrough).model
    except InputError:
        return None
    left, _, _ = np.linalg.svd(np.vstack([result.B, result.D]), full_matrices=False)
    return plant_alone((result.A, left[:order, :1], result.C, left[order:, :1]), feedthrough=feedthrough)


def placed(chain: WienerHammersteinModel, u: Floats, y: Floats, count: int) -> WienerHammersteinModel:
    """Return the chain with the knots of its last block where its input is now, its values by least squares.

    Args:
        chain: perhaps without a block behind.
        u: shape (N,).
        y: shape (N,).
        count: of knots.
    """
    _, w = chain.inner(u)
    knots = knots_for(w, count)
    values = np.asarray(np.linalg.lstsq(weights(w, knots), y, rcond=1e-10)[0], dtype=np.float64)
    return rescaled(replace(chain, behind=PiecewiseLinearBlock(knots, values, np.eye(count)[:, 1:])), u)


def rescaled(chain: WienerHammersteinModel, u: Floats) -> WienerHammersteinModel:
    """Return the same chain, scaled so that the slope of the regression of its last block is 1; that is then held.

    A block that is even has no such slope; its scale stays as it is, and what is held is its regression on what it is
    now.

    Args:
        chain: with a block behind, or without.
        u: shape (N,).
    """
    if chain.behind is None:
        return chain
    _, w = chain.inner(u)
    knots, values = chain.behind.knots, chain.behind.values
    hats = weights(w, knots)
    levels = hats @ values
    slope = float(line_of(w, knots)[1] @ values)
    odd = abs(slope) * w.std() > _EVEN * levels.std()
    gain = slope if odd else 1.0
    linear = chain.linear
    scaled = replace(linear, C=gain * linear.C, D=gain * linear.D, offset=gain * linear.offset)
    turned = slice(None, None, -1 if gain < 0.0 else 1)
    knots, values = (gain * knots)[turned], values[turned]
    held = line_of(gain * w, knots)[1] if odd else (levels - levels.mean()) @ hats
    return WienerHammersteinModel(chain.before, scaled, PiecewiseLinearBlock(knots, values, free_directions(held)))


def with_behind(linear: Innovations, u: Floats, y: Floats, count: int) -> WienerHammersteinModel:
    """Return a chain with a static block behind the linear one.

    Args:
        linear: the block.
        u: shape (N,).
        y: shape (N,).
        count: of knots.
    """
    return placed(WienerHammersteinModel(None, linear, None), u, y, count)
