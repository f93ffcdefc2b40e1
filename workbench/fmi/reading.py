"""Read the description of an FMU leniently: modelDescription.xml, and the terminals beside it."""

from __future__ import annotations

import codecs
import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from workbench.core.names import plain_unit
from workbench.core.scratch import scratch
from workbench.errors import FmuError, one_line
from workbench.fmi.clocks import Additions, additions_of
from workbench.fmi.description import (
    Capabilities,
    DefaultExperiment,
    Description,
    DisplayUnit,
    UnitDefinition,
)
from workbench.fmi.fmpy_access import model_description
from workbench.fmi.platforms import platforms_in
from workbench.fmi.structure import with_structure
from workbench.fmi.terminals import terminals_in
from workbench.fmi.variable import FLOAT_TYPES, Value, Variable

__all__ = ["MAX_XML_BYTES", "read_description"]

MAX_XML_BYTES = 512 << 20
MAX_ELEMENTS = 1_000_000


def read_description(folder: Path, *, source: str, structure: Mapping[str, int] | None = None) -> Description:
    """Read the description of an unpacked FMU.

    Args:
        folder: where it is unpacked.
        source: what the user named, for messages.
        structure: structural parameters → values other than those in the file; arrays have the sizes that follow.

    Raises:
        FmuError: not well-formed, has a document type or entities, or bends rules so far that it
            cannot be read.
    """
    path = folder / "modelDescription.xml"
    if path.stat().st_size > MAX_XML_BYTES:
        raise FmuError(f"{source}: modelDescription.xml is larger than {MAX_XML_BYTES >> 20} MiB")
    digest = hashlib.sha256(path.read_bytes()).digest()
    found = _described(_Text(digest, platforms_in(folder), tuple(sorted((structure or {}).items())), folder, source))
    terminals, remarks = terminals_in(folder)
    return replace(found, terminals=terminals, notes=(*found.notes, *remarks)) if terminals or remarks else found


@dataclass(frozen=True)
class _Text:
    """A description to be read; equal ones, wherever they lie, are read once."""

    digest: bytes
    platforms: tuple[str, ...]
    structure: tuple[tuple[str, int], ...]
    folder: Path = field(compare=False)
    source: str = field(compare=False)


@lru_cache(maxsize=8)
def _described(text: _Text) -> Description:
    data = (text.folder / "modelDescription.xml").read_bytes()
    _refuse_entities(data, text.source)
    raw, notes = _read(text.folder, text.source)
    if text.structure:
        data = with_structure(data, dict(text.structure))
        with scratch("sizes") as folder:
            (folder / "modelDescription.xml").write_bytes(data)
            raw, _ = _read(folder, text.source)
    try:
        more = additions_of(data) if str(raw.fmiVersion).startswith("3") else Additions()
        return _convert(raw, text.platforms, notes, _directional(text.folder), more)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise FmuError(f"{text.source}: modelDescription.xml cannot be understood: {error}") from error


def _refuse_entities(data: bytes, source: str) -> None:
    utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\0" in data[:4]
    if utf16:
        data = data.replace(b"\0", b"")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise FmuError(
            f"{source}: modelDescription.xml declares a document type or entities, which FMI does "
            "not use and XML bombs do; refused"
        )


def _read(folder: Path, source: str) -> tuple[Any, list[str]]:
    """Read with FMPy, first strictly, then leniently with what was bent as notes."""
    try:
        return model_description.read_model_description(str(folder)), []
    except model_description.ValidationError as error:
        problems = [one_line(p) for p in error.problems]
    except Exception as error:  # noqa: BLE001  FMPy raises bare Exception for broken rules
        problems = [one_line(str(error))]
    try:
        raw = model_description.read_model_description(str(folder), validate=False)
    except Exception as error:
        raise FmuError(f"{source}: modelDescription.xml cannot be read: {error}") from error
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return raw, [f"modelDescription.xml violates the FMI standard: {problems[0]}{more}"]


