"""Steps of pre-processing: offset and trend, magnitude, sampling interval."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError, suggest

__all__ = ["Detrended", "PreprocessingStep", "check_columns", "detrend", "remove_offset", "resample", "scale"]


@dataclass(frozen=True, eq=False)
class PreprocessingStep:
    """Data after a step of pre-processing.

    Attributes:
        experiment: the new data; the old are unchanged.
        what: what was done, in one line, also in the notes of the data.
    """

    experiment: Experiment
    what: str


def check_columns(experiment: Experiment, columns: Sequence[str] | None, known: Sequence[str]) -> tuple[str, ...]:
    """Return the columns asked for, all known ones where none are.

    Raises:
        InputError: unknown column.
    """
    if columns is None:
        return tuple(known)
    for column in columns:
        if column not in known:
            raise InputError(f"{experiment.name}: there is no column '{column}' here; {suggest(column, known)}")
    return tuple(dict.fromkeys(columns))


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
    names = experiment.names
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
    names = experiment.names
    chosen = check_columns(experiment, list(values), names)
    for name, value in values.items():
        if not np.isfinite(value):
            raise InputError(f"offset of {name} must be a finite number, not {value}")
    offset = np.array([float(values.get(n, 0.0)) for n in names])
    return _without(experiment, offset, np.zeros(len(names)), f"operating point taken out of {', '.join(chosen)}")


def _without(experiment: Experiment, offset: Floats, slope: Floats, what: str) -> Detrended:
    names, m = experiment.names, experiment.n_inputs
    trend = offset + np.outer(experiment.time - experiment.time.mean(), slope)
    new = experiment.with_data(u=experiment.u - trend[:, :m], y=experiment.y - trend[:, m:], note=what)
    offsets, slopes = (dict(zip(names, v.tolist(), strict=True)) for v in (offset, slope))
    return Detrended(new, what, offsets, slopes)


MEASURES: Mapping[str, Callable[[Floats], Floats]] = {
    "deviation": lambda x: np.asarray(np.std(x, axis=0)),
    "peak": lambda x: np.asarray(np.max(np.abs(x), axis=0)),
    "range": lambda x: np.asarray(np.ptp(x, axis=0)),
}


@dataclass(frozen=True, eq=False)
class ScaledColumns(PreprocessingStep):
    """Data divided by a factor for each column.

    Attributes:
        experiment, what: as in `PreprocessingStep`.
        factors: column → what it was divided by, [its unit].
    """

    factors: dict[str, float]

    def undo(self, B: Floats, C: Floats, D: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the matrices of a model of the scaled data in the original units.

        Args:
            B: shape (n, m).
            C: shape (p, n).
            D: shape (p, m).
        """
        u = np.array([self.factors[n] for n in self.experiment.input_names])
        y = np.array([self.factors[n] for n in self.experiment.output_names])
        return B / u, C * y[:, None], D * y[:, None] / u


def scale(experiment: Experiment, *, by: str | Mapping[str, float] = "deviation") -> ScaledColumns:
    """Divide each column by its magnitude; constant columns stay as they are.

    Args:
        experiment: recorded data, offsets taken out before where `by` is "peak".
        by: "deviation" (standard deviation), "peak" (largest magnitude), "range", or column → factor.

    Raises:
        InputError: unknown measure or column, a factor that is not positive.

    Examples:
        >>> data = wb.make_experiment(0.1, u=[0, 5, -5, 0], y=[0, 1, 2, 2])
        >>> print(wb.scale(data, by="peak").experiment.u[:, 0])
        [ 0.  1. -1.  0.]
    """
    names, m = experiment.names, experiment.n_inputs
    values = np.hstack([experiment.u, experiment.y])
    if isinstance(by, str):
        if by not in MEASURES:
            raise InputError(f"scaling by '{by}' is unknown; {suggest(by, MEASURES)}")
        factors = MEASURES[by](values)
        factors = np.where((np.ptp(values, axis=0) > 0.0) & (factors > 0.0), factors, 1.0)
    else:
        check_columns(experiment, list(by), names)
        factors = np.array([float(by.get(n, 1.0)) for n in names])
    for name, factor in zip(names, factors.tolist(), strict=True):
        if not (np.isfinite(factor) and factor > 0.0):
            raise InputError(f"factor of {name} must be positive, not {factor:g}")
    what = f"scaled by {by if isinstance(by, str) else 'given factors'}"
    new = experiment.with_data(u=experiment.u / factors[:m], y=experiment.y / factors[m:], note=what)
    return ScaledColumns(new, what, dict(zip(names, factors.tolist(), strict=True)))


