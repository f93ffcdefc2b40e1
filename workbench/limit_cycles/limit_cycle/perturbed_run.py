"""What a system does when it is pushed away from its operating point: it comes to rest, oscillates, or goes away."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.model.described_model import DescribedModel
from workbench.response.simulate.zero_crossings import pass_rate, rising_passes

__all__ = ["Observation", "observe"]

_ROWS = 4000  # of a stretch
_STRETCHES = 5  # each twice as long as the one before
_REST = 1e-3  # of the first swing: a motion that has fallen below it is at rest
_GONE = 1e6  # first swings
_SAME = 0.01  # relative difference of the swings of both halves of a stretch, of what keeps oscillating
_PERIODS = 6  # in half a stretch, at least


@dataclass(frozen=True, kw_only=True)
class Observation(RecordPart):
    """A free run from a disturbed operating point.

    Attributes:
        push: by which the variable was moved at the start.
        outcome: "rest", "oscillation", "divergence" or "undecided".
        seconds: length of the run [s].
        frequency_hz: of the oscillation; None: there is none.
        swing: half the peak-to-peak value in the last half of the last stretch.
        states: state → value at the end.
        reason: of a divergence, where the model gives one.
    """

    push: float
    outcome: str
    seconds: float
    frequency_hz: float | None = None
    swing: float = 0.0
    states: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""

    def words(self) -> str:
        """Return what happened, in a few words."""
        ends = {
            "rest": f"comes to rest within {self.seconds:.3g} s",
            "oscillation": f"keeps oscillating at {self.frequency_hz or 0.0:.4g} Hz",
            "divergence": f"grows without bound{f' ({self.reason})' if self.reason else ''}",
            "undecided": f"has neither come to rest nor settled on an oscillation after {self.seconds:.3g} s",
        }
        return f"a run with the block's input moved by {self.push:.3g} {ends[self.outcome]}"


def observe(
    model: DescribedModel,
    *,
    values: Mapping[str, float],
    states: list[str],
    watch: str,
    push: float,
    seconds: float,
    time: float,
) -> Observation:
    """Run a system freely, longer and longer, until it is plain what it does.

    Not a proof: what is seen is what happens from this start, and slow growth looks like an oscillation.

    Args:
        model: the system.
        values: where it starts, and its held inputs.
        states: whose values at the end are wanted.
        watch: variable that tells.
        push: by which it was moved at the start.
        seconds: length of the first stretch [s].
        time: session time at the start [s].

    Raises:
        InputError: the start cannot be reached.
    """
    run = 0.0
    first = abs(push)
    swing = 0.0
    with model.open_at(time=time, values=values) as session:
        for stretch in range(_STRETCHES):
            length = seconds * 2.0**stretch
            points = session.time + length * np.arange(1, _ROWS + 1) / _ROWS
            try:
                record = session.advance(float(points[-1]), signals={}, record=[watch], points=points)
            except SimulationError as error:
                return Observation(push=push, outcome="divergence", seconds=run, swing=swing, reason=str(error))
            run += length
            v = record.values[watch]
            half = record.time > points[_ROWS // 2]
            before, swing = 0.5 * float(np.ptp(v[~half])), 0.5 * float(np.ptp(v[half]))
            first = max(first, before) if stretch == 0 else first
            outcome, frequency = _outcome(record.time[half], v[half], first, before)
            if outcome:
                result = session.values(states)
                return Observation(
                    push=push, outcome=outcome, seconds=run, frequency_hz=frequency, swing=swing, states=result
                )
    return Observation(push=push, outcome="undecided", seconds=run, swing=swing)


def _outcome(at: Floats, v: Floats, first: float, before: float) -> tuple[str, float | None]:
    """Return what the last half of a stretch shows, and its frequency [Hz]; "": nothing yet."""
    swing = 0.5 * float(np.ptp(v))
    if not np.isfinite(swing) or swing > _GONE * first:
        return "divergence", None
    if swing < _REST * first and swing <= before:
        return "rest", None
    passes = rising_passes(at, v - 0.5 * (float(v.max()) + float(v.min())))
    if len(passes) > _PERIODS and abs(swing - before) < _SAME * swing:
        return "oscillation", pass_rate(passes)
    return "", None
