"""From the signals of an identification to a refined model in their units, and back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats
from workbench.identification.identified.model import IdentifiedModel, NoiseModel
from workbench.identification.prediction.model_selection import Chosen, SelectionOptions, choose
from workbench.identification.prediction.refine import Refined, instrumented, refine
from workbench.identification.prediction.start import started, with_own
from workbench.identification.subspace.estimate import model_of
from workbench.identification.subspace.matrices import InputFit, Noise
from workbench.identification.subspace.record import ScaledData, advance, as_tuple, prepare

__all__ = ["RefinedModel", "instrumented_model", "parameter_spread", "refined_model"]


_OPEN = 1e-13  # of the largest eigenvalue of the correlations of the information: rounding, the data say nothing


@dataclass(frozen=True, eq=False)
class RefinedModel:
    """A refined model in the units of its signals.

    Attributes:
        model: without names.
        chosen: how it was found, of signals of size one.
        above: the model of a higher order that explains significantly more; None: there is none.
    """

    model: IdentifiedModel
    chosen: Chosen
    above: IdentifiedModel | None = None


def refined_model(start: IdentifiedModel, u: Floats, y: Floats, wish: SelectionOptions) -> RefinedModel | None:
    """Return the model of the least prediction error; None where nothing can be refined.

    Args:
        start: from the same signals, with its delays.
        u: shape (N, m), the operating point taken off.
        y: shape (N, p), likewise.
        wish: what is asked for.
    """
    record = prepare(u, y)
    delays = as_tuple(start.delay or 0, u.shape[1])
    core, (su, sy) = start.undelayed(), (record.u_scale, record.y_scale)
    plant = core.A, core.B * su, core.C / sy[:, None], core.D * su / sy[:, None]
    scaled = wish if wish.gains is None else replace(wish, gains=wish.gains * su / sy[:, None])
    with one_thread():
        chosen = choose(advance(record.u, record.y, delays), [plant], scaled)
    if chosen is None:
        return None
    above = None if chosen.above is None else _in_units(chosen.above, record, delays, start.dt)
    return RefinedModel(_in_units(chosen.refined, record, delays, start.dt), chosen, above)


def instrumented_model(
    start: IdentifiedModel, u: Floats, driven: Floats, y: Floats, wish: SelectionOptions
) -> IdentifiedModel | None:
    """Return the model whose errors know nothing of a reference; None where there is none near, or it is open.

    Args:
        start: a stable plant near it, and its disturbance.
        u: shape (N, m), the operating point taken off.
        driven: shape (N, m), that part of u which the reference makes.
        y: shape (N, p), the operating point taken off.
        wish: with feedthrough and gains.
    """
    record, delays = prepare(u, y), as_tuple(start.delay or 0, u.shape[1])
    core, (su, sy) = start.undelayed(), (record.u_scale, record.y_scale)
    p = len(sy)
    noise = (np.zeros((0, 0)), np.zeros((0, p)), np.zeros((p, 0)))
    if start.noise is not None:
        noise = start.noise.A, start.noise.K * sy, start.noise.C / sy[:, None]
    with one_thread():
        pair = advance(record.u, record.y, delays)
        plant = core.A, core.B * su, core.C / sy[:, None], core.D * su / sy[:, None]
        begun = replace(
            with_own(started(pair, plant), noise, feedthrough=wish.feedthrough),
            gains=None if wish.gains is None else wish.gains * su / sy[:, None],
        )
        known = advance(driven / su, record.y, delays)[0]
        # The least prediction error under the inputs as they are is mostly near, too, and free of the first stage's.
        near = refine(begun, pair, stable=True)
        starts = [*(() if near is None else (near.model,)), begun]
        result = next((one for one in (instrumented(start, pair, known) for start in starts) if one is not None), None)
    model = None if result is None else _in_units(result, record, delays, start.dt)
    return None if model is None or model.spread is None else model


def _in_units(result: Refined, record: ScaledData, delays: tuple[int, ...], dt: float) -> IdentifiedModel:
    fit, n, (su, sy) = result.model, result.model.plant, (record.u_scale, record.y_scale)
    inputs = InputFit(fit.B[:n], fit.D, fit.x0[:n], fit.offset)
    noise = Noise(fit.K[:n], result.covariance)
    model = model_of(fit.A[:n, :n], fit.C[:, :n], inputs, noise, record=record, delays=delays, dt=dt)
    own = None
    if fit.disturbance:
        own = NoiseModel(A=fit.A[n:, n:], K=fit.K[n:] / sy, C=sy[:, None] * fit.C[:, n:])
    return replace(model, noise=own, spread=parameter_spread(result, su, sy))


def parameter_spread(result: Refined, su: Floats, sy: Floats) -> Floats | None:
    """Return a factor of the covariance of A, B, C, D of the plant; None where the data leave a direction open.

    The inverse of Fisher's information (Ljung 1999, section 9.4), enlarged for the numbers fitted. It is so much larger
    for the pole of an integrator than for others that only its correlations tell whether a direction is open.
    """
    fit, n = result.model, result.model.plant
    size = np.sqrt(np.diag(result.information))
    if size.min() <= 0.0:
        return None
    values, vectors = np.linalg.eigh(result.information / np.outer(size, size))
    if values[0] <= _OPEN * values[-1]:
        return None
    left = result.samples - result.freedom / len(fit.C)
    turned = result.directions @ (vectors / size[:, None])
    factor = turned / np.sqrt(values) * np.sqrt(result.samples / max(left, 1.0))
    every = np.zeros((sum(part.size for part in fit.parts), factor.shape[1]))
    every[result.entries] = factor
    sizes = np.cumsum([0, *(part.size for part in fit.parts)])
    A, B, _, C, D = (
        every[a:b].reshape(*part.shape, factor.shape[1])
        for a, b, part in zip(sizes[:5], sizes[1:6], fit.parts[:5], strict=True)
    )
    count = factor.shape[1]
    parts = (
        A[:n, :n], B[:n] / su[:, None], sy[:, None, None] * C[:, :n], sy[:, None, None] * D / su[:, None],
    )  # fmt: skip
    return np.concatenate([part.reshape(-1, count) for part in parts])
