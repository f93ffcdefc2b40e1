"""The checks: one table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from workbench.errors import InputError, suggest
from workbench.health.check.dependencies import dependencies
from workbench.health.check.directional import directional
from workbench.health.check.inputs import inputs
from workbench.health.check.jumps import jumps
from workbench.health.check.largest_step import largest_step
from workbench.health.check.memory import memory
from workbench.health.check.nominals import nominals
from workbench.health.check.promise import promise
from workbench.health.check.real_time import real_time
from workbench.health.check.references import references
from workbench.health.check.repeatability import determinism, instances, reset, snapshots
from workbench.health.check.result import Answer
from workbench.health.check.runs import drift, runs
from workbench.health.check.start_time import start_time
from workbench.health.check.starts import starts
from workbench.health.check.step import step
from workbench.health.check.subject import CheckedFmu

__all__ = ["CHECKS", "FILE", "PROCESSES", "VALIDATION", "CheckEntry", "choose"]

FILE, VALIDATION, PROCESSES = "file", "validation", "processes"


@dataclass(frozen=True)
class CheckEntry:
    """One check.

    Attributes:
        question: that it answers.
        run: does it; None: on the file, without running the FMU, or beside the other checks, in processes of its own.
        interfaces: for which it makes sense.
    """

    question: str
    run: Callable[[CheckedFmu], Answer] | None
    interfaces: tuple[str, ...] = ("me", "cs")


_ME, _CS = ("me",), ("cs",)

# In the order of the card: `runs` decides how long the others may run, `step` with which step; `memory` comes last,
# it ages the process.
CHECKS: Mapping[str, CheckEntry] = {
    VALIDATION: CheckEntry("Does the description conform to the FMI standard?", None, (FILE,)),
    "runs": CheckEntry("Does it instantiate, initialise and run?", runs),
    "step": CheckEntry("Does it converge with the communication step?", step, _CS),
    "largest-step": CheckEntry("How long may its communication step be?", largest_step, _CS),
    "real-time": CheckEntry("Does a step take less time than it covers?", real_time, _CS),
    "reset": CheckEntry("Does a reset restore the initial state?", reset),
    "determinism": CheckEntry("Does the same run give the same numbers?", determinism),
    PROCESSES: CheckEntry("Does another process give the same numbers?", None),
    "instances": CheckEntry("Can two instances exist at once?", instances),
    "snapshots": CheckEntry("Does restoring a saved state work?", snapshots),
    "promise": CheckEntry("Are the numbers the same while steps may still be undone?", promise),
    "directional": CheckEntry("Are its directional derivatives correct?", directional, _ME),
    "dependencies": CheckEntry("Are all dependencies declared?", dependencies, _ME),
    "references": CheckEntry("Does it reproduce the reference results that it carries?", references),
    "drift": CheckEntry("Does it move without being forced?", drift),
    "start-time": CheckEntry("Does the result depend on the start time?", start_time),
    "starts": CheckEntry("Has it the start values that it declares?", starts),
    "nominals": CheckEntry("Do nominal values match the size of the states?", nominals, _ME),
    "inputs": CheckEntry("Do continuous inputs act continuously?", inputs),
    "jumps": CheckEntry("Does its own solver react at once to a change of input?", jumps, _CS),
    "memory": CheckEntry("Do closed instances leak memory?", memory),
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
            raise InputError(f"'{name}' is not a check; {suggest(name, CHECKS)}")
    chosen = tuple(name for name in CHECKS if name in wanted and name not in unwanted)
    if not chosen:
        raise InputError("no check is left; skip fewer")
    return chosen
