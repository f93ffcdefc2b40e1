"""The order of the model, and why.

Free of noise, the rank decides: singular values fall to rounding. With noise no gap in the singular values is to
be trusted; instead the model of every order is made as it would be handed out and simulated, and the smallest of

    log det V(n) + n (p + m) log(N') / N'

is taken, V(n) being the covariance of the simulation's error: the Bayesian criterion (Ljung 1999, section 16.4) for a
model whose order is worth p + m numbers. N' is the number of samples divided by Σ ρ²(τ), ρ being the autocorrelation
of the error that the largest of the models leaves (Bartlett 1946): coloured noise carries that much less information,
and without the correction its dynamics would be modelled as if they were the system's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.subspace.candidates import HorizonView
from workbench.identification.subspace.final_model import cost, deliver, simulation_cost
from workbench.identification.subspace.horizon import largest_order
from workbench.identification.subspace.settings import SubspaceSettings
from workbench.identification.subspace.weightings import Subspace

__all__ = ["OrderChoice", "check_order", "choose_order"]

_LAGS = 200


@dataclass(frozen=True, eq=False)
class OrderChoice:
    """An order and its reason.

    Attributes:
        order: n.
        reason: in one line.
        criterion: shape (k + 1,), of the orders 0 … k, smallest is best; NaN where an order could not
            be the best any more, empty where rounding alone decides.
        notes: doubts, one line each.
    """

    order: int
    reason: str
    criterion: Floats
    notes: tuple[str, ...] = ()


def choose_order(record: tuple[Floats, Floats], trial: HorizonView, settings: SubspaceSettings) -> OrderChoice:
    """Return the automatic order.

    Args:
        record: u and y, of size one.
        trial: how the record is seen.
        settings: of the identification.
    """
    space, most = trial.space, min(settings.most, largest_order(trial.factor.horizon, trial.factor.outputs))
    if not space.noisy and space.rank <= most:
        why = f"singular values beyond the first {space.rank} are rounding errors: the data are free of noise"
        return OrderChoice(space.rank, why, np.zeros(0))
    orders = np.arange(min(most, space.rank) + 1)
    last = deliver(record, trial, int(orders[-1]), settings).error
    samples = len(record[0]) / _inflation(last)
    price = orders * (record[0].shape[1] + record[1].shape[1]) * np.log(samples) / samples
    costs = np.full(len(orders), np.nan)
    costs[-1] = cost(last)
    for n in orders[:-1]:
        costs[n] = simulation_cost(record, trial, int(n), settings)
        if _settled(costs, price, int(n)):
            break
    return _choice(costs + price, costs)


def _settled(costs: Floats, price: Floats, n: int) -> bool:
    """Tell whether no order above n can be the best: all simulate no better than the largest, at a higher price."""
    floor, best = costs[-1], float(np.min((costs + price)[: n + 1]))
    return bool(floor <= np.min(costs[: n + 1]) and floor + price[n + 1] > best)


def _inflation(error: Floats) -> float:
    """Return Σ ρ²(τ) over positive and negative lags, the largest of the outputs."""
    samples = len(error)
    lags = min(_LAGS, samples // 4)
    spectrum = np.abs(np.fft.rfft(error, 2 * samples, axis=0)) ** 2
    covariance = np.fft.irfft(spectrum, axis=0)[: lags + 1]
    rho = covariance / np.maximum(covariance[0], 1e-300)
    chance = 1.0 / samples  # what white noise shows at every lag
    return float(np.max(1.0 + 2.0 * np.sum(np.maximum(rho[1:] ** 2 - chance, 0.0), axis=0)))


def _choice(criterion: Floats, costs: Floats) -> OrderChoice:
    order = int(np.nanargmin(criterion))
    last = len(criterion) - 1
    why = f"smallest Bayesian criterion of the simulation error among orders 0 to {last}"
    if order > 0:
        why += f"; order {order - 1} would raise the error by {_percent(costs[order - 1] - costs[order])}"
    if order < last:
        above = order + 1 if np.isfinite(costs[order + 1]) else last
        if np.isfinite(costs[above]):  # a model that cannot be simulated lowers nothing
            why += f"; order {above} would lower it by {_percent(costs[order] - costs[above])} only"
    notes = []
    if order == last > 1:
        notes.append(f"order {order} is the largest considered: allow more, or check the data")
    return OrderChoice(order, why, criterion, tuple(notes))


def _percent(difference: float) -> str:
    return f"{100.0 * np.expm1(min(max(difference, 0.0) / 2.0, 50.0)):.3g} %"


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
        raise InputError(
            f"order {order} is too high: the data determine only {held}, singular values beyond are rounding errors"
        )
