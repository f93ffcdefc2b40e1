"""Subspace identification: from a record to a state-space model without iteration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.subspace.horizon import (
    DEFAULT_METHOD,
    DEFAULT_MOST,
    HorizonView,
    SubspaceSettings,
    candidates,
    check_interval,
    check_order_wish,
    first_trial,
    largest_order,
    look,
)
from workbench.identification.subspace.matrices import InputFit, Noise, radius
from workbench.identification.subspace.order import Delivered, OrderChoice, check_order, choose_order, cost, deliver
from workbench.identification.subspace.projections import oblique_loss, principal_angles
from workbench.identification.subspace.record import ScaledData, advance, as_tuple, prepare, with_chains
from workbench.identification.subspace.result import SubspaceEstimate
from workbench.requests.decorator import with_origin

__all__ = ["estimate", "model_of"]

_LOSS = 10.0  # from here on n4sid was 5 to 20 times less accurate than moesp in trials


@with_origin()
def estimate(
    u: ArrayLike,
    y: ArrayLike,
    dt: float,
    *,
    order: int | Literal["auto"] = "auto",
    method: str = DEFAULT_METHOD,
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
        order: number of states without delays, 0 for a gain, or "auto".
        method: name in `workbench.identification.subspace.projections.METHODS`; which weighting, see there.
        basis: the source report's keyword: "combined" weights outputs by their covariance (principal angles),
            "unscaled" does not (singular values); None: the method's own.
        horizon: block rows of past and future [samples]; None: several are tried (`subspace/horizon.py`).
        max_order: largest order the automatic choice considers.
        feedthrough: estimate D; else it is zero.
        delay: known delay of all inputs or of each [samples].
        biased: A, B, C, D from the regression on the state sequence: less variance, and a bias that does not vanish
            with the length of the record. The source report's choice for real-life data.
        stable: move poles outside the unit circle inside, see `workbench.identification.subspace.order`.

    Raises:
        InputError: data not finite, of unequal length, too short for the order or not exciting enough; unknown name.

    Examples:
        >>> import numpy as np
        >>> u, y = np.random.default_rng(0).standard_normal(300), np.zeros(300)
        >>> for k in range(299):
        ...     y[k + 1] = 0.5 * y[k] + u[k]
        >>> print(wb.estimate(u, y, 0.1, order=1).model.A.round(6))
        [[0.5]]
    """
    settings = SubspaceSettings(
        order=check_order_wish(order), method=method, basis=basis, horizon=horizon, most=max_order,
        feedthrough=feedthrough, biased=biased, stable=stable,
    )  # fmt: skip
    return _estimated(prepare(u, y), check_interval(dt), settings, delay)


def _estimated(
    record: ScaledData, interval: float, settings: SubspaceSettings, delay: int | Sequence[int]
) -> SubspaceEstimate:
    """Return the model of a record: horizon and order first, then the matrices."""
    delays = as_tuple(delay, record.u.shape[1])
    data = advance(record.u, record.y, delays)
    with one_thread():
        first = first_trial(data, settings)
        choice = _order(data, first, settings)
        trial = _best_trial(data, first, choice.order, settings)
        result = deliver(data, trial, choice.order, settings)
    if not np.all(np.isfinite(result.fit.B)):
        raise InputError(
            f"a model of order {choice.order} grows beyond all numbers over {len(data[0])} samples; ask for a lower "
            "order, or for a stable model"
        )
    notes = (
        *record.notes,
        first.note,
        *choice.notes,
        result.noise.note,
        _oblique(trial, settings.method),
        _stability(result, settings),
    )
    return SubspaceEstimate(
        model=model_of(result.A, result.C, result.fit, result.noise, record=record, delays=delays, dt=interval),
        method=settings.method,
        basis=settings.weighting,
        biased=settings.biased,
        order=choice.order,
        order_reason=choice.reason,
        order_criterion=choice.criterion,
        singular_values=trial.space.singular_values,
        principal_angles_deg=principal_angles(trial.parts),
        floor=trial.space.floor,
        horizon=trial.factor.horizon,
        stabilised=result.moved,
        notes=tuple(n for n in notes if n),
    )


