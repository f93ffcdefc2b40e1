"""Feed the output of a nonlinear block forward to a control input, so that its effect on the block's input vanishes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.analysis.describing.base import Complex
from workbench.analysis.feed_forward.design import Design, Settings, design
from workbench.analysis.feed_forward.plant import Plant, linear_plant
from workbench.analysis.feed_forward.remaining import remaining
from workbench.analysis.feed_forward.result import FeedForwardResult
from workbench.analysis.feed_forward.step import Judge
from workbench.analysis.feed_forward.trial import Run, Trial, run_trial
from workbench.analysis.feed_forward.wiring import Loops, ends_of_actuator, variable_of
from workbench.analysis.limit_cycle.cut import find_ports
from workbench.analysis.reduction.band_error import dense_grid
from workbench.analysis.reduction.factored import right_of_axis
from workbench.core.blas import one_thread
from workbench.core.linear import LinearPart
from workbench.core.operating_point import At
from workbench.errors import InputError
from workbench.model.described import DescribedModel
from workbench.model.placing import standing, start_at
from workbench.origin import with_origin
from workbench.signals import Signal

__all__ = ["feed_forward"]

_WIDER = 4.0  # times the band's edge: how far the curves are computed
_OFF_ZERO = 0.2  # of the amplitude: a mean beyond is no asymmetry of a motion
_SHORTEST = 4  # digits of a frequency in words


@with_origin()
def feed_forward(
    model: DescribedModel,
    *,
    block: str,
    target: str,
    feedback: tuple[str, float] | None = None,
    orders: tuple[int, int] | None = None,
    hankel: float = 1e-4,
    method: str = "match-dc",
    cancel: float = 1e-5,
    low_pass: float = 5.0,
    low_pass_order: int = 1,
    sign: str = "auto",
    band: tuple[float, float] | None = None,
    inputs: Mapping[str, Signal] | None = None,
    outputs: Sequence[str] = (),
    closes_at: float = 0.0,
    stop: float | None = None,
    actuator: str | None = None,
    crude: bool = False,
    at: At | None = None,
    time: float | None = None,
) -> FeedForwardResult:
    """Design a filter F ≈ H/G from a block's output to a control input, and try it.

    With v the block's input, w its output and u the control, the linear part is v = G u − H w. Fed with u = F w,
    F = H/G, the block would have no effect on its own input at all. Such a filter is large, and unstable where G has
    zeros right of the imaginary axis. So, in the order of the steps of the result: G and H, stabilised by a scalar
    feedback, are reduced separately (balanced, to `orders` or to Hankel singular values above `hankel`); they are
    joined by zeros and poles, not by polynomials; poles and zeros that nearly meet are cancelled; poles right of the
    axis are mirrored, which keeps the gain and changes the phase; the sign is changed where that turned the phase by
    180° at low frequency; a low-pass ends the band in which the filter holds.

    When not to use it: mirroring is exact in gain only. If poles were mirrored inside the band, w is not compensated
    around their frequencies, and may be amplified: `steps[-1].residual` above 1 says so. The block's output then
    acts through (G F/H − 1) H instead of −H; where this loop is unstable at high gain, a block that grows faster than
    linearly drives the system to infinity in finite time. Trials without actuator limits show it, limits turn it into
    a larger limit cycle.

    Source: the filter of chapter 8.6 of the source report; J.-J. Slotine, W. Li, Applied Nonlinear Control, chapter 6.

    Args:
        model: a system; it stays open.
        block: name of the nonlinear block's component, with one input and one output.
        target: control input, "component.variable", not driven by anything but the system's inputs.
        feedback: variable and gain of a scalar feedback to the target that stays, ("component.variable", gain).
        orders: of the reduced G and H.
        hankel: without `orders`: Hankel singular values from this part of the largest on are kept.
        method: of the reduction: "match-dc" (gain at frequency 0 exact) or "truncate".
        cancel: relative distance of pole and zero, absolute below 1 rad/s, up to which they cancel.
        low_pass: corner of the low-pass [Hz].
        low_pass_order: 0: no low-pass.
        sign: "auto" (by the number of real poles mirrored), "change" or "keep".
        band: lowest and highest frequency in which errors count [Hz]; None: 0.1 Hz (or a fiftieth of the corner, if
            that is less) up to the corner.
        inputs: forced inputs that start the motion; None: nothing is simulated.
        outputs: variables to record in simulations besides the block's input, output and the target.
        closes_at: time at which feedback and filter are connected in simulations [s].
        stop: end of simulations [s]; None: the system's own.
        actuator: file of a model with one input and one output in front of the target, such as `fmu:LimitedActuator`.
        crude: also try the filter cut down to its gain where |H| is largest.
        at: operating point, where simulations begin, too: a point, a result that has one, or the file of either; None:
            the start values.
        time: session time of the linearisation [s]; None: that of `at`, else where the model
            starts.

    Raises:
        InputError: no system, unknown names, a target that is driven, orders or tolerances out of range.
        FmuError, SimulationError: the model cannot be opened or evaluated.

    Examples:
        The aircraft without its aileron's actuator has one pair of unstable poles; the published feedback removes it.

        >>> with wb.load("system:failed_aileron") as aircraft:
        ...     design = wb.feed_forward(
        ...         aircraft, block="damper", target="aircraft.inner_aileron", orders=(36, 29),
        ...         feedback=("aircraft.outer_aileron_position", -0.7),
        ...     )
        >>> print(len(design.open_unstable), len(design.closed_unstable))
        2 0
    """
    loops = _loops(model, block, target, feedback, actuator)
    settings = Settings(
        orders=orders, hankel=hankel, method=method, cancel=cancel, low_pass=low_pass, low_pass_order=low_pass_order,
        sign=sign, band=band or (min(0.1, low_pass / 50.0), low_pass),
    )  # fmt: skip
    settings.check()
    model, remarks = start_at(model, at)
    point = model.at
    run = _run(model, inputs, outputs, closes_at, stop)
    time = model.start_time if time is None else time
    with one_thread():
        plant = linear_plant(model, loops, at=point, time=time)
        frequency = dense_grid(plant.G, plant.H, settings.band[0], _WIDER * settings.band[1])
        judge = Judge(frequency, settings.band, plant.G.response(frequency), plant.H.response(frequency))
        made = design(plant.G, plant.H, settings, judge)
        looked_at = (0.1 * settings.band[0], _WIDER * settings.band[1])
        left = remaining(model, block, plant, made.part, band=looked_at, at=point, time=time)
    trials = () if run is None else _trials(model, loops, made, judge, run, crude=crude)
    units = tuple(variable_of(model, name, "variable").unit for name in (loops.ports.w, target, loops.ports.v))
    said = [left] if isinstance(left, str) else left.words(units[2])
    return FeedForwardResult(
        model=model.name, interface=model.interface, solver=model.solver, block=block,
        input=loops.ports.v, output=loops.ports.w, target=target, source=loops.source, gain=loops.gain,
        filter_units=(units[0], units[1]), band=settings.band, frequency_hz=frequency, g=judge.g, h=judge.h,
        open_unstable=_right(plant.open_poles), closed_unstable=_right(plant.poles), design=made,
        limit_cycles=None if isinstance(left, str) else left, trials=trials,
        notes=(
            *remarks, *plant.notes, *_doubts(plant, made, loops), *made.notes, *said, *_off_zero(trials, loops),
            *_failures(trials),
        ),
        operating_point=standing(model),
    )  # fmt: skip


def _loops(
    model: DescribedModel, block: str, target: str, feedback: tuple[str, float] | None, actuator: str | None
) -> Loops:
    ports = find_ports(model, block)
    variable_of(model, target, "target")
    if actuator is not None:
        ends_of_actuator(actuator)  # said also where nothing is simulated with it
    if feedback is None:
        return Loops(ports=ports, target=target, actuator=actuator)
    variable_of(model, feedback[0], "feedback")
    if not np.isfinite(feedback[1]):
        raise InputError(f"feedback gain must be a finite number, not {feedback[1]:g}")
    return Loops(ports=ports, target=target, source=feedback[0], gain=feedback[1], actuator=actuator)


def _run(
    model: DescribedModel,
    inputs: Mapping[str, Signal] | None,
    outputs: Sequence[str],
    closes_at: float,
    stop: float | None,
) -> Run | None:
    if inputs is None:
        return None
    end = stop if stop is not None else model.description.experiment.stop_time
    if end is None:
        raise InputError(f"{model.name}: stop is missing: give the end of the simulation [s]")
    if not 0.0 <= closes_at < end:
        raise InputError(f"closes_at must lie between 0 and the end of the simulation at {end:g} s, not {closes_at:g}")
    known = {v.name for v in model.inputs}
    for name in inputs:
        if name not in known:
            raise InputError(f"{model.name}: '{name}' is not an input of the system; known: {', '.join(sorted(known))}")
    for name in outputs:
        variable_of(model, name, "output")
    return Run(inputs=dict(inputs), outputs=tuple(outputs), stop=end, closes_at=closes_at)


def _trials(
    model: DescribedModel, loops: Loops, made: Design, judge: Judge, run: Run, *, crude: bool
) -> tuple[Trial, ...]:
    wanted: list[tuple[str, Loops, LinearPart | None]] = []
    if loops.source is not None:
        wanted.append(("scalar feedback", loops, None))
    wanted.append(("feed-forward", loops, made.part))
    if crude:
        gain = LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), _plain_gain(judge))
        wanted.append(("plain gain, no limits", replace(loops, actuator=None), gain))
        if loops.actuator is not None:
            wanted.append(("plain gain", loops, gain))
    return tuple(run_trial(model, where, part, run, name=name) for name, where, part in wanted)


def _plain_gain(judge: Judge) -> float:
    """Return H/G as a plain number, at the frequency where H is largest in the band."""
    inside = np.flatnonzero((judge.frequency >= judge.band[0]) & (judge.frequency <= judge.band[1]))
    peak = inside[int(np.argmax(np.abs(judge.h[inside])))]
    value = complex(judge.h[peak] / judge.g[peak])
    return float(np.copysign(abs(value), value.real))


def _right(poles: Complex) -> Complex:
    return np.asarray(poles[right_of_axis(poles)], dtype=np.complex128)


def _doubts(plant: Plant, made: Design, loops: Loops) -> list[str]:
    notes = []
    if len(right := _right(plant.poles)):
        how = "the feedback does not stabilise it" if loops.source else "a scalar feedback may stabilise it"
        notes.append(f"the linear part has {len(right)} unstable poles; {how}; the reduction keeps them")
    last = made.steps[-1]
    if last.residual > 1.0:
        notes.append(
            f"the filter amplifies the block's effect up to {last.residual:.{_SHORTEST - 1}g} times its largest effect "
            "without the filter: the mirrored poles are in the band"
        )
    return notes


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


def _failures(trials: Sequence[Trial]) -> list[str]:
    return [f"{t.name}: {t.failure}" for t in trials if t.failure]
