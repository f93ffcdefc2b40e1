"""The step of a co-simulation instance, and what else only the kernel asks: it does so itself."""

from __future__ import annotations

import ctypes
import math
from ctypes import byref
from dataclasses import dataclass

from workbench.fmi.access import is_good
from workbench.fmi.fmi3 import Instance3
from workbench.fmi.instance import DISCARD, Instance

__all__ = ["StepResult", "do_step", "never_back", "next_tick"]


@dataclass(frozen=True)
class StepResult:
    """What a co-simulation step ended with.

    Attributes:
        time: how far the FMU got [s].
        event: it wants an event iteration.
        terminate: it wants the simulation to end.
    """

    time: float
    event: bool = False
    terminate: bool = False


def do_step(part: Instance, time: float, step: float) -> StepResult:
    """Advance a co-simulation FMU from `time` by `step` [s]."""
    part.time = time
    own = time + part.clock
    if part.version == 1:
        part.call("fmi1DoStep", own, step, b"\1")
        return StepResult(time + step)
    if part.version == 2:
        status = part.library["fmi2DoStep"](part.component, own, step, int(never_back(part)))
        end = part.ended_at() if status == DISCARD else None
        if end is not None:
            return StepResult(end, terminate=True)
        if not is_good(status):
            part.fail("fmi2DoStep", status)
        return StepResult(time + step)
    event, terminate, early = (ctypes.c_bool() for _ in range(3))
    reached = ctypes.c_double(own + step)
    part.call("fmi3DoStep", own, step, never_back(part), byref(event), byref(terminate), byref(early), byref(reached))
    end = float(reached.value) - part.clock if early.value else time + step
    return StepResult(end, bool(event.value), bool(terminate.value))


def next_tick(part: Instance) -> float:
    """Return when the next of its clocks ticks [s]; infinite: none does, or it is not known yet."""
    ticking = part._ticking if isinstance(part, Instance3) else None
    return math.inf if ticking is None else ticking.next_tick


def never_back(part: Instance) -> bool:
    """Return the promise noSetFMUStatePriorToCurrentPoint (FMI 2.0.4, 4.2.2), as FMPy and OMSimulator give it.

    Some FMUs take a step without it for one that is to be repeated: it is withheld from those only of which a state
    is kept.
    """
    return part.saved.value == 0
