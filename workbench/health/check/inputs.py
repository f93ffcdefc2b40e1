"""Are continuous inputs taken as what they are: continuous?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.variable import Variable
from workbench.health.check.compare import largest_gap, relative_gaps
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu, same_bits
from workbench.session.fmu import FmuSession

__all__ = ["inputs"]

_AT = 0.3713  # of a test run: no special instant
_FINE = 16  # steps for one natural step, for the reference
_WORSE = 2.0
_SHARES = (1.0, 20.0)  # of the usual amplitude: a twentieth of an input's size, and all of it
_OFF = 0.9371  # of the natural step: samples of the model do not fall on communication points
_HELD = "inputs held from the start of each communication step are half a step late"


def inputs(subject: CheckedFmu) -> Answer:
    """Model exchange: an input set in continuous-time mode acts; co-simulation: inputs are interpolated as claimed.

    Model exchange: in the middle of a run each continuous input is set 5 % of its size away, without an event.
    Derivatives, outputs or event indicators must answer where they do after an event iteration with the same value
    (quantisers answer by their indicators alone, sampled inputs by neither). Broken: only the event shows it.

    Co-simulation that claims canInterpolateInputs: one run with input slopes, one with held inputs, one with steps 16
    times shorter. Broken: the slopes are refused, or lead more than twice as far away as held inputs. Watch: they
    are taken and change nothing (as when explicit Euler looks at the beginning of each step only), or no input acts at
    all, not even moved by its full size. Without the claim: good, with what held inputs cost (here they have the value
    of the middle of a step, where the FMU takes steps of any length). Not applicable: no continuous inputs.
    """
    if not subject.inputs:
        return Answer("not applicable", "no continuous inputs")
    share = _acting(subject)
    if not subject.is_cs:
        return _model_exchange(subject, share)
    return _idle(subject) if share is None else _co_simulation(subject, share)


def _idle(subject: CheckedFmu) -> Answer:
    names = ", ".join(subject.inputs)
    return Answer("watch", f"no observed variable responds to {names} in {subject.span:.4g} s", _DEAF)


_DEAF = "responses from here are zero; another operating point, a larger amplitude or a longer run may show more"


def _acting(subject: CheckedFmu) -> float | None:
    """Return how far, in amplitudes, inputs must go until something answers; a play or a dead band wants more."""
    rest = subject.run(subject.constants(0.0))
    for share in _SHARES:
        try:
            if not same_bits(subject.run(subject.sines(share)), rest):
                return share
        except SimulationError:
            return 1.0
    return None


# -- model exchange -----------------------------------------------------------------------------


def _model_exchange(subject: CheckedFmu, share: float | None) -> Answer:
    answered, silent, deaf = list[str](), list[str](), list[str]()
    with subject.model.open_session(start_time=subject.start) as session:
        session.advance(subject.start + _AT * subject.span, signals=subject.constants(0.0))
        _event(session)  # one that is due here belongs to no input
        for name, (middle, _) in subject.inputs.items():
            amplitude = subject.sines(share or 1.0)[name].amplitude
            quick, slow = _answers(session, session.inputs[name], middle, amplitude)
            (answered if quick else deaf if slow else silent).append(name)
    numbers = {"answered": answered, "silent": silent, "deaf": deaf}
    if deaf:
        text = f"{', '.join(deaf)}: declared continuous, but it acts only at events"
        return Answer(
            "broken", text, "responses contain a staircase: declare it discrete, or force it by steps", numbers
        )
    if share is None and not answered:
        return _idle(subject)
    rest = f"; nothing answers to {len(silent)} between events" if silent else ""
    return Answer("good", f"{len(answered)} of {len(subject.inputs)} act in continuous time{rest}", numbers=numbers)


def _answers(session: FmuSession, variable: Variable, middle: float, amplitude: float) -> tuple[bool, bool]:
    """Return whether an input acts in continuous time, and whether it does through an event."""
    instance = session.instance
    writer = instance.access([variable])
    base = _seen(session)
    writer.write([middle + amplitude])
    quick = not np.array_equal(base, _seen(session))
    _event(session)
    slow = not np.array_equal(base, _seen(session))
    writer.write([middle])
    _event(session)
    return quick, slow


def _seen(session: FmuSession) -> Floats:
    """Return outputs, derivatives and event indicators where the model stands."""
    instance = session.instance
    outputs = [v for v in instance.description.variables if v.causality == "output" and v.is_number]
    # Outputs first: OpenModelica's FMUs do not compute them anew once the derivatives are known.
    y = np.array([float(v) for v in instance.access(outputs).read()]) if outputs else np.empty(0)
    instance.get_derivatives()
    instance.get_indicators()
    return np.concatenate([y, instance.dx, instance.z])


def _event(session: FmuSession) -> None:
    session.instance.enter_event_mode()
    session.instance.iterate_events()
    session.instance.enter_continuous_mode()


# -- co-simulation ------------------------------------------------------------------------------


def _co_simulation(subject: CheckedFmu, share: float) -> Answer:
    fastest = max(s.frequency for s in subject.sines().values())
    delay = 180.0 * fastest * subject.step
    cost = f"{_HELD} ({0.5 * subject.step:.3g} s, {delay:.2g}° at {fastest:.3g} Hz)"
    claims = subject.model.description.interfaces["cs"]
    if not claims.interpolates_inputs:
        evidence = f"here they have the value of the middle of a step; {cost}" if claims.variable_step else cost
        return Answer("good", "inputs act; interpolation is not claimed", evidence, {"interpolates": False})
    if not _takes_slopes(subject):
        text = "canInterpolateInputs is claimed, but input derivatives are rejected"
        return Answer("broken", text, cost, {"interpolates": False})
    return _slopes(subject, cost, share)


def _takes_slopes(subject: CheckedFmu) -> bool:
    with subject.open() as session:
        session.advance(subject.start, signals=subject.sines())
        instance = session.instance
        access = instance.access([session.inputs[n] for n in subject.inputs])
        return bool(instance.try_input_slopes(access, [0.0] * len(subject.inputs)))


def _slopes(subject: CheckedFmu, cost: str, share: float) -> Answer:
    h = _OFF * subject.step
    points = subject.points(step=h)
    signals = subject.sines(share)
    with subject.model.recipe.open() as model:
        model.slopes = True  # believed, not probed
        with_slopes = replace(subject, model=model).run(signals, step=h, points=points)
    with replace(subject.model.recipe, hold_inputs=True).open() as model:
        held = replace(subject, model=model).run(signals, step=h, points=points)
    reference = subject.run(signals, step=h / _FINE, points=points)
    if same_bits(with_slopes, held):
        text = "canInterpolateInputs is claimed and input derivatives are accepted, but have no effect"
        return Answer("watch", text, f"not given where a probe sees that; elsewhere {cost}", {"interpolates": False})
    near, far = (float(relative_gaps(run, reference).max(initial=0.0)) for run in (with_slopes, held))
    numbers = {"interpolates": True, "error_slopes": near, "error_held": far}
    if near > _WORSE * far:
        gap = largest_gap(with_slopes, reference, subject.names)
        text = (
            f"input derivatives make the result worse: {gap.words} compared with a run with {_FINE} times shorter steps"
        )
        return Answer("broken", text, cost, numbers)
    return Answer("good", f"interpolated: error {near:.2g} of the range, {far:.2g} with held inputs", numbers=numbers)
