"""The motion that a feedback finds when it closes: a limit cycle, predicted or simulated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from workbench.core.records.record import entry
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.limit_cycles.feedback.block import TwoPorts, cycles_in
from workbench.limit_cycles.feedback.closed_system import ControlLaw, FeedbackPath
from workbench.limit_cycles.limit_cycle.confirm import PER_PERIOD, TOLERANCE
from workbench.limit_cycles.limit_cycle.harmonic_balance import balance, states_of
from workbench.loops.nyquist.nyquist import nyquist
from workbench.model.described_model import DescribedModel
from workbench.response.simulate.zero_crossings import pass_rate, rising_passes
from workbench.session.base import Session
from workbench.signals.kinds import Signal

__all__ = ["InitialMotion", "closing", "initial_motion", "mean_magnitude"]

_PERIODS = 40  # that a predicted cycle is simulated for, so that what the prediction left out has settled
_SHOWN = 10  # periods kept, by which the frequency is told
_ROWS = 20_000  # of a motion whose frequency is not foretold


@dataclass(frozen=True, eq=False)
class InitialMotion:
    """What the runs of a settling study begin with.

    Attributes:
        opens: session time at which each run is opened [s].
        closes: session time at which the feedback closes [s].
        values: states and inputs at `opens`, by the model's names.
        first: states and inputs at the very beginning.
        frequency: of the motion at the end [Hz].
        magnitude: mean of |variable| over the last cycle before the feedback closes.
        centre: value of the variable at rest.
        how: in words.
        time, motion: the variable over the last cycles, shape (k,).
        signals: that force the model; not written to files, and so not read from them.
    """

    opens: float
    closes: float
    values: Mapping[str, float]
    first: Mapping[str, float]
    frequency: float
    magnitude: float
    centre: float
    how: str
    time: Floats
    motion: Floats
    signals: Mapping[str, Signal] = field(default_factory=dict, metadata=entry(kept=False))


def _predicted_cycle(place: FeedbackPath, two: TwoPorts) -> tuple[dict[str, float], float]:
    """Return the largest stable limit cycle of the system without feedback: states on it, and its frequency [Hz].

    Args:
        place: of the feedback.
        two: the system opened at its block.

    Raises:
        InputError: no stable limit cycle is predicted.
    """
    name, block, part = place.model.name, two.block, two.part(0.0)
    if block is None:
        raise InputError(f"{name}: the block is not static, so no cycle is predicted; excite one (pulse, start_after)")
    result = [c for c in cycles_in(nyquist(part, block)) if c.stable]
    if not result:
        raise InputError(
            f"{name}: no stable limit cycle is predicted without feedback, so nothing settles; excite a motion "
            "(pulse, start_after)"
        )
    first = max(result, key=lambda c: c.amplitude or 0.0)
    cycle = balance(part, (block,), frequency=first.frequency_hz, amplitude=first.amplitude or 0.0)
    if cycle is None:
        raise InputError(
            f"{name}: harmonic balance finds no cycle near {first.frequency_hz:.4g} Hz; excite one (pulse)"
        )
    x, rest = states_of(part, cycle, np.zeros(1))[0], two.lin.operating_point.x
    known = {v.name for v in place.model.states}
    named = {place.outer(n): rest[n] + float(x[i]) for n, i in two.lin.states.items()}
    return {n: v for n, v in named.items() if n in known}, cycle.frequency


def initial_motion(
    place: FeedbackPath,
    point: OperatingPoint,
    watch: str,
    *,
    centre: float,
    time: float,
    signals: Mapping[str, Signal],
    start_after: float | None,
    two: TwoPorts | None,
) -> InitialMotion:
    """Return the motion that the feedback closes on: under signals, or else on a predicted cycle, simulated.

    Args:
        place: of the feedback.
        point: where the model rests.
        watch: variable whose magnitude decides, by the model's name.
        centre: of it at rest.
        time: session time at which the simulation begins [s].
        signals: that excite the motion.
        start_after: how long they run before the feedback closes [s]; None: a cycle is predicted in their place.
        two: the system opened at its block; None: there is none.

    Raises:
        InputError: no stable limit cycle is predicted, sessions cannot begin on it, nothing oscillates at the end.
        SimulationError: the simulation fails.
    """
    model, first, guess = place.model, {**point.x, **point.u}, None
    if start_after is not None:
        closes, rows = time + start_after, _ROWS
        how = f"after {start_after:g} s under {', '.join(signals) or 'no signal'}"
    else:
        states, guess = _startable_cycle(place, two, time, first)
        first |= states
        closes, rows = time + _PERIODS / guess, _PERIODS * PER_PERIOD
        how = f"starting from the predicted limit cycle, simulated for {_PERIODS} periods"
    points = np.linspace(time, closes, rows + 1)[1:]
    with model.open_at(time=time, values=first, tolerance=TOLERANCE) as session:
        record = session.advance(closes, signals=signals, record=[watch], points=points).right_limits()
        kept = [v.name for v in (*model.states, *model.inputs) if v.is_number] if model.interface == "me" else []
        end = session.values(kept)
    at, moved = record.time, record.values[watch] - centre
    passes = rising_passes(at, moved)[-_SHOWN - 1 :]
    frequency = pass_rate(passes, guess) if len(passes) > 2 else guess
    size = 0.0 if frequency is None else float(mean_magnitude(at, moved, 1.0 / frequency)[-1])
    if frequency is None or not size > TOLERANCE * abs(centre):
        raise InputError(
            f"{model.name}: {watch} does not oscillate when the feedback closes at {closes:g} s; excite it (pulse)"
        )
    last, goes_on = at >= closes - _SHOWN / frequency, _begins_at(model, closes, end)
    return InitialMotion(
        opens=closes if goes_on else time,
        closes=closes,
        values=end if goes_on else first,
        first=first,
        signals=dict(signals),
        frequency=frequency,
        magnitude=size,
        centre=centre,
        how=how,
        time=at[last],
        motion=moved[last] + centre,
    )


def _startable_cycle(
    place: FeedbackPath, two: TwoPorts | None, time: float, held: Mapping[str, float]
) -> tuple[dict[str, float], float]:
    """Return the states on a predicted cycle, where sessions can begin with `held` and these, and its frequency."""
    if two is None:
        raise InputError(
            f"{place.model.name}: no nonlinear block is known, so no limit cycle is predicted; name it (block), or "
            "excite a motion (pulse, start_after)"
        )
    states, frequency = _predicted_cycle(place, two)
    if not _begins_at(place.model, time, {**held, **states}):
        raise InputError(
            f"{place.model.name}: its sessions cannot start at a given point, so a predicted cycle cannot be started; "
            "excite a motion (pulse, start_after)"
        )
    return states, frequency


def _begins_at(model: DescribedModel, time: float, values: Mapping[str, float]) -> bool:
    """Whether a session that begins with these values goes on as the one that they were taken from.

    Not where a model keeps more than its continuous states (discrete states, clocks, co-simulation), or does not take
    them.
    """
    if model.interface != "me":
        return False
    with model.open_point(time=time) as point:
        if point.memory or len(point.ticks(1, 1e300)):
            return False
    names = [v.name for v in model.states if v.name in values]
    with model.open_at(time=time, values=values) as session:
        return np.allclose(list(session.values(names).values()), [values[n] for n in names])


@contextmanager
def closing(place: FeedbackPath, law: ControlLaw, motion: InitialMotion) -> Iterator[tuple[Session, str]]:
    """Open the system with a feedback on a motion; yield its session, and the full name of what it hands to the target.

    Args:
        place: of the feedback.
        law: the feedback.
        motion: opens with these values at that time.
    """
    system, handed = place.closed(law)
    values = place.start_values(motion.values)
    with place.opened(system) as model, model.open_at(time=motion.opens, values=values, tolerance=TOLERANCE) as session:
        yield session, handed


def mean_magnitude(time: Floats, x: Floats, period: float) -> Floats:
    """Return the mean of |x| over the period before each time, shape (n,); over what there is at the beginning.

    Args:
        time: rising [s], shape (n,).
        x: shape (n,).
        period: [s].
    """
    size = np.abs(x)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (size[1:] + size[:-1]) * np.diff(time))])
    begin = np.maximum(time - period, time[0])
    span = np.maximum(time - begin, np.finfo(float).tiny)
    return np.where(time > time[0], (total - np.interp(begin, time, total)) / span, size)
