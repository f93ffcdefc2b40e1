"""Whether a model has the variables that an analysis is asked about: the one place for "no such input"."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

from workbench.core.records.names_in_text import check_names
from workbench.core.records.option import EACH, DeclaredOption
from workbench.core.records.quantity import Quantity
from workbench.core.values.conversion import in_other_unit
from workbench.errors import InputError, suggest
from workbench.fmi.description import UnitDefinition
from workbench.fmi.variable import NEGATED, Variable
from workbench.model.base import Model
from workbench.model.described_model import DescribedModel
from workbench.model.starts import conversion_to, in_its_unit
from workbench.signals.kinds import Signal, Step, Table, levels_of
from workbench.signals.numbers import Numbers
from workbench.signals.text import signals_of

if TYPE_CHECKING:
    from workbench.signals.text import Signals

__all__ = [
    "Kind",
    "by_own_names",
    "check_variables",
    "declared_units",
    "forced_inputs",
    "found_variables",
    "in_own_units",
    "variables_of",
]

Kind = Literal["input", "output", "state", "parameter", "variable"]

_KINDS: tuple[Kind, ...] = ("input", "output", "state", "parameter")


def check_variables(model: Model, names: Collection[str], *kinds: Kind, what: str, number: bool = False) -> None:
    """Refuse names that are not variables of a model of these kinds.

    Args:
        model: whose they should be.
        names: as they were given.
        kinds: what they may be; "variable" is anything that the model describes.
        what: the option that has the names, in messages.
        number: whether the variables must be numbers.

    Raises:
        InputError: one is not; the message has near names, or says what it is instead.
    """
    accepted = [v.name for kind in kinds for v in _of(model, kind) if v.is_number or not number]
    negated = {v.name for kind in kinds for v in _of(model, kind) if v.type.startswith(NEGATED)}
    for name in names:
        if name in negated:
            words = f"'{name}' of {model.name} is minus another variable, and only listed; use the other one"
            raise InputError(f"{what}: {words}" if what else words)
        whole, bracket, _ = name.rpartition("[")
        if bracket and name not in accepted and whole in accepted:
            words = f"'{whole}' of {model.name} is not an array, and takes one number or signal"
            over_time = (
                "; values over time are a table: wb.Table(times, values), or a CSV file" if "input" in kinds else ""
            )
            raise InputError(f"{what}: {words}{over_time}" if what else words)
        if elements := _elements(name, accepted):
            words = f"'{name}' of {model.name} is an array; name an element, {elements[0]} … {elements[-1]}"
            raise InputError(f"{what}: {words}" if what else words)
    others = {v.name: kind for kind in reversed(_KINDS) if kind not in kinds for v in _of(model, kind)}
    shown: tuple[Kind, ...] = ("parameter", "output", "state") if "parameter" in kinds else ("output", "state")
    first = {f"{kind}s": [v.name for v in _of(model, kind)] for kind in shown if "variable" in kinds}
    check_names(names, accepted, kinds=kinds, what=what, model=model.name, others=others, first=first)


def found_variables(model: Model, names: Iterable[str], *kinds: Kind, what: str) -> list[str]:
    """Return names, each once, whole arrays as their elements.

    Args:
        model: whose variables they should be.
        names: as they were given.
        kinds: see `check_variables`.
        what: the option that has the names, in messages.

    Raises:
        InputError: see `check_variables`.
    """
    accepted = [v.name for kind in kinds for v in _of(model, kind)]
    result = [one for name in names for one in (_elements(name, accepted) or [name])]
    check_variables(model, result, *kinds, what=what)
    return list(dict.fromkeys(result))


_TRUTH: Mapping[str, int] = {"false": 0, "true": 1}


def variables_of(model: Model) -> dict[str, Variable]:
    """Return all variables that a model tells of, by name."""
    return {v.name: v for v in (*model.parameters, *model.states, *_of(model, "variable"))}


def declared_units(model: Model, names: Iterable[str]) -> dict[str, str | None]:
    """Return the units of variables by name; None: it has none, as have states that FMI 1 does not name."""
    known = {name: variable.unit for name, variable in variables_of(model).items()}
    return {name: known.get(name) for name in names}


def forced_inputs(model: Model, given: Signals, *, what: str = "inputs") -> dict[str, Signal]:
    """Return the signals that force a model's inputs, with the names of values that they have there.

    Items of an enumeration, true and false may stand for numbers. Between two of them nothing lies, so a table that
    forces such an input is a staircase.

    Args:
        model: whose inputs they are.
        given: input → signal, as `signals_of` takes it.
        what: the option that has them, in messages.

    Raises:
        InputError: no such input, not a signal, or a value that the input's enumeration does not have.
    """
    units = _units(model)

    def numbers(name: str) -> Numbers:
        check_variables(model, [name], "input", what=what)
        return Numbers(items[name], lambda text, meaning: in_its_unit(inputs[name], text, units, meaning))

    inputs = {v.name: v for v in model.inputs}
    items = {name: _items(model, v) for name, v in inputs.items()}
    result = signals_of(given, numbers)
    check_variables(model, result, "input", what=what)
    own = {name: _converted(inputs[name], signal, units) for name, signal in result.items()}
    return {name: _stepwise(inputs[name], signal, items[name]) for name, signal in own.items()}


def _converted(variable: Variable, signal: Signal, units: Mapping[str, UnitDefinition]) -> Signal:
    """Return a table in the unit of the input that it forces; an input without a unit takes numbers as they are."""
    if not isinstance(signal, Table) or signal.unit is None:
        return signal
    values = signal.values
    if variable.unit and signal.unit != variable.unit:
        result = conversion_to(variable, signal.unit, units)
        if result is None:
            raise InputError(
                f"input {variable.name}: values in '{signal.unit}' do not convert to its unit, {variable.unit}; "
                "give them in a unit that does, or without one"
            )
        values = [in_other_unit(x, result) for x in values]
    return replace(signal, values=values, unit=None)


def by_own_names(model: Model, values: Mapping[str, Any], notes: set[str]) -> dict[str, Any]:
    """Return options with the variables' own names in place of other names that they have (FMI 3.0 aliases).

    Those without names in them are left out.

    Args:
        model: that has the variables.
        values: option → a text, or texts in tuples and lists, or as keys.
        notes: gets what was replaced, in words.

    Raises:
        InputError: two names of one variable have a value each.
    """
    names = _other_names(model)
    result = {option: _by_own_names(names, value, notes) for option, value in values.items()} if names else {}
    return {option: value for option, value in result.items() if value is not values[option]} if notes else {}


def _by_own_names(names: Mapping[str, str], value: Any, notes: set[str]) -> Any:  # noqa: ANN401
    if isinstance(value, str) and value in names:
        notes.add(f"{value} is another name of {names[value]}")
        return names[value]
    if type(value) in (tuple, list):
        return type(value)(_by_own_names(names, part, notes) for part in value)
    if type(value) is not dict:
        return value
    result = {_by_own_names(names, key, notes): part for key, part in value.items()}
    if len(result) < len(value):
        twice = next(name for name in value if names.get(name) in value)
        raise InputError(f"{twice} is another name of {names[twice]}: give one of them")
    return result


def _other_names(model: Model) -> dict[str, str]:
    """Return alias → the variable's own name, of elements and of whole arrays."""
    if not isinstance(model, DescribedModel):
        return {}
    pairs = {v.name: v.alias_of for v in model.description.variables if v.alias_of}
    arrays = {a.rpartition("[")[0]: own.rpartition("[")[0] for a, own in pairs.items() if own.endswith("]")}
    return arrays | pairs


