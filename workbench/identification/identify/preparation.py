"""What happens to the data before an identification: columns, settling part, operating point."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment, read_experiment
from workbench.data.preprocess.detrend import Detrended, detrend, remove_offset
from workbench.data.preprocess.settle import cut_settling
from workbench.errors import InputError

__all__ = ["PreparedData", "chosen", "cut", "prepare"]


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


def _nothing(data: Experiment) -> Detrended:
    return remove_offset(data, {})


# Name → what takes the operating point off.
_DETRENDS: Mapping[str, Callable[[Experiment], Detrended]] = {
    "mean": detrend,
    "linear": lambda data: detrend(data, kind="linear"),
    "none": _nothing,
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
