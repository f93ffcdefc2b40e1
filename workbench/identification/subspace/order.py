"""The model of an order, and the order that is chosen.

Free of noise, the rank decides: singular values fall to rounding. With noise no gap in the singular values is to
be trusted; instead the model of every order is made as it would be handed out and simulated, and the smallest of

    log det V(n) + n (p + m) log(N') / N'

is taken, V(n) being the covariance of the simulation's error: the Bayesian criterion (Ljung 1999, section 16.4) for a
model whose order is worth p + m numbers. N' is the number of samples divided by Σ ρ²(τ), ρ being the autocorrelation
of the error that the largest of the models leaves (Bartlett 1946): coloured noise carries that much less information,
and without the correction its dynamics would be modelled as if they were the system's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.subspace.horizon import HorizonView, SubspaceSettings, largest_order
from workbench.identification.subspace.matrices import (
    InputFit,
    Noise,
    StateFit,
    fit_inputs,
    fit_states,
    noise_of,
    radius,
    residual,
    shifted_observability,
    stabilise,
)
from workbench.identification.subspace.projections import Subspace

__all__ = ["Delivered", "OrderChoice", "check_order", "choose_order", "cost", "deliver"]

_GROWTH = 1e3  # a model whose free motion grows more than this over the record is fitted by prediction
_TINY = 1e-26  # of the outputs' mean square: keeps the logarithm finite where an output is free of noise


@dataclass(frozen=True, eq=False)
class Delivered:
    """The model of the scaled record.

    Attributes:
        A: shape (n, n).
        C: shape (p, n).
        fit: B, D, initial state and constant part.
        noise: gain and covariance of the innovations.
        moved: poles outside the unit circle that were moved inside.
        error: shape (N, p), what the simulation leaves of the output; not finite where it has no finite one.
    """

    A: Floats
    C: Floats
    fit: InputFit
    noise: Noise
    moved: int
    error: Floats


def deliver(record: tuple[Floats, Floats], trial: HorizonView, order: int, settings: SubspaceSettings) -> Delivered:
    """Return the model of an order.

    An automatic order may not end in a model that cannot be simulated on its own data: where that of the order is
    unstable, the one with its poles moved inside is made as well, and of both the better simulation is taken.

    Args:
        record: u and y, of size one.
        trial: how the record is seen.
        order: n.
        settings: of the identification.
    """
    states = fit_states(trial.factor, trial.space.memory[:order], feedthrough=settings.feedthrough)
    A, C = states.A, states.C
    if not settings.biased:
        A, C = shifted_observability(trial.space.observability[:, :order], trial.factor.outputs)
    tame, moved = stabilise(A)
    if settings.stable:
        return _completed(record, (states, tame, C, moved), settings)
    result = _completed(record, (states, A, C, 0), settings)
    if settings.order is not None or radius(A) < 1.0:
        return result
    return min(result, _completed(record, (states, tame, C, moved), settings), key=lambda model: cost(model.error))


def cost(error: Floats) -> float:
    """Return log det of the covariance of a simulation's error; infinite where there is no finite simulation.

    Args:
        error: shape (N, p).
    """
    with np.errstate(all="ignore"):  # an unstable model overflows
        covariance = error.T @ error / len(error)
    if not np.all(np.isfinite(covariance)):
        return math.inf
    return float(np.linalg.slogdet(covariance + _TINY * np.eye(len(covariance)))[1])


def _completed(
    record: tuple[Floats, Floats], dynamics: tuple[StateFit, Floats, Floats, int], settings: SubspaceSettings
) -> Delivered:
    states, A, C, moved = dynamics
    noise = noise_of(states, A, C)
    if settings.biased and not moved and not _grows(record, A):
        fit = _start(record, A, C, states)
    else:
        fit = _fit(record, A, C, noise, feedthrough=settings.feedthrough)
    with np.errstate(all="ignore"):  # an unstable model overflows
        error = residual(*record, A, C, fit)
    return Delivered(A, C, fit, noise, moved, error)


def _start(record: tuple[Floats, Floats], A: Floats, C: Floats, states: StateFit) -> InputFit:
    """Return the regression's own B and D with the initial state and the constant part that suit them best."""
    u, y = record
    fit = InputFit(states.B, states.D, np.zeros(len(A)), np.zeros(len(C)))
    free = fit_inputs(u[:, :0], residual(u, y, A, C, fit), A, C, feedthrough=False)
    return InputFit(states.B, states.D, free.x0, free.offset)


def _fit(record: tuple[Floats, Floats], A: Floats, C: Floats, noise: Noise, *, feedthrough: bool) -> InputFit:
    """Fit B, D and x0, once more with outputs weighted by what the first fit left of each if there are several."""
    grows = _grows(record, A)
    fit = fit_inputs(*record, A, C, feedthrough=feedthrough, K=noise.K if grows else None)
    if grows or noise.note or len(C) == 1:
        return fit
    weight = _weight(residual(*record, A, C, fit))
    return fit if weight is None else fit_inputs(*record, A, C, feedthrough=feedthrough, weight=weight)


def _grows(record: tuple[Floats, Floats], A: Floats) -> bool:
    return len(record[0]) * math.log(max(radius(A), 1e-300)) > math.log(_GROWTH)


def _weight(error: Floats) -> Floats | None:
    """Return the inverse root of the error's covariance.

    None where some combination of outputs has no error, and where all have much the same so that it would not matter.
    """
    values, vectors = np.linalg.eigh(error.T @ error / len(error))
    if values[0] <= 1e-10 * values[-1] or values[0] > 0.5 * values[-1]:
        return None
    weight: Floats = (vectors / np.sqrt(values)).T
    return weight


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
        costs[n] = cost(deliver(record, trial, int(n), settings).error)
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
