"""Measured data as a model is to play them: its inputs forced, its outputs compared where there is a sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.excite.recording import Sampling
from workbench.data.experiment.experiment import Experiment, read_signals
from workbench.errors import InputError, suggest
from workbench.identification.calibrate.request import Calibrate
from workbench.identification.calibrate.responses import is_measured_response, responses
from workbench.model import Model
from workbench.model.names import check_variables, declared_units, forced_inputs, variables_of
from workbench.signals.kinds import Signal, Table

__all__ = ["PlayedData", "check_named", "measured", "played"]

_TINY = 1e-9  # of an interval: two times closer than that are one
_NAMED = 6  # columns in a message


def measured(model: Model, given: Sequence[Experiment | str | Path], request: Calibrate) -> tuple[Experiment, ...]:
    """Return the data with the model's names and in its units; NaN where an output is missing.

    Args:
        model: whose inputs and outputs were measured.
        given: experiments or files.
        request: which columns are which.

    Raises:
        InputError: it cannot be read, names a variable that is not there, or has nothing to compare or in another unit.
    """
    result: list[Experiment] = []
    for one in given:
        if is_measured_response(one):
            result += responses(model, one, Path(one).name if isinstance(one, str | Path) else "response")
        else:
            known = one if isinstance(one, Experiment) else read_signals(one, dt=request.dt)
            result.append(_of_model(model, known, request))
    return tuple(result)


def check_named(data: Sequence[Experiment], request: Calibrate) -> None:
    """Refuse what is said of inputs and outputs that were not measured.

    Args:
        data: measured.
        request: weights, delays, next inputs and their rates by name.

    Raises:
        InputError: an unknown name, a value that is not positive.
    """
    measured = {
        "outputs": [name for one in data for name in one.output_names],
        "inputs": [name for one in data for name in one.input_names],
    }
    for option in ("weights", "delays", "next_inputs", "next_rate"):
        side = "inputs" if option.startswith("next") else "outputs"
        for name, value in (getattr(request, option) or {}).items():
            if name not in measured[side]:
                raise InputError(
                    f"{option}: '{name}' is not among the measured {side}; {suggest(name, measured[side])}"
                )
            if value < 0.0 or (value == 0.0 and option != "delays"):
                raise InputError(f"{option}: {name} = {value:g} is not a positive number")


def _of_model(model: Model, data: Experiment, request: Calibrate) -> Experiment:
    inputs, outputs = _channels(model, data, request)
    for name, column in {**inputs, **outputs}.items():
        if column not in data.names:
            wanted = f"'{column}'" if column == name else f"'{column}' for {name}"
            raise InputError(f"{data.name}: there is no column {wanted}; {suggest(column, data.names)}")
    unused = [column for column in data.names if column not in (*inputs.values(), *outputs.values())]
    notes = [f"{data.name}: not used: {', '.join(unused[:_NAMED])}"] if unused else []
    columns = dict(zip(data.names, np.hstack([data.u, data.y]).T, strict=True))
    units = data.units
    u = np.column_stack([columns[c] for c in inputs.values()]) if inputs else np.empty((len(data.time), 0))
    y = np.column_stack([columns[c] for c in outputs.values()])
    result = replace(
        data, u=_held(data.name, u, tuple(inputs), notes), y=y, input_names=tuple(inputs), output_names=tuple(outputs),
        input_units=tuple(units[c] for c in inputs.values()), output_units=tuple(units[c] for c in outputs.values()),
        notes=(*data.notes, *notes),
    )  # fmt: skip
    _check(result)
    return result.in_units(declared_units(model, result.names))


def _channels(model: Model, data: Experiment, request: Calibrate) -> tuple[dict[str, str], dict[str, str]]:
    """Return input → column and output → column."""
    inputs: Mapping[str, str] | None = request.inputs  # type: ignore[assignment]  # its form makes names of a list
    outputs: Mapping[str, str] | None = request.outputs  # type: ignore[assignment]
    if inputs is None:
        taken = outputs or {}
        inputs = {v.name: v.name for v in model.inputs if v.name in data.names and v.name not in taken}
    if outputs is None:
        numbers = [name for name, v in variables_of(model).items() if v.is_number and v.causality != "input"]
        outputs = {name: name for name in data.names if name in numbers and name not in inputs.values()}
    inputs, outputs = dict(inputs), dict(outputs)
    check_variables(model, inputs, "input", what="inputs")
    check_variables(model, outputs, "variable", what="outputs", number=True)
    if not outputs:
        known, first = ", ".join(data.names[:_NAMED]), next((v.name for v in model.outputs if v.is_number), "y")
        raise InputError(
            f"{data.name}: no column is an output of {model.name}; say with `outputs` which output is in which column, "
            f"as {first}={data.names[-1]}; columns: {known}"
        )
    return inputs, outputs


def _held(name: str, u: Floats, names: Sequence[str], notes: list[str]) -> Floats:
    """Return the inputs, held where a sample is missing."""
    gone = ~np.isfinite(u)
    if not gone.any():
        return u
    first = gone[0]
    if first.any():
        raise InputError(f"{name}: input '{names[int(np.argmax(first))]}' is missing at the first sample; cut it off")
    last = np.maximum.accumulate(np.where(gone, 0, np.arange(len(u))[:, None]), axis=0)
    notes.append(f"{name}: {int(gone.any(axis=1).sum())} missing samples of inputs are held at the last value")
    return np.take_along_axis(u, last, axis=0)


def _check(data: Experiment) -> None:
    for name, column in zip(data.output_names, data.y.T, strict=True):
        if not np.any(np.isfinite(column)):
            raise InputError(f"{data.name}: output '{name}' has no samples; leave it out")
    if np.isfinite(data.y).sum() < 2:
        raise InputError(f"{data.name}: fewer than two samples of outputs")


@dataclass(frozen=True, eq=False)
class PlayedData:
    """Data laid out in the time of a session.

    Attributes:
        name: of the data.
        outputs: names.
        signals: what forces each input.
        reads: when outputs are read, rising, shape (k,) [s].
        rows: which of these is a sample's, shape (n, p).
        end: of the run [s].
        step: longest communication step of a co-simulation [s]; None: model exchange.
        late: the left limit is read, else the right one.
        tiny: times closer than that are one [s].
    """

    name: str
    outputs: tuple[str, ...]
    signals: Mapping[str, Signal]
    reads: Floats
    rows: Floats
    end: float
    step: float | None
    late: bool
    tiny: float


def played(model: Model, data: Experiment, sampling: Sampling, request: Calibrate, step: float | None) -> PlayedData:
    """Return data laid out in the time of a session.

    The first sample is where sessions start; a sampled model keeps its phase to the times of the data.

    Args:
        model: that is to play them, where it starts.
        data: with the model's names.
        sampling: how the model samples.
        request: how inputs go on between samples, and what delays sensors have.
        step: see `PlayedData`.
    """
    start, interval = model.start_time, data.dt
    begin = start
    if sampling.period is not None:
        phase = (data.time[0] - start) / sampling.period
        begin += sampling.period * max(0.0, phase - np.floor(phase + 1e-6))
    time = data.time - data.time[0] + begin
    shown = time + (interval if sampling.late else sampling.lead)
    delays = [float((request.delays or {}).get(name, 0.0)) for name in data.output_names]
    at = np.maximum(shown[:, None] - np.array(delays), start)
    reads, rows = np.unique(at, return_inverse=True)
    signals: dict[str, Signal] = {
        name: _signal(time - sampling.lead, column, request.interpolate)
        for name, column in zip(data.input_names, data.u.T, strict=True)
    }
    return PlayedData(
        name=data.name, outputs=data.output_names, signals=forced_inputs(model, signals), reads=reads,
        rows=rows.reshape(at.shape), end=float(max(reads[-1], time[-1])), step=step, late=sampling.late,
        tiny=_TINY * interval,
    )  # fmt: skip


def _signal(time: Floats, values: Floats, interpolate: str) -> Table:
    if interpolate == "linear":
        return Table(time.tolist(), values.tolist())
    keep = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    return Table(time[keep].tolist(), values[keep].tolist(), interpolate="hold")
