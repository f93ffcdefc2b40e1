"""Whether a model has the variables that an analysis is asked about: the one place for "no such input"."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from workbench.core.names import check_names
from workbench.fmi.variable import Variable
from workbench.model.base import Model
from workbench.model.described import DescribedModel

__all__ = ["Kind", "check_variables"]

Kind = Literal["input", "output", "state", "parameter", "variable"]

_KINDS: tuple[Kind, ...] = ("input", "output", "state", "parameter")


def check_variables(model: Model, names: Iterable[str], *kinds: Kind, what: str, number: bool = False) -> None:
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
    others = {v.name: kind for kind in reversed(_KINDS) if kind not in kinds for v in _of(model, kind)}
    check_names(names, accepted, kinds=kinds, what=what, model=model.name, others=others)


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
