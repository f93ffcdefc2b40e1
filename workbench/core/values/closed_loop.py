"""A closed loop of a system, as recorded data remember it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from workbench.core.records.record import RecordPart

__all__ = ["ClosedLoop", "between"]


@dataclass(frozen=True, kw_only=True)
class ClosedLoop(RecordPart):
    """Components of a system that drive each other, and the signals that have to do with them.

    Attributes:
        system: its name.
        components: in the order of the system.
        acting: signals that act on the loop, those inside it included.
        inside: signals of its components.
        showing: signals that it moves, those inside it included.
    """

    system: str
    components: tuple[str, ...]
    acting: tuple[str, ...]
    inside: tuple[str, ...]
    showing: tuple[str, ...]

    def words(self, source: str) -> str:
        """Return what it means for a model from one of its signals, in one line."""
        listed = " and ".join(filter(None, [", ".join(self.components[:-1]), self.components[-1]]))
        loop = f"the closed loop of {listed} in system {self.system}"
        if source in self.inside:
            return f"{source} is inside {loop}: it reacts to what it moves"
        return f"{source} acts on {loop}: the model is that of the closed loop"


def between(loops: Sequence[ClosedLoop], inputs: Sequence[str], outputs: Sequence[str]) -> dict[str, ClosedLoop]:
    """Return the inputs that act on a loop which moves one of the outputs, each with that loop.

    Args:
        loops: of the system.
        inputs: names of signals.
        outputs: likewise.
    """
    result: dict[str, ClosedLoop] = {}
    for loop in loops:
        if set(outputs) & set(loop.showing):
            result |= {name: loop for name in inputs if name in loop.acting and name not in result}
    return result
