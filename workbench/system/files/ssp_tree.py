"""The tree of an SSD: systems, components, connectors and connections as they are written, nothing resolved.

A component that is an SSD or SSP itself stands in the tree as its top-level system. A signal dictionary is one more
system, whose connectors are its entries and which passes values on; what refers to it has the same connectors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from workbench.core.records.names_in_text import plain_unit
from workbench.errors import InputError, suggest
from workbench.system.files.ssp_xml import Element, Package, boolean, children, descend, linear, number, parse, tag

__all__ = ["ANNOTATION", "Connector", "Hop", "Key", "SspComponent", "SspSource", "own_annotation", "read_tree"]

# Type of the annotations in which the workbench keeps what SSP has no place for.
ANNOTATION = "fmi-workbench"
_TRANSFORMATIONS = ("BooleanMappingTransformation", "IntegerMappingTransformation", "EnumerationMappingTransformation")

# Types of components that are systems: a package, or its description alone.
_NESTED = ("application/x-ssp-package", "application/x-ssp-definition")
_DEEPEST = 16  # systems in files inside each other
_DICTIONARY = "application/x-ssp-signal-dictionary"

# A connector: path of the element below the root system, and name.
Key = tuple[tuple[str, ...], str]


@dataclass(frozen=True)
class Connector:
    """A connector of an element. `unit` and `kind` are None where the file names none."""

    name: str
    kind: str | None
    type: str
    unit: str | None


@dataclass(frozen=True)
class Hop:
    """One connection as written, with ends resolved to elements.

    Attributes:
        start, end: the connectors.
        gain, offset: of the LinearTransformation.
        convert: whether units are converted (not suppressed).
        closes_at: time [s] at which it closes, from the workbench's own annotation.
    """

    start: Key
    end: Key
    gain: float = 1.0
    offset: float = 0.0
    convert: bool = True
    closes_at: float | None = None


@dataclass(frozen=True)
class SspSource:
    """Where an element was written.

    Attributes:
        package: what its sources are relative to.
        ssd: root of the file, with its units and enumerations.
        open_nested: opens a file of a type in `_NESTED`.
        depth: how many files it is inside of.
    """

    package: Package
    ssd: Element
    open_nested: Callable[[str, str, SspSource], SspSource]
    depth: int = 0

    def nested(self, source: str, where: str) -> SspSource:
        """Return the origin of what stands in another file.

        Args:
            source: of the component.
            where: for messages.

        Raises:
            InputError: it is missing, broken, or too deep, as one that holds itself.
        """
        if self.depth >= _DEEPEST:
            raise InputError(f"{where}: more than {_DEEPEST} systems inside each other; does one hold itself?")
        return replace(self.open_nested(source, where, self), depth=self.depth + 1)


@dataclass(frozen=True)
class SspComponent:
    """A system or a component.

    Attributes:
        path: names from the root system (left out) down to this element.
        element: its XML.
        origin: where that was written.
        connectors: by name.
        nodes: elements of a system by name, its signal dictionaries among them; empty for a component.
        references: name of a reference to a signal dictionary → the dictionary, with the reference's connectors.
        hops: connections of a system; empty for a component.
        bindings: its parameter bindings, later ones before earlier ones, each with where it was written.
        is_system: whether it is one.
    """

    path: tuple[str, ...]
    element: Element
    origin: SspSource
    connectors: dict[str, Connector]
    nodes: dict[str, SspComponent] = field(default_factory=dict)
    references: Mapping[str, SspComponent] = field(default_factory=dict)
    hops: tuple[Hop, ...] = ()
    bindings: tuple[tuple[Element, SspSource], ...] = ()
    is_system: bool = False

    @property
    def name(self) -> str:
        """The path with dots, for messages; the root has its own name."""
        return ".".join(self.path) or self.element.get("name") or "root"

    def walk(self) -> Iterator[SspComponent]:
        """Yield this node and all below it, in the file's order."""
        yield self
        for node in self.nodes.values():
            yield from node.walk()


