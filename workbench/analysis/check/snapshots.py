"""Does the saved FMU state really bring the FMU back?"""

from __future__ import annotations

from workbench.analysis.check.compare import largest_gap
from workbench.analysis.check.result import Answer
from workbench.analysis.check.subject import CheckedFmu, same_bits
from workbench.errors import FmuError, SimulationError

__all__ = ["snapshots"]

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
