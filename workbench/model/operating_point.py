"""Where a model is to start: operating points are read, checked against the model, and taken from its sessions."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from workbench.core.records.names_in_text import check_names
from workbench.core.values.operating_point import At, OperatingPoint
from workbench.errors import InputError, SimulationError
from workbench.fmi.description import ModelDescription
from workbench.fmi.variable import Variable
from workbench.model.base import Model

if TYPE_CHECKING:
    from workbench.session.base import Session

__all__ = ["bias_of", "centre_of", "find_point", "named", "standing", "start_at"]

_Model = TypeVar("_Model", bound="Model")

_SHOWN = 8  # digits of a hash in a message
_LISTED = 6  # names in a message
_SAME = 1e-9  # relative: values that are written twice, with the digits of a command line


def find_point(model: Model, at: At | None) -> tuple[OperatingPoint | None, tuple[str, ...]]:
    """Return the operating point that `at` names, for this model, and remarks on it.

    Args:
        model: that is to start there.
        at: a point, a result that has one, the file of either; None: where the model starts by itself.

    Raises:
        InputError: no such file, not a point, a point of another model, a name that the model does not have, a state
            without value, a bias that says something else of an input.
    """
    if at is None:
        return model.at, ()
    point, what, notes = _taken(at)
    _check_model(model, point, what)
    _check_names(model, point, what)
    _check_bias(model, point, what)
    return point, (*notes, *_remarks(model, point, what))


def start_at(model: _Model, at: At | None) -> tuple[_Model, tuple[str, ...]]:
    """Return the model that starts at an operating point, and remarks on that point.

    Args:
        model: which.
        at: see `find_point`.

    Raises:
        InputError: see `find_point`, `Model.starting_at`.
    """
    if at is None:
        return model, ()
    point, notes = find_point(model, at)
    return model.starting_at(point, notes), notes


def named(model: Model, point: OperatingPoint) -> OperatingPoint:
    """Return the point with its model's name, content and parameters.

    Args:
        model: whose point it is.
        point: as an analysis found it.
    """
    return replace(point, model=model.name, model_sha256=_content(model), parameters=_parameters(model))


def standing(model: Model, session: Session | None = None) -> OperatingPoint:
    """Return the point at which a model's sessions start.

    Args:
        model: which.
        session: one that has not been advanced; None: one is opened.

    Raises:
        FmuError, SimulationError: it cannot be opened.
    """
    if session is None:
        with model.open_session() as opened:
            return standing(model, opened)
    kinds = (model.states, model.inputs, model.outputs, _held(model))
    x, u, y, discrete = (_read(session, [v.name for v in kind if v.is_number]) for kind in kinds)
    units = {v.name: v.unit for v in (*model.states, *model.inputs, *model.outputs)}
    shown = {name: units[name] for name in (*x, *u, *y)}
    return named(model, OperatingPoint(x=x, u=u, y=y, discrete=discrete, units=shown, time=session.time))


def bias_of(model: Model, name: str, at: OperatingPoint | None = None) -> float:
    """Return what a session adds to the signal that forces an input: the model's bias, unless a point gives the value.

    Args:
        model: that the session is of.
        name: of the input.
        at: where the session starts; None: where the model says.
    """
    point = at or model.at
    return 0.0 if point is not None and name in point.u else float(model.bias.get(name, 0.0))


def centre_of(model: Model, name: str) -> float:
    """Return the value about which the signal of a forced input moves, without the bias that a session adds.

    Args:
        model: at the operating point, where there is one; else the input's start value counts.
        name: of the input.
    """
    if model.at is not None and name in model.at.u:
        return float(model.at.u[name])
    declared = next((v.start for v in model.inputs if v.name == name), None)
    start = model.start_values.get(name, declared)
    return float(start) if isinstance(start, int | float) else 0.0


def _held(model: Model) -> list[Variable]:
    """Return the discrete states, those that the model shows."""
    every: tuple[Variable, ...] = description.variables if (description := _described(model)) is not None else ()
    return [v for v in every if v.variability == "discrete" and v.causality in ("local", "output") and not v.alias_of]


def _described(model: Model) -> ModelDescription | None:
    result = getattr(model, "description", None)
    return result if isinstance(result, ModelDescription) else None


def _read(session: Session, names: list[str]) -> dict[str, float]:
    """Return the values of those variables that a session shows: FMI 1.0 does not name states, others hide them."""
    try:
        return session.values(names)
    except (InputError, SimulationError):
        result: dict[str, float] = {}
        for name in names if len(names) > 1 else ():
            result |= _read(session, [name])
        return result


# -- what was given ----------------------------------------------------------------------------


def _taken(at: At) -> tuple[OperatingPoint, str, tuple[str, ...]]:
    """Return the point, how a message calls it, and remarks."""
    if isinstance(at, str | Path):
        what = str(at)
        try:
            read = OperatingPoint.read(at)
        except InputError as error:
            kind = ", as an operating point is" if "is not JSON" in str(error) else ""
            remedy = "; workbench trim --json writes a point" if "trim --json" not in str(error) else ""
            raise InputError(f"at: {error}{kind}{remedy}") from None
        anonymous = f"{what}: does not name its model; it is assumed to belong to this one"
        return read, what, () if read.model_sha256 or read.model else (anonymous,)
    point = at if isinstance(at, OperatingPoint) else getattr(at, "operating_point", None)
    if not isinstance(point, OperatingPoint):
        raise InputError(f"at: {type(at).__name__} has no operating point; give one, a result of trim, or its file")
    for name, value in {**point.values, "time": point.time}.items():
        if not math.isfinite(value):
            raise InputError(f"operating point: {name} must be a finite number, not {value}")
    return point, "the operating point", ()


def _content(model: Model) -> str:
    return "" if model.recipe is None else model.recipe.content()


def _check_model(model: Model, point: OperatingPoint, what: str) -> None:
    content = _content(model)
    known = bool(point.model_sha256 and content)
    if known and point.model_sha256 == content:
        return
    if point.model and point.model != model.name:
        raise InputError(
            f"{what} belongs to another model, {point.model}, not {model.name}; find a point of {model.name} by "
            "workbench trim"
        )
    if known:
        raise InputError(
            f"{what} belongs to another version of {model.name}: the SHA-256 is {point.model_sha256[:_SHOWN]}… there "
            f"and {content[:_SHOWN]}… here; find the point again by workbench trim"
        )


def _check_names(model: Model, point: OperatingPoint, what: str) -> None:
    inputs = [v.name for v in model.inputs]
    check_names(point.u, inputs, kinds=("input",), what=what, model=model.name)
    states = [v.name for v in model.states]
    description = _described(model)
    variables = set() if description is None else {v.name for v in description.variables}
    if states:
        own = [name for name in (*point.x, *point.discrete) if name not in variables]
        check_names(own, states, kinds=("state",), what=what, model=model.name)
    missing = [name for name in states if name not in point.x] if point.x else []
    if missing:
        raise InputError(
            f"{what}: has values for some states of {model.name}, but not for {_listed(missing)}; add them"
        )


def _check_bias(model: Model, point: OperatingPoint, what: str) -> None:
    """Refuse a bias that makes an input something else than the point does."""
    starts = {v.name: v.start for v in model.inputs} | dict(model.start_values)
    for name, bias in model.bias.items():
        biased = float(starts[name] or 0.0) + bias
        if name in point.u and not _same(biased, point.u[name]):
            raise InputError(
                f"bias: {name} would be {biased:g}, but {what} has {point.u[name]:g} there; leave one of them out"
            )


def _remarks(model: Model, point: OperatingPoint, what: str) -> tuple[str, ...]:
    notes = []
    usual: dict[str, Any] = {v.name: v.start for v in model.parameters}
    here, given = _parameters(model), model.start_values
    for name in {**point.parameters, **here}:
        then, now = point.parameters.get(name, usual.get(name)), here.get(name, usual.get(name))
        if not _same(then, now):
            notes.append(
                f"{what} was found with {name} = {then}, but here {name} = {now}: it may not be an equilibrium"
            )
    for name, value in point.values.items():
        if name in given and name not in here and not _same(given[name], value):
            notes.append(f"{name} starts at {value:g}, as {what} says, not at {given[name]}, which was set")
    if not point.x and model.states and point.model:
        notes.append(f"{what} has no states, as co-simulation exposes none; they start at the model's start values")
    return tuple(notes)


def _same(a: object, b: object) -> bool:
    if isinstance(a, int | float) and isinstance(b, int | float):
        return abs(a - b) <= _SAME * max(abs(a), abs(b))
    return a == b


def _parameters(model: Model) -> dict[str, Any]:
    """Return the parameters that were set → value."""
    names = {v.name for v in model.parameters}
    return {name: value for name, value in model.start_values.items() if name in names}


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more