def read_tree(system: Element, origin: SspSource) -> SspComponent:
    """Return the tree of a System element.

    Args:
        system: the element.
        origin: where it was written.

    Raises:
        InputError: an unknown element in a connection, a mapping transformation, two outputs connected, a signal
            dictionary or a nested system that is missing or broken.
    """
    return _system(system, (), origin, {})


def _system(
    element: Element, path: tuple[str, ...], origin: SspSource, known: Mapping[str, SspComponent]
) -> SspComponent:
    """Return the node of a system.

    Args:
        element: its XML.
        path: of it.
        origin: where it was written.
        known: signal dictionaries of the systems around it.
    """
    own = dict(_dictionaries(element, path, origin))
    known = {**known, **own}
    nodes: dict[str, SspComponent] = {node.path[-1]: node for node in own.values()}
    references: dict[str, SspComponent] = {}
    for child in children(element, "Elements", "*"):
        name = child.get("name")
        if not name:
            raise InputError(f"a {tag(child)} of system '{'.'.join(path) or 'root'}' has no name")
        if name in nodes or name in references:
            raise InputError(f"two elements are called '{'.'.join((*path, name))}'; rename one")
        if tag(child) == "SignalDictionaryReference":
            references[name] = _reference(child, known)
        else:
            nodes[name] = _element(child, (*path, name), origin, known)
    bindings = _bindings(element, origin)
    system = SspComponent(
        path, element, origin, _connectors(element), nodes, references, bindings=bindings, is_system=True
    )
    return replace(system, hops=tuple(_hop(c, system) for c in children(element, "Connections", "Connection")))


def _element(
    element: Element, path: tuple[str, ...], origin: SspSource, known: Mapping[str, SspComponent]
) -> SspComponent:
    if tag(element) == "System":
        return _system(element, path, origin, known)
    if tag(element) != "Component":
        raise InputError(f"element '{path[-1]}' is a {tag(element)}; only Component and System are read")
    bindings = _bindings(element, origin)
    if element.get("type") not in _NESTED:
        return SspComponent(path, element, origin, _connectors(element), bindings=bindings)
    inner = origin.nested(element.get("source") or "", f"component '{'.'.join(path)}'")
    system = descend(inner.ssd, "System")
    if system is None:
        raise InputError(f"component '{'.'.join(path)}': {element.get('source')} holds no System")
    result = _system(system, path, inner, {})  # names of dictionaries are looked up within a file
    return replace(result, bindings=(*result.bindings, *bindings))


def _bindings(element: Element, origin: SspSource) -> tuple[tuple[Element, SspSource], ...]:
    return tuple((b, origin) for b in children(element, "ParameterBindings", "ParameterBinding"))


# -- signal dictionaries ---------------------------------------------------------------------------


def _dictionaries(element: Element, path: tuple[str, ...], origin: SspSource) -> Iterator[tuple[str, SspComponent]]:
    for written in children(element, "SignalDictionaries", "SignalDictionary"):
        name = written.get("name") or ""
        where = f"SignalDictionary '{name}'"
        kind = written.get("type") or _DICTIONARY
        if kind != _DICTIONARY:
            raise InputError(f"{where}: type '{kind}' is not read; only {_DICTIONARY} is")
        source = written.get("source")
        file = parse(origin.package.file(source, where), "SignalDictionary") if source else None
        inside = file if file is not None else descend(written, "SignalDictionary")
        entries = [] if inside is None else [_connector(e, None) for e in children(inside, "DictionaryEntry")]
        own = SspComponent(
            (*path, f"{name} (signal dictionary)"),
            written,
            origin if file is None else replace(origin, ssd=file),
            {e.name: e for e in entries},
            is_system=True,
        )
        yield name, own


def _reference(element: Element, known: Mapping[str, SspComponent]) -> SspComponent:
    """Return the dictionary that an element refers to, with the kinds of the element's own connectors."""
    where = f"SignalDictionaryReference '{element.get('name')}'"
    name = element.get("dictionary") or ""
    if name not in known:
        raise InputError(f"{where}: there is no signal dictionary '{name}'; {suggest(name, known)}")
    entries = known[name].connectors
    connectors = _connectors(element)
    for connector in connectors:
        if connector not in entries:
            raise InputError(
                f"{where}: the dictionary '{name}' has no entry '{connector}'; {suggest(connector, entries)}"
            )
    return replace(known[name], connectors={**{n: replace(e, kind=None) for n, e in entries.items()}, **connectors})


