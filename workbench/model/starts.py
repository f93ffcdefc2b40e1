"""Start values and biases as they are asked for: names, arrays, items of enumerations, types."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TypeAlias, Union

from workbench.core.records.names_in_text import check_names, plain_unit, split_names
from workbench.core.records.quantity import DecimalCommaError, quantity
from workbench.core.values.conversion import in_other_unit, named_conversion
from workbench.errors import InputError, article, suggest
from workbench.fmi.description import UnitDefinition
from workbench.fmi.variable import FLOAT_TYPES, WHOLE_RANGES, Value, Variable
from workbench.signals.numbers import Meaning

__all__ = ["check_biases", "check_starts", "conversion_to", "elements_of", "in_its_unit"]

_SETTABLE = ("parameter", "structuralParameter", "input", "local", "output")
_NO_TYPES: Mapping[str, Mapping[str, int]] = MappingProxyType({})
_NO_UNITS: Mapping[str, UnitDefinition] = MappingProxyType({})
_Nested: TypeAlias = Union[str, "list[_Nested]"]


def elements_of(name: str, variables: Mapping[str, Variable]) -> tuple[str, ...]:
    """Return the names of an array's elements, the last index running first; empty where there is no such array.

    Args:
        name: of the whole array.
        variables: by name.
    """
    return tuple(n for n in variables if n.startswith(f"{name}[")) if name not in variables else ()


def check_starts(
    values: Mapping[str, Value],
    variables: Mapping[str, Variable],
    enumerations: Mapping[str, Mapping[str, int]] = _NO_TYPES,
    units: Mapping[str, UnitDefinition] = _NO_UNITS,
    *,
    what: str = "",
) -> dict[str, Value]:
    """Return start values in their variables' types, arrays element by element.

    Args:
        values: name → value; that of a whole array is a text such as "[1, 2]" or "[[1, 2], [3, 4]]", of an enumeration
            the name or the number of an item; a number with a unit, such as "20degC", is converted.
        variables: by name.
        enumerations: type → item → value.
        units: what the FMU defines about its units, by name.
        what: the option that has them; empty: messages do not say it.

    Raises:
        InputError: no such variable, it cannot be set, the value is not of its type, or its unit does not fit.
    """
    if what:
        try:
            return check_starts(values, variables, enumerations, units)
        except InputError as error:
            raise InputError(f"{what}: {error}") from None
    result: dict[str, Value] = {}
    for name, value in values.items():
        elements = elements_of(name, variables)
        for one, part in _parts(name, value, elements).items() if elements else ((name, value),):
            own = own_name(one, variables)
            if own in result:
                by = "by another name" if own != one else "with the whole array"
                raise InputError(f"{own} is set twice: by itself, and {by}")
            result[own] = _start(own, part, variables, enumerations, units)
    return result


def own_name(name: str, variables: Mapping[str, Variable]) -> str:
    """Return the name of the variable of which `name` is another name; `name` itself where it is none."""
    variable = variables.get(name)
    return name if variable is None else variable.alias_of or name


def _parts(name: str, value: Value, elements: Sequence[str]) -> dict[str, Value]:
    """Return element → value of a whole array."""
    shape = tuple(int(i) for i in elements[-1].rpartition("[")[2].rstrip("]").split(","))
    size = " × ".join(map(str, shape))
    text = str(value).strip()
    if not text.startswith("["):
        raise InputError(f"{name}: this is an array of {size} elements; write {name}=[…], or {elements[0]}={value}")
    given = _nested(text)
    if _shape(given) not in (shape, (math.prod(shape),)):
        shape_given = " × ".join(map(str, _shape(given)))
        raise InputError(f"{name}: this is an array of {size} elements, not {shape_given}")
    return dict(zip(elements, _flat(given), strict=True))


def _nested(text: str) -> _Nested:
    text = text.strip()
    return [_nested(part) for part in split_names(text[1:-1])] if text[:1] == "[" and text[-1:] == "]" else text


def _shape(given: _Nested) -> tuple[int, ...]:
    """Return the extents; (0,) in place of those that are not alike."""
    if isinstance(given, str):
        return ()
    inner = {_shape(part) for part in given}
    return (len(given), *inner.pop()) if len(inner) == 1 else (0,)


def _flat(given: _Nested) -> list[str]:
    return [given] if isinstance(given, str) else [text for part in given for text in _flat(part)]


def _start(
    name: str,
    value: Value,
    variables: Mapping[str, Variable],
    enumerations: Mapping[str, Mapping[str, int]],
    units: Mapping[str, UnitDefinition],
) -> Value:
    check_names([name], variables, kinds=("variable",))
    variable = variables[name]
    if variable.causality not in _SETTABLE or variable.variability == "constant":
        raise InputError(f"{name}: a {variable.variability} {variable.causality} cannot be set")
    if variable.type in ("Binary", "Clock"):
        raise InputError(f"{name}: this is {article(variable.type)}, which cannot be set; leave it out")
    items = enumerations.get(variable.declared_type or "", {}) if variable.type == "Enumeration" else {}
    if isinstance(value, str) and value in items:
        return items[value]
    try:
        if isinstance(value, str) and variable.type in FLOAT_TYPES:
            value = in_its_unit(variable, value, units)
        number = _as_type(variable, value)
        if items and number not in items.values():
            raise ValueError(value)
        return number
    except (DecimalCommaError, InputError) as error:
        raise InputError(f"{name}: {error}") from None
    except (OverflowError, TypeError, ValueError):  # the first of a whole number that no float can be
        if items:
            raise InputError(f"{name}: its enumeration has no item '{value}'; {suggest(str(value), items)}") from None
        known = "; known: false, true" if variable.type == "Boolean" else ""
        raise InputError(f"{name}: '{value}' is not a value that {article(variable.type)} can have{known}") from None


def in_its_unit(
    variable: Variable, value: float | str, units: Mapping[str, UnitDefinition], meaning: Meaning = "level"
) -> float:
    """Return a number in the variable's unit of one that may be given in another, as in "2deg".

    Args:
        variable: whose value it is.
        value: a number, or a text.
        units: what the FMU defines about its units, by name.
        meaning: level: a value; change: a difference of two, which is converted by the factor alone; height: one or
            the other, so that a zero that lies elsewhere would leave open what is meant.

    Raises:
        InputError: the unit does not fit; the message does not name the variable.
        ValueError: it is not a number.
    """
    number, given = quantity(value)
    if not given or given == variable.unit:
        return number
    if variable.unit is None:
        raise InputError(f"it has no unit; give a plain number in place of '{value}'")
    result = conversion_to(variable, given, units)
    if result is None:
        cases = (given.lower(), f"{given[:-1].lower()}{given[-1].upper()}", given.capitalize())  # rad, degC, Hz
        near = next((unit for unit in cases if conversion_to(variable, unit, units)), None)
        remedy = f"did you mean {near}?" if near else "give a number in that, or a unit that does"
        raise InputError(f"'{given}' does not convert to its unit, {variable.unit}; {remedy}")
    factor, offset = result
    if meaning == "height" and offset:
        raise InputError(
            f"{value} may be a value or a difference, since the zeros of {given} and {variable.unit} differ; give it "
            f"in {variable.unit}"
        )
    return in_other_unit(number, (factor, 0.0 if meaning == "change" else offset))


def conversion_to(variable: Variable, given: str, units: Mapping[str, UnitDefinition]) -> tuple[float, float] | None:
    """Return factor and offset that turn a value in a given unit into one in a variable's; None: there are none.

    Args:
        variable: that has a unit.
        given: the unit's name: a display unit of the FMU, or any that is known.
        units: what the FMU defines about its units, by name.
    """
    own = units.get(variable.unit or "", UnitDefinition())
    for shown in own.display:
        if plain_unit(shown.name) == plain_unit(given) and shown.factor:
            return 1.0 / shown.factor, -shown.offset / shown.factor
    known = {name: unit for name, defined in units.items() if (unit := defined.unit(name)) is not None}
    return named_conversion(given, variable.unit or "", known)


def _as_type(variable: Variable, value: Value) -> Value:
    """Return `value` as the variable's type; raises ValueError if it cannot be that."""
    if variable.type == "String":
        return str(value)
    if variable.type == "Boolean":
        return _as_boolean(value)
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(value)
    if variable.type in FLOAT_TYPES:
        return number
    if number != int(number):
        raise ValueError(value)
    whole = int(value) if isinstance(value, int | str) and "." not in str(value) else int(number)
    least, largest = WHOLE_RANGES.get(variable.type, (whole, whole))
    if not least <= whole <= largest:
        raise ValueError(value)
    return whole


