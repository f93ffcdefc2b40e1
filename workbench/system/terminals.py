"""Connections between terminals of FMI 3.0, written as those between their members."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from workbench.errors import InputError, suggest
from workbench.fmi.description import Terminal, TerminalMember
from workbench.fmi.variable import Variable
from workbench.system.components import OpenComponent
from workbench.system.description import Connection, SystemDescription
from workbench.system.names import NameTable

__all__ = ["members_connected"]

_FLOWS = ("inflow", "outflow")
_KINDS = ("signal", *_FLOWS)
_RULES = ("plug", "bus", "sequence")


def members_connected(description: SystemDescription, parts: Sequence[OpenComponent]) -> SystemDescription:
    """Return the system with a connection for each pair of members in place of each between terminals.

    Members of a plug are all matched by name, those of a bus where both have one of that name, those of a sequence by
    their order. Of each pair one is an input and the other an output, whatever side of the connection they are on.
    Flows that both go into their components, or both out of them, have opposite signs, for they sum to zero.

    Args:
        description: as it is written down.
        parts: its components, opened, in the same order.

    Raises:
        InputError: terminals that do not match; the message names file and connection.
    """
    if not any(p.description.terminals for p in parts):
        return description
    known = _Terminals(parts)
    try:
        connections = tuple(one for c in description.connections for one in known.connected(c))
    except InputError as error:
        raise InputError(f"{description.source or f'system {description.name}'}: {error}") from None
    return replace(description, connections=connections)


class _Terminals:
    """The terminals of all components.

    Args:
        parts: the components.
    """

    def __init__(self, parts: Sequence[OpenComponent]) -> None:
        self._names = NameTable([p.name for p in parts], [p.description.variables for p in parts])
        self._terminals = {p.name: {t.name: t for t in p.description.terminals} for p in parts}
        self._variables = {p.name: {v.name: v for v in p.description.variables} for p in parts}

    def connected(self, connection: Connection) -> list[Connection]:
        """Return what a connection stands for: itself, unless it is between terminals."""
        try:
            ends = [self._names.split(name) for name in (connection.source, connection.destination)]
        except InputError:  # said where connections are checked
            return [connection]
        result = [None if self._is_variable(*end) else self._terminals[end[0]].get(end[1]) for end in ends]
        if not any(result):
            return [connection]
        try:
            return self._pairs(connection, ends, result)
        except InputError as error:
            raise InputError(f"connection {connection.source} → {connection.destination}: {error}") from None

    def _is_variable(self, component: str, name: str) -> bool:
        known = self._variables[component]
        return name in known or any(v.startswith(f"{name}[") for v in known)

    def _pairs(
        self, connection: Connection, ends: Sequence[tuple[str, str]], result: Sequence[Terminal | None]
    ) -> list[Connection]:
        first, second = result
        if first is None or second is None:
            component, name = ends[0 if first is None else 1]
            near = suggest(name, self._terminals[component])
            raise InputError(f"'{name}' is not a terminal of '{component}', and a terminal takes another; {near}")
        if (connection.gain, connection.offset, connection.unit) != (1.0, 0.0, None):
            raise InputError("terminals are connected as they are: leave out gain, offset and unit")
        if first.rule != second.rule:
            raise InputError(f"matching rules differ, {first.rule} and {second.rule}; connect members one by one")
        matched = _matched(first.rule, self._members(ends[0][0], first), self._members(ends[1][0], second))
        return [self._one(connection, ends, pair) for pair in matched]

    def _members(self, component: str, terminal: Terminal) -> dict[str, TerminalMember]:
        """Return name → member, those of terminals inside as "inner.member"."""
        result = {m.name: m for m in terminal.members}
        for name, inner in self._terminals[component].items():
            if name.startswith(f"{terminal.name}."):
                begin = name.removeprefix(f"{terminal.name}.")
                result.update({f"{begin}.{m.name}": m for m in inner.members})
        return result

    def _one(
        self, connection: Connection, ends: Sequence[tuple[str, str]], pair: tuple[TerminalMember, TerminalMember]
    ) -> Connection:
        for member in pair:
            if member.kind not in _KINDS:
                raise InputError(f"member '{member.name}' is a {member.kind}; connect such members one by one")
        names = [f"{component}.{m.variable}" for (component, _), m in zip(ends, pair, strict=True)]
        inputs = [self._variable(c, m).causality == "input" for (c, _), m in zip(ends, pair, strict=True)]
        if inputs[0] == inputs[1]:
            what = "inputs" if inputs[0] else "outputs"
            raise InputError(f"{names[0]} and {names[1]} are both {what}; of two members one must be an input")
        source, destination = reversed(names) if inputs[0] else names
        opposite = pair[0].kind in _FLOWS and pair[0].kind == pair[1].kind
        return replace(connection, source=source, destination=destination, gain=-1.0 if opposite else 1.0)

    def _variable(self, component: str, member: TerminalMember) -> Variable:
        known = self._variables[component]
        if member.variable not in known:
            raise InputError(f"member '{member.name}' names the variable '{member.variable}', which is not there")
        return known[member.variable]


def _matched(
    rule: str, first: Mapping[str, TerminalMember], second: Mapping[str, TerminalMember]
) -> list[tuple[TerminalMember, TerminalMember]]:
    """Return the pairs of members that belong together."""
    if rule not in _RULES:
        raise InputError(f"matching rule '{rule}' is its exporter's own; connect members one by one")
    if rule == "sequence":
        if len(first) != len(second):
            raise InputError(f"{len(first)} members to {len(second)}; connect members one by one")
        return list(zip(first.values(), second.values(), strict=True))
    if rule == "plug" and first.keys() != second.keys():
        lonely = ", ".join(sorted(first.keys() ^ second.keys()))
        raise InputError(f"members that only one of them has: {lonely}; connect members one by one")
    pairs = [(first[name], second[name]) for name in first if name in second]
    if not pairs:
        raise InputError("no member of the one has the name of one of the other; connect members one by one")
    return pairs
