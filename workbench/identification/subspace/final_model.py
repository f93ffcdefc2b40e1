"""The model that is handed out, made from what a trial shows; choices are judged by it and by no other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.identification.subspace.candidates import HorizonView
from workbench.identification.subspace.matrices import radius, shifted_observability, stabilise
from workbench.identification.subspace.settings import SubspaceSettings
from workbench.identification.subspace.simulated import InputFit, fit_inputs, residual
from workbench.identification.subspace.states import Noise, StateFit, fit_states, noise_of

__all__ = ["Delivered", "cost", "deliver", "simulation_cost"]

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
    found = _completed(record, (states, A, C, 0), settings)
    if settings.order is not None or radius(A) < 1.0:
        return found
    return min(found, _completed(record, (states, tame, C, moved), settings), key=lambda model: cost(model.error))


def simulation_cost(record: tuple[Floats, Floats], trial: HorizonView, order: int, settings: SubspaceSettings) -> float:
    """Return `cost` of the model that is handed out for an order.

    Args:
        record: u and y, of size one.
        trial: how the record is seen.
        order: n.
        settings: of the identification.
    """
    return cost(deliver(record, trial, order, settings).error)


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
