"""Bring inputs and outputs to magnitude one, which several of them with different units need."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.data.preprocess.prepared import PreprocessingStep, all_columns, check_columns
from workbench.errors import InputError, suggest

__all__ = ["MEASURES", "ScaledColumns", "scale"]

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
    names, m = all_columns(experiment), experiment.n_inputs
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