_LARGEST = 50  # of the whole numbers whose ratio is the change of the interval
_FEWEST = 20  # samples left


@dataclass(frozen=True, eq=False)
class Resampled(PreprocessingStep):
    """Data on another interval.

    Attributes:
        experiment, what: as in `PreprocessingStep`.
        ratio: new interval over the old one.
        filtered: frequencies above the new Nyquist frequency were taken out before.
    """

    ratio: Fraction
    filtered: bool


def resample(experiment: Experiment, *, dt: float, antialias: bool = True) -> Resampled:
    """Put data on a longer interval.

    With `antialias` inputs and outputs pass the same zero-phase low pass (FIR, polyphase) and then are
    interpolated; a linear model stays the same. Without, every n-th sample is taken as it is: exact where the
    inputs are held over the new interval and there is no noise; else what lies above the new Nyquist frequency
    is folded down.

    Args:
        experiment: recorded data.
        dt: new interval [s], not shorter than the old one, with a ratio of small whole numbers.
        antialias: filter first.

    Raises:
        InputError: a shorter interval, an awkward ratio, too few samples left.

    Examples:
        Every second sample:

        >>> import numpy as np
        >>> data = wb.make_experiment(0.1, u=np.repeat(np.arange(50), 2), y=np.arange(100))
        >>> print(wb.resample(data, dt=0.2, antialias=False).experiment.y[:4, 0])
        [0. 2. 4. 6.]
    """
    if not (np.isfinite(dt) and dt > 0.0):
        raise InputError(f"the new sampling interval must be positive, not {dt:g} s")
    ratio = Fraction(dt / experiment.dt).limit_denominator(_LARGEST)
    if abs(float(ratio) * experiment.dt / dt - 1.0) > 1e-6 or ratio.numerator > 1000:
        raise InputError(
            f"{dt:g} s is not a simple ratio of the sampling interval, {experiment.dt:g} s; use a multiple"
        )
    if ratio < 1:
        raise InputError(
            f"{dt:g} s is shorter than the sampling interval, {experiment.dt:g} s: record at that interval instead"
        )
    if not antialias and ratio.denominator != 1:
        raise InputError(f"without a filter {dt:g} s must be a multiple of the sampling interval, {experiment.dt:g} s")
    if experiment.n_samples / ratio < _FEWEST:
        raise InputError(f"{experiment.name}: fewer than {_FEWEST} samples would be left at {dt:g} s")
    u, y = experiment.u[:: ratio.numerator].copy(), experiment.y[:: ratio.numerator].copy()
    if antialias:  # padded with the mean: a jump from the first sample to 0 would ring into the record
        from scipy import signal  # noqa: PLC0415 - slow to import

        up, down = ratio.denominator, ratio.numerator
        u, y = (signal.resample_poly(x, up, down, axis=0, padtype="mean") for x in (experiment.u, experiment.y))
    time = experiment.time[0] + dt * np.arange(len(u))
    what = f"resampled from {experiment.dt:g} s to {dt:g} s{'' if antialias else ' without a filter'}"
    return Resampled(experiment.with_data(u=u, y=y, time=time, note=what), what, ratio, antialias)
