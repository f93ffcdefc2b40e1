"""The motion that a feedback finds when it closes: a limit cycle, predicted or simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.core.records.record import entry
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.limit_cycles.feedback.block import TwoPorts
from workbench.limit_cycles.feedback.closed_system import FeedbackPath
from workbench.limit_cycles.feedback.plant import Standing
from workbench.limit_cycles.limit_cycle.confirm import TOLERANCE
from workbench.limit_cycles.limit_cycle.harmonic_balance import balance, states_of
from workbench.response.simulate.zero_crossings import pass_rate, rising_passes
from workbench.signals.kinds import Signal

__all__ = ["PER_CYCLE", "InitialMotion", "from_cycle", "from_signals", "mean_magnitude"]

PER_CYCLE = 64  # recorded points
_PERIODS = 40  # that a predicted cycle is simulated for, so that what the prediction left out has settled
_SHOWN = 6  # periods kept for pictures
_PASSES = 11
_NOTHING = 1e-12


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


def from_cycle(
    place: FeedbackPath, where: Standing, two: TwoPorts, watch: str, *, centre: float, time: float
) -> InitialMotion:
    """Return the largest stable limit cycle of the system without feedback, by harmonic balance and then simulated.

    Args:
        place: of the feedback.
        where: operating point.
        two: the system opened at its block.
        watch: variable whose magnitude decides, by the model's name.
        centre: of it at rest.
        time: session time at which the simulation begins [s].

    Raises:
        InputError: no stable limit cycle is predicted.
        SimulationError: the simulation fails.
    """
    states, frequency = _predicted(place, two)
    return _simulated(
        place, where, watch, centre=centre, states=states, signals={}, begin=time, closes=time + _PERIODS / frequency,
        guess=frequency, how=f"starting from the predicted limit cycle, simulated for {_PERIODS} periods",
    )  # fmt: skip


def _predicted(place: FeedbackPath, two: TwoPorts) -> tuple[dict[str, float], float]:
    name = place.model.name
    block = two.block
    if block is None:
        raise InputError(f"{name}: the block has a memory, so no cycle is predicted; excite one (pulse, start_after)")
    result = [c for c in two.loop_cycles() if c.stable and c.amplitude is not None]
    if not result:
        raise InputError(
            f"{name}: no stable limit cycle is predicted without feedback, so nothing settles; excite a motion "
            "(pulse, start_after)"
        )
    first = max(result, key=lambda c: c.amplitude or 0.0)
    cycle = balance(two.part(0.0), (block,), frequency=first.frequency_hz, amplitude=first.amplitude or 0.0)
    if cycle is None:
        raise InputError(
            f"{name}: harmonic balance finds no cycle near {first.frequency_hz:.4g} Hz; excite one (pulse)"
        )
    x = states_of(two.part(0.0), cycle, np.zeros(1))[0]
    known = {v.name for v in place.model.states}
    rest = two.lin.operating_point.x
    named = {place.outer(n): rest[n] + float(x[i]) for n, i in two.lin.states.items()}
    return {n: v for n, v in named.items() if n in known}, cycle.frequency


def from_signals(
    place: FeedbackPath,
    where: Standing,
    watch: str,
    *,
    centre: float,
    signals: Mapping[str, Signal],
    time: float,
    start_after: float,
) -> InitialMotion:
    """Return the motion after some time under signals from rest.

    Args:
        place: of the feedback.
        where: operating point.
        watch: variable whose magnitude decides, by the model's name.
        centre: of it at rest.
        signals: input → signal, such as a short pulse.
        time: session time at which the simulation begins [s].
        start_after: how long it runs before the feedback closes [s].

    Raises:
        InputError: nothing oscillates at the end.
        SimulationError: the simulation fails.
    """
    return _simulated(
        place, where, watch, centre=centre, states={}, signals=signals, begin=time, closes=time + start_after,
        guess=None, how=f"after {start_after:g} s under {', '.join(signals) or 'no signal'}",
    )  # fmt: skip


def _simulated(
    place: FeedbackPath,
    where: Standing,
    watch: str,
    *,
    centre: float,
    states: Mapping[str, float],
    signals: Mapping[str, Signal],
    begin: float,
    closes: float,
    guess: float | None,
    how: str,
) -> InitialMotion:
    """Run the system without feedback; where its states are all there is to know, the runs may begin at the end."""
    model, values = place.model, {**where.point.x, **where.point.u, **states}
    interval = (closes - begin) / 20_000 if guess is None else 1.0 / (guess * PER_CYCLE)
    count = max(1, round((closes - begin) / interval))
    points = np.append(begin + (closes - begin) * np.arange(1, count) / count, closes)
    with model.open_at(time=begin, values=values, tolerance=TOLERANCE) as session:
        if guess is not None and where.hidden:
            raise InputError(
                f"{model.name}: its sessions cannot start at a given point, so a predicted cycle cannot be started; "
                "excite a motion (pulse, start_after)"
            )
        record = session.advance(closes, signals=signals, record=[watch], points=points).right_limits()
        end = {} if where.hidden else session.values([v.name for v in (*model.states, *model.inputs) if v.is_number])
    time, motion = record.time, record.values[watch]
    frequency = _frequency(time, motion - centre, guess)
    if frequency is None:
        raise InputError(f"{model.name}: {watch} does not oscillate before the feedback closes at {closes:g} s")
    last = time >= closes - _SHOWN / frequency
    magnitude = float(mean_magnitude(time[last], motion[last] - centre, 1.0 / frequency)[-1])
    if not magnitude > _NOTHING * (1.0 + abs(centre)):
        raise InputError(
            f"{model.name}: {watch} is at rest when the feedback closes at {closes:g} s; excite it (pulse)"
        )
    return InitialMotion(
        opens=begin if where.hidden else closes,
        closes=closes,
        values=dict(values) if where.hidden else end,
        first=dict(values),
        signals=dict(signals),
        frequency=frequency,
        magnitude=magnitude,
        centre=centre,
        how=how,
        time=time[last],
        motion=motion[last],
    )


def _frequency(time: Floats, x: Floats, guess: float | None) -> float | None:
    """Return passes through zero per time at the end of a record [Hz]."""
    at = rising_passes(time, x)[-_PASSES:]
    if len(at) < 3:
        return guess
    return pass_rate(at, guess)


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
    before = np.interp(begin, time, total)
    span = np.maximum(time - begin, 1e-300)
    return np.where(time > time[0], (total - before) / span, size)