def _connectors(element: Element) -> dict[str, Connector]:
    result = [_connector(c, c.get("kind")) for c in children(element, "Connectors", "Connector")]
    return {connector.name: connector for connector in result}


def _connector(element: Element, kind: str | None) -> Connector:
    """Return a connector, or an entry of a signal dictionary."""
    types = [c for c in element if tag(c) not in ("ConnectorGeometry", "Annotations", "Dimension", "MetaData")]
    said = types[0] if types else None
    unit = "" if said is None else plain_unit(said.get("unit") or "")
    return Connector(element.get("name") or "", kind, "Real" if said is None else tag(said), unit or None)


# -- connections ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _End:
    """One end of a connection: its connector, how it is written, and whether it is a source or a sink; None: either."""

    key: Key
    name: str
    role: str | None


def _hop(element: Element, system: SspComponent) -> Hop:
    start, end = (_end(element, side, system) for side in ("start", "end"))
    where = f"connection {start.name} → {end.name}"
    roles = [start.role, end.role]
    if roles in (["source", "source"], ["sink", "sink"]):
        what = "outputs" if roles[0] == "source" else "inputs"
        raise InputError(f"{where}: connects two {what}; a connection leads from an output to an input")
    if roles in (["sink", "source"], ["sink", None], [None, "source"]):
        start, end = end, start  # start and end do not say which way values go, the kinds of the connectors do
    gain, offset = _transformation(element, where)
    own = own_annotation(element, "Connection")
    convert = not boolean(element, "suppressUnitConversion")
    closes_at = None if own is None else number(own, "closesAt", 0.0, where)
    return Hop(start.key, end.key, gain, offset, convert=convert, closes_at=closes_at)


def _end(element: Element, side: str, system: SspComponent) -> _End:
    owner, name = element.get(f"{side}Element") or "", element.get(f"{side}Connector")
    if not name:
        raise InputError(f"a connection of system '{system.name}' has no {side}Connector")
    if element.get(f"{side}Indices"):
        raise InputError(
            f"a connection of system '{system.name}' takes elements of the array '{name}', which is not read"
        )
    if not owner:
        return _End((system.path, name), name, _role(system.connectors.get(name), own=True))
    elements = {**system.nodes, **system.references}
    if owner not in elements:
        raise InputError(
            f"a connection of system '{system.name}' names '{owner}.{name}', but there is no element '{owner}'; "
            f"{suggest(owner, elements)}"
        )
    node = elements[owner]
    if owner in system.references and name not in node.connectors:
        raise InputError(
            f"a connection of system '{system.name}' names '{owner}.{name}', but the signal dictionary has no such "
            f"entry; {suggest(name, node.connectors)}"
        )
    return _End((node.path, name), f"{owner}.{name}", _role(node.connectors.get(name), own=False))


def _role(connector: Connector | None, *, own: bool) -> str | None:
    """Return whether a connector gives or takes values inside a system; None: the file does not say.

    Args:
        connector: None: it is not listed.
        own: whether it is the system's own, seen from inside.
    """
    takes = {"input", "parameter", "structuralParameter"}
    gives = {"output", "calculatedParameter", "local", "constant"}
    kinds = {**dict.fromkeys(takes, own), **dict.fromkeys(gives, not own)}
    is_source = None if connector is None else kinds.get(connector.kind or "")
    return None if is_source is None else "source" if is_source else "sink"


def _transformation(element: Element, where: str) -> tuple[float, float]:
    for name in _TRANSFORMATIONS:
        if descend(element, name) is not None:
            raise InputError(f"{where}: {name} is not read; only LinearTransformation is")
    return linear(element, where)


def own_annotation(element: Element | None, name: str) -> Element | None:
    """Return what the workbench's own annotation of an element holds under a name; None: there is none."""
    for annotation in children(element, "Annotations", "Annotation"):
        if annotation.get("type") == ANNOTATION:
            return descend(annotation, name)
    return None
