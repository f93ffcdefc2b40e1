"""Are the numbers the same whether or not steps may still be undone?"""

from __future__ import annotations

from workbench.errors import FmuError, SimulationError
from workbench.health.check.compare import unlike
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu, Trajectory, same_bits

__all__ = ["promise"]

_NOT_TAKEN_BACK = (
    "its saved states are not used: restores repeat the run, and the FMU is always promised that none will come"
)


def promise(subject: CheckedFmu) -> Answer:
    """Make the same run with and without the promise that no earlier state will be restored.

    The promise is noSetFMUStatePriorToCurrentPoint, which each step tells the FMU: what it need not keep any more. Runs
    are made with it; without it where a saved state is kept. Broken: without it the numbers are others, as with
    exporters that take such a step for one that is to be repeated. Not applicable: the FMU does not repeat its own runs
    (see determinism), or FMI 1.0, whose doStep says only that a step is new.
    """
    if subject.model.description.major == 1:
        return Answer("not applicable", "FMI 1.0 has no such promise")
    given = subject.run(subject.sines())
    try:
        withheld = _without(subject)
    except (FmuError, SimulationError) as error:
        return Answer("broken", f"while steps may still be undone it fails: {error}", _NOT_TAKEN_BACK)
    if same_bits(given, withheld):
        return Answer("good", f"{given.values.size} values are the same to the last bit")
    if not same_bits(given, subject.run(subject.sines())):
        return Answer("not applicable", "even the same run does not repeat itself (see determinism)")
    where = "while steps may still be undone (noSetFMUStatePriorToCurrentPoint is false)"
    return unlike(given, withheld, subject.names, where, _NOT_TAKEN_BACK)


def _without(subject: CheckedFmu) -> Trajectory:
    with subject.open() as session:
        for part in session.instance.parts:
            part.saved.value += 1  # as if a state were kept
        return subject.observe(session, subject.sines(), subject.points())
