"""The tree of an SSD: systems, components, connectors and connections as they are written, nothing resolved."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from workbench.errors import InputError, suggest
from workbench.system.ssp_xml import Element, boolean, children, descend, linear, number, tag

__all__ = ["ANNOTATION", "Connector", "Hop", "Key", "Node", "own_annotation", "read_tree"]

# Type of the annotations in which the workbench keeps what SSP has no place for.
ANNOTATION = "fmi-workbench"
_TRANSFORMATIONS = ("BooleanMappingTransformation", "IntegerMappingTransformation", "EnumerationMappingTransformation")

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
class Node:
    """A system or a component.

    Attributes:
        path: names from the root system (left out) down to this element.
        element: its XML.
        connectors: by name.
        nodes: elements of a system by name; empty for a component.
        hops: connections of a system; empty for a component.
        is_system: whether it is one.
    """

    path: tuple[str, ...]
    element: Element
    connectors: dict[str, Connector]
    nodes: dict[str, Node] = field(default_factory=dict)
    hops: tuple[Hop, ...] = ()
    is_system: bool = False

    @property
    def name(self) -> str:
        """The path with dots, for messages; the root has its own name."""
        return ".".join(self.path) or self.element.get("name") or "root"

    def walk(self) -> Iterator[Node]:
        """Yield this node and all below it, in the file's order."""
        yield self
        for node in self.nodes.values():
            yield from node.walk()


def read_tree(system: Element) -> Node:
    """Return the tree of a System element.

    Raises:
        InputError: a signal dictionary, an unknown element in a connection, a mapping transformation, two outputs
            connected.
    """
    return _system(system, ())


def _system(element: Element, path: tuple[str, ...]) -> Node:
    _refuse_dictionaries(element)
    nodes: dict[str, Node] = {}
    for child in children(element, "Elements", "*"):
        node = _element(child, path)
        if node.path[-1] in nodes:
            raise InputError(f"two elements are called '{node.name}'; rename one")
        nodes[node.path[-1]] = node
    system = Node(path, element, _connectors(element), nodes, (), is_system=True)
    hops = tuple(_hop(c, system) for c in children(element, "Connections", "Connection"))
    return Node(path, element, system.connectors, nodes, hops, is_system=True)


def _element(element: Element, path: tuple[str, ...]) -> Node:
    name = element.get("name")
    if not name:
        raise InputError(f"a {tag(element)} of system '{'.'.join(path) or 'root'}' has no name")
    inner = (*path, name)
    if tag(element) == "System":
        return _system(element, inner)
    if tag(element) == "SignalDictionaryReference":
        raise InputError(f"'{name}' is a SignalDictionaryReference; signal dictionaries are not read: connect directly")
    if tag(element) != "Component":
        raise InputError(f"element '{name}' is a {tag(element)}; only Component and System are read")
    return Node(inner, element, _connectors(element))


def _refuse_dictionaries(element: Element) -> None:
    found = descend(element, "SignalDictionaries", "SignalDictionary")
    if found is not None:
        raise InputError(f"SignalDictionary '{found.get('name')}': signal dictionaries are not read: connect directly")


def _connectors(element: Element) -> dict[str, Connector]:
    found = {}
    for connector in children(element, "Connectors", "Connector"):
        kinds = [c for c in connector if tag(c) not in ("ConnectorGeometry", "Annotations", "Dimension")]
        kind = kinds[0] if kinds else None
        name = connector.get("name") or ""
        unit = None if kind is None else kind.get("unit")
        found[name] = Connector(name, connector.get("kind"), "Real" if kind is None else tag(kind), unit or None)
    return found


# -- connections ---------------------------------------------------------------------------------


def _hop(element: Element, system: Node) -> Hop:
    ends = [_end(element, side, system) for side in ("start", "end")]
    where = f"connection {ends[0][1]} → {ends[1][1]}"
    roles = [_role(key, system) for key, _ in ends]
    if roles in (["source", "source"], ["sink", "sink"]):
        what = "outputs" if roles[0] == "source" else "inputs"
        raise InputError(f"{where}: connects two {what}; a connection leads from an output to an input")
    if roles in (["sink", "source"], ["sink", None], [None, "source"]):
        ends.reverse()  # start and end do not say which way values go, the kinds of the connectors do
    gain, offset = _transformation(element, where)
    own = own_annotation(element, "Connection")
    convert = not boolean(element, "suppressUnitConversion")
    closes_at = None if own is None else number(own, "closesAt", 0.0, where)
    return Hop(ends[0][0], ends[1][0], gain, offset, convert=convert, closes_at=closes_at)


def _end(element: Element, side: str, system: Node) -> tuple[Key, str]:
    """Return the connector at one end of a connection, and its name for messages."""
    owner, name = element.get(f"{side}Element") or "", element.get(f"{side}Connector")
    if not name:
        raise InputError(f"a connection of system '{system.name}' has no {side}Connector")
    if element.get(f"{side}Indices"):
        raise InputError(
            f"a connection of system '{system.name}' takes elements of the array '{name}', which is not read"
        )
    if not owner:
        return (system.path, name), name
    if owner not in system.nodes:
        raise InputError(
            f"a connection of system '{system.name}' names '{owner}.{name}', but there is no element '{owner}'; "
            f"{suggest(owner, system.nodes)}"
        )
    return (system.nodes[owner].path, name), f"{owner}.{name}"


def _role(key: Key, system: Node) -> str | None:
    """Return whether a connector gives or takes values inside a system; None: the file does not say."""
    own = key[0] == system.path
    node = system if own else system.nodes[key[0][-1]]
    connector = node.connectors.get(key[1])
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