def _directional(folder: Path) -> frozenset[str]:
    """Return the FMI 3.0 interfaces that provide directional derivatives; FMPy drops the attribute."""
    root = etree.parse(str(folder / "modelDescription.xml")).getroot()
    claims = {e.tag: e.get("providesDirectionalDerivatives") for e in root if isinstance(e.tag, str)}
    return frozenset(tag for tag, value in claims.items() if value in ("true", "1"))


def _convert(
    raw: Any, platforms: tuple[str, ...], notes: list[str], directional: AbstractSet[str], more: Additions
) -> Description:
    version = str(raw.fmiVersion)
    depends = _dependencies(raw)
    arrays = {int(v.valueReference): tuple(v.shape) for v in raw.modelVariables if v.shape}
    variables = tuple(s for v in raw.modelVariables for s in _scalars(v, depends, notes))
    states, derivatives = _states(raw, variables, notes)
    return Description(
        fmi_version=version,
        major=int(version.partition(".")[0]),
        model_name=raw.modelName or "unnamed",
        token=raw.guid or "",
        generation_tool=raw.generationTool,
        description=raw.description,
        interfaces=_interfaces(raw, directional, more),
        platforms=platforms,
        experiment=_experiment(raw.defaultExperiment),
        variables=variables,
        states=states,
        derivatives=derivatives,
        state_count=int(raw.numberOfContinuousStates),
        indicator_count=int(raw.numberOfEventIndicators),
        shapes=arrays,
        log_categories=tuple(c.name for c in raw.logCategories if c.name),
        notes=tuple(notes),
        units={plain_unit(u.name): _unit(u) for u in raw.unitDefinitions if u.name},
        enumerations={t.name: _items(t) for t in raw.typeDefinitions if t.items},
        scheduled=more.scheduled,
        clocks=more.clocks,
        clocked=more.clocked,
        intermediate=more.intermediate,
    )


