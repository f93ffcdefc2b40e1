"""The design of a feed-forward filter and its trials, in their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.limit_cycles.feed_forward.design import design
from workbench.limit_cycles.feed_forward.design_step import FilterComparison
from workbench.limit_cycles.feed_forward.plant import Plant, linear_plant
from workbench.limit_cycles.feed_forward.remaining_cycles import Remaining, remaining
from workbench.limit_cycles.feed_forward.request import FeedForward
from workbench.limit_cycles.feed_forward.result import Design, FeedForwardResult
from workbench.limit_cycles.feed_forward.trial import Trial, TrialSettings, run_trial
from workbench.limit_cycles.feed_forward.weighting import Weighting
from workbench.limit_cycles.feed_forward.wiring import Loops, variable_of
from workbench.limit_cycles.feedback.actuator import ends_of
from workbench.loops.opened_system import find_ports
from workbench.model.described_model import DescribedModel
from workbench.model.names import forced_inputs
from workbench.model.operating_point import standing, start_at
from workbench.point.reduction.band_error import dense_grid
from workbench.point.reduction.factored import right_of_axis

__all__ = ["run"]

_WIDER = 4.0  # times the band's edge: how far the curves are computed
_OFF_ZERO = 0.2  # of the amplitude: a larger mean is not an asymmetry of the motion


def run(model: DescribedModel, request: FeedForward, job: Job) -> FeedForwardResult:
    """Design the filter, then try it.

    Args:
        model: a system; it stays open.
        request: what to design.
        job: is told which simulation is finished; without those that are not, the design is its partial record.

    Raises:
        InputError: no system, unknown names, a target that is driven, orders or tolerances out of range.
        FmuError, SimulationError: the model cannot be opened or evaluated.
    """
    loops = _loops(model, request)
    model, remarks = start_at(model, request.at)
    wanted = _run(model, request)
    result = _designed(model, request, loops, remarks)
    if result.shared is not None:
        loops = replace(loops, weights=result.shared.weights)
    trials: list[Trial] = []
    job.partial = lambda: _with_trials(result, loops, trials)
    if wanted is not None:
        planned = _controls(result, loops, crude=request.crude)
        for (name, where, part), number in zip(planned, count(1), strict=False):
            trials.append(run_trial(model, where, part, wanted, name=name))
            job.done(name, number, len(planned))
    return _with_trials(result, loops, trials)


def _designed(model: DescribedModel, request: FeedForward, loops: Loops, remarks: Sequence[str]) -> FeedForwardResult:
    """Return the filter with what is predicted of it, before anything is simulated."""
    point, band = model.at, request.counted
    time = model.start_time if request.time is None else request.time
    with one_thread():
        plant = linear_plant(model, loops, at=point, time=time, band=band, weighting=request.weighting)
        frequency = dense_grid(plant.G, plant.H, band[0], _WIDER * band[1])
        judge = FilterComparison(frequency, band, plant.G.response(frequency), plant.H.response(frequency))
        made = design(plant.G, plant.H, request, judge)
        looked_at = (0.1 * band[0], _WIDER * band[1])
        left = remaining(model, request.block, plant, made.part, band=looked_at, at=point, time=time)
    units = tuple(variable_of(model, name, "variable").unit for name in (loops.ports.w, loops.target, loops.ports.v))
    said = left.words(units[2]) if isinstance(left, Remaining) else [left]
    return FeedForwardResult(
        model=model.name, interface=model.interface, solver=model.solver, block=request.block,
        input=loops.ports.v, output=loops.ports.w, target=loops.target, source=loops.source, gain=loops.gain,
        filter_units=(units[0], units[1]), band=band, frequency_hz=frequency, g=judge.g, h=judge.h,
        open_unstable=_right(plant.open_poles), closed_unstable=_right(plant.poles), design=made,
        second=loops.second, shared=plant.weighting,
        limit_cycles=left if isinstance(left, Remaining) else None,
        notes=(*remarks, *plant.notes, *_doubts(plant, made, loops), *made.notes, *said),
        operating_point=standing(model),
    )  # fmt: skip


def _with_trials(result: FeedForwardResult, loops: Loops, trials: Sequence[Trial]) -> FeedForwardResult:
    failures = [f"{t.name}: {t.failure}" for t in trials if t.failure]
    return replace(result, trials=tuple(trials), notes=(*result.notes, *_off_zero(trials, loops), *failures))


def _loops(model: DescribedModel, request: FeedForward) -> Loops:
    ports = find_ports(model, request.block)
    variable_of(model, request.target, "target")
    if request.actuator is not None:
        ends_of(request.actuator)  # said also where nothing is simulated with it
    if request.second is not None:
        variable_of(model, request.second, "second target")
        if request.second == request.target:
            raise InputError(f"{request.second} is the target itself; name another second control input")
    if request.feedback is None:
        return Loops(ports=ports, target=request.target, second=request.second, actuator=request.actuator)
    source, gain = request.feedback
    variable_of(model, source, "feedback")
    return Loops(
        ports=ports, target=request.target, second=request.second, source=source, gain=gain, actuator=request.actuator
    )


def _run(model: DescribedModel, request: FeedForward) -> TrialSettings | None:
    if request.inputs is None:
        return None
    end = request.stop if request.stop is not None else model.description.experiment.stop_time
    if end is None:
        raise InputError(f"{model.name}: stop is missing: give the end of the simulation [s]")
    if not 0.0 <= request.closes_at < end:
        raise InputError(
            f"closes_at must lie between 0 and the end of the simulation at {end:g} s, not {request.closes_at:g}"
        )
    inputs = forced_inputs(model, request.inputs)
    for name in request.outputs:
        variable_of(model, name, "output")
    return TrialSettings(inputs=inputs, outputs=tuple(request.outputs), stop=end, closes_at=request.closes_at)


def _controls(result: FeedForwardResult, loops: Loops, *, crude: bool) -> list[tuple[str, Loops, LinearPart | None]]:
    """Return what is simulated: name, connections, filter."""
    wanted: list[tuple[str, Loops, LinearPart | None]] = []
    if loops.source is not None:
        wanted.append(("scalar feedback", loops, None))
    wanted.append(("feed-forward", loops, result.part))
    if crude:
        gain = LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), _plain_gain(result))
        wanted.append(("plain gain, no limits", replace(loops, actuator=None), gain))
        if loops.actuator is not None:
            wanted.append(("plain gain", loops, gain))
    return wanted


def _plain_gain(result: FeedForwardResult) -> float:
    """Return H/G as a plain number, at the frequency where H is largest in the band."""
    inside = np.flatnonzero((result.frequency_hz >= result.band[0]) & (result.frequency_hz <= result.band[1]))
    peak = inside[int(np.argmax(np.abs(result.h[inside])))]
    value = complex(result.exact[peak])
    return float(np.copysign(abs(value), value.real))


def _right(poles: Complex) -> Complex:
    return np.asarray(poles[right_of_axis(poles)], dtype=np.complex128)


def _doubts(plant: Plant, made: Design, loops: Loops) -> list[str]:
    notes = [] if plant.weighting is None else [_shared(plant.weighting, loops)]
    if len(right := _right(plant.poles)):
        how = "the feedback does not stabilise it" if loops.source else "a scalar feedback may stabilise it"
        notes.append(f"the linear part has {len(right)} unstable poles; {how}; the reduction keeps them")
    last = made.steps[-1]
    if last.residual > 1.0:
        notes.append(
            f"the filter amplifies the block's effect up to {last.residual:.3g} times its largest effect "
            "without the filter: the mirrored poles are in the band"
        )
    return notes


def _shared(result: Weighting, loops: Loops) -> str:
    (x, y), better = result.weights, 100.0 * (1.0 - result.left / result.left_alone)
    return (
        f"the filter's output goes to {loops.target} with {x:.4g} and to {loops.second} with {y:.4g} (least "
        f"{result.method} error); a constant gain comes {better:.2g} % nearer to H than with {loops.target} alone"
    )


def _off_zero(trials: Sequence[Trial], loops: Loops) -> list[str]:
    """Tell where the block's input does not move about 0: the filter takes the block's constant part out, too."""
    if not trials or trials[0].closes_at <= 0.0:
        return []
    first = trials[0]
    late = (first.time >= 0.5 * first.closes_at) & (first.time < first.closes_at)
    v = first.signals[loops.ports.v][late]
    middle = 0.5 * float(v.max(initial=-np.inf) + v.min(initial=np.inf)) if len(v) else 0.0
    if abs(middle) <= _OFF_ZERO * first.before:
        return []
    words = (
        f"before the control closes {loops.ports.v} moves about {middle:.3g}, not about 0: the filter acts on the "
        "block's constant output, too, and moves the operating point; amplitudes and settling are measured from 0"
    )
    return [words]
