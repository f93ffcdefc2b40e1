"""A system over one of its parameters, or over a factor on what leaves its block."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from workbench.errors import InputError, SimulationError
from workbench.limit_cycles.limit_cycle.branch import Branch, BranchPoint
from workbench.limit_cycles.limit_cycle.result import LimitCycle
from workbench.limit_cycles.limit_cycle.shooting import Orbits, follow_orbits
from workbench.loops.opened_system import Ports, recipe_of
from workbench.model.described_model import DescribedModel
from workbench.model.varied import Varied, set_to
from workbench.response.periodic.continuation import Manner
from workbench.response.periodic.place import Place

__all__ = ["GAIN", "Range", "follow_cycles", "range_of"]

GAIN = "gain"
_ON_BRANCH = 0.02  # interpolated
_SAME = 1e-3  # by shooting, both


@dataclass(frozen=True)
class Range:
    """What is varied.

    Attributes:
        name: of the parameter, or "gain".
        low, high: its bounds.
        start: its value in the system as it is.
        at: its value → the system there; it stays open.
        close: closes what was opened for that.
    """

    name: str
    low: float
    high: float
    start: float
    at: Callable[[float], DescribedModel]
    close: Callable[[], None]

    def value(self, p: float) -> float:
        """Return the value at p in 0 … 1."""
        return self.low + (self.high - self.low) * p

    @property
    def begin(self) -> float:
        """The p of the system as it is."""
        return (self.start - self.low) / (self.high - self.low)


def range_of(model: DescribedModel, name: str, limits: tuple[float, float], *, ports: Ports, time: float) -> Range:
    """Return what is varied.

    Args:
        model: the system; it stays open.
        name: full name of a parameter or start value, or "gain": a factor on the connections that leave the block.
        limits: lowest and highest value.
        ports: of the block.
        time: session time [s].

    Raises:
        InputError: the system's own value does not lie between the limits.
    """
    described = {v.name for v in model.description.variables}
    of_blocks = {v.name: v.start for v in model.parameters if v.name not in described}
    if name == GAIN:
        start = 1.0
    elif name in of_blocks:
        start = float(of_blocks[name] or 0.0)
    else:
        with model.open_session(start_time=time) as session:
            start = session.values([name])[name]
    low, high = limits
    if not low <= start <= high or not low < high:
        raise InputError(f"{name}: its value {start:g} must lie between the limits {low:g} and {high:g}")
    kept = Varied(lambda value: _amplified(model, ports, value))

    def at(value: float) -> DescribedModel:
        return kept.at(value) if name == GAIN else set_to(model, {name: value})

    return Range(name, low, high, start, at, kept.close)


def _amplified(model: DescribedModel, ports: Ports, factor: float) -> DescribedModel:
    """Return the system with another gain behind its block; it is all of the loop's that is not the block's."""
    recipe = recipe_of(model)
    connections = tuple(
        replace(c, gain=factor * c.gain) if c.source == ports.w else c for c in recipe.system.connections
    )
    return recipe.changed(replace(recipe.system, connections=connections)).open()


def follow_cycles(
    cycles: Sequence[LimitCycle],
    over: Range,
    orbits: Callable[[Callable[[float], DescribedModel], LimitCycle], Orbits],
    *,
    stopped: Callable[[], bool],
    told: Callable[[float, float], None],
    begun: Callable[[Callable[[], Branch]], None],
    ended: Callable[[Branch], None],
) -> list[str]:
    """Follow closed orbits over a parameter, each branch once; return in words what could not be followed or located.

    Args:
        cycles: that shooting found.
        over: what is varied.
        orbits: (p → the system there, a cycle) → its family.
        stopped: asked between places; true ends it by KeyboardInterrupt.
        told: called with the part of the work that is done, and the value.
        begun: is given what returns the branch being followed, as far as it goes.
        ended: is given each branch when it is complete.
    """
    branches: list[Branch] = []
    notes: list[str] = []
    try:
        for number, cycle in enumerate(cycles):
            if any(_passes(b, over.start, cycle) for b in branches):
                continue
            family = orbits(lambda p: over.at(over.value(p)), cycle)
            try:
                first = family.arrive(cycle.states or {}, cycle.frequency_hz, over.begin)
            except SimulationError as error:
                notes.append(f"{over.name}: the cycle of {cycle.frequency_hz:.4g} Hz cannot be followed: {error}")
                continue
            progress = _progress(over, number, len(cycles), told)
            branches.append(
                follow_orbits(
                    family,
                    first,
                    parameter=over.name,
                    limits=(over.low, over.high),
                    manner=Manner(stopped=stopped, told=progress, marks=(over.begin,)),
                    begun=begun,
                    noted=notes.append,
                )
            )
            ended(branches[-1])
    finally:
        over.close()
    return notes


def _progress(over: Range, number: int, count: int, report: Callable[[float, float], None]) -> Callable[[Place], None]:
    """Return what tells how much of the range a branch has seen: up first, then down."""
    seen = [0.0]

    def at(place: Place) -> None:
        room = 1.0 - over.begin if place.p > over.begin else over.begin
        seen.append(max(seen[-1], number + (min(abs(place.p - over.begin) / room, 1.0) if room > 0.0 else 1.0)))
        report(0.99 * seen[-1] / count, over.value(place.p))

    return at


def _passes(branch: Branch, value: float, cycle: LimitCycle) -> bool:
    """Whether a branch has a cycle at a value of its parameter: it has points there, but where that failed."""
    if any(_is(p, value, cycle) for p in branch.points):
        return True
    for a, b in pairwise(branch.points):
        if (a.value - value) * (b.value - value) <= 0.0 and a.value != b.value:
            part = (value - a.value) / (b.value - a.value)
            amplitude = a.amplitude + part * (b.amplitude - a.amplitude)
            if abs(amplitude / cycle.amplitude - 1.0) < _ON_BRANCH:
                return True
    return False


def _is(p: BranchPoint, value: float, cycle: LimitCycle) -> bool:
    """Whether a point of a branch is a cycle found at a value of the parameter."""
    there = abs(p.value - value) <= _SAME * abs(value)
    pairs = ((p.amplitude, cycle.amplitude), (p.frequency_hz, cycle.frequency_hz))
    return there and all(abs(a / b - 1.0) < _SAME for a, b in pairs)
