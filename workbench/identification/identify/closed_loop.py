"""Identify a plant that runs in a closed loop by its recorded reference.

First what the reference makes of the inputs is found by a long equation: the reference knows nothing of the
disturbance, so neither does this part of the inputs. Then the plant is identified from it as in an open loop
(P. M. J. Van den Hof and R. J. P. Schrama, Automatica 29, 1993), and the disturbance is what the plant leaves of the
output under the inputs as they were. From there both are refined under the inputs as they were, with the first part as
an instrument; that has a covariance (`prediction/refine.py`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.data.long_arx import LongArx, fit_long_arx
from workbench.errors import InputError
from workbench.identification.identified.model import NoiseModel
from workbench.identification.identify.data import PreparedData, chosen, gathered, prepare
from workbench.identification.identify.refinement import wished
from workbench.identification.identify.request import Identify
from workbench.identification.prediction.model import instrumented_model
from workbench.identification.prediction.model_selection import noise_alone
from workbench.identification.subspace.result import SubspaceEstimate

__all__ = ["driven_by", "with_disturbance", "with_reference"]

_LAGS = (1, 2, 3, 4, 6, 8, 11, 15, 20, 25)  # of the long equation
_LEAST = 0.005  # of an input's variance that the reference must explain


def with_reference(
    data: Experiment | str | Path, request: Identify
) -> tuple[tuple[Experiment, ...], Experiment | None]:
    """Return the experiments, and the same with the reference for input where one was named.

    Args:
        data: an experiment, or a file.
        request: with names of columns.

    Raises:
        InputError: no such file or column.
    """
    name = request.closed_loop
    if name in (None, "direct"):
        return gathered(data, request), None
    if request.also or request.repair:
        raise InputError("closed_loop: by a reference it is one experiment, as recorded: not with also or repair")
    inputs = None if request.inputs is None else [*request.inputs, *(() if name in request.inputs else (str(name),))]
    whole = chosen(data, inputs, request.outputs, request.dt)
    driving = [n for n in whole.input_names if n != name]
    if name not in whole.input_names:
        raise InputError(f"{whole.name}: there is no column '{name}' for the reference of the closed loop")
    if not driving:
        raise InputError(f"{whole.name}: '{name}' is the only input, so it cannot be the reference of another")
    return (whole.select(driving, whole.output_names),), whole.select([str(name)], [*driving, *whole.output_names])


def driven_by(reference: Experiment, prepared: PreparedData, request: Identify) -> PreparedData:
    """Return the data with that part of the inputs which the reference makes.

    Args:
        reference: with the reference for input; inputs of the plant first among the outputs.
        prepared: the data.
        request: how they were prepared.

    Raises:
        InputError: the reference does nothing to an input.
    """
    other = prepare(reference, how=request.detrend, settle=request.settle)
    m = prepared.u.shape[1]
    with one_thread():
        arx = _long_enough(other.u, other.y[:, :m])
        made = arx.simulate(other.u)
        shown = 1.0 - np.var(prepared.u - made, axis=0) / np.var(prepared.u, axis=0)
    # A reference that does nothing explains as many samples as there are coefficients, by chance.
    if not np.all(shown > _LEAST + 4.0 * arx.lags / len(made)):
        raise InputError(
            f"{prepared.data.name}: the reference '{request.closed_loop}' does not drive the inputs; is it the right "
            "column?"
        )
    return replace(prepared, u=made)


def _long_enough(r: Floats, u: Floats) -> LongArx:
    """Return the equation of the length that Akaike's criterion chooses.

    A longer one would put the disturbance into the inputs that it makes: each of its coefficients takes a bit of it.
    """
    tried = [fit_long_arx(r, u, lags=lags) for lags in _LAGS]
    rows = len(u) - max(arx.lags for arx in tried)
    cost = [
        rows
        * np.linalg.slogdet(arx.residual[-rows:].T @ arx.residual[-rows:] / rows + np.diag(arx.floor**2 + 1e-300))[1]
        + 2 * (arx.a.size + arx.b.size)
        for arx in tried
    ]
    return tried[int(np.argmin(cost))]


def with_disturbance(
    result: SubspaceEstimate, prepared: PreparedData, driving: PreparedData, request: Identify
) -> SubspaceEstimate:
    """Return the estimate with a model of what its plant leaves of the output under the inputs as they were.

    Args:
        result: from what the reference makes of the inputs.
        prepared: the data.
        driving: the same with what the reference makes of the inputs.
        request: with the order of the disturbance.

    Raises:
        InputError: the plant is unstable.
    """
    # The covariance of the second stage lacks the error of the first; that of the instrument does not.
    model = replace(result.model, K=np.zeros_like(result.model.K), noise=None, spread=None)
    if not model.is_stable:
        raise InputError(
            "the plant is unstable: a recorded reference does not help here; use closed_loop=direct, or a stable model"
        )
    x0 = model.initial_state(prepared.u, prepared.y)
    left = prepared.y - model.simulate(prepared.u, x0)
    scale = left.std(axis=0)
    with one_thread():
        alone = noise_alone(
            (left - left.mean(axis=0)) / scale, request.noise if isinstance(request.noise, int) else None
        )
    if alone is None:
        return result.with_model(replace(model, x0=x0))
    noise = alone.model
    own = NoiseModel(A=noise.A, K=noise.K / scale, C=scale[:, None] * noise.C) if len(noise.A) else None
    covariance = scale[:, None] * alone.covariance * scale
    near = replace(model, x0=x0, y0=model.y0 + left.mean(axis=0), covariance=covariance, noise=own)
    wish = wished(result, prepared, request)
    better = instrumented_model(near, prepared.u, driving.u, prepared.y, wish)
    return result.with_model(near if better is None else better)
