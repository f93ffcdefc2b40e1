"""Other sizes of an FMI 3.0 FMU: its description with other values of structural parameters."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.errors import InputError
from workbench.fmi.declared import Declared
from workbench.fmi.description import ModelDescription
from workbench.fmi.variable import Value

__all__ = ["STRUCTURAL", "structural_values", "with_structure"]

STRUCTURAL = "structuralParameter"


def structural_values(description: ModelDescription, values: Mapping[str, Value]) -> dict[str, int]:
    """Return those of the values that are of structural parameters.

    Args:
        description: the FMU's.
        values: name → value.

    Raises:
        InputError: one is not a whole number, or outside what the FMU allows.
    """
    known = {v.name: v for v in description.variables if v.causality == STRUCTURAL}
    result = {}
    for name in known.keys() & values.keys():
        variable = known[name]
        result[name] = _whole(name, values[name])
        lowest, highest = variable.minimum or 0.0, variable.maximum
        if result[name] < lowest or (highest is not None and result[name] > highest):
            most = "" if highest is None else f" and at most {highest:g}"
            raise InputError(f"{name}: the FMU takes at least {lowest:g}{most}, not {result[name]}")
    return result


def _whole(name: str, value: Value) -> int:
    try:
        number = float(value)
    except ValueError:
        number = 0.5
    if not number.is_integer():
        raise InputError(f"{name}: a structural parameter takes a whole number, not '{value}'")
    return int(number)


def with_structure(declared: Declared, values: Mapping[str, int]) -> None:
    """Let structural parameters start with other values.

    Args:
        declared: changed in place.
        values: name → value.
    """
    for variable in declared.variables:
        value = values.get(variable.name or "")
        if variable.causality == STRUCTURAL and value is not None:
            variable.start = str(value)
