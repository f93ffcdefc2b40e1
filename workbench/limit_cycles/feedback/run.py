"""One simulation in which the feedback closes on a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.record import entry
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.limit_cycles.feedback.actuator import Actuator
from workbench.limit_cycles.feedback.closed_system import FeedbackPath, FeedbackSpec
from workbench.limit_cycles.feedback.initial_motion import PER_CYCLE, InitialMotion, mean_magnitude
from workbench.limit_cycles.limit_cycle.confirm import TOLERANCE
from workbench.show.result import Result

__all__ = ["HANDED", "FeedbackRun", "feedback_run"]

_LEAD = 12  # cycles shown before the feedback closes, where the motion begins in the cycle
_AFTER = 160  # cycles simulated after that, unless an end is asked for
_MOST = 400_000  # points
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
    _picture = "workbench.limit_cycles.feedback.picture_run:plot_feedback_run"

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
        if not 0.0 <= seconds <= self.time[-1] - self.closes_at + 1e-9:
            raise InputError(
                f"the simulation ends {self.time[-1] - self.closes_at:g} s after closing, not {seconds:g} s"
            )
        size = mean_magnitude(self.time, self.signals[self.watch], 1.0 / self.frequency_hz)
        then = int(np.searchsorted(self.time, self.closes_at + seconds, side="right")) - 1
        before = int(np.searchsorted(self.time, self.closes_at, side="right")) - 1
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
    start: InitialMotion,
    gain: float,
    *,
    begin: float,
    watch: str,
    y0: float,
    actuator: Actuator | None,
    outputs: Sequence[str] = (),
    stop: float | None = None,
) -> FeedbackRun:
    """Simulate: the motion, the feedback closing on it, what becomes of it.

    Args:
        place: place of the feedback.
        start: the motion.
        gain: g.
        begin: session time at which a motion that was excited by signals begins [s].
        watch: variable whose magnitude decides, by the model's name.
        y0: value of the source at rest.
        actuator: between gain and target; None: none.
        outputs: further variables, by the model's names.
        stop: session time of the end [s]; None: 160 cycles after closing.

    Raises:
        InputError: unknown output, an end before the feedback closes.
        FmuError, SimulationError: the system cannot be opened or simulated.
    """
    opens, closes, values = _times(start, begin)
    stop = closes + _AFTER / start.frequency if stop is None else stop
    if not stop > closes:
        raise InputError(f"stop: {stop:g} s is not after the feedback closes at {closes:g} s")
    law = FeedbackSpec(gain, y0, actuator, closes)
    command, handed, scale = place.command(law)
    shown = {n: place.inner(n) for n in dict.fromkeys([place.shown[0], watch, *outputs])}
    count = min(_MOST, round((stop - opens) * start.frequency * PER_CYCLE))
    points = np.append(opens + (stop - opens) * np.arange(1, count) / count, stop)
    with (
        place.opened(place.closed(law)) as model,
        model.open_at(time=opens, values=place.start_values(values), tolerance=TOLERANCE) as session,
    ):
        record = session.advance(
            stop, signals=place.inputs(start.signals), record=[*shown.values(), command, handed], points=points
        )
    record = record.right_limits()
    known = {v.name: v.unit for v in place.model.description.variables}
    signals = {n: record.values[full] for n, full in shown.items()}
    units = {n: known.get(n) or None for n in shown}
    return FeedbackRun(
        model=place.model.name,
        gain=gain,
        source=place.shown[0],
        target=place.shown[1],
        watch=watch,
        closes_at=closes,
        frequency_hz=start.frequency,
        time=record.time,
        signals={**signals, HANDED: scale * record.values[handed]},
        units={**units, HANDED: place.target_unit},
        limit=None if actuator is None else actuator.limit,
        rate_limit=None if actuator is None else actuator.rate_limit,
    )


def _times(start: InitialMotion, begin: float) -> tuple[float, float, Mapping[str, float]]:
    """Return when the run opens and when the feedback closes [s], and the values that it opens with."""
    if start.signals or start.opens < start.closes:
        return begin, start.closes, start.first
    return start.opens, start.opens + _LEAD / start.frequency, start.values
