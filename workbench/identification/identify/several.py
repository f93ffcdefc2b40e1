"""Several experiments as one record, and the model of it without what joins them.

Where one experiment ends and the next begins the state jumps, to anywhere. An input that is one at the last sample
before and zero elsewhere makes any jump, by its column of B: with one such input for each joint the estimators need
know nothing of experiments, neither the subspaces, for which the pulse is an input like others, nor the refinement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment, read_pieces
from workbench.data.preprocess.outliers import remove_outliers
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.identify.preparation import PreparedData, chosen, prepare
from workbench.identification.identify.request import Identify

__all__ = ["gathered", "joined", "prepared_all", "without_joints"]


def gathered(data: Experiment | str | Path, asked: Identify) -> tuple[Experiment, ...]:
    """Return all experiments with the columns asked for, the longest piece of the first file first.

    Args:
        data: an experiment, or a file.
        asked: with names of columns, further experiments, and whether they are repaired.

    Raises:
        InputError: no such file or column, another interval than the first's, units that cannot be converted.
    """
    first = _read(data, asked)
    names = first[0].input_names, first[0].output_names
    named = replace(asked, inputs=names[0], outputs=names[1])
    found = (*first, *(e for given in asked.also or () for e in _read(given, named)))
    others = [_alike(found[0], other) for other in found[1:]]
    notes = dict.fromkeys(note for experiment in (found[0], *others) for note in experiment.notes)
    return replace(found[0], notes=tuple(notes)), *others


def _read(data: Experiment | str | Path, asked: Identify) -> list[Experiment]:
    if asked.repair and not isinstance(data, Experiment):
        found = list(read_pieces(str(data), inputs=asked.inputs, outputs=asked.outputs, dt=asked.dt))
        found.sort(key=lambda e: -e.n_samples)
    else:
        found = [chosen(data, asked.inputs, asked.outputs, asked.dt)]
    return [remove_outliers(e).experiment for e in found] if asked.repair else found


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


def prepared_all(experiments: Sequence[Experiment], asked: Identify) -> list[PreparedData]:
    """Return each experiment with its own operating point taken off.

    Args:
        experiments: as read.
        asked: how.
    """
    return [prepare(e, how=asked.detrend, settle=asked.settle) for e in experiments]


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
