"""The order of the model, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.analysis.subspace.hankel import ROUNDING, HankelFactor
from workbench.analysis.subspace.weightings import Subspace
from workbench.errors import InputError
from workbench.session.base import Floats

__all__ = ["OrderChoice", "choose_order"]


@dataclass(frozen=True, eq=False)
class OrderChoice:
    """An order and its reason.

    Attributes:
        order: n.
        reason: in one line.
        criterion: shape (k + 1,), of the orders 0 … k, smallest is best; empty where rounding alone decides.
    """

    order: int
    reason: str
    criterion: Floats


def choose_order(factor: HankelFactor, space: Subspace, most: int) -> OrderChoice:
    """Return the automatic order.

    Args:
        factor: of the record.
        space: of the weighting.
        most: largest order considered.
    """
    held = space.rank
    if not space.noisy and held <= most:
        return OrderChoice(held, f"all beyond {held} is rounding: the data are free of noise", np.zeros(0))
    criterion = _bic(factor, space, min(most, held))
    best = int(np.argmin(criterion))
    return OrderChoice(best, f"smallest information criterion among orders 0 to {len(criterion) - 1}", criterion)


def _bic(factor: HankelFactor, space: Subspace, most: int) -> Floats:
    i, p, m = factor.horizon, factor.outputs, factor.inputs
    u, y, past = factor.u(i, i + 1), factor.y(i, i + 1), factor.past()
    values = []
    for n in range(most + 1):
        known = np.vstack([space.memory[:n] @ past, u])
        left = y - np.linalg.lstsq(known.T, y.T, rcond=10.0 * ROUNDING * known.shape[1])[0].T @ known
        _, logdet = np.linalg.slogdet(left @ left.T)
        values.append(logdet * factor.columns + np.log(factor.columns) * n * (2 * p + m))
    return np.array(values) / factor.columns


def check_order(order: int, space: Subspace) -> None:
    """Refuse an order beyond what the data hold.

    Args:
        order: asked for.
        space: of the weighting.

    Raises:
        InputError: singular values up to the order are rounding.
    """
    held = space.rank
    if order > held:
        raise InputError(f"order {order} is too high: the data hold {held} only, singular values beyond are rounding")
