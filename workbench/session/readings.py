"""Values of variables, as numbers that can be recorded."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from workbench.core.records.names_in_text import check_names
from workbench.errors import InputError, SimulationError
from workbench.fmi.access import VariableAccess
from workbench.fmi.variable import Variable

__all__ = ["find", "read_finite"]


def find(names: Sequence[str], variables: Mapping[str, Variable]) -> list[Variable]:
    """Return the variables called `names`; each must stand for a number.

    Raises:
        InputError: unknown name, or a text.
    """
    check_names(names, variables, kinds=("variable",))
    result = []
    for name in names:
        if not (variables[name].is_number or variables[name].type == "Clock"):  # whose ticks are counted
            raise InputError(f"'{name}' is a {variables[name].type}; only numbers can be recorded")
        result.append(variables[name])
    return result


def read_finite(access: VariableAccess, variables: Sequence[Variable], time: float) -> list[float]:
    """Return the values of a prepared access, each finite.

    Raises:
        SimulationError: one is not; the message names it.
    """
    values: list[float] = access.read()
    if not math.isfinite(sum(values)):
        for variable, value in zip(variables, values, strict=True):
            if not math.isfinite(value):
                raise SimulationError(f"{variable.name} is {value:g}, not a finite number", time=time)
    return values
