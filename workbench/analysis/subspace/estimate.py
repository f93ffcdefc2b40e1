"""Subspace identification: from a record to a state-space model without iteration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from workbench.analysis.identified import IdentifiedModel
from workbench.analysis.subspace.data import Record, prepare
from workbench.analysis.subspace.delays import advance, as_tuple, with_chains
from workbench.analysis.subspace.hankel import HankelFactor, factorise
from workbench.analysis.subspace.horizon import DEFAULT_MOST, choose_horizon, largest_order
from workbench.analysis.subspace.order import OrderChoice, check_order, choose_order
from workbench.analysis.subspace.result import SubspaceEstimate
from workbench.analysis.subspace.simulated import InputFit, fit_inputs
from workbench.analysis.subspace.stability import stabilise
from workbench.analysis.subspace.states import Noise, StateFit, fit_states, noise_of, radius
from workbench.analysis.subspace.weightings import Projection, Subspace, basis_of, principal_angles, project, subspace
from workbench.errors import InputError
from workbench.session.base import Floats

__all__ = ["estimate"]

_GROWTH = 1e3  # a model whose free motion grows more than this over the record is fitted by prediction


@dataclass(frozen=True)
class _Wish:
    """What the caller asked for, checked."""

    order: int | None
    method: str
    basis: str
    horizon: int | None
    most: int
    feedthrough: bool
    biased: bool
    stable: bool


@dataclass(frozen=True, eq=False)
class _Found:
    """The model of the scaled record."""

    A: Floats
    C: Floats
    fit: InputFit
    noise: Noise
    moved: int
    notes: tuple[str, ...]


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

    Not for data recorded in closed loop: the estimate is then biased (Chiuso & Picci 2005; see the data advice). Not for
    inputs that excite less than order + horizon: see `notes`. Offsets must be taken off before.

    Args:
        u: inputs, shape (N, m) or (N,), held from sample to sample.
        y: outputs, shape (N, p) or (N,); y[k] holds the effect of u[k] if there is feedthrough.
        dt: sampling interval [s].
        order: number of states without delays, or "auto".
        method: name in `workbench.analysis.subspace.METHODS`; which weighting, see there.
        basis: the source report's keyword: "combined" weights outputs by their covariance (principal angles), "unscaled"
            does not (singular values); None: the method's own.
        horizon: block rows of the past and of the future [samples]; None: 2 · order + 2, or max_order + 2 with the
            automatic order.
        max_order: largest order the automatic choice considers.
        feedthrough: estimate D; else it is zero.
        delay: known delay of all inputs or of each [samples].
        biased: A, B, C, D from the regression on the state sequence: less variance, and a bias that does not vanish with
            the length of the record. The source report's choice for real-life data.
        stable: move poles outside the unit circle inside, see `workbench.analysis.subspace.stability`.

    Raises:
        InputError: data not finite, of unequal length, too short for the order or not exciting enough; unknown name.
    """
    delays, record = _checked(u, y, dt, delay)
    wish = _wish(order, method, basis, horizon, max_order, feedthrough=feedthrough, biased=biased, stable=stable)
    shifted = advance(record.u, record.y, delays)
    factor, notes = _factor(*shifted, wish)
    parts = project(factor)
    space = subspace(parts, wish.method, wish.basis)
    choice = _order(factor, space, wish)
    found = _identify(shifted, factor, parts, space, choice.order, wish)
    model = _unscaled(found, record, delays, dt, (u, y))
    return SubspaceEstimate(
        model=model,
        method=method,
        basis=wish.basis,
        biased=biased,
        order=choice.order,
        order_reason=choice.reason,
        order_criterion=choice.criterion,
        singular_values=space.singular_values,
        principal_angles_deg=principal_angles(parts),
        floor=space.floor,
        horizon=factor.horizon,
        stabilised=found.moved,
        notes=(*record.notes, *notes, *found.notes),
    )


def _checked(u: ArrayLike, y: ArrayLike, dt: float, delay: int | Sequence[int]) -> tuple[tuple[int, ...], Record]:
    if not (math.isfinite(dt) and dt > 0.0):
        raise InputError(f"dt must be positive, not {dt} s")
    record = prepare(u, y)
    return as_tuple(delay, record.u.shape[1]), record


def _wish(
    order: int | str, method: str, basis: str | None, horizon: int | None, most: int,
    *, feedthrough: bool, biased: bool, stable: bool,
) -> _Wish:  # fmt: skip
    if isinstance(order, str):
        if order != "auto":
            raise InputError(f"order '{order}' is neither a number nor 'auto'")
        wanted = None
    else:
        wanted = int(order)
        if wanted < 1:
            raise InputError(f"order must be 1 or more, not {order}")
    if most < 1:
        raise InputError(f"max_order must be 1 or more, not {most}")
    return _Wish(wanted, method, basis_of(method, basis), horizon, most, feedthrough, biased, stable)


