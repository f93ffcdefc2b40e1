"""What happens to the data before an identification: columns, settling part, operating point, several as one record.

Where one experiment ends and the next begins the state jumps, to anywhere. An input that is one at the last sample
before and zero elsewhere makes any jump, by its column of B: with one such input for each joint the estimators need
know nothing of experiments, neither the subspaces, for which the pulse is an input like others, nor the refinement.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment, read_experiment, read_pieces
from workbench.data.preprocess.outliers import remove_outliers
from workbench.data.preprocess.settle import cut_settling
from workbench.data.preprocess.steps import Detrended, detrend, remove_offset
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.identify.request import Identify

__all__ = ["PreparedData", "chosen", "cut", "gathered", "joined", "prepare", "prepared_all", "without_joints"]


@dataclass(frozen=True, eq=False)
class PreparedData:
    """Data ready for the estimator.

    Attributes:
        data: as recorded, without the settling part.
        u: shape (N, m), inputs without their operating point and trend.
        y: shape (N, p), outputs likewise.
        u0, y0: shape (m,), (p,), operating point that was taken off.
    """

    data: Experiment
    u: Floats
    y: Floats
    u0: Floats
    y0: Floats


# Name → what takes the operating point off.
_DETRENDS: Mapping[str, Callable[[Experiment], Detrended]] = {
    "mean": detrend,
    "linear": lambda data: detrend(data, kind="linear"),
    "none": lambda data: remove_offset(data, {}),
}


def chosen(
    data: Experiment | str | Path, inputs: Sequence[str] | None, outputs: Sequence[str] | None, dt: float | None
) -> Experiment:
    """Return the data with the columns asked for.

    Args:
        data: an experiment, or a CSV file.
        inputs: names; None: the experiment's own, or what the file says.
        outputs: names; None: likewise.
        dt: sampling interval of a file without times [s].

    Raises:
        InputError: no such file or column, gaps, numbers that are none.
    """
    if not isinstance(data, Experiment):
        return read_experiment(data, inputs=inputs, outputs=outputs, dt=dt)
    if inputs is None and outputs is None:
        return data
    return data.select(inputs or data.input_names, outputs or data.output_names)


def prepare(data: Experiment, *, how: str, settle: float) -> PreparedData:
    """Cut the settling part off and take the operating point away.

    Args:
        data: as recorded.
        how: "mean", "linear" or "none".
        settle: so much is cut off the beginning [s].

    Raises:
        InputError: too little left after the cut, a column that never changes.
    """
    kept = cut(data, settle)
    _check_moving(kept)
    level = _DETRENDS[how](kept)
    return PreparedData(kept, level.experiment.u, level.experiment.y, level.u0, level.y0)


def _check_moving(data: Experiment) -> None:
    for kind, names, values in (("input", data.input_names, data.u), ("output", data.output_names, data.y)):
        still = np.ptp(values, axis=0) <= 1e-12 * np.max(np.abs(values), axis=0)
        if still.any():
            k = int(np.argmax(still))
            what = "it excites nothing" if kind == "input" else "there is nothing to identify"
            advice = "; leave it out" if len(names) > 1 else ""
            raise InputError(f"{data.name}: {kind} '{names[k]}' is constant ({values[0, k]:.6g}): {what}{advice}")


def cut(data: Experiment, settle: float) -> Experiment:
    """Cut the settling part off.

    Args:
        data: as recorded.
        settle: so much is cut off the beginning [s].

    Raises:
        InputError: too little left.
    """
    first = int(np.ceil(settle / data.dt - 1e-9))
    return cut_settling(data, samples=first).experiment if first else data


def gathered(data: Experiment | str | Path, request: Identify) -> tuple[Experiment, ...]:
    """Return all experiments with the columns asked for, the longest piece of the first file first.

    Args:
        data: an experiment, or a file.
        request: with names of columns, further experiments, and whether they are repaired.

    Raises:
        InputError: no such file or column, another interval than the first's, units that cannot be converted.
    """
    first = _read(data, request)
    names = first[0].input_names, first[0].output_names
    named = replace(request, inputs=names[0], outputs=names[1])
    result = (*first, *(e for given in request.also or () for e in _read(given, named)))
    others = [_alike(result[0], other) for other in result[1:]]
    notes = dict.fromkeys(note for experiment in (result[0], *others) for note in experiment.notes)
    return replace(result[0], notes=tuple(notes)), *others


def _read(data: Experiment | str | Path, request: Identify) -> list[Experiment]:
    if request.repair and not isinstance(data, Experiment):
        result = list(read_pieces(str(data), inputs=request.inputs, outputs=request.outputs, dt=request.dt))
        result.sort(key=lambda e: -e.n_samples)
    else:
        result = [chosen(data, request.inputs, request.outputs, request.dt)]
    return [remove_outliers(e).experiment for e in result] if request.repair else result


def _alike(first: Experiment, other: Experiment) -> Experiment:
    """Return another experiment in the units of the first."""
    if abs(other.dt - first.dt) > 1e-6 * first.dt:
        raise InputError(f"{other.name}: sampled every {other.dt:g} s, {first.name} every {first.dt:g} s; resample one")
    return other.in_units(first.units)


def joined(pieces: Sequence[PreparedData]) -> PreparedData:
    """Return all experiments as one record, with a pulse as input for each joint.

    Args:
        pieces: prepared, the first gives operating point and names.
    """
    first = pieces[0]
    if len(pieces) == 1:
        return first
    lengths = np.cumsum([len(piece.u) for piece in pieces])
    u = np.zeros((int(lengths[-1]), first.u.shape[1] + len(pieces) - 1))
    u[:, : first.u.shape[1]] = np.vstack([piece.u for piece in pieces])
    u[lengths[:-1] - 1, np.arange(len(pieces) - 1) + first.u.shape[1]] = 1.0
    return replace(first, u=u, y=np.vstack([piece.y for piece in pieces]))


def prepared_all(experiments: Sequence[Experiment], request: Identify) -> list[PreparedData]:
    """Return each experiment with its own operating point taken off.

    Args:
        experiments: as read.
        request: how.
    """
    return [prepare(e, how=request.detrend, settle=request.settle) for e in experiments]


def without_joints(model: IdentifiedModel, inputs: int) -> IdentifiedModel:
    """Return the model without the inputs that join experiments.

    Args:
        model: of the joined record.
        inputs: so many are the system's own; they come first.
    """
    if len(model.u0) == inputs:
        return model
    n, p, every = len(model.undelayed().A), len(model.y0), len(model.u0)
    spread = model.spread
    if spread is not None:
        sizes = np.cumsum([0, n * n, n * every, p * n, p * every])
        A, B, C, D = (spread[a:b] for a, b in pairwise(sizes))
        count = spread.shape[1]
        own: list[Floats] = [
            part.reshape(rows, every, count)[:, :inputs].reshape(-1, count) for part, rows in ((B, n), (D, p))
        ]
        spread = np.vstack([A, own[0], C, own[1]])
    return replace(
        model, B=model.B[:, :inputs], D=model.D[:, :inputs], u0=model.u0[:inputs],
        input_names=model.input_names[:inputs], input_units=model.input_units[:inputs], delay=model.delay[:inputs],
        spread=spread,
    )  # fmt: skip