def _unit(raw: Any) -> UnitDefinition:
    display = tuple(DisplayUnit(d.name, float(d.factor), float(d.offset)) for d in raw.displayUnits if d.name)
    base = raw.baseUnit
    if base is None:
        return UnitDefinition(display=display)
    exponents = {name: int(getattr(base, name)) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    return UnitDefinition(exponents, float(base.factor), float(base.offset), display)


def _items(raw: Any) -> dict[str, int]:
    return {item.name: int(item.value) for item in raw.items}


def _interfaces(raw: Any, directional: AbstractSet[str], more: Additions) -> dict[str, Capabilities]:
    found = {}
    for name, element_name, element in (
        ("me", "ModelExchange", raw.modelExchange),
        ("cs", "CoSimulation", raw.coSimulation),
    ):
        if element is not None and element.modelIdentifier:
            made = _capabilities(raw.fmiVersion, name, element, directional=element_name in directional)
            found[name] = replace(
                made,
                adjoint_derivatives=element_name in more.adjoint,
                intermediate_update=element_name in more.updating,
            )
    return found


def _capabilities(version: str, name: str, element: Any, *, directional: bool) -> Capabilities:
    cs = name == "cs"
    return Capabilities(
        identifier=element.modelIdentifier,
        state=bool(element.canGetAndSetFMUstate),
        directional_derivatives=bool(element.providesDirectionalDerivative) or directional,
        # FMPy does not read FMI 1.0's co-simulation capabilities; constant steps would be the
        # cautious reading, but most FMI 1.0 exports take any step.
        variable_step=not cs or version.startswith("1") or bool(element.canHandleVariableCommunicationStepSize),
        interpolates_inputs=cs and version.startswith("2") and bool(element.canInterpolateInputs),
        event_mode=cs and bool(element.hasEventMode),
        completed_step=not cs and (version.startswith("1") or bool(element.needsCompletedIntegratorStep)),
        once_per_process=bool(element.canBeInstantiatedOnlyOncePerProcess),
        needs_tool=bool(element.needsExecutionTool),
    )


def _experiment(raw: Any) -> DefaultExperiment:
    if raw is None:
        return DefaultExperiment()
    return DefaultExperiment(
        start_time=_number(raw.startTime),
        stop_time=_number(raw.stopTime),
        tolerance=_positive(raw.tolerance),
        step=_positive(raw.stepSize),
    )


def _number(text: Any) -> float | None:
    try:
        value = float(text)
    except (TypeError, ValueError):
        return None
    return value if math.isfinite(value) else None


def _positive(text: Any) -> float | None:
    value = _number(text)
    return value if value is not None and value > 0.0 else None


def _dependencies(raw: Any) -> dict[str, tuple[str, ...]]:
    return {
        u.variable.name: tuple(d.name for d in u.dependencies)
        for u in (*raw.outputs, *raw.derivatives)
        if u.dependencies is not None
    }


def _scalars(raw: Any, depends: Mapping[str, tuple[str, ...]], notes: list[str]) -> Iterator[Variable]:
    """Yield the scalars of one declared variable: itself, or the elements of the array."""
    size = int(np.prod(raw.shape)) if raw.shape else 1
    if size > MAX_ELEMENTS:
        raise ValueError(f"array {raw.name} has {size} elements")
    starts = _starts(raw, size, notes)
    for element in range(size):
        yield Variable(
            name=raw.name + _index(raw.shape, element),
            type=raw.type,
            unit=plain_unit(raw.unit or _declared(raw, "unit") or "") or None,
            start=starts[element],
            description=raw.description,
            causality=raw.causality,
            variability=raw.variability,
            minimum=_number(raw.min),
            maximum=_number(raw.max),
            nominal=_nominal(raw),
            value_reference=int(raw.valueReference),
            element=element,
            derivative_of=raw.derivative.name + _index(raw.shape, element) if hasattr(raw.derivative, "name") else None,
            dependencies=depends.get(raw.name),
            initial=raw.initial,
            display_unit=raw.displayUnit or _declared(raw, "displayUnit"),
            declared_type=_declared(raw, "name"),
        )


def _index(shape: tuple[int, ...] | None, element: int) -> str:
    if not shape:
        return ""
    return "[" + ",".join(str(int(i) + 1) for i in np.unravel_index(element, shape)) + "]"


def _declared(raw: Any, attribute: str) -> Any:
    return getattr(raw.declaredType, attribute, None) if raw.declaredType is not None else None


def _nominal(raw: Any) -> float | None:
    value = _number(raw.nominal)
    if value is None:
        value = _number(_declared(raw, "nominal"))
    return abs(value) if value else None


def _starts(raw: Any, size: int, notes: list[str]) -> list[Value | None]:
    if raw.start is None:
        return [None] * size
    convert = _start_reader(raw.type)
    # A string may hold blanks; every other array start is a list separated by them.
    texts = [raw.start] if size == 1 or raw.type == "String" else str(raw.start).split()
    try:
        values: list[Value | None] = [convert(t) for t in texts]
    except ValueError:
        notes.append(f"start value '{raw.start}' of {raw.name} is not a valid {raw.type}; ignored")
        return [None] * size
    if len(values) == 1:
        return values * size
    return values if len(values) == size else [None] * size


def _start_reader(kind: str) -> Callable[[str], Value]:
    if kind in FLOAT_TYPES or kind == "Clock":
        return float
    if kind == "Boolean":
        return _read_boolean
    if kind in ("String", "Binary"):
        return str
    return int


def _read_boolean(text: str) -> bool:
    if text not in ("true", "false", "1", "0"):
        raise ValueError(text)
    return text in ("true", "1")


def _states(
    raw: Any, variables: tuple[Variable, ...], notes: list[str]
) -> tuple[tuple[Variable, ...], tuple[Variable, ...]]:
    """Return states and derivatives in the order of the FMU's state vector."""
    by_name = {v.name: v for v in variables}
    wanted = (
        by_name[u.variable.name + _index(u.variable.shape, e)]
        for u in raw.derivatives
        for e in range(int(np.prod(u.variable.shape)) if u.variable.shape else 1)
    )
    derivatives = tuple(wanted)
    states = []
    for number, derivative in enumerate(derivatives, 1):
        state = by_name.get(derivative.derivative_of or "")
        if state is None:
            notes.append(f"derivative {derivative.name} does not name its state, which is called state[{number}]")
            state = Variable(name=f"state[{number}]")
        states.append(state)
    return tuple(states), derivatives
