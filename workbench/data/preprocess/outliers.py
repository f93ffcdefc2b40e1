"""Single samples that fit neither their neighbours nor the inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, ndimage

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.data.long_arx import lagged
from workbench.data.preprocess.steps import PreprocessingStep, check_columns
from workbench.errors import InputError

__all__ = ["remove_outliers"]

THRESHOLD = 6.5  # robust standard deviations: once in 10¹⁰ normal samples
_NEIGHBOURS = 6
_VISIBLE = 0.02  # of the signal's usual range: smaller ones do no harm
_GROSS = 1.5  # ranges outside the range of 99 % of the samples
_ROUNDS = 30
_MOST = 0.05  # of the samples: more are no outliers but the signal's nature
_SPREAD = 1.4826  # median absolute deviation → standard deviation, normal distribution


@dataclass(frozen=True, eq=False)
class OutliersRemoved(PreprocessingStep):
    """Data with outliers replaced.

    Attributes:
        experiment, what: as in `PreprocessingStep`.
        samples: column → samples that were replaced.
    """

    samples: dict[str, tuple[int, ...]]


def remove_outliers(
    experiment: Experiment, *, columns: Sequence[str] | None = None, threshold: float = THRESHOLD
) -> OutliersRemoved:
    """Replace outliers of the outputs by what their neighbours and the inputs say.

    Each output is interpolated linearly from its neighbours on both sides and from the inputs around; a sample
    stands out if its error exceeds `threshold` robust standard deviations (median absolute deviation) and 2 % of
    the signal's range. The largest of a neighbourhood is replaced first and the fit repeated, as
    an outlier disturbs its neighbours.
    Inputs are not searched: what stands out there may well have been applied.

    Not for outliers in long rows: a burst is its own neighbourhood.

    Args:
        experiment: recorded data.
        columns: outputs; None: all.
        threshold: [robust standard deviations].

    Raises:
        InputError: unknown column, or a threshold that is not positive.

    Examples:
        >>> import numpy as np
        >>> u = np.random.default_rng(0).standard_normal(1000)
        >>> y = 2 * u
        >>> y[500] = 100.0
        >>> cleaned = wb.remove_outliers(wb.make_experiment(0.1, u, y))
        >>> print((cleaned.experiment.y[500, 0] / u[500]).round(3))
        2.0
    """
    if not threshold > 0.0:
        raise InputError(f"threshold must be positive, not {threshold:g} standard deviations")
    chosen = check_columns(experiment, columns, experiment.output_names)
    y = experiment.y.copy()
    samples = {}
    for name in chosen:
        i = experiment.output_names.index(name)
        samples[name], y[:, i] = _search(y[:, i], experiment.u, threshold)
    count = sum(map(len, samples.values()))
    what = f"{count} outlier{'' if count == 1 else 's'} replaced"
    return OutliersRemoved(experiment.with_data(y=y, note=what) if count else experiment, what, samples)


def _search(y: Floats, u: Floats, threshold: float) -> tuple[tuple[int, ...], Floats]:
    """Return the samples that stand out, and the signal with them replaced."""
    repaired, result = _without_gross(y)
    if np.ptp(repaired) == 0.0 or len(y) < 20 * (_NEIGHBOURS + 1) * (1 + u.shape[1]) // 2:
        return tuple(sorted(result)), repaired
    low, high = np.quantile(repaired, [0.005, 0.995])
    visible = _VISIBLE * max(high - low, 1e-300)
    for _ in range(_ROUNDS):
        error, weights = _interpolation_error(repaired, u, result)
        if result:
            repaired = _repaired(repaired, error, weights, result)
            error, weights = _interpolation_error(repaired, u, result)
        limit = max(threshold * _robust_spread(error), visible)
        worst = _peaks(np.abs(error), limit)
        if not worst.size:
            break
        result.update(worst.tolist())
        if len(result) > _MOST * len(y):
            return (), y  # so many: that is the signal's nature
    return tuple(sorted(result)), repaired


def _peaks(size: Floats, limit: float) -> NDArray[np.intp]:
    """Return the samples above the limit that no neighbour exceeds."""
    around = ndimage.maximum_filter1d(size, 2 * _NEIGHBOURS + 1, mode="constant")
    return np.flatnonzero((size > limit) & (size == around))


def _without_gross(y: Floats) -> tuple[Floats, set[int]]:
    """Replace what lies far outside the range of nearly all samples by the last sample before that does not."""
    low, high = np.quantile(y, [0.005, 0.995])
    margin = _GROSS * (high - low)
    gross = (y > high + margin) | (y < low - margin)
    if margin == 0.0 or not np.any(gross) or np.mean(gross) > _MOST:
        return y.copy(), set()
    good = np.flatnonzero(~gross)
    return np.interp(np.arange(len(y)), good, y[good]), set(np.flatnonzero(gross).tolist())


def _interpolation_error(y: Floats, u: Floats, result: set[int]) -> tuple[Floats, Floats]:
    """Return y − its linear interpolation from neighbours and inputs, shape (n,), and the neighbours' weights.

    The error is 0 near both ends. Rows in which a found outlier takes part are left out of the fit. The weights have
    shape (2w + 1,), 0 in the middle.
    """
    n, w = len(y), _NEIGHBOURS
    window = lagged(y[:, None], 0, 2 * w, 2 * w)
    columns = np.hstack([np.delete(window, w, axis=1), lagged(u, 0, 2 * w, 2 * w), np.ones((n - 2 * w, 1))])
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    spoilt = np.isin(np.arange(n), list(result)).astype(np.float64)[:, None]
    clean: NDArray[np.bool_] = np.sum(lagged(spoilt, 0, 2 * w, 2 * w), axis=1) == 0.0
    if np.mean(clean) < 0.5:
        clean = np.ones(n - 2 * w, dtype=np.bool_)
    theta = linalg.lstsq(columns[clean] / scale, window[clean, w], cond=1e-10, lapack_driver="gelsy")[0] / scale
    error = np.zeros(n)
    error[w : n - w] = window[:, w] - columns @ theta
    return error, np.insert(theta[: 2 * w], w, 0.0)


def _repaired(y: Floats, error: Floats, weights: Floats, result: set[int]) -> Floats:
    """Return the signal with the found samples where all their errors vanish, each other's neighbours included."""
    at = np.array(sorted(result))
    distance = at[:, None] - at[None, :] + _NEIGHBOURS
    near = (distance >= 0) & (distance <= 2 * _NEIGHBOURS)
    # The window runs from the newest sample to the oldest: weight i belongs to y[k + w − i].
    effect = np.eye(len(at)) - np.where(near, weights[np.clip(distance, 0, 2 * _NEIGHBOURS)], 0.0)
    new = y.copy()
    new[at] -= np.linalg.lstsq(effect, error[at], rcond=1e-8)[0]
    return new


def _robust_spread(error: Floats) -> float:
    """Return the median absolute deviation as a standard deviation, widened where the errors are not normal."""
    size = np.abs(error[error != 0.0])
    if not size.size:
        return 0.0
    middle, most = np.quantile(size, [0.5, 0.99])
    # A rate limit or friction leaves errors that are nearly 0 mostly and large often: then the tail is the measure.
    return float(max(_SPREAD * middle, most / 2.576))
