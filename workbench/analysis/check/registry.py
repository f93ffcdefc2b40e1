"""The checks: one table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from workbench.analysis.check.dependencies import dependencies
from workbench.analysis.check.determinism import determinism
from workbench.analysis.check.directional import directional
from workbench.analysis.check.drift import drift
from workbench.analysis.check.inputs import inputs
from workbench.analysis.check.instances import instances
from workbench.analysis.check.jumps import jumps
from workbench.analysis.check.memory import memory
from workbench.analysis.check.nominals import nominals
from workbench.analysis.check.reset import reset
from workbench.analysis.check.result import Finding
from workbench.analysis.check.runs import runs
from workbench.analysis.check.snapshots import snapshots
from workbench.analysis.check.start_time import start_time
from workbench.analysis.check.step import step
from workbench.analysis.check.subject import Subject
from workbench.errors import InputError, suggest

__all__ = ["CHECKS", "FILE", "VALIDATION", "Check", "choose"]

FILE, VALIDATION = "file", "validation"


@dataclass(frozen=True)
class Check:
    """One check.

    Attributes:
        question: that it answers.
        run: does it; None: on the file, without running the FMU.
        interfaces: for which it makes sense.
    """

    question: str
    run: Callable[[Subject], Finding] | None
    interfaces: tuple[str, ...] = ("me", "cs")


_ME, _CS = ("me",), ("cs",)

# In the order of the card: `runs` decides how long the others may run, `step` with which step; `memory` comes last,
# it ages the process.
CHECKS: Mapping[str, Check] = {
    VALIDATION: Check("Does the description keep the rules of FMI?", None, (FILE,)),
    "runs": Check("Does it instantiate, initialise and run?", runs),
    "step": Check("Does it converge with the communication step?", step, _CS),
    "reset": Check("Does a reset bring it back to where it began?", reset),
    "determinism": Check("Does the same run give the same numbers?", determinism),
    "instances": Check("Can two instances live at once?", instances),
    "snapshots": Check("Does its saved state really bring it back?", snapshots),
    "directional": Check("Are its directional derivatives the derivatives?", directional, _ME),
    "dependencies": Check("Does anything depend on what is not declared?", dependencies, _ME),
    "drift": Check("What does it do by itself?", drift),
    "start-time": Check("Does it matter when a run begins?", start_time),
    "nominals": Check("Are nominal values of the size of the states?", nominals, _ME),
    "inputs": Check("Are continuous inputs taken as continuous?", inputs),
    "jumps": Check("Does its own solver see at once that an input changes?", jumps, _CS),
    "memory": Check("Do closed instances leave memory behind?", memory),
}


def choose(only: Iterable[str] | None, skip: Iterable[str] | None) -> tuple[str, ...]:
    """Return the names of the checks that are wanted, in the order of the card.

    Args:
        only: names; None: all.
        skip: names to leave out; None: none.

    Raises:
        InputError: an unknown name, or nothing left.
    """
    wanted = list(CHECKS) if only is None else list(only)
    unwanted = list(skip or ())
    for name in (*wanted, *unwanted):
        if name not in CHECKS:
            raise InputError(f"'{name}' is no check; {suggest(name, CHECKS)}")
    chosen = tuple(name for name in CHECKS if name in wanted and name not in unwanted)
    if not chosen:
        raise InputError("no check is left; take fewer names out")
    return chosen
