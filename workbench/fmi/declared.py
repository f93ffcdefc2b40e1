"""What is read of a modelDescription.xml: one class an element, one field an attribute; nothing else reads the file.

A field is filled from the attribute of its own name in FMI's spelling (`value_reference` from `valueReference`), or
from those that `written` gives where the versions of FMI spell it differently; its type says how the text is read. A
new attribute is one line here.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any

from workbench.errors import FmuError

__all__ = [
    "Alias",
    "BaseUnit",
    "Category",
    "ClockVariable",
    "Declared",
    "DeclaredDisplayUnit",
    "DeclaredExperiment",
    "DeclaredType",
    "DeclaredUnit",
    "DeclaredVariable",
    "Dimension",
    "Interface",
    "Item",
    "Root",
    "Start",
    "Unknown",
    "fill",
]


Word = str  # one of few, which many elements share


def written(*names: str) -> Mapping[str, tuple[str, ...]]:
    """Return the metadata of a field that stands in the file under one of these names; none: it is not an attribute."""
    return {"written": names}


@dataclass(slots=True)
class Root:
    """The document itself; in FMI 1.0 also what its interface is."""

    fmi_version: str = ""
    model_name: str | None = None
    token: str | None = field(default=None, metadata=written("guid", "instantiationToken"))
    description: str | None = None
    generation_tool: str | None = None
    variable_naming_convention: str = "flat"
    model_identifier: str | None = None
    number_of_continuous_states: int = 0
    number_of_event_indicators: int = 0


@dataclass(slots=True)
class Interface:
    """ModelExchange, CoSimulation, ScheduledExecution; the Capabilities of FMI 1.0."""

    model_identifier: str | None = None
    needs_execution_tool: bool = False
    can_be_instantiated_only_once_per_process: bool = False
    state: bool | None = field(default=None, metadata=written("canGetAndSetFMUstate", "canGetAndSetFMUState"))
    directional_derivatives: bool | None = field(
        default=None, metadata=written("providesDirectionalDerivative", "providesDirectionalDerivatives")
    )
    provides_adjoint_derivatives: bool = False
    provides_intermediate_update: bool = False
    completed_integrator_step_not_needed: bool = False
    needs_completed_integrator_step: bool = False
    can_handle_variable_communication_step_size: bool | None = None
    can_interpolate_inputs: bool = False
    has_event_mode: bool = False
    fixed_internal_step_size: float | None = None


@dataclass(slots=True)
class DeclaredExperiment:
    """DefaultExperiment."""

    start_time: float | None = None
    stop_time: float | None = None
    tolerance: float | None = None
    step_size: float | None = None


@dataclass(slots=True)
class Category:
    """A category of log messages."""

    name: str | None = None


@dataclass(slots=True)
class BaseUnit:
    """What a unit is made of: exponents of the base units."""

    kg: int | None = field(default=None, metadata=written("kg"))
    m: int | None = field(default=None, metadata=written("m"))
    s: int | None = field(default=None, metadata=written("s"))
    A: int | None = field(default=None, metadata=written("A"))
    K: int | None = field(default=None, metadata=written("K"))
    mol: int | None = field(default=None, metadata=written("mol"))
    cd: int | None = field(default=None, metadata=written("cd"))
    rad: int | None = field(default=None, metadata=written("rad"))
    factor: float | None = None
    offset: float | None = None


@dataclass(slots=True)
class DeclaredDisplayUnit:
    """A unit in which values of another may be shown; DisplayUnitDefinition in FMI 1.0."""

    name: str | None = field(default=None, metadata=written("name", "displayUnit"))
    factor: float | None = field(default=None, metadata=written("factor", "gain"))
    offset: float | None = None


@dataclass(slots=True)
class DeclaredUnit:
    """A unit; in FMI 1.0 its name alone is known."""

    name: str | None = field(default=None, metadata=written("name", "unit"))
    base: list[BaseUnit] = field(default_factory=list, metadata=written())
    display: list[DeclaredDisplayUnit] = field(default_factory=list, metadata=written())


@dataclass(slots=True)
class Item:
    """An item of an enumeration; FMI 1.0 numbers them by their order, from 1."""

    name: str | None = None
    value: int | None = None


@dataclass(slots=True)
class DeclaredType:
    """A type that variables may be declared to be of.

    Attributes:
        kind: "Real", "Enumeration", "Float64", …
        items: of an enumeration.
    """

    kind: str = field(default="", metadata=written())
    name: str | None = None
    unit: Word | None = None
    display_unit: Word | None = None
    min: float | None = None
    max: float | None = None
    nominal: float | None = None
    items: list[Item] = field(default_factory=list, metadata=written())


@dataclass(slots=True)
class Dimension:
    """One extent of an array: a number, or the variable that holds it."""

    start: int | None = None
    value_reference: int | None = None


@dataclass(slots=True)
class Alias:
    """Another name of a variable (FMI 3.0)."""

    name: str | None = None
    description: str | None = None
    display_unit: Word | None = None


@dataclass(slots=True)
class Start:
    """The start value of a string or binary variable (FMI 3.0), one for each element."""

    value: str | None = None


@dataclass(slots=True)
class DeclaredVariable:
    """A variable; in FMI 1.0 and 2.0 together with the element of its type.

    Attributes:
        kind: "Real", "Boolean", "Float64", …; empty: the file does not say.
        line: where it stands.
    """

    kind: str = field(default="", metadata=written())
    line: int = field(default=0, metadata=written())
    name: str | None = None
    value_reference: int | None = None
    description: str | None = None
    causality: Word | None = None
    variability: Word | None = None
    initial: Word | None = None
    declared_type: Word | None = None
    unit: Word | None = None
    display_unit: Word | None = None
    min: float | None = None
    max: float | None = None
    nominal: float | None = None
    start: str | None = None
    derivative: int | None = None
    alias: Word | None = None
    clocks: tuple[int, ...] = ()
    intermediate_update: bool = False
    dimensions: list[Dimension] | None = field(default=None, metadata=written())
    aliases: list[Alias] | None = field(default=None, metadata=written())
    starts: list[Start] | None = field(default=None, metadata=written())


@dataclass(slots=True)
class ClockVariable(DeclaredVariable):
    """A clock (FMI 3.0); what is counted is counted in ticks of 1 / `resolution` seconds."""

    interval_variability: Word | None = None
    interval_decimal: float | None = None
    shift_decimal: float | None = None
    resolution: float | None = None
    interval_counter: float | None = None
    shift_counter: float | None = None


@dataclass(slots=True)
class Unknown:
    """An entry of the model structure; `variable` and `dependencies` count variables (FMI 2.0) or are references (3.0).

    Attributes:
        line: where it stands.
    """

    line: int = field(default=0, metadata=written())
    variable: int | None = field(default=None, metadata=written("index", "valueReference"))
    dependencies: tuple[int, ...] | None = None
    dependencies_kind: str | None = None


@dataclass(slots=True)
class Declared:
    """A whole description, as it stands in the file.

    Attributes:
        root: the document's attributes.
        interfaces: element → what it says; FMI 1.0: "CoSimulation" or "ModelExchange", by what there is.
        experiment: the default experiment; None: not declared.
        categories, units, types, variables: in the file's order.
        structure: "Outputs", "Derivatives", "ClockedStates", "InitialUnknowns", "EventIndicators" → entries; FMI 3.0's
            elements are called so here, too.
        problems: where the file leaves the schema that the standard publishes.
        lost: those of `problems` that hide what a variable is: its causality, type, value reference and the like.
    """

    root: Root = field(default_factory=Root)
    interfaces: dict[str, Interface] = field(default_factory=dict)
    experiment: DeclaredExperiment | None = None
    categories: list[Category] = field(default_factory=list)
    units: list[DeclaredUnit] = field(default_factory=list)
    types: list[DeclaredType] = field(default_factory=list)
    variables: list[DeclaredVariable] = field(default_factory=list)
    structure: dict[str, list[Unknown]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)

    @property
    def major(self) -> int:
        """The version of FMI: 1, 2 or 3."""
        return int(self.root.fmi_version[0])


# -- reading attributes ------------------------------------------------------------------------


def _text(text: str) -> str:
    return text


def _flag(text: str) -> bool:
    return text in ("true", "1")


def _number(text: str) -> float | None:
    """Return a finite number; bounds and nominal values that are none are not there."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _whole(text: str) -> int:
    if len(text) > LONGEST:
        raise ValueError
    return int(text)


