"""Identify a linear model from recorded data and compare it with other data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from workbench.data.advice.advise import advise
from workbench.data.advice.result import Advice
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.identify.closed_loop import driven_by, with_disturbance, with_reference
from workbench.identification.identify.data import PreparedData, chosen, cut, joined, prepared_all, without_joints
from workbench.identification.identify.refinement import refined
from workbench.identification.identify.request import Identify
from workbench.identification.identify.result import IdentifyResult
from workbench.identification.subspace.estimate import estimate
from workbench.identification.subspace.record import as_tuple
from workbench.identification.subspace.result import SubspaceEstimate
from workbench.identification.validate.overlay import Overlay, overlay
from workbench.identification.validate.spread import model_spread
from workbench.identification.validate.validate import validate
from workbench.jobs.job import Job
from workbench.point.lin.result import LinResult
from workbench.response.nfr.result import NfrResult

__all__ = ["run"]


def run(data: Experiment | str | Path, request: Identify, job: Job) -> IdentifyResult:
    """Identify a model; see `Identify`."""
    experiments, reference = with_reference(data, request)
    pieces = prepared_all(experiments, request)
    prepared = pieces[0]
    order = request.order
    advice = advise(prepared.data, order=None if order == "auto" else order, feedthrough=request.feedthrough)
    if order != "auto":
        advice.refuse(order)
    job.done("data judged", 1, 3)
    driving = joined(pieces) if reference is None else driven_by(reference, prepared, request)
    estimated = estimate(
        driving.u,
        driving.y,
        prepared.data.dt,
        order=order,
        max_order=request.max_order,
        method=request.method,
        basis=request.basis,
        horizon=request.horizon,
        feedthrough=request.feedthrough,
        delay=_delays(request, advice, driving.u.shape[1]),
        biased=request.biased,
        stable=request.stable,
    )
    other = _other(request, prepared.data)
    better, refinement, rival = refined(estimated, driving, other, request)
    if reference is not None:
        better = with_disturbance(better, prepared, driving, request)
    better = better.with_model(without_joints(better.model, prepared.u.shape[1]))
    advice.refuse(better.order)
    job.done("model estimated", 2, 3)
    model = _named(better, prepared)
    rival = None if rival is None else without_joints(rival, prepared.u.shape[1])
    result = IdentifyResult(
        data=prepared.data,
        advice=advice,
        estimate=better.with_model(model),
        refinement=refinement,
        experiments=tuple(f"{e.name}: {e.n_samples} samples" for e in experiments),
        closed_loop_method=request.closed_loop,
        delays_told=delays_told(advice, better.model.delay) if request.delay == "auto" else "",
        detrend=request.detrend,
        settle=request.settle,
        own=validate(model, prepared.data, lags=request.lags),
        other=None if other is None else validate(model, other, lags=request.lags),
        uncertainty=None if model.spread is None else model_spread(model, rival=rival),
        overlay=_overlay(model, request),
    )
    job.done("model validated", 3, 3)
    return result


def _delays(request: Identify, advice: Advice, inputs: int) -> tuple[int, ...]:
    """Return the delay of each input, as asked or as the advice estimates it; the inputs that join data have none.

    Args:
        request: with the delay.
        advice: estimates it beyond the sample that all systems take [samples].
        inputs: how many, with those that join experiments.
    """
    own = len(advice.experiment.input_names)
    given = _estimated(advice) if request.delay == "auto" else as_tuple(request.delay, own)
    return (*given, *(0,) * (inputs - own))


def _estimated(advice: Advice) -> tuple[int, ...]:
    result = advice.finding("delay").values
    names, outputs = advice.experiment.input_names, advice.experiment.output_names
    waits = [[result.get(f"{u} → {y}") for y in outputs] for u in names]
    return tuple(max(0, min((w for w in row if w is not None), default=1) - 1) for row in waits)


def delays_told(advice: Advice, delays: Sequence[int]) -> str:
    """Return where the delays of the model come from, in one line; empty where there are none."""
    named = [f"{u}: {d}" for u, d in zip(advice.experiment.input_names, delays, strict=False) if d]
    evidence = advice.finding("delay").evidence
    return f"delay, by the data ({evidence}), samples taken out of the fit: {', '.join(named) or 'none'}"


def _named(result: SubspaceEstimate, prepared: PreparedData) -> IdentifiedModel:
    data = prepared.data
    return result.model.named(
        input_names=data.input_names,
        output_names=data.output_names,
        input_units=data.input_units,
        output_units=data.output_units,
        name=data.name,
        u0=prepared.u0,
        y0=prepared.y0 + result.model.y0,
    )


def _other(request: Identify, data: Experiment) -> Experiment | None:
    if request.validation is None:
        return None
    other = chosen(request.validation, data.input_names, data.output_names, request.dt).in_units(data.units)
    if abs(other.dt - data.dt) > 1e-6 * data.dt:
        raise InputError(f"{other.name}: sampled every {other.dt:g} s, {data.name} every {data.dt:g} s; resample one")
    return cut(other, request.settle)


def _overlay(model: IdentifiedModel, request: Identify) -> Overlay | None:
    """Lay the model over what other analyses found."""
    lin, nfr = request.lin, request.nfr
    if lin is None and nfr is None:
        return None
    return overlay(
        model,
        lin=LinResult.read(lin) if isinstance(lin, str | Path) else lin,
        nfr=NfrResult.read(nfr) if isinstance(nfr, str | Path) else nfr,
        amplitude=request.amplitude,
    )
