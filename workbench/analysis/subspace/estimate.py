"""Subspace identification: from a record to a state-space model without iteration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from workbench.analysis.blas import one_thread
from workbench.analysis.subspace.data import prepare
from workbench.analysis.subspace.delays import advance, as_tuple
from workbench.analysis.subspace.finish import model_of
from workbench.analysis.subspace.horizon import largest_order
from workbench.analysis.subspace.matrices import radius, shifted_observability
from workbench.analysis.subspace.order import OrderChoice, check_order, choose_order
from workbench.analysis.subspace.result import SubspaceEstimate
from workbench.analysis.subspace.settings import DEFAULT_MOST, Settings, check_interval, check_order_wish
from workbench.analysis.subspace.simulated import InputFit, fit_inputs, residual
from workbench.analysis.subspace.stability import stabilise
from workbench.analysis.subspace.states import Noise, fit_states, noise_of
from workbench.analysis.subspace.trial import Trial, best_trial, first_trial
from workbench.analysis.subspace.weightings import principal_angles
from workbench.origin import with_origin
from workbench.session.base import Floats

__all__ = ["estimate"]

_GROWTH = 1e3  # a model whose free motion grows more than this over the record is fitted by prediction


@dataclass(frozen=True, eq=False)
class _Found:
    """The model of the scaled record."""

    A: Floats
    C: Floats
    fit: InputFit
    noise: Noise
    moved: int


@with_origin()
def estimate(
    u: ArrayLike,
    y: ArrayLike,
    dt: float,
    *,
    order: int | Literal["auto"] = "auto",
    method: str = "n4sid",
    basis: str | None = None,
    horizon: int | None = None,
    max_order: int = DEFAULT_MOST,
    feedthrough: bool = True,
    delay: int | Sequence[int] = 0,
    biased: bool = False,
    stable: bool = False,
) -> SubspaceEstimate:
    """Identify a linear discrete state-space model from a record of inputs and outputs.

    A and C follow from the shift of the extended observability matrix, which is found as the column space of a weighted
    projection of future outputs on the past (Van Overschee & De Moor 1996, chapter 4; Verhaegen & Verdult 2007,
    chapter 9); B, D and the initial state from a linear regression on the simulated output; K and the covariance of the
    innovations from the residuals of the state sequence. Channels are brought to one size first, so that units do not
    matter.

    Not for data recorded in closed loop, where the projection along the future input is biased (Chiuso & Picci 2005;
    the data advice has a test). Not for a single sine or few lines: 2 · horizon + order independent shifts of the
    input are needed. A constant part of each output is estimated beside (`y0` of the model); large offsets
    are better taken off before, as a note says.

    Args:
        u: inputs, shape (N, m) or (N,), held from sample to sample.
        y: outputs, shape (N, p) or (N,); y[k] holds the effect of u[k] if there is feedthrough.
        dt: sampling interval [s].
        order: number of states without delays, 0 for a gain, or "auto" (which gives 0 without noise only).
        method: name in `workbench.analysis.subspace.METHODS`; which weighting, see there.
        basis: the source report's keyword: "combined" weights outputs by their covariance (principal angles),
            "unscaled" does not (singular values); None: the method's own.
        horizon: block rows of the past and of the future [samples]; None: several are tried, see
            `workbench.analysis.subspace.horizon`.
        max_order: largest order the automatic choice considers.
        feedthrough: estimate D; else it is zero.
        delay: known delay of all inputs or of each [samples].
        biased: A, B, C, D from the regression on the state sequence: less variance, and a bias that does not vanish
            with the length of the record. The source report's choice for real-life data.
        stable: move poles outside the unit circle inside, see `workbench.analysis.subspace.stability`.

    Raises:
        InputError: data not finite, of unequal length, too short for the order or not exciting enough; unknown name.
    """
    interval = check_interval(dt)
    settings = Settings(
        order=check_order_wish(order), method=method, basis=basis, horizon=horizon, most=max_order,
        feedthrough=feedthrough, biased=biased, stable=stable,
    )  # fmt: skip
    record = prepare(u, y)
    delays = as_tuple(delay, record.u.shape[1])
    data = advance(record.u, record.y, delays)
    with one_thread():
        first = first_trial(data, settings)
        choice = _order(data, first, settings)
        trial = best_trial(data, first, choice.order, settings)
        found = _identify(data, trial, choice.order, settings)
    notes = (*record.notes, first.note, *choice.notes, found.noise.note, _stability(found.A, found.moved))
    return SubspaceEstimate(
        model=model_of(found.A, found.C, found.fit, found.noise, record=record, delays=delays, dt=interval),
        method=method,
        basis=settings.weighting,
        biased=biased,
        order=choice.order,
        order_reason=choice.reason,
        order_criterion=choice.criterion,
        singular_values=trial.space.singular_values,
        principal_angles_deg=principal_angles(trial.parts),
        floor=trial.space.floor,
        horizon=trial.factor.horizon,
        stabilised=found.moved,
        notes=tuple(n for n in notes if n),
    )


def _order(data: tuple[Floats, Floats], first: Trial, settings: Settings) -> OrderChoice:
    if settings.order is None:
        most = min(settings.most, largest_order(first.factor.horizon, first.factor.outputs))
        return choose_order(data, first.space, most, feedthrough=settings.feedthrough)
    check_order(settings.order, first.space)
    return OrderChoice(settings.order, "given", np.zeros(0))


def _identify(data: tuple[Floats, Floats], trial: Trial, order: int, settings: Settings) -> _Found:
    states = fit_states(trial.factor, trial.space.memory[:order], feedthrough=settings.feedthrough)
    A, C = states.A, states.C
    if not settings.biased:
        A, C = shifted_observability(trial.space.observability[:, :order], trial.factor.outputs)
    A, moved = stabilise(A) if settings.stable else (A, 0)
    noise = noise_of(states, A, C)
    fit = _fit(data, A, C, noise, feedthrough=settings.feedthrough)
    if settings.biased and not moved:
        fit = InputFit(states.B, states.D, fit.x0, fit.offset)
    return _Found(A, C, fit, noise, moved)


def _fit(data: tuple[Floats, Floats], A: Floats, C: Floats, noise: Noise, *, feedthrough: bool) -> InputFit:
    """Fit B, D and x0, once more with outputs weighted by what the first fit left of each if there are several."""
    grows = len(data[0]) * math.log(max(radius(A), 1e-300)) > math.log(_GROWTH)
    K = noise.K if grows else None
    fit = fit_inputs(*data, A, C, feedthrough=feedthrough, K=K)
    if grows or noise.note or len(C) == 1:
        return fit
    weight = _weight(residual(*data, A, C, fit))
    return fit if weight is None else fit_inputs(*data, A, C, feedthrough=feedthrough, weight=weight)


def _weight(error: Floats) -> Floats | None:
    """Return the inverse root of the error's covariance.

    None where some combination of outputs has no error, and where all have much the same so that it would not matter.
    """
    values, vectors = np.linalg.eigh(error.T @ error / len(error))
    if values[0] <= 1e-10 * values[-1] or values[0] > 0.5 * values[-1]:
        return None
    weight: Floats = (vectors / np.sqrt(values)).T
    return weight


def _stability(A: Floats, moved: int) -> str:
    if moved:
        return f"{moved} pole(s) outside the unit circle were moved inside"
    size = radius(A)
    if size < 1.0:
        return ""
    return f"the model is not stable (|pole| = {size:.6g}); if the system is, take a lower order or stable=True"