def _list(text: str) -> tuple[int, ...]:
    return tuple(_whole(word) for word in text.split())


LONGEST = 20  # digits of any number that FMI counts with

# How the text of an attribute is read, by the type of its field.
_READERS: Mapping[str, Callable[[str], Any]] = {
    "str": _text,
    "Word": sys.intern,
    "bool": _flag,
    "float": _number,
    "int": _whole,
    "tuple[int, ...]": _list,
}


def fill(made: Any, attributes: Iterable[tuple[str, str]], line: int) -> None:
    """Set the fields of an object of this module from an element's attributes; others are passed over.

    Args:
        made: the object.
        attributes: name and text of each.
        line: where the element stands, for the message.

    Raises:
        FmuError: what must be a whole number is not.
    """
    known = _KNOWN[type(made)]
    for name, text in attributes:
        entry = known.get(name)
        if entry is not None:
            try:
                setattr(made, entry[0], entry[1](text))
            except ValueError:
                raise FmuError(f'line {line}: {name}="{text[:60]}" is not a whole number') from None


def _names(entry: Field[Any]) -> tuple[str, ...]:
    given: tuple[str, ...] | None = entry.metadata.get("written")
    if given is not None:
        return given
    first, *more = entry.name.split("_")
    return (first + "".join(word.capitalize() for word in more),)


# Class → attribute → (field, reader).
_KNOWN: Mapping[type[Any], Mapping[str, tuple[str, Callable[[str], Any]]]] = {
    kind: {
        name: (entry.name, _READERS[str(entry.type).removesuffix(" | None")])
        for entry in fields(kind)
        for name in _names(entry)
    }
    for kind in (
        Root, Interface, DeclaredExperiment, Category, BaseUnit, DeclaredDisplayUnit, DeclaredUnit, Item, DeclaredType,
        Dimension, Alias, Start, DeclaredVariable, ClockVariable, Unknown,
    )
}  # fmt: skip
