"""Identify a linear model from recorded data and compare it with other data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.analysis.advice import Advice, advise
from workbench.analysis.experiment.experiment import Experiment, read_experiment
from workbench.analysis.identified.model import IdentifiedModel
from workbench.analysis.identify.request import Identify
from workbench.analysis.identify.result import IdentifyResult
from workbench.analysis.lin.result import LinResult
from workbench.analysis.nfr.result import NfrResult
from workbench.analysis.preprocess.detrend import Detrended, detrend, remove_offset
from workbench.analysis.preprocess.settle import cut_settling
from workbench.analysis.subspace import SubspaceEstimate, estimate
from workbench.analysis.validate.bootstrap import PoleBootstrap, bootstrap_poles
from workbench.analysis.validate.estimator import same_settings
from workbench.analysis.validate.overlay import Overlay, overlay
from workbench.analysis.validate.validate import validate
from workbench.core.job import Job
from workbench.errors import InputError
from workbench.session.base import Floats

__all__ = ["Prepared", "chosen", "cut", "prepare", "run"]


def run(data: Experiment | str | Path, asked: Identify, job: Job) -> IdentifyResult:
    """Identify a model; see `Identify`."""
    prepared = prepare(chosen(data, asked.inputs, asked.outputs, asked.dt), how=asked.detrend, settle=asked.settle)
    order = asked.order
    advice = advise(prepared.data, order=None if order == "auto" else order, feedthrough=asked.feedthrough)
    if order != "auto":
        advice.refuse(order)
    job.done("data judged", 1, 3)
    found = estimate(
        prepared.u,
        prepared.y,
        prepared.data.dt,
        order=order,
        max_order=asked.max_order,
        method=asked.method,
        basis=asked.basis,
        horizon=asked.horizon,
        feedthrough=asked.feedthrough,
        delay=_delays(advice) if asked.delay == "auto" else asked.delay,
        biased=asked.biased,
        stable=asked.stable,
    )
    advice.refuse(found.order)
    job.done("model estimated", 2, 3)
    model = _named(found, prepared)
    other = _other(asked, prepared.data)
    regions = _regions(found.with_model(model), prepared, asked)
    result = IdentifyResult(
        data=prepared.data,
        advice=advice,
        estimate=found.with_model(model),
        detrend=asked.detrend,
        settle=asked.settle,
        own=validate(model, prepared.data, lags=asked.lags, bootstrap=regions),
        other=None if other is None else validate(model, other, lags=asked.lags, bootstrap=regions),
        overlay=_overlay(model, asked),
    )
    job.done("model validated", 3, 3)
    return result


def _delays(advice: Advice) -> tuple[int, ...]:
    """Return the delay of each input that the advice estimates, beyond the sample that all systems take [samples]."""
    found = advice.finding("delay").values
    names, outputs = advice.experiment.input_names, advice.experiment.output_names
    waits = [[found.get(f"{u} → {y}") for y in outputs] for u in names]
    return tuple(max(0, min((w for w in row if w is not None), default=1) - 1) for row in waits)


def _named(found: SubspaceEstimate, prepared: Prepared) -> IdentifiedModel:
    data = prepared.data
    return found.model.named(
        input_names=data.input_names,
        output_names=data.output_names,
        input_units=data.input_units,
        output_units=data.output_units,
        name=data.name,
        u0=prepared.u0,
        y0=prepared.y0 + found.model.y0,
    )


def _other(asked: Identify, data: Experiment) -> Experiment | None:
    if asked.validation is None:
        return None
    other = chosen(asked.validation, data.input_names, data.output_names, asked.dt)
    if abs(other.dt - data.dt) > 1e-6 * data.dt:
        raise InputError(f"{other.name}: sampled every {other.dt:g} s, {data.name} every {data.dt:g} s; resample one")
    return cut(other, asked.settle)


def _regions(found: SubspaceEstimate, prepared: Prepared, asked: Identify) -> PoleBootstrap | None:
    if not asked.bootstrap:
        return None
    return bootstrap_poles(
        found.model,
        prepared.data,
        same_settings(found),
        replicates=asked.bootstrap,
        seed=asked.seed,
        workers=asked.place.apart,
    )


def _overlay(model: IdentifiedModel, asked: Identify) -> Overlay | None:
    """Lay the model over what other analyses found."""
    lin, nfr = asked.lin, asked.nfr
    if lin is None and nfr is None:
        return None
    return overlay(
        model,
        lin=LinResult.read(lin) if isinstance(lin, str | Path) else lin,
        nfr=NfrResult.read(nfr) if isinstance(nfr, str | Path) else nfr,
        amplitude=asked.amplitude,
    )


# -- what happens to the data before --------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Prepared:
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


def prepare(data: Experiment, *, how: str, settle: float) -> Prepared:
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
    return Prepared(kept, level.experiment.u, level.experiment.y, level.u0, level.y0)


def _check_moving(data: Experiment) -> None:
    for kind, names, values in (("input", data.input_names, data.u), ("output", data.output_names, data.y)):
        still = np.ptp(values, axis=0) <= 1e-12 * np.max(np.abs(values), axis=0)
        if still.any():
            k = int(np.argmax(still))
            what = "it excites nothing" if kind == "input" else "there is nothing to identify"
            raise InputError(f"{data.name}: {kind} '{names[k]}' is constant ({values[0, k]:.6g}): {what}; leave it out")


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
