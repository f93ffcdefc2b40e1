"""What a model does by itself while its input is zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.errors import SimulationError
from workbench.response.nfr.point import NfrPoint, PointTask
from workbench.response.periodic.period_map import PeriodRange
from workbench.session import Recorded, Session
from workbench.session.compiled import CompiledMeSession

__all__ = ["ZeroInput", "doubt", "watch"]

# Own movement beyond this part of a measured amplitude is told, unless it is dying away: by so much at least
# while it is watched.
_TELL, _DECAY = 0.05, 0.7

# More than this factor from the first to the eighth period is not drift but an unstable run.
_GROWTH = 100.0

_PERIODS = 8

# A movement below this part of the output's size counts as none.
_NOTHING = 1e-9


@dataclass(frozen=True, kw_only=True)
class ZeroInput(RecordPart):
    """How an output moves under zero input (and bias), in the last of eight periods of the lowest frequency.

    Attributes:
        seconds: length of that period [s].
        drift: slope of the straight line through it [unit of the output per s].
        swing: half the peak-to-peak value of what deviates from that line [unit of the output].
        decays: whether the movement is at most 0.7 times what it was in the first period: a transient, which
            the measurement removes.
        grows: whether it is more than a hundred times what it was in the first period.
        most: largest movement of all eight periods [unit of the output].
        events: number of events in the last one; 0 where that is not known.
        reason: why it could not be watched to the end; None where it could.
    """

    seconds: float = 0.0
    drift: float = 0.0
    swing: float = 0.0
    decays: bool = False
    grows: bool = False
    most: float = 0.0
    events: int = 0
    reason: str | None = None

    def told_apart(self, *, continuous: bool) -> float:
        """Return how far the output moves where that must be told apart from a response [unit of the output].

        A transient of a continuous model need not be: its states go to where they would be without it.

        Args:
            continuous: whether the model is of model exchange, without samplers.
        """
        passing = continuous and self.decays and not self.events
        return 0.0 if passing or self.grows or self.reason is not None else self.most

    @property
    def movement(self) -> float:
        """Drift over the period, or swing, whichever is larger [unit of the output]."""
        return max(abs(self.drift) * self.seconds, self.swing)


def watch(session: Session, task: PointTask) -> ZeroInput:
    """Run with zero input, to the end also where nothing moves at first.

    Args:
        session: session of the model, not advanced yet.
        task: names, rows per period and the lowest frequency.
    """
    begin = session.time
    zero = replace(task, amplitude=0.0).sine(begin)
    seen: list[ZeroInput] = []
    events = 0
    try:
        for k in range(_PERIODS):
            before = _events(session)
            points = PeriodRange(begin, task.frequency, task.rows, k).points
            end = float(points[-1])
            record = session.advance(end, signals={task.input: zero}, record=(task.output,), points=points)
            seen.append(_movement(record, task.output))
            events = _events(session) - before
    except SimulationError as error:
        return ZeroInput(reason=str(error))
    first, last = seen[0].movement, seen[-1].movement
    return replace(
        seen[-1],
        decays=last <= _DECAY * first,
        grows=last > _GROWTH * first,
        most=max(z.movement for z in seen),
        events=events,
    )


def _events(session: Session) -> int:
    return session.events if isinstance(session, CompiledMeSession) else 0


def _movement(record: Recorded, output: str) -> ZeroInput:
    time, y = record.time - record.time[0], record.values[output]
    if not np.all(np.isfinite(y)):
        raise SimulationError(f"{output} is not finite", time=float(record.time[-1]))
    if float(np.ptp(y)) <= _NOTHING * float(np.max(np.abs(y))):
        return ZeroInput(seconds=float(time[-1]))
    level, slope = np.polynomial.polynomial.polyfit(time, y, 1)
    rest = y - level - slope * time
    return ZeroInput(seconds=float(time[-1]), drift=float(slope), swing=0.5 * float(np.ptp(rest)))


def doubt(result: ZeroInput, points: Sequence[NfrPoint], *, output: str, way: str) -> str | None:
    """Return a warning where the model's own movement is more than 5 % of what was measured.

    Args:
        result: the movement.
        points: the measured points; the one that suffers most is named.
        output: name of the output.
        way: what helps where the communication step is too long.
    """
    if result.reason is not None:
        return f"with zero input the run fails: {result.reason}"
    measured = [p for p in points if p.response]
    if not measured or result.decays:
        return None
    worst = max(measured, key=lambda p: _share(result, p))
    if _share(result, worst) <= _TELL:
        return None
    if result.grows:
        return (
            f"with zero input {output} grows without bound; the model is unstable there, or a co-simulation step too "
            f"long ({way}): the points tell more"
        )
    return (
        f"with zero input {output} moves by itself (drifts by {result.drift:.3g} per s, swings by "
        f"±{result.swing:.3g}), {100.0 * _share(result, worst):.2g} % of the amplitude at {worst.frequency:.6g} Hz, "
        f"amplitude {worst.amplitude:g}; start at rest (`start_values`, `bias`) or measure with a larger amplitude"
    )


def _share(result: ZeroInput, point: NfrPoint) -> float:
    """The model's own movement in a period of the point, relative to the output's amplitude there."""
    amplitude = abs(point.response or 0.0) * point.amplitude
    return max(abs(result.drift) / point.frequency, result.swing) / amplitude
