"""The values a session is asked to start at: which can be set when, and whether they took."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.records.names_in_text import check_names
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Value, Variable
from workbench.session.evaluated_point import named_states
from workbench.session.forcing import convert, fitting

__all__ = [
    "COMPUTED",
    "RELATIVE",
    "Miss",
    "NotReachedError",
    "StartPoint",
    "check_values",
    "in_words",
    "misses",
    "starts_of",
    "unkept_in_words",
]

RELATIVE = 1e-6  # an FMU that computes in single precision gives a value back within 6e-8
AT_ZERO = 1e-13  # nominal values: what rounding leaves where 0 was asked for
COMPUTED = 1e-9  # the same where something was computed: a difference of other values, the end of a run


class NotReachedError(InputError):
    """A session does not start where it was asked to; `message` names the variables."""


@dataclass(frozen=True)
class Miss:
    """A value that did not take.

    Attributes:
        name: of the variable.
        asked: the value asked for.
        found: the value that the model has instead.
    """

    name: str
    asked: Value
    found: Value

    def __str__(self) -> str:
        return f"{self.name} is {_shown(self.found)}, not {_shown(self.asked)}"


def _shown(value: Value) -> str:
    if isinstance(value, bool | str):
        return str(value).lower() if isinstance(value, bool) else f"'{value}'"
    return f"{value + 0.0:.9g}"  # no -0


def in_words(result: Sequence[Miss]) -> str:
    """Return the first of them in full and how many more there are."""
    more = f" (and {len(result) - 1} more: {', '.join(m.name for m in result[1:5])})" if len(result) > 1 else ""
    return f"{result[0]}{more}"


def unkept_in_words(result: Sequence[Miss]) -> str:
    """Return what of the declared start values an FMU has otherwise: the first in full, and how many more there are."""
    first, others = result[0], [m.name for m in result[1:]]
    more = f" (and {len(others)} more: {', '.join(others[:4])}{', …' if others[4:] else ''})" if others else ""
    says = f"the description says start {_shown(first.asked)}"
    return f"{first.name}: {says}, the FMU has {_shown(first.found)} until it is set{more}"


def misses(
    instance: Instance,
    variables: Sequence[Variable],
    wanted: Mapping[str, Value],
    *,
    near: float = AT_ZERO,
    sizes: Mapping[str, float] | None = None,
) -> list[Miss]:
    """Return those of `variables` that do not have the values asked for.

    Args:
        instance: initialised.
        variables: to read.
        wanted: name → value.
        near: how far from 0 a value may be where 0 was asked for [sizes, else nominal values].
        sizes: name → magnitude.
    """
    known = sizes or {}
    if not variables:
        return []
    result = instance.access(variables).read()
    return [
        Miss(v.name, fitting(v, wanted[v.name]), value)
        for v, value in zip(variables, result, strict=True)
        if not _took(v, wanted[v.name], value, near * (known.get(v.name) or v.nominal or 1.0))
    ]


def _took(variable: Variable, wanted: Value, result: Value, near: float) -> bool:
    if isinstance(wanted, str) or isinstance(result, str):
        return str(wanted) == str(result)
    if not math.isfinite(result):
        return False
    # Where a value is tiny for its variable, rounding of larger terms may be all that it is.
    small = near if variable.causality != "parameter" or wanted == 0.0 else 0.0
    return abs(result - wanted) <= RELATIVE * abs(wanted) + small


def starts_of(variables: Mapping[str, Variable], values: Mapping[str, float]) -> dict[str, Value]:
    """Return start values in their variables' types, those alone that the FMU lets one set."""
    known = {n: variables[n] for n in values if n in variables}
    settable = {n: float(values[n]) for n, v in known.items() if v.start is not None or v.causality == "input"}
    return {n: convert(variables[n], v) for n, v in settable.items()}


