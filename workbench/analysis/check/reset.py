"""Does a reset bring the FMU back to where it began?"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack

from workbench.analysis.check.compare import largest_gap
from workbench.analysis.check.result import Finding
from workbench.analysis.check.subject import Subject, Trajectory, same_bits
from workbench.errors import FmuError, SimulationError
from workbench.fmi.instance import WARNING, Instance

__all__ = ["reset"]

# FMI version → interface → name of the function; FMI 1.0 model exchange has none.
_FUNCTIONS: Mapping[int, Mapping[str, str]] = {
    1: {"cs": "fmi1ResetSlave"},
    2: {"me": "fmi2Reset", "cs": "fmi2Reset"},
    3: {"me": "fmi3Reset", "cs": "fmi3Reset"},
}
_ELSEWHERE = "none here: sessions use a new instance; tools that reset get other results"
_ROUNDING = 1e-12


def reset(subject: Subject) -> Finding:
    """Run, reset, run again in the same instance: both runs must be the same.

    Broken: the second run differs, or the FMU fails after a reset that it called good. Watch: it refuses to reset, or
    differs by rounding. Not applicable: FMI 1.0 model exchange, which knows no reset, and FMUs that do not repeat their
    own runs (see determinism).
    """
    name = _FUNCTIONS[subject.model.description.major].get(subject.model.interface)
    if name is None:
        return Finding("not applicable", "FMI 1.0 model exchange has no reset")
    instance = subject.model.new_instance()
    with ExitStack() as stack:
        stack.callback(instance.close)
        first = _run(subject, instance, stack)
        if not instance.library.has(name):
            return Finding("broken", f"the binary does not have {name}", _ELSEWHERE)
        status = instance.library[name](instance.component)
        if status > WARNING:
            return Finding("watch", f"{name} returns status {status}", _ELSEWHERE)
        try:
            second = _run(subject, instance, stack)
        except (FmuError, SimulationError) as error:
            return Finding("broken", f"after a reset it fails: {error}", _ELSEWHERE)
    if not same_bits(first, second) and not same_bits(first, subject.run(subject.sines())):
        return Finding("not applicable", "even a new instance does not repeat its run (see determinism)")
    return _judge(subject, first, second)


def _run(subject: Subject, instance: Instance, stack: ExitStack) -> Trajectory:
    session = subject.model.open_on(instance, start_time=subject.start, step=subject.step)
    stack.callback(session.close)
    return subject.observe(session, subject.sines(), subject.points())


def _judge(subject: Subject, first: Trajectory, second: Trajectory) -> Finding:
    if same_bits(first, second):
        return Finding("good", f"{first.values.size} values are the same to the last bit after a reset")
    gap = largest_gap(first, second, subject.names)
    verdict = "watch" if gap.relative <= _ROUNDING else "broken"
    return Finding(verdict, f"after a reset {gap.words}", _ELSEWHERE, {"relative": gap.relative})
