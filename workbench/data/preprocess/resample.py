"""Put data on a longer sampling interval."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy import signal

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.data.preprocess.prepared import PreprocessingStep
from workbench.errors import InputError

__all__ = ["Resampled", "resample"]

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
    take = _filtered if antialias else _picked
    u, y = (take(x, ratio) for x in (experiment.u, experiment.y))
    time = experiment.time[0] + dt * np.arange(len(u))
    what = f"resampled from {experiment.dt:g} s to {dt:g} s{'' if antialias else ' without a filter'}"
    return Resampled(experiment.with_data(u=u, y=y, time=time, note=what), what, ratio, antialias)


def _filtered(x: Floats, ratio: Fraction) -> Floats:
    # Padded with its mean: a jump from the first sample to 0 would ring into the record.
    return np.asarray(signal.resample_poly(x, ratio.denominator, ratio.numerator, axis=0, padtype="mean"))


def _picked(x: Floats, ratio: Fraction) -> Floats:
    return x[:: ratio.numerator].copy()
