"""Can two instances live at once without disturbing each other?"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workbench.analysis.check.compare import largest_gap
from workbench.analysis.check.result import Finding
from workbench.analysis.check.subject import Subject, Trajectory, same_bits
from workbench.errors import FmuError, SimulationError
from workbench.session.base import Session
from workbench.signals import Signal

__all__ = ["instances"]

_TURNS = 8
_ALONE = "use one session at a time: replayed snapshots, lin by response and systems that contain it twice go wrong"


def instances(subject: Subject) -> Finding:
    """Run two instances turn by turn with opposite inputs, and each alone: the same to the last bit.

    Each run is cut into eight turns, alone, too. Broken: together they give other values than alone (they share
    memory), or the second one is refused though the FMU does not say so. Not applicable: it says that it allows one
    instance per process, or it does not repeat its own runs (see determinism), so that nothing can be compared.
    """
    if subject.model.description.interfaces[subject.model.interface].once_per_process:
        return Finding("not applicable", "the FMU says that it allows one instance per process", _ALONE)
    signals = (subject.sines(), subject.sines(-1.0))
    alone = [_alone(subject, s) for s in signals]
    if not same_bits(alone[0], _alone(subject, signals[0])):
        return Finding("not applicable", "even the same run alone does not give the same values (see determinism)")
    try:
        together = _together(subject, signals)
    except (FmuError, SimulationError) as error:
        return Finding("broken", f"two instances at once fail: {error}", _ALONE)
    for one, other in zip(alone, together, strict=True):
        if not same_bits(one, other):
            gap = largest_gap(one, other, subject.names)
            return Finding("broken", f"beside a second instance {gap.words}", _ALONE, {"relative": gap.relative})
    return Finding(
        "good",
        f"2 instances in turn, {2 * alone[0].values.size} values identical to those of one alone, to the last bit",
    )


def _turns(subject: Subject) -> list[np.ndarray]:
    return [p for p in np.array_split(subject.points(), _TURNS) if len(p)]


def _alone(subject: Subject, signals: Mapping[str, Signal]) -> Trajectory:
    with subject.open() as session:
        return _joined([subject.observe(session, signals, points) for points in _turns(subject)])


def _together(subject: Subject, signals: tuple[Mapping[str, Signal], ...]) -> list[Trajectory]:
    with subject.open() as first, subject.open() as second:
        sessions: list[Session] = [first, second]
        parts: list[list[Trajectory]] = [[], []]
        for points in _turns(subject):
            for session, forced, found in zip(sessions, signals, parts, strict=True):
                found.append(subject.observe(session, forced, points))
        return [_joined(p) for p in parts]


def _joined(parts: list[Trajectory]) -> Trajectory:
    return Trajectory(np.concatenate([p.time for p in parts]), np.concatenate([p.values for p in parts]))
