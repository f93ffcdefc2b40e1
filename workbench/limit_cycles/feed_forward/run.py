"""The design of a feed-forward filter and its trials, in their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.limit_cycles.feed_forward.design import design
from workbench.limit_cycles.feed_forward.design_step import FilterComparison
from workbench.limit_cycles.feed_forward.plant import linear_plant
from workbench.limit_cycles.feed_forward.remaining_cycles import Remaining, remaining
from workbench.limit_cycles.feed_forward.request import FeedForward
from workbench.limit_cycles.feed_forward.result import FeedForwardResult
from workbench.limit_cycles.feed_forward.trial import Trial, run_trial
from workbench.limit_cycles.feed_forward.weighting import Weighting
from workbench.limit_cycles.feedback.actuator import Actuator, wrapped
from workbench.limit_cycles.feedback.closed_system import ControlLaw, FeedbackPath, find_place
from workbench.loops.opened_system import Ports, find_ports
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
        InputError: no system, unknown names, orders or tolerances out of range.
        FmuError, SimulationError: the model cannot be opened or evaluated.
    """
    ports = find_ports(model, request.block)
    if request.second == request.target:
        raise InputError(f"{request.second} is the target itself; name another second control input")
    model, remarks = start_at(model, request.at)
    place = find_place(
        model, ports.w if request.feedback is None else request.feedback[0], request.target, request.second
    )
    actuator = None if request.actuator is None else wrapped(request.actuator)  # said also where nothing is simulated
    stop = _stop(place, request)
    result = _designed(place, ports, request, remarks)
    trials: list[Trial] = []
    job.partial = lambda: _with_trials(result, trials)
    if stop is not None:
        inputs = forced_inputs(model, request.inputs or {})
        planned = _controls(result, ports, actuator, crude=request.crude)
        for name, law in planned:
            trials.append(
                run_trial(
                    place, ports, law, name=name, inputs=inputs, outputs=request.outputs, closes_at=request.closes_at,
                    stop=stop,
                )
            )  # fmt: skip
            job.done(name, len(trials), len(planned))
    return _with_trials(result, trials)


def _designed(place: FeedbackPath, ports: Ports, request: FeedForward, remarks: Sequence[str]) -> FeedForwardResult:
    """Return the filter with what is predicted of it, before anything is simulated."""
    model, point, band = place.model, place.model.at, request.counted
    time = model.start_time if request.time is None else request.time
    source, gain = request.feedback or (None, 0.0)
    with one_thread():
        plant = linear_plant(place, ports, gain, at=point, time=time, band=band, weighting=request.weighting)
        frequency = dense_grid(plant.G, plant.H, band[0], _WIDER * band[1])
        judge = FilterComparison(frequency, band, plant.G.response(frequency), plant.H.response(frequency))
        made = design(plant.G, plant.H, request, judge)
        looked_at = (0.1 * band[0], _WIDER * band[1])
        left = remaining(model, request.block, plant, made.part, band=looked_at, at=point, time=time)
    units = {v.name: v.unit for v in model.description.variables}
    said = left.words(units.get(ports.v)) if isinstance(left, Remaining) else [left]
    result = FeedForwardResult(
        model=model.name, interface=model.interface, solver=model.solver, block=request.block,
        input=ports.v, output=ports.w, target=request.target, source=source, gain=gain,
        filter_units=(units.get(ports.w), place.target_unit), band=band, frequency_hz=frequency, g=judge.g, h=judge.h,
        open_unstable=_right(plant.open_poles), closed_unstable=_right(plant.poles), design=made,
        second=request.second, shared=plant.weighting,
        limit_cycles=left if isinstance(left, Remaining) else None,
        operating_point=standing(model),
    )  # fmt: skip
    return replace(result, notes=(*remarks, *plant.notes, *_doubts(result), *made.notes, *said))


