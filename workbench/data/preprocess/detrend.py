"""Take the operating point or a trend out of data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.data.preprocess.prepared import PreprocessingStep, all_columns, check_columns
from workbench.errors import InputError, suggest

__all__ = ["KINDS", "Detrended", "detrend", "remove_offset"]

KINDS: Mapping[str, int] = {"constant": 0, "linear": 1}


@dataclass(frozen=True, eq=False)
class Detrended(PreprocessingStep):
    """Data without offsets.

    Attributes:
        experiment, what: as in `PreprocessingStep`.
        offsets: column → value taken out at the middle of the record, [its unit]; 0 for columns left alone.
        slopes: column → trend taken out, [its unit/s].
    """

    offsets: dict[str, float]
    slopes: dict[str, float]

    @property
    def u0(self) -> Floats:
        """Offsets of the inputs, shape (m,): the model's operating point."""
        return np.array([self.offsets[n] for n in self.experiment.input_names])

    @property
    def y0(self) -> Floats:
        """Offsets of the outputs, shape (p,)."""
        return np.array([self.offsets[n] for n in self.experiment.output_names])


def detrend(experiment: Experiment, *, kind: str = "constant", columns: Sequence[str] | None = None) -> Detrended:
    """Subtract the mean or the straight line of least squares from columns.

    A straight line is also taken out of slow true motion: use "linear" only where the drift is a fault.

    Args:
        experiment: recorded data.
        kind: "constant" or "linear".
        columns: names; None: all.

    Raises:
        InputError: unknown kind or column.

    Examples:
        The mean is 3.5.

        >>> data = wb.make_experiment(0.1, u=[0, 1, 1, 0], y=[2, 3, 4, 5], output_names=["y"])
        >>> print(wb.detrend(data, columns=["y"]).experiment.y[:, 0])
        [-1.5 -0.5  0.5  1.5]
    """
    if kind not in KINDS:
        raise InputError(f"detrend kind '{kind}' is unknown; {suggest(kind, KINDS)}")
    names = all_columns(experiment)
    chosen = check_columns(experiment, columns, names)
    clock = experiment.time - experiment.time.mean()
    values = np.hstack([experiment.u, experiment.y])
    taken = np.isin(names, chosen)
    offset = np.where(taken, values.mean(axis=0), 0.0)
    slope = np.where(taken & (KINDS[kind] > 0), clock @ values / (clock @ clock), 0.0)
    what = f"{'mean' if kind == 'constant' else 'straight line'} taken out of {', '.join(chosen)}"
    return _without(experiment, offset, slope, what)


def remove_offset(experiment: Experiment, values: Mapping[str, float]) -> Detrended:
    """Subtract known values, such as the operating point of a trim.

    Args:
        experiment: recorded data.
        values: column → value at the operating point, [its unit].

    Raises:
        InputError: unknown column, or a value that is not finite.

    Examples:
        >>> data = wb.make_experiment(0.1, u=[0, 1, 1, 0], y=[2, 3, 4, 5], output_names=["y"])
        >>> print(wb.remove_offset(data, {"y": 2.0}).experiment.y[:, 0])
        [0. 1. 2. 3.]
    """
    names = all_columns(experiment)
    chosen = check_columns(experiment, list(values), names)
    for name, value in values.items():
        if not np.isfinite(value):
            raise InputError(f"offset of {name} must be a finite number, not {value}")
    offset = np.array([float(values.get(n, 0.0)) for n in names])
    return _without(experiment, offset, np.zeros(len(names)), f"operating point taken out of {', '.join(chosen)}")


def _without(experiment: Experiment, offset: Floats, slope: Floats, what: str) -> Detrended:
    names, m = all_columns(experiment), experiment.n_inputs
    trend = offset + np.outer(experiment.time - experiment.time.mean(), slope)
    new = experiment.with_data(u=experiment.u - trend[:, :m], y=experiment.y - trend[:, m:], note=what)
    offsets, slopes = (dict(zip(names, v.tolist(), strict=True)) for v in (offset, slope))
    return Detrended(new, what, offsets, slopes)
