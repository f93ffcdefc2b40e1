"""Validate an identified model against recorded data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError, suggest
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.validate.pole_zero import near_cancellations
from workbench.identification.validate.residuals import residuals_of
from workbench.identification.validate.result import Validation
from workbench.requests.decorator import with_origin

__all__ = ["suited", "validate"]

LAGS = 25
PER_LAG = 4  # samples there must be for each lag
GROWTH = 1e12  # a free motion that grows more than this over the record is not an output


@with_origin()
def validate(
    model: IdentifiedModel,
    data: Experiment,
    *,
    lags: int | None = None,
    steps: int = 1,
    start: str = "fit",
) -> Validation:
    """Hold a model against recorded data: fits, residual tests, poles that zeros nearly cancel.

    `simulation` computes the output from the input alone; `prediction` corrects it by every measured sample up to
    `steps` before. What is white in a good model is the one-step prediction error. The simulation error is only as
    white as the disturbance is; its cross-correlation with the input is what counts there. Use data that were not used
    for the fit: on the data of the fit every figure is better than the model is.

    Not for closed-loop data: the cross-correlation at negative lags shows it; the simulation is then not a fair test.

    Args:
        model: discrete.
        data: as recorded, with the names of the model's channels (one input and one output may have others, which a
            note tells); the model takes its operating point off itself.
        lags: number of lags of the residual tests [samples]; None: 25, or a quarter of a short record.
        steps: how far ahead the prediction looks [samples].
        start: where the model starts: "fit" at the state that suits the record best, "rest" at the operating point,
            "model" at its own x0 (for the record it was identified from).

    Raises:
        InputError: other channels or sampling interval than the model's, units that cannot be converted to its own, too
            few samples for the lags, unknown start.

    Examples:
        The model of data without noise reproduces them.

        >>> import numpy as np
        >>> u = np.random.default_rng(0).standard_normal(1000)
        >>> y = 0.5 * u
        >>> model = wb.estimate(u, y, 0.1, order=0).model
        >>> print(round(wb.validate(model, wb.make_experiment(0.1, u, y)).fit_percent["y1"], 3))
        100.0
    """
    given = suited(model, data)
    many = _lags(given, lags)
    simulated = _simulated(model, given, start)
    predicted = _predicted(model, given, steps, start)
    kind = "one-step prediction" if steps == 1 else f"{steps}-step prediction"
    return Validation(
        model=model,
        data=given,
        simulation=residuals_of("simulation", given, simulated, lags=many),
        prediction=residuals_of(kind, given, predicted, lags=many),
        cancellations=near_cancellations(model),
        notes=_notes(model, given),
    )


def suited(model: IdentifiedModel, data: Experiment) -> Experiment:
    """Return the data with the model's channels in the model's order, and in its units.

    Channels are found by name. One input and one output may have other names: they can only be the model's.

    Args:
        model: discrete.
        data: may hold more channels.

    Raises:
        InputError: a channel is missing, another sampling interval, or units that cannot be converted.
    """
    return _chosen(model, data).in_units(model.units)


def _chosen(model: IdentifiedModel, data: Experiment) -> Experiment:
    if not abs(data.dt - model.dt) <= 1e-6 * model.dt:
        raise InputError(f"{data.name}: sampled every {data.dt:g} s, the model every {model.dt:g} s; resample the data")
    known, wanted = (*data.input_names, *data.output_names), (*model.input_names, *model.output_names)
    missing = [n for n in wanted if n not in known]
    if not missing:
        return data.select(model.input_names, model.output_names)
    numbers = (data.n_inputs, data.n_outputs), (len(model.input_names), len(model.output_names))
    if len(missing) == len(wanted) and numbers[0] == numbers[1] and max(numbers[0]) == 1:
        renamed = f"{', '.join(known)} are used as {', '.join(wanted)} of the model"
        notes = (*data.notes, renamed)
        return replace(data, input_names=model.input_names, output_names=model.output_names, notes=notes)
    if len(missing) == len(wanted):
        ours, theirs = (
            f"{', '.join(i)} → {', '.join(o)}"
            for i, o in ((model.input_names, model.output_names), (data.input_names, data.output_names))
        )
        raise InputError(f"{data.name}: has {theirs}, none of them of the model, {ours}; rename them as the model's")
    raise InputError(f"{data.name}: there is no column '{missing[0]}' of the model; {suggest(missing[0], known)}")


def _lags(data: Experiment, lags: int | None) -> int:
    most = data.n_samples // PER_LAG
    if lags is None:
        if most < 2:
            raise InputError(f"{data.name}: {data.n_samples} samples are too few to validate; at least {2 * PER_LAG}")
        return min(LAGS, most)
    if not 1 <= lags <= most:
        raise InputError(f"lags: {lags} is not between 1 and {most}, a quarter of the {data.n_samples} samples")
    return lags


# Name → state at the first sample; None: fitted to the record.
STARTS: Mapping[str, Callable[[IdentifiedModel], Floats | None]] = {
    "fit": lambda _: None,
    "rest": lambda model: np.zeros(model.order),
    "model": lambda model: model.x0,
}


def _start(model: IdentifiedModel, data: Experiment, start: str, *, predicting: bool) -> Floats:
    if start not in STARTS:
        raise InputError(f"start '{start}' is unknown; {suggest(start, STARTS)}")
    known = STARTS[start](model)
    return model.initial_state(data.u, data.y, predicting=predicting) if known is None else known


def _simulated(model: IdentifiedModel, data: Experiment, start: str) -> Floats:
    """Return the simulated output; NaN where an unstable model has no finite one."""
    radius = float(np.max(np.abs(model.poles), initial=0.0))
    if radius > 1.0 and data.n_samples * np.log(radius) > np.log(GROWTH):
        return np.full(data.y.shape, np.nan)
    return model.simulate(data.u, _start(model, data, start, predicting=False))


def _predicted(model: IdentifiedModel, data: Experiment, steps: int, start: str) -> Floats:
    return model.predict(data.u, data.y, steps, _start(model, data, start, predicting=True))


def _notes(model: IdentifiedModel, data: Experiment) -> tuple[str, ...]:
    notes = list(data.notes)
    if not model.has_noise_model:
        notes.append("the model has no noise model (K = 0): its prediction is its simulation")
    if not model.is_stable:
        notes.append(f"the model is unstable: largest pole magnitude {np.max(np.abs(model.poles)):.6g}")
    return tuple(notes)