def _with_trials(result: FeedForwardResult, trials: Sequence[Trial]) -> FeedForwardResult:
    failures = [f"{t.name}: {t.failure}" for t in trials if t.failure]
    return replace(result, trials=tuple(trials), notes=(*result.notes, *_off_zero(trials, result.input), *failures))


def _stop(place: FeedbackPath, request: FeedForward) -> float | None:
    """Return the end of the simulations [s]; None: nothing is simulated."""
    if request.inputs is None:
        return None
    model = place.model
    end = request.stop if request.stop is not None else model.description.experiment.stop_time
    if end is None:
        raise InputError(f"{model.name}: stop is missing: give the end of the simulation [s]")
    if not 0.0 <= request.closes_at < end:
        raise InputError(
            f"closes_at must lie between 0 and the end of the simulation at {end:g} s, not {request.closes_at:g}"
        )
    forced_inputs(model, request.inputs)
    for name in request.outputs:
        place.inner(name)
    return end


def _controls(
    result: FeedForwardResult, ports: Ports, actuator: Actuator | None, *, crude: bool
) -> list[tuple[str, ControlLaw]]:
    """Return what is simulated."""
    shares = (1.0, 0.0) if result.shared is None else result.shared.weights
    alone = ControlLaw(gain=result.gain, filtered=ports.w, shares=shares, actuator=actuator)
    wanted = [] if result.source is None else [("scalar feedback", alone)]
    wanted.append(("feed-forward", replace(alone, filter=result.part)))
    if crude:
        plain = replace(alone, filter=LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), _plain_gain(result)))
        wanted.append(("plain gain, no limits", replace(plain, actuator=None)))
        wanted += [] if actuator is None else [("plain gain", plain)]
    return wanted


def _plain_gain(result: FeedForwardResult) -> float:
    """Return H/G as a plain number, at the frequency where H is largest in the band."""
    inside = np.flatnonzero((result.frequency_hz >= result.band[0]) & (result.frequency_hz <= result.band[1]))
    peak = inside[int(np.argmax(np.abs(result.h[inside])))]
    value = complex(result.exact[peak])
    return float(np.copysign(abs(value), value.real))


def _right(poles: Complex) -> Complex:
    return np.asarray(poles[right_of_axis(poles)], dtype=np.complex128)


def _doubts(result: FeedForwardResult) -> list[str]:
    notes = [] if result.shared is None else [_shared(result.shared, result)]
    if right := len(result.closed_unstable):
        how = "the feedback does not stabilise it" if result.source else "a scalar feedback may stabilise it"
        notes.append(f"the linear part has {right} unstable poles; {how}; the reduction keeps them")
    last = result.steps[-1]
    if last.residual > 1.0:
        notes.append(
            f"the filter amplifies the block's effect up to {last.residual:.3g} times its largest effect "
            "without the filter: the mirrored poles are in the band"
        )
    return notes


def _shared(result: Weighting, loops: FeedForwardResult) -> str:
    (x, y), better = result.weights, 100.0 * (1.0 - result.left / result.left_alone)
    return (
        f"the filter's output goes to {loops.target} with {x:.4g} and to {loops.second} with {y:.4g} (least "
        f"{result.method} error); a constant gain comes {better:.2g} % nearer to H than with {loops.target} alone"
    )


def _off_zero(trials: Sequence[Trial], block_input: str) -> list[str]:
    """Tell where the block's input does not move about 0: the filter takes the block's constant part out, too."""
    if not trials or trials[0].closes_at <= 0.0:
        return []
    first = trials[0]
    late = (first.time >= 0.5 * first.closes_at) & (first.time < first.closes_at)
    v = first.signals[block_input][late]
    middle = 0.5 * float(v.max(initial=-np.inf) + v.min(initial=np.inf)) if len(v) else 0.0
    if abs(middle) <= _OFF_ZERO * first.before:
        return []
    words = (
        f"before the control closes {block_input} moves about {middle:.3g}, not about 0: the filter acts on the "
        "block's constant output, too, and moves the operating point; amplitudes and settling are measured from 0"
    )
    return [words]
