"""One simulation in which the feedback closes on a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from workbench.core.records.record import entry
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.limit_cycles.feedback.closed_system import ControlLaw, FeedbackPath
from workbench.limit_cycles.feedback.initial_motion import InitialMotion, closing, mean_magnitude
from workbench.limit_cycles.feedback.settling import LONGEST
from workbench.limit_cycles.limit_cycle.confirm import PER_PERIOD
from workbench.response.simulate.run import MAX_POINTS
from workbench.show.result import Result

__all__ = ["HANDED", "FeedbackRun", "feedback_run"]

HANDED = "handed to the target"


@dataclass(frozen=True, eq=False, kw_only=True)
class FeedbackRun(Result):
    """A simulation in which the feedback closes.

    Attributes:
        model: name of the system.
        gain: g.
        source, target: output and input of the feedback.
        watch: variable whose magnitude decides.
        closes_at: when the feedback closes [s].
        frequency_hz: frequency of the motion before [Hz].
        time: shape (k,) [s].
        signals: source, watch, what is handed to the target, further outputs; each of shape (k,).
        units: units of these variables; None where none is declared.
        limit, rate_limit: of what is handed to the target [its unit, its unit / s]; None: not known.
    """

    _page = "workbench.limit_cycles.feedback.page:run_page"
    _picture = "workbench.limit_cycles.feedback.picture_runs:plot_feedback_run"

    model: str
    gain: float
    source: str
    target: str
    watch: str
    closes_at: float
    frequency_hz: float
    time: Floats = field(metadata=entry(dims=("time",), unit="s"))
    signals: Mapping[str, Floats] = field(metadata=entry(dims=("time",)))
    units: Mapping[str, str | None]
    limit: float | None
    rate_limit: float | None

    @property
    def handed(self) -> Floats:
        """What the feedback hands to the target, behind the actuator if there is one [unit of the target]."""
        return self.signals[HANDED]

    def left(self, seconds: float) -> float:
        """Return the mean magnitude of `watch` over a cycle some time after closing, over that before.

        Args:
            seconds: after closing [s].

        Raises:
            InputError: the simulation ended before.
        """
        longest = self.time[-1] - self.closes_at
        if not 0.0 <= seconds <= longest + 1e-9:
            raise InputError(f"the simulation ends {longest:g} s after closing, not {seconds:g} s")
        size = mean_magnitude(self.time, self.signals[self.watch], 1.0 / self.frequency_hz)
        then, before = np.searchsorted(self.time, [self.closes_at + seconds, self.closes_at], side="right") - 1
        return float(size[then] / size[before])

    def derived(self) -> dict[str, Any]:
        """Return what came of it."""
        after = self.time >= self.closes_at
        rate = np.abs(np.diff(self.handed)) / np.diff(self.time)
        return {
            "stop": float(self.time[-1]),
            "left_at_end": self.left(float(self.time[-1]) - self.closes_at),
            "peak_deflection": float(np.abs(self.handed).max()),
            "peak_rate": float(rate.max(initial=0.0)),
            "peak_after": {n: float(np.abs(v[after]).max()) for n, v in self.signals.items()},
        }


def feedback_run(
    place: FeedbackPath,
    motion: InitialMotion,
    law: ControlLaw,
    watch: str,
    *,
    begin: float,
    outputs: Sequence[str] = (),
    stop: float | None = None,
) -> FeedbackRun:
    """Simulate: the motion from its beginning, the feedback closing on it, what becomes of it.

    Args:
        place: place of the feedback.
        motion: which.
        law: the feedback.
        watch: variable whose magnitude decides, by the model's name.
        begin: session time at which the motion begins [s].
        outputs: further variables, by the model's names.
        stop: session time of the end [s]; None: 250 cycles after closing.

    Raises:
        InputError: unknown output, an end before the feedback closes.
        FmuError, SimulationError: the system cannot be opened or simulated.
    """
    stop = motion.closes + LONGEST / motion.frequency if stop is None else stop
    if not stop > motion.closes:
        raise InputError(f"stop: {stop:g} s is not after the feedback closes at {motion.closes:g} s")
    shown = {n: place.inner(n) for n in dict.fromkeys([place.shown[0], watch, *outputs])}
    count = min(MAX_POINTS, round((stop - begin) * motion.frequency * PER_PERIOD))
    points = np.linspace(begin, stop, count + 1)[1:]
    first = replace(motion, opens=begin, values=motion.first)
    with closing(place, replace(law, closes_at=motion.closes), first) as (session, handed):
        record = session.advance(
            stop, signals=place.inputs(motion.signals), record=[*shown.values(), handed], points=points
        ).right_limits()
    known = {v.name: v.unit for v in place.model.description.variables}
    scale = 1.0 if law.actuator is None else law.actuator.scale
    return FeedbackRun(
        model=place.model.name,
        gain=law.gain,
        source=place.shown[0],
        target=place.shown[1],
        watch=watch,
        closes_at=motion.closes,
        frequency_hz=motion.frequency,
        time=record.time,
        signals={**{n: record.values[full] for n, full in shown.items()}, HANDED: scale * record.values[handed]},
        units={**{n: known.get(n) or None for n in shown}, HANDED: place.target_unit},
        limit=None if law.actuator is None else law.actuator.limit,
        rate_limit=None if law.actuator is None else law.actuator.rate_limit,
    )