def _factor(u: Floats, y: Floats, wish: _Wish) -> tuple[HankelFactor, tuple[str, ...]]:
    """Return the factor, with a shorter horizon where the input does not excite the one first chosen."""
    (samples, m), p = u.shape, y.shape[1]
    horizon = choose_horizon(samples, m, p, wish.order, wish.horizon, wish.most)
    factor = factorise(u, y, horizon)
    excited = factor.excitation
    if excited >= 2 * horizon:
        return factor, ()
    shorter, least = excited // 2, 2 if wish.order is None else wish.order // p + 2
    if wish.horizon is not None or shorter < least:
        raise InputError(
            f"the inputs excite {excited} block rows only; order {wish.order or 'auto'} needs at least {2 * least}: use "
            "a richer input (PRBS, more lines) or a lower order"
        )
    note = f"the inputs excite {excited} block rows only, therefore horizon {shorter} instead of {horizon}"
    return factorise(u, y, shorter), (note,)


def _order(factor: HankelFactor, space: Subspace, wish: _Wish) -> OrderChoice:
    if wish.order is None:
        return choose_order(factor, space, min(wish.most, largest_order(factor.horizon, factor.outputs)))
    check_order(wish.order, space)
    return OrderChoice(wish.order, "given", np.zeros(0))


def _identify(
    record: tuple[Floats, Floats], factor: HankelFactor, parts: Projection, space: Subspace, order: int, wish: _Wish
) -> _Found:
    p, memory = factor.outputs, space.memory[:order]
    states = fit_states(factor, memory, feedthrough=wish.feedthrough)
    A, C = (states.A, states.C) if wish.biased else shifted_observability(space.observability[:, :order], p)
    A, moved = stabilise(A) if wish.stable else (A, 0)
    noise = noise_of(states, A, C)
    fit = _input_fit(record, A, C, noise, states, wish, moved)
    return _Found(A, C, fit, noise, moved, tuple(n for n in (noise.note, _moved(moved)) if n))


def shifted_observability(observability: Floats, outputs: int) -> tuple[Floats, Floats]:
    """Return A and C of the extended observability matrix [C; C A; C A²; …].

    Args:
        observability: shape (i p, n).
        outputs: p.
    """
    A: Floats = np.linalg.lstsq(observability[:-outputs], observability[outputs:], rcond=None)[0]
    return A, observability[:outputs]


def _input_fit(
    record: tuple[Floats, Floats], A: Floats, C: Floats, noise: Noise, states: StateFit, wish: _Wish, moved: int
) -> InputFit:
    grows = len(record[0]) * math.log(max(radius(A), 1e-300)) > math.log(_GROWTH)
    fit = fit_inputs(*record, A, C, feedthrough=wish.feedthrough, K=noise.K if grows else None)
    if wish.biased and not moved:
        return InputFit(states.B, states.D, fit.x0, fit.covariance)
    return fit


def _moved(moved: int) -> str:
    return f"{moved} poles were moved into the unit circle" if moved else ""


def _unscaled(
    found: _Found, record: Record, delays: tuple[int, ...], dt: float, data: tuple[ArrayLike, ArrayLike]
) -> IdentifiedModel:
    """Return the model in the units of the record, delays included."""
    su, sy, noise = record.u_scale, record.y_scale, found.noise
    B, C, D = found.fit.B / su, sy[:, None] * found.C, sy[:, None] * found.fit.D / su
    m, p, chain = len(su), len(sy), sum(delays)
    A, B, C, D = with_chains(found.A, B, C, D, delays)
    model = IdentifiedModel(
        A=A, B=B, C=C, D=D, K=np.vstack([noise.K / sy, np.zeros((chain, p))]),
        x0=np.append(found.fit.x0, np.zeros(chain)), dt=float(dt), u0=np.zeros(m), y0=np.zeros(p),
        covariance=sy[:, None] * noise.covariance * sy, delay=delays if chain else (),
        input_names=tuple(f"u{k + 1}" for k in range(m)), output_names=tuple(f"y{k + 1}" for k in range(p)),
        input_units=(None,) * m, output_units=(None,) * p,
    )  # fmt: skip
    if not chain:
        return model
    u, y = (np.asarray(v, dtype=np.float64).reshape(len(record.u), -1) for v in data)
    return replace(model, x0=model.initial_state(u, y))