def in_own_units(model: Model, names: str | Iterable[str], value: Any, declared: DeclaredOption) -> Any:  # noqa: ANN401
    """Return an option's value with every `Quantity` as a number in the unit of its variable.

    Args:
        model: that has the variables.
        names: of the variable; several: of each that the value has by name.
        value: a number or a tuple of such; by name where there are several.
        declared: the option.

    Raises:
        InputError: no such variable, or its unit does not fit.
    """
    if not isinstance(names, str):
        return {name: in_own_units(model, name, value[name], declared) for name in names}
    if isinstance(value, tuple):
        return tuple(in_own_units(model, names, part, declared) for part in value)
    if not isinstance(value, Quantity):
        return value
    by_name = declared.option.of == EACH
    check_variables(model, [names], "variable", what=declared.name if by_name else declared.option.of)
    variable = variables_of(model)[names]
    try:
        return in_its_unit(variable, str(value), _units(model), "change" if declared.option.change else "level")
    except InputError as error:
        raise InputError(f"{declared.name}: {names}: {error}") from None


def _units(model: Model) -> Mapping[str, UnitDefinition]:
    return model.description.units if isinstance(model, DescribedModel) else {}


def _items(model: Model, variable: Variable) -> Mapping[str, int]:
    """Return the names of the values that a variable can have; empty where it is not one of few."""
    if variable.type == "Boolean":
        return _TRUTH
    if variable.type != "Enumeration" or not isinstance(model, DescribedModel):
        return {}
    return model.description.enumerations.get(variable.declared_type or "", {})


def _stepwise(variable: Variable, signal: Signal, items: Mapping[str, int]) -> Signal:
    """Return a table as a staircase where its input has nothing between two values, or changes at events only."""
    if isinstance(signal, Table) and not variable.is_continuous_input:
        signal = replace(signal, interpolate="hold")
    if not items:
        return signal
    name = variable.name
    if items is not _TRUTH and (wrong := [x for x in levels_of(signal) if round(x) not in items.values()]):
        where = " (initial, of the step)" if isinstance(signal, Step) and wrong[0] == signal.initial else ""
        known = suggest(f"{wrong[0]:g}", items)
        raise InputError(f"input {name}: its enumeration has no item {wrong[0]:g}{where}; {known}")
    return signal


def _elements(name: str, accepted: Sequence[str]) -> list[str]:
    """Return the elements of an array, the last index running first; none where there is no such array."""
    begin = f"{name}["
    return [] if name in accepted else [one for one in accepted if one.startswith(begin)]


def _of(model: Model, kind: Kind) -> tuple[Variable, ...]:
    if kind == "input":
        return model.inputs
    if kind == "output":
        return model.outputs
    if kind == "state":
        return model.states
    if kind == "parameter":
        return model.parameters
    described = model.description.variables if isinstance(model, DescribedModel) else model.states
    return (*described, *model.inputs, *model.outputs)
