"""A system with one loop cut: opened, or with a sum in it through which a signal is injected."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace

from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.loops.loop.place import find_place
from workbench.loops.loop.request import Open
from workbench.loops.loop.result import Opening
from workbench.loops.opened_system import free_name
from workbench.model import Model
from workbench.model.described_model import DescribedModel
from workbench.system.components import open_parts
from workbench.system.connection_checks import resolve, settled
from workbench.system.description import (
    Component,
    Connection,
    GainComponent,
    Resolved,
    SumComponent,
    SystemDescription,
)
from workbench.system.model import SystemModel
from workbench.system.terminals import members_connected

__all__ = ["INJECTED", "PASSED", "RETURNED", "CutLoop", "cut_loop", "injected_at", "loop_sources", "source_of"]

RETURNED = "loop.returned"
PASSED = "loop.passed"
INJECTED = "loop.injected"


@dataclass(frozen=True, eq=False)
class CutLoop:
    """A system, the place at which its loop is cut, and where it stands there.

    Attributes:
        model: the system as it is, the loop closed; it stays open.
        place: the connections that are cut.
        point: where it stands; None: where it starts.
        value: of the signal at the place there [unit of the source].
        time: session time [s].
        notes: one line each.
    """

    model: SystemModel
    place: Opening
    point: OperatingPoint | None
    value: float
    time: float
    notes: tuple[str, ...]
    _system: SystemDescription

    @contextmanager
    def opened(
        self, change: Callable[[SystemDescription], SystemDescription] = lambda system: system
    ) -> Iterator[DescribedModel]:
        """Give the system with the loop open.

        Its input "loop.passed" goes where the signal went, biased at the signal's value; its output "loop.returned" is
        what comes back.

        Args:
            change: of the opened system, which keeps its connections.
        """
        with self._open(_broken, {PASSED: self.value}, change) as model:
            yield model

    @contextmanager
    def injected(self) -> Iterator[DescribedModel]:
        """Give the system with the loop closed and an input "loop.injected" added to the signal at the place.

        Outputs: "loop.returned" before the sum, "loop.passed" behind it.
        """
        with self._open(_summed, {}) as model:
            yield model

    @contextmanager
    def _open(
        self,
        make: _Make,
        bias: Mapping[str, float],
        change: Callable[[SystemDescription], SystemDescription] = lambda system: system,
    ) -> Iterator[DescribedModel]:
        recipe = self.model.recipe
        held = {} if self.point is None else self.point.u
        kept = {name: value for name, value in recipe.bias.items() if name not in held}
        changed = recipe.changed(change(_cut(self._system, self.place, make)))
        opened = replace(changed, bias={**kept, **bias}, at=self.point)
        with opened.open() as model:
            yield model


def cut_loop(model: Model, where: Open, *, point: OperatingPoint | None = None) -> CutLoop:
    """Return a system's loop, ready to be cut.

    Args:
        model: the system; it stays open.
        where: see `find_place`.
        point: of the closed loop, as trim finds it; None: where the system starts.

    Raises:
        InputError: no system, parts of co-simulation, no such connection, a connection that is in no loop.
        SimulationError: the system cannot be started there.
    """
    system = _checked(model)
    resolved = _resolved(system)
    place = find_place(system.system, resolved, where)
    plain = settled(system.system, resolved)
    time = 0.0 if point is None else point.time
    with system.open_at(time=time, values={} if point is None else point.values) as session:
        value = session.values([place.source])[place.source]
    return CutLoop(system, place, point, value, time, _notes(plain, place, time), plain)


@contextmanager
def injected_at(
    model: Model, wheres: Sequence[Open], *, point: OperatingPoint | None = None
) -> Iterator[tuple[DescribedModel, tuple[Opening, ...], tuple[str, ...]]]:
    """Give the system with its loops closed and an input added to the signal at each of several places; and the places.

    Input and outputs at place k, from 1: "loop.injected.k", "loop.returned.k" before the sum, "loop.passed.k" behind.

    Args:
        model: the system; it stays open.
        wheres: see `find_place`.
        point: see `cut_loop`.

    Raises:
        InputError: see `cut_loop`; or two places have a connection in common.
        SimulationError: the system cannot be started there.
    """
    system = _checked(model)
    resolved = _resolved(system)
    places = [find_place(system.system, resolved, where) for where in wheres]
    for a, b in itertools.combinations(places, 2):
        if set(a.wires) & set(b.wires):
            raise InputError(f"open: {a.label} and {b.label} have a connection in common; open it once")
    plain = settled(system.system, resolved)
    changed, outputs = plain, dict[str, str]()
    for number, place in enumerate(places, 1):
        changed = _cut(changed, place, _summed, mark=f".{number}")
        outputs |= changed.outputs
    recipe = replace(system.recipe, system=replace(changed, outputs=outputs), at=point)
    if point is not None:
        recipe = replace(recipe, bias={n: value for n, value in recipe.bias.items() if n not in point.u})
    time = 0.0 if point is None else point.time
    notes = tuple(dict.fromkeys(note for place in places for note in _notes(plain, place, time)))
    with recipe.open() as opened:
        yield opened, tuple(places), notes


def loop_sources(model: Model) -> tuple[str, ...]:
    """Return the variables whose connections are in a loop, but for outputs of gains and sums, if there are others.

    Args:
        model: the system.

    Raises:
        InputError: no system, parts of co-simulation.
    """
    system = _checked(model)
    resolved = _resolved(system)
    found = list[str]()
    for source in dict.fromkeys(w.ends[0] for w in resolved.wires):
        with suppress(InputError):  # in no loop, or no real number
            found.append(find_place(system.system, resolved, source).source)
    plain = {c.name for c in system.system.components if isinstance(c, GainComponent | SumComponent)}
    return tuple(s for s in found if s.partition(".")[0] not in plain) or tuple(found)


def source_of(model: Model, where: Open) -> str:
    """Return the variable whose connections are opened.

    Args:
        model: the system.
        where: see `find_place`.

    Raises:
        InputError: see `cut_loop`.
    """
    system = _checked(model)
    return find_place(system.system, _resolved(system), where).source


def _checked(model: Model) -> SystemModel:
    if isinstance(model, SystemModel) and model.interface == "me":
        return model
    if isinstance(getattr(model, "system", None), SystemDescription):
        raise InputError(
            f"loop: {model.name} has co-simulation parts, whose loop cannot be opened (their steps are part of it); "
            f"{model.way_out()}"
        )
    raise InputError(
        f"loop: {model.name} is a single model and has no connection to open; connect it into a system first"
    )


def _resolved(model: SystemModel) -> Resolved:
    recipe = model.recipe
    with ExitStack() as undo:
        parts = open_parts(recipe.system.components, undo, recipe.parts, interface=recipe.interface)
        system = members_connected(recipe.system, parts)
        return resolve(system, [p.description.variables for p in parts])


def _notes(system: SystemDescription, place: Opening, time: float) -> tuple[str, ...]:
    notes = []
    for i, c in enumerate(system.connections):
        if c.closes_at is None or c.closes_at <= time:
            continue
        what = "is measured as if it were closed" if i in place.wires else "is open here"
        notes.append(f"{c.source} → {c.destination} closes at {c.closes_at:g} s and {what} (time {time:g} s)")
    return tuple(notes)


# -- descriptions ---------------------------------------------------------------------------------

_Made = tuple[Component, tuple[Connection, ...], Mapping[str, tuple[str, ...]], Mapping[str, str]]
_Make = Callable[[str, str], _Made]


def _broken(name: str, source: str) -> _Made:
    """Return a relay that an input drives in place of the source."""
    return GainComponent(name=name), (), {PASSED: (f"{name}.u",)}, {RETURNED: source}


def _summed(name: str, source: str) -> _Made:
    """Return a sum of the source and an input."""
    lead = Connection(source=source, destination=f"{name}.u1", convert=False)
    return SumComponent(name=name), (lead,), {INJECTED: (f"{name}.u2",)}, {RETURNED: source, PASSED: f"{name}.y"}


def _cut(system: SystemDescription, place: Opening, make: _Make, *, mark: str = "") -> SystemDescription:
    """Return the system with a block behind the source; gains, offsets and units stay behind the block.

    Args:
        system: with its connections in the order of the place.
        place: where.
        make: the block.
        mark: behind the names of its signals.
    """
    name = free_name("loop_cut", system.components)
    block, leads, inputs, outputs = make(name, place.source)
    connections = [
        replace(c, source=f"{name}.y", closes_at=None) if i in place.wires else c
        for i, c in enumerate(system.connections)
    ]
    return replace(
        system,
        components=(*system.components, block),
        connections=(*connections, *leads),
        inputs={**system.inputs, **{n + mark: ends for n, ends in inputs.items()}},
        outputs={n + mark: variable for n, variable in outputs.items()},
    )
