"""Whether a model has the variables that an analysis is asked about: the one place for "no such input"."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Literal

from workbench.core.names import check_names
from workbench.errors import InputError
from workbench.fmi.variable import Variable
from workbench.model.base import Model
from workbench.model.described import DescribedModel

__all__ = ["Kind", "check_variables", "found_variables"]

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
    for name in names:
        if elements := _elements(name, accepted):
            told = f"'{name}' of {model.name} is an array; name an element, {elements[0]} … {elements[-1]}"
            raise InputError(f"{what}: {told}" if what else told)
    others = {v.name: kind for kind in reversed(_KINDS) if kind not in kinds for v in _of(model, kind)}
    check_names(names, accepted, kinds=kinds, what=what, model=model.name, others=others)


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
    found = [one for name in names for one in (_elements(name, accepted) or [name])]
    check_variables(model, found, *kinds, what=what)
    return list(dict.fromkeys(found))


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
