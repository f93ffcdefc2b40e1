"""Values of SSP parameter sets as values of FMU variables: units, enumerations and types converted."""

from __future__ import annotations

import math
from collections.abc import Mapping

from workbench.core.values.conversion import Unit, named_conversion
from workbench.errors import InputError, suggest
from workbench.fmi.variable import FLOAT_TYPES, Value, Variable
from workbench.system.files.ssp_parameters import Parameter
from workbench.system.fmu_facts import FmuInterface

__all__ = ["values_for"]

_TRUTH = {"true": True, "1": True, "false": False, "0": False}


def values_for(name: str, parameter: Parameter, facts: FmuInterface, unit: str | None) -> dict[str, Value]:
    """Return variable → value for one entry of a parameter set; the elements of an array, if `name` is one.

    Args:
        name: as the FMU names it.
        parameter: what the set says.
        facts: about the FMU.
        unit: of the variable; None: none known.

    Returns:
        Empty where the FMU has no such variable.

    Raises:
        InputError: the value does not fit the variable's type or unit.
    """
    texts = parameter.texts
    if name in facts.variables:
        return {name: _value(parameter, " ".join(texts), facts.variables[name], facts, unit)}
    elements = [v for v in facts.variables.values() if v.name.startswith(f"{name}[")]
    whole = " ".join(texts)
    if elements and whole.startswith("[") and whole.endswith("]"):  # of our own: arrays of sizes that are set
        return {name: whole}
    if not elements or len(texts) not in (1, len(elements)):
        return {}
    spread = texts if len(texts) == len(elements) else texts * len(elements)
    return {v.name: _value(parameter, t, v, facts, unit) for v, t in zip(elements, spread, strict=True)}


def _value(parameter: Parameter, text: str, variable: Variable, facts: FmuInterface, unit: str | None) -> Value:
    where = f"{parameter.where}: {variable.name}"
    if variable.type == "Binary" or parameter.type == "Binary":
        raise InputError(f"{where}: binary values are not read")
    if variable.type == "String":
        return text
    try:
        if variable.type == "Boolean":
            return _TRUTH[text.strip().lower()]
        if variable.type == "Enumeration":
            return _item(parameter, text, facts.items.get(variable.name, {}))
        return _number(parameter, text, variable, facts.units, unit)
    except (KeyError, ValueError) as error:
        raise InputError(f"{where}: '{text}' is not a value of a {variable.type}{_hint(error)}") from None


def _hint(error: Exception) -> str:
    return f"; {error}" if isinstance(error, _ItemError) else ""


class _ItemError(ValueError):
    """An item that the enumeration does not have; holds the near names."""


def _item(parameter: Parameter, text: str, items: Mapping[str, int]) -> int:
    known = items or parameter.enumerations.get(parameter.enumeration or "", {})
    if text in known:
        return known[text]
    if known and not text.lstrip("-").isdigit():
        raise _ItemError(suggest(text, known))
    return int(text)


def _number(
    parameter: Parameter,
    text: str,
    variable: Variable,
    definitions: Mapping[str, Unit],
    unit: str | None,
) -> float | int:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(text)
    factor, offset = _conversion(parameter, variable, definitions, unit)
    number = parameter.factor * (factor * number + offset) + parameter.offset
    if variable.type in FLOAT_TYPES:
        return number
    if number != int(number):
        raise ValueError(text)
    return int(text) if text.lstrip("+-").isdigit() and number == float(text) else int(number)


def _conversion(
    parameter: Parameter,
    variable: Variable,
    definitions: Mapping[str, Unit],
    unit: str | None,
) -> tuple[float, float]:
    given = parameter.unit
    if not parameter.convert or given is None or unit is None or given == unit:
        return 1.0, 0.0
    result = named_conversion(given, unit, parameter.units, {**parameter.units, **definitions})
    if result is None:
        raise InputError(
            f"{parameter.where}: {variable.name}: the value is in {given}, the variable in {unit}, which cannot be "
            "converted"
        )
    return result
