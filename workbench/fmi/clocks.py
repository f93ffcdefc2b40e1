"""What a description of FMI 3.0 says of clocks, scheduled execution, adjoint derivatives and intermediate update."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO

from lxml import etree

from workbench.fmi.description import Capabilities, Clock

__all__ = ["Additions", "additions_of"]

_TRUE = ("true", "1")
_INTERFACES = ("ModelExchange", "CoSimulation", "ScheduledExecution")


@dataclass(frozen=True)
class Additions:
    """What stands in a description besides what FMI 2.0 has, too; the fields are those of `Description`.

    Attributes:
        adjoint, updating: elements of the interfaces that provide adjoint derivatives, and that ask for inputs inside a
            step.
    """

    scheduled: Capabilities | None = None
    clocks: Mapping[str, Clock] = field(default_factory=dict)
    clocked: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    intermediate: frozenset[int] = frozenset()
    adjoint: frozenset[str] = frozenset()
    updating: frozenset[str] = frozenset()


def additions_of(data: bytes) -> Additions:
    """Return what a modelDescription.xml of FMI 3.0 says of these.

    Args:
        data: the file, well-formed and without a document type.
    """
    root = etree.parse(
        BytesIO(data), etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    ).getroot()
    declared = [e for e in root.iterfind("ModelVariables/*") if isinstance(e.tag, str) and e.get("name")]
    names = {e.get("valueReference", ""): e.get("name", "") for e in declared if e.tag == "Clock"}
    ticked = {e.get("name", ""): _referred(e, names) for e in declared if e.get("clocks")}
    return Additions(
        scheduled=_scheduled(root.find("ScheduledExecution")),
        clocks={e.get("name", ""): _clock(e, ticked) for e in declared if e.tag == "Clock"},
        clocked={name: clocks for name, clocks in ticked.items() if clocks},
        intermediate=frozenset(
            int(e.get("valueReference", "0"))
            for e in declared
            if e.get("causality") == "input" and _flag(e, "intermediateUpdate")
        ),
        adjoint=frozenset(t for t in _INTERFACES if _flag(root.find(t), "providesAdjointDerivatives")),
        updating=frozenset(t for t in _INTERFACES if _flag(root.find(t), "providesIntermediateUpdate")),
    )


def _flag(element: etree._Element | None, name: str) -> bool:
    return element is not None and element.get(name) in _TRUE


def _scheduled(element: etree._Element | None) -> Capabilities | None:
    if element is None or not element.get("modelIdentifier"):
        return None
    return Capabilities(
        identifier=element.get("modelIdentifier", ""),
        state=_flag(element, "canGetAndSetFMUState"),
        directional_derivatives=_flag(element, "providesDirectionalDerivatives"),
        adjoint_derivatives=_flag(element, "providesAdjointDerivatives"),
        completed_step=False,
        once_per_process=_flag(element, "canBeInstantiatedOnlyOncePerProcess"),
        needs_tool=_flag(element, "needsExecutionTool"),
    )


def _referred(element: etree._Element, names: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(names[r] for r in (element.get("clocks") or "").split() if r in names)


def _clock(element: etree._Element, ticked: Mapping[str, tuple[str, ...]]) -> Clock:
    resolution = _number(element, "resolution") or 0.0
    interval, shift = _number(element, "intervalDecimal"), _number(element, "shiftDecimal")
    # Counters are exact where the decimal is rounded: 1/3 s.
    counts, shifts = _number(element, "intervalCounter"), _number(element, "shiftCounter")
    if resolution > 0.0:
        interval = interval if counts is None else counts / resolution
        shift = shift if not shifts else shifts / resolution
    return Clock(
        kind=element.get("intervalVariability") or "triggered",
        causality=element.get("causality") or "local",
        value_reference=int(element.get("valueReference") or 0),
        interval=interval,
        shift=shift or 0.0,
        clocks=ticked.get(element.get("name", ""), ()),
    )


def _number(element: etree._Element, name: str) -> float | None:
    try:
        return float(element.get(name, ""))
    except ValueError:
        return None
