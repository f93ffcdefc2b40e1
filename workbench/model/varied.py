"""A model with other values of its parameters."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

from workbench.errors import InputError
from workbench.fmi.variable import Value
from workbench.model.base import Model
from workbench.model.described import DescribedModel

__all__ = ["Varied", "opened_with", "with_parameters"]

_KEPT = 4  # opened models


def with_parameters(model: Model, parameters: Mapping[str, Value]) -> AbstractContextManager[Model]:
    """Return the model with other parameters, a new one if there are any.

    Raises:
        InputError: the model is not a file.
    """
    if not parameters:
        return nullcontext(model)
    if not isinstance(model, DescribedModel):
        raise InputError(f"{model.name}: its parameters cannot be set, for it is not a file")
    return opened_with(model, parameters)


def opened_with(model: DescribedModel, parameters: Mapping[str, Value]) -> DescribedModel:
    """Return a model with other parameters, newly opened; the caller closes it."""
    return replace(model.recipe, start_values={**model.recipe.start_values, **parameters}).open()


class Varied:
    """A model at values of one of its parameters, the newest of them kept open.

    Args:
        opened: value → the model there, newly opened.
    """

    def __init__(self, opened: Callable[[float], DescribedModel]) -> None:
        self._opened = opened
        self._open: OrderedDict[float, DescribedModel] = OrderedDict()

    def at(self, value: float) -> DescribedModel:
        """Return the model at a value; it is closed when other values are asked for, or by `close`."""
        if value not in self._open:
            self._rest(_KEPT - 1)
            self._open[value] = self._opened(value)
        self._open.move_to_end(value)
        return self._open[value]

    def close(self) -> None:
        """Close what is open. Any number of times."""
        self._rest(0)

    def _rest(self, count: int) -> None:
        while len(self._open) > count:
            self._open.popitem(last=False)[1].close()
