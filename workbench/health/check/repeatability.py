"""Is a run repeated the same: beside another instance, in a new one, after a reset, from a saved state?"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack

import numpy as np

from workbench.errors import FmuError, SimulationError
from workbench.fmi.access import is_good
from workbench.fmi.instance import Instance
from workbench.health.check.compare import largest_gap, unlike
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu, Trajectory, same_bits
from workbench.session.base import Session
from workbench.signals.kinds import Signal

__all__ = ["determinism", "instances", "reset", "snapshots"]

_TURNS = 8
_COPIES = "none: each instance gets a copy of its code, with memory of its own"
_ALONE = "use one session at a time: replayed snapshots, lin by response and systems that contain it twice go wrong"


def instances(subject: CheckedFmu) -> Answer:
    """Run two instances turn by turn with opposite inputs, and each alone: the same to the last bit.

    Each run is cut into eight turns, alone, too. Broken: together they give other values than alone (they share
    memory), or the second one is refused though the FMU does not say so. Not applicable: it says that it allows one
    instance per process, or it does not repeat its own runs (see determinism), so that nothing can be compared.
    """
    if subject.model.description.interfaces[subject.model.interface].once_per_process:
        return Answer("not applicable", "the FMU says that it allows one instance per process", _COPIES)
    signals = (subject.sines(), subject.sines(-1.0))
    alone = [_alone(subject, s) for s in signals]
    if not same_bits(alone[0], _alone(subject, signals[0])):
        return Answer("not applicable", "even the same run alone does not give the same values (see determinism)")
    try:
        together = _together(subject, signals)
    except (FmuError, SimulationError) as error:
        return Answer("broken", f"two instances at once fail: {error}", _ALONE)
    for one, other in zip(alone, together, strict=True):
        if not same_bits(one, other):
            gap = largest_gap(one, other, subject.names)
            return Answer("broken", f"beside a second instance {gap.words}", _ALONE, {"relative": gap.relative})
    return Answer(
        "good",
        f"2 instances in turn, {2 * alone[0].values.size} values identical to those of one alone, to the last bit",
    )


def _turns(subject: CheckedFmu) -> list[np.ndarray]:
    return [p for p in np.array_split(subject.points(), _TURNS) if len(p)]


def _alone(subject: CheckedFmu, signals: Mapping[str, Signal]) -> Trajectory:
    with subject.open() as session:
        return _joined([subject.observe(session, signals, points) for points in _turns(subject)])


def _together(subject: CheckedFmu, signals: tuple[Mapping[str, Signal], ...]) -> list[Trajectory]:
    with subject.open() as first, subject.open() as second:
        sessions: list[Session] = [first, second]
        parts: list[list[Trajectory]] = [[], []]
        for points in _turns(subject):
            for session, forced, result in zip(sessions, signals, parts, strict=True):
                result.append(subject.observe(session, forced, points))
        return [_joined(p) for p in parts]


def _joined(parts: list[Trajectory]) -> Trajectory:
    return Trajectory(np.concatenate([p.time for p in parts]), np.concatenate([p.values for p in parts]))


# -- does the same run give the same numbers -------------------------------------------------------


def determinism(subject: CheckedFmu) -> Answer:
    """Make the same run twice, in new instances, with another run between them: equal to the last bit.

    The inputs swing as in `runs`; the run between swings the other way. Chaotic and unstable models pass: equal
    operations on equal numbers give equal results. Broken: the runs differ by more than 1e-12 of a range; watch:
    by less (sums whose order changes, as with threads). What differs from one process to the next: see `processes`.
    """
    first = subject.run(subject.sines())
    subject.run(subject.sines(-1.0))
    second = subject.run(subject.sines())
    count = int(first.values.size)
    if same_bits(first, second):
        return Answer("good", f"2 runs, {count} values each: equal to the last bit", numbers={"values": count})
    wrong = "no result is repeatable; snapshots by replay go wrong, and responses may not settle"
    return unlike(first, second, subject.names, "in a second run", wrong, values=count)


# -- does a reset bring the FMU back to where it began ---------------------------------------------

# FMI version → interface → name of the function; FMI 1.0 model exchange has none.
_FUNCTIONS: Mapping[int, Mapping[str, str]] = {
    1: {"cs": "fmi1ResetSlave"},
    2: {"me": "fmi2Reset", "cs": "fmi2Reset"},
    3: {"me": "fmi3Reset", "cs": "fmi3Reset"},
}
_ELSEWHERE = "none here: sessions use a new instance; tools that reset get other results"


def reset(subject: CheckedFmu) -> Answer:
    """Run, reset, run again in the same instance: both runs must be the same.

    Broken: the second run differs, or the FMU fails after a reset that it called good. Watch: it refuses to reset, or
    differs by rounding. Not applicable: FMI 1.0 model exchange, which knows no reset, and FMUs that do not repeat their
    own runs (see determinism).
    """
    name = _FUNCTIONS[subject.model.description.major].get(subject.model.interface)
    if name is None:
        return Answer("not applicable", "FMI 1.0 model exchange has no reset")
    instance = subject.model.new_instance()
    with ExitStack() as stack:
        stack.callback(instance.close)
        first = _run(subject, instance, stack)
        if not instance.library.has(name):
            return Answer("broken", f"the binary does not have {name}", _ELSEWHERE)
        status = instance.library[name](instance.component)
        if not is_good(status):
            return Answer("watch", f"{name} returns status {status}", _ELSEWHERE)
        try:
            second = _run(subject, instance, stack)
        except (FmuError, SimulationError) as error:
            return Answer("broken", f"after a reset it fails: {error}", _ELSEWHERE)
    if not same_bits(first, second) and not same_bits(first, subject.run(subject.sines())):
        return Answer("not applicable", "even a new instance does not repeat its run (see determinism)")
    return _judge(subject, first, second)


def _run(subject: CheckedFmu, instance: Instance, stack: ExitStack) -> Trajectory:
    session = subject.model.open_on(instance, start_time=subject.start, step=subject.step)
    stack.callback(session.close)
    return subject.observe(session, subject.sines(), subject.points())


def _judge(subject: CheckedFmu, first: Trajectory, second: Trajectory) -> Answer:
    if same_bits(first, second):
        return Answer("good", f"{first.values.size} values are the same to the last bit after a reset")
    return unlike(first, second, subject.names, "after a reset", _ELSEWHERE)


# -- from a saved state ---------------------------------------------------------------------------

_REPLAY = "replay is used instead: each restore repeats the run from its start; slower, with the same results"


def snapshots(subject: CheckedFmu) -> Answer:
    """Take the FMU's state, go on, take it back, and go on again: the same values, near and far.

    First the probe that every session makes (`session/probe.py`: values after the restore, and one step from there).
    Then over the whole test run, where a variable that was forgotten in the state has time to show: half the run,
    save, and twice the second half from the saved state with another run between them, equal to the last bit.
    Broken: claimed, but wrong. Not applicable: not claimed.
    """
    model = subject.model
    if not model.description.interfaces[model.interface].state:
        return Answer("not applicable", "the FMU does not claim to save its state", _REPLAY, {"method": "replay"})
    why = model.why_replay()
    if why:
        return Answer("broken", f"claimed, but {why}", _REPLAY, {"method": "replay"})
    return _far(subject)


def _far(subject: CheckedFmu) -> Answer:
    points = subject.points()
    middle = max(1, len(points) // 2)
    numbers = {"method": "state"}
    with subject.open() as session:
        subject.observe(session, subject.sines(), points[:middle])
        saved = session.snapshot()
        runs = []
        try:
            for _ in range(2):
                session.restore(saved)
                runs.append(subject.observe(session, subject.sines(), points[middle:]))
                session.restore(saved)
                subject.observe(session, subject.sines(-1.0), points[middle:])
        except (FmuError, SimulationError) as error:
            return Answer("broken", f"after a restore it fails: {error}", _TRUSTED, numbers)
    first, second = runs
    if same_bits(first, second):
        return Answer("good", f"2 restores, {first.values.size} values each: equal to the last bit", numbers=numbers)
    gap = largest_gap(first, second, subject.names)
    evidence = f"claimed, but after a second restore {gap.words}"
    return Answer("broken", evidence, _TRUSTED, {**numbers, "relative": gap.relative})


_TRUSTED = (
    "the quick probe does not detect this, so restores go wrong: lin by response and masters that repeat steps are "
    "wrong"
)
