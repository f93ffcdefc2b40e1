"""Cut off the beginning of a record, in which the system still settles from where it started."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.data.long_arx import fit_long_arx
from workbench.data.preprocess.steps import PreprocessingStep
from workbench.errors import InputError

__all__ = ["TAME", "cut_settling", "settling_samples"]

_PART = 2  # the record's first half is searched, its second half is the measure
_VISIBLE = 0.3  # of an output's standard deviation
_OUT = 4.0  # standard deviations of the later error
TAME = 1e-3  # relative: the start excites frequencies that the inputs later need not contain
_LEFT = 0.3  # of the record, at least, is kept


@dataclass(frozen=True, eq=False)
class WithoutStart(PreprocessingStep):
    """Data without their beginning.

    Attributes:
        experiment, what: as in `PreprocessingStep`.
        samples: so many were cut off.
    """

    samples: int


def settling_samples(experiment: Experiment) -> int:
    """Return after how many samples the outputs follow from the inputs in the record alone.

    A long linear equation is fitted and run from rest. In the beginning it misses what inputs before the record
    and the initial state left behind; the last sample of the first half at which that exceeds the later error
    (4 standard deviations, and 30 % of the output's) ends the settling.

    Args:
        experiment: recorded data.
    """
    u, y = (np.asarray(x - x[len(x) // _PART :].mean(axis=0)) for x in (experiment.u, experiment.y))
    half = len(u) // _PART
    equation = fit_long_arx(u, y, truncate=TAME)
    error = y - equation.simulate(u)
    if not np.all(np.isfinite(error)):
        return 0
    error -= error[half:].mean(axis=0)
    limit = np.maximum(_OUT * np.std(error[half:], axis=0), _VISIBLE * np.std(y[half:], axis=0))
    out = np.flatnonzero(np.any(_smoothed(np.abs(error[:half])) > limit, axis=1))
    return _end(out)


def cut_settling(experiment: Experiment, *, samples: int | None = None) -> WithoutStart:
    """Cut off the beginning of a record.

    Seldom needed for state-space models, whose initial state is estimated; but one that the linear range does not
    cover (a limit reached from far away) should go.

    Args:
        experiment: recorded data.
        samples: number of samples to cut off; None: what `settling_samples` finds.

    Raises:
        InputError: negative, or less than 30 % of the record would be left.

    Examples:
        >>> data = wb.make_experiment(0.1, u=[0, 1, 1, 0, 1], y=[9, 3, 4, 5, 6])
        >>> print(wb.cut_settling(data, samples=1).experiment.n_samples)
        4
    """
    count = settling_samples(experiment) if samples is None else samples
    if not 0 <= count <= (1.0 - _LEFT) * experiment.n_samples:
        raise InputError(f"{experiment.name}: {count} of {experiment.n_samples} samples cannot be cut off")
    if not count:
        return WithoutStart(experiment, "nothing cut off: no settling can be seen", 0)
    what = f"first {count} samples ({count * experiment.dt:.3g} s) cut off: settling"
    rest = experiment.part(count)
    return WithoutStart(rest.with_data(note=what), what, count)


def _smoothed(error: Floats) -> Floats:
    """Return the median of three neighbours, so that a single error does not count as settling."""
    if len(error) < 3:
        return error
    inner = np.median(np.stack([error[:-2], error[1:-1], error[2:]]), axis=0)
    return np.vstack([inner[:1], inner, inner[-1:]])


def _end(out: np.ndarray[tuple[int, ...], np.dtype[np.intp]]) -> int:
    """Return the sample after the row of errors that begins with the record; 0 where none does."""
    if not out.size or out[0] > 3:
        return 0
    gaps = np.flatnonzero(np.diff(out) > max(10, 0.5 * out[0]))
    return int(out[gaps[0]] if gaps.size else out[-1]) + 1
