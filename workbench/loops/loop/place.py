"""Where a loop is opened: the connections that leave one variable, or one of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from workbench.errors import InputError, article, suggest
from workbench.fmi.variable import FLOAT_TYPES
from workbench.fmi.wiring import Wire
from workbench.loops.loop.request import Open
from workbench.loops.loop.result import Opening
from workbench.system.description import Resolved, SystemDescription

__all__ = ["find_place"]

_ARROWS = ("→", "->")


def find_place(system: SystemDescription, resolved: Resolved, at: Open) -> Opening:
    """Return the connections that `at` names.

    Args:
        system: as it is written down.
        resolved: its wires.
        at: a source "plant.y": all connections that leave it; an input "controller.u": the one that ends there; or one
            connection, ("plant.y", "controller.u") or "plant.y -> controller.u". A system's output stands for its
            variable.

    Raises:
        InputError: there is no such connection, it does not carry a real number, or it is not in a loop.
    """
    names = [c.name for c in system.components]
    ends = [w.ends for w in resolved.wires]
    source, target = _split(at)
    if source in resolved.outputs:
        port = resolved.outputs[source]
        source = f"{names[port.component]}.{port.variable.name}"
    chosen = [
        i for i, (a, b) in enumerate(ends) if (source in (a, b) if target is None else (source, target) == (a, b))
    ]
    if not chosen:
        raise InputError(_unknown(source, target, ends))
    wires = [resolved.wires[i] for i in chosen]
    _check_real(wires[0], ends[chosen[0]][0])
    place = Opening(
        source=ends[chosen[0]][0],
        unit=wires[0].source.unit,
        wires=tuple(chosen),
        destinations=tuple(ends[i][1] for i in chosen),
        discrete=wires[0].source.variability == "discrete",
    )
    _check_loop(place, wires, resolved.wires, names)
    return place


def _split(at: Open) -> tuple[str, str | None]:
    """Return source and destination; None: all."""
    if not isinstance(at, str):
        if len(at) != 2:
            raise InputError(f'at: {at!r} is not a connection; write "plant.y", or ("plant.y", "controller.u")')
        return at[0], at[1]
    for arrow in _ARROWS:
        source, result, target = (part.strip() for part in at.partition(arrow))
        if result:
            return source, target
    return at.strip(), None


def _unknown(source: str, target: str | None, ends: Sequence[tuple[str, str]]) -> str:
    if target is not None:
        known = [f"{a} -> {b}" for a, b in ends]
        return f"open: there is no connection {source} -> {target}; {suggest(f'{source} -> {target}', known)}"
    return f"open: no connection leaves '{source}'; {suggest(source, [a for a, _ in ends])}"


def _check_real(wire: Wire, source: str) -> None:
    for variable in (wire.source, wire.destination):
        if variable.type not in FLOAT_TYPES:
            raise InputError(
                f"open: {source}: '{variable.name}' is {article(variable.type)}; a loop can be opened where a real "
                "number is handed over"
            )


def _check_loop(place: Opening, cut: Sequence[Wire], wires: Sequence[Wire], names: Sequence[str]) -> None:
    """Refuse a place from which nothing leads back to the source's component.

    Raises:
        InputError: it is in no loop.
    """
    home = cut[0].from_component
    reached = _reached({w.to_component for w in cut}, wires)
    if home in reached:
        return
    ends = ", ".join(sorted(names[k] for k in reached))
    raise InputError(
        f"open: {place.label} is not in a loop: it leads to {ends}, and nothing leads back to {names[home]}"
    )


def _reached(start: Collection[int], wires: Sequence[Wire]) -> set[int]:
    """Return the components that connections lead to, those of the start included."""
    result, fresh = set(start), set(start)
    while fresh:
        fresh = {w.to_component for w in wires if w.from_component in fresh} - result
        result |= fresh
    return result
