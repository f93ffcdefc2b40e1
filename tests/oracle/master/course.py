"""How the inputs of a unit go on over one communication step."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.fmi.variable import Variable

__all__ = ["Course", "Reached"]


@dataclass(frozen=True, slots=True)
class Course:
    """One input over one step: linear from `start` to `end`.

    Attributes:
        component: whose input it is.
        variable: of that component.
        start, end: right limit at the start and left limit at the end of the step.
        bow: mean over the step less that of the straight line.
    """

    component: int
    variable: Variable
    start: float
    end: float
    bow: float = 0.0

    def at(self, part: float) -> float:
        """Return the value after this part of the step."""
        return self.start if self.end == self.start else self.start + (self.end - self.start) * part


@dataclass(frozen=True, slots=True)
class Reached:
    """How far a unit got.

    Attributes:
        time: [s].
        event: it waits for an event iteration there.
    """

    time: float
    event: bool = False