def _as_boolean(value: Value) -> bool:
    text = str(value).lower()
    if text not in ("true", "false", "1", "0", "1.0", "0.0"):
        raise ValueError(value)
    return text in ("true", "1", "1.0")


def check_biases(
    bias: Mapping[str, float | str],
    variables: Mapping[str, Variable],
    units: Mapping[str, UnitDefinition] = _NO_UNITS,
) -> dict[str, float]:
    """Return the biases, in the units of their inputs.

    Args:
        bias: input → number, or a text with a unit, such as "2deg".
        variables: by name.
        units: what the FMU defines about its units, by name.

    Raises:
        InputError: no such real input, the value is not finite, or its unit does not fit.
    """
    result = {}
    bias = {own_name(name, variables): value for name, value in bias.items()}
    inputs = {n: v for n, v in variables.items() if v.causality == "input"}
    check_names(bias, inputs, kinds=("input",), what="bias", others={n: v.causality for n, v in variables.items()})
    for name, value in bias.items():
        if inputs[name].type not in FLOAT_TYPES:
            raise InputError(f"bias: input '{name}' is a {inputs[name].type}; only real inputs take a bias")
        try:
            result[name] = in_its_unit(inputs[name], value, units, "height")
        except (InputError, ValueError) as error:
            raise InputError(f"bias: {name}: {error}") from None
        if not math.isfinite(result[name]):
            raise InputError(f"bias: {name} must be a finite number, not {value}")
    return result