class StartPoint:
    """An operating point that one instance is taken to.

    Continuous states are set after initialisation, in model exchange: initial equations cannot override them there.
    Discrete states can be set before initialisation alone. Inputs can be set at any time.

    Args:
        instance: initialised.
        variables: name → variable, all of the model's.
        values: states, discrete states and inputs → where to start.
        outputs: what the model shows there, where it is known.

    Attributes:
        near: how far from 0 a state may be where 0 was asked for [sizes, else nominal values].
        sizes: state or output → its magnitude, where it is known.

    Raises:
        InputError: an unknown name.
    """

    def __init__(
        self,
        instance: Instance,
        variables: Mapping[str, Variable],
        values: Mapping[str, float],
        outputs: Mapping[str, float],
    ) -> None:
        self.values = {name: float(value) for name, value in values.items()}
        self._outputs = {name: float(value) for name, value in outputs.items()}
        self.near = AT_ZERO
        self.sizes: Mapping[str, float] = {}
        self._instance = instance
        # In co-simulation a state is a variable like others, or not shown at all.
        states = instance.description.states if instance.interface == "cs" else named_states(instance)
        shown = [v.name for v in states if v.name in variables or instance.interface == "me"]
        self._positions = {name: i for i, name in enumerate(shown)}
        _check_names(self.values, variables, self._positions)
        _check_names(self._outputs, variables, ())
        self.outputs = [variables[n] for n in self._outputs]
        known = [variables[n] for n in self.values if n in variables]
        self.inputs = [v for v in known if v.causality == "input"]
        self.states = [v for v in known if v.name in self._positions]
        self.others = [v for v in known if v.causality != "input" and v.name not in self._positions]

    def missed_states(self) -> list[Miss]:
        """Return the states that are not where they are asked to be."""
        result = misses(self._instance, self.states, self.values, near=self.near, sizes=self.sizes)
        named = {v.name for v in self.states}
        unnamed = {n: i for n, i in self._positions.items() if n in self.values and n not in named}
        if unnamed:
            self._instance.get_states()
            x = self._instance.x
            plain = ((Variable(n), self.values[n], float(x[i])) for n, i in unnamed.items())
            result += [
                Miss(v.name, request, value) for v, request, value in plain if not _took(v, request, value, self.near)
            ]
        return result

    def missed(self, some: Iterable[Variable]) -> list[Miss]:
        """Return those of `some` that do not have the values asked for."""
        return misses(self._instance, list(some), self.values)

    def missed_outputs(self) -> list[Miss]:
        """Return the outputs that are not what they are at the point, to the error of what has been computed."""
        return misses(self._instance, self.outputs, self._outputs, near=COMPUTED, sizes=self.sizes)

    def moved(self, x: Floats, u: Floats, inputs: Sequence[Variable]) -> tuple[Floats, Floats]:
        """Return states, shape (n,), and `inputs`, shape (m,), with those asked for in their place."""
        wanted = self.values
        states = [wanted.get(name, value) for name, value in zip(self._positions, x.tolist(), strict=True)]
        forced = [wanted.get(v.name, value) for v, value in zip(inputs, u.tolist(), strict=True)]
        return np.array(states, dtype=np.float64), np.array(forced, dtype=np.float64)

    def refuse(self, result: Sequence[Miss], remedy: str) -> None:
        """Raise an error if anything was missed.

        Raises:
            NotReachedError: something was.
        """
        if result:
            name = self._instance.description.model_name
            raise NotReachedError(f"{name}: cannot be started at this operating point: {in_words(result)}; {remedy}")


def _check_names(values: Iterable[str], variables: Mapping[str, Variable], states: Iterable[str]) -> None:
    check_names(values, {*variables, *states}, kinds=("variable",), what="operating point")


def check_values(values: Mapping[str, float], variables: Mapping[str, Variable]) -> None:
    """Refuse values that their variables cannot have.

    Raises:
        InputError: not finite, or not of the variable's type.
    """
    for name, value in values.items():
        if not math.isfinite(value):
            raise InputError(f"operating point: {name} must be a finite number, not {value}")
        variable = variables.get(name)
        if variable is None:
            continue
        if not variable.is_number:
            raise InputError(f"operating point: {name} is a {variable.type}; only numbers can be given")
        if abs(float(convert(variable, value)) - value) > RELATIVE * abs(value):
            raise InputError(f"operating point: {name} is of type {variable.type} and cannot be {value:.9g}")