def _order(data: tuple[Floats, Floats], first: HorizonView, settings: SubspaceSettings) -> OrderChoice:
    if settings.order is None:
        return choose_order(data, first, settings)
    check_order(settings.order, first.space)
    return OrderChoice(settings.order, "given", np.zeros(0))


def _best_trial(
    record: tuple[Floats, Floats], first: HorizonView, order: int, settings: SubspaceSettings
) -> HorizonView:
    """Return the horizon whose model of the given order simulates the record best."""
    if first.fixed:
        return first
    size = len(record[0]), record[0].shape[1], record[1].shape[1]
    others = [look(record, h, settings) for h in candidates(order, first.factor.horizon, size)]
    usable = [t for t in (first, *others) if order <= min(t.space.rank, largest_order(t.factor.horizon, size[2]))]
    if len(usable) < 2:
        return first
    return min(usable, key=lambda t: _merit(record, t, order, settings))


def _merit(
    record: tuple[Floats, Floats], trial: HorizonView, order: int, settings: SubspaceSettings
) -> tuple[bool, float]:
    """Return what is smaller for the better horizon: one with a stable model before one without, then the error."""
    result = deliver(record, trial, order, settings)
    return result.moved > 0 or radius(result.A) >= 1.0, cost(result.error)


def _oblique(trial: HorizonView, method: str) -> str:
    loss = oblique_loss(trial.parts) if method == "n4sid" and trial.space.noisy else 1.0
    if loss < _LOSS:
        return ""
    return (
        f"n4sid: noise counts {loss:.2g} times as much in its oblique projection as in moesp's, as the future inputs "
        "nearly follow from the past ones (slow for this sampling interval): use moesp, or resample"
    )


def _stability(result: Delivered, settings: SubspaceSettings) -> str:
    if result.moved:
        why = "" if settings.stable else (
            ": the model as it was estimated does not follow its own data; if the system itself is unstable, give the "
            "order"
        )  # fmt: skip
        return f"{result.moved} pole(s) outside the unit circle were moved inside{why}"
    size = radius(result.A)
    if size < 1.0:
        return ""
    return f"the model is not stable (|pole| = {size:.6g}); if the system is, use a lower order, or the option stable"


# -- the model in the units of the record, delays included -----------------------------------------


def model_of(
    A: Floats, C: Floats, fit: InputFit, noise: Noise, *, record: ScaledData, delays: tuple[int, ...], dt: float
) -> IdentifiedModel:
    """Return the identified model.

    Args:
        A: shape (n, n).
        C: shape (p, n), of outputs of size one.
        fit: B, D, x0 and constant part of channels of size one.
        noise: likewise.
        record: with the sizes of the channels.
        delays: delays of the inputs [samples].
        dt: sampling interval [s].
    """
    su, sy = record.u_scale, record.y_scale
    B, C, D = fit.B / su, sy[:, None] * C, sy[:, None] * fit.D / su
    m, p, chain = len(su), len(sy), sum(delays)
    A, B, C, D = with_chains((A, B, C, D), delays)
    model = IdentifiedModel(
        A=A, B=B, C=C, D=D, K=np.vstack([noise.K / sy, np.zeros((chain, p))]),
        x0=np.append(fit.x0, np.zeros(chain)), dt=dt, u0=np.zeros(m), y0=sy * fit.offset,
        covariance=sy[:, None] * noise.covariance * sy, delay=delays if chain else (),
        input_names=tuple(f"u{k + 1}" for k in range(m)), output_names=tuple(f"y{k + 1}" for k in range(p)),
        input_units=(None,) * m, output_units=(None,) * p,
    )  # fmt: skip
    return replace(model, x0=model.initial_state(record.u * su, record.y * sy)) if chain else model
