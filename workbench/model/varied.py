"""A model with other values of its parameters."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping

from workbench.errors import InputError
from workbench.fmi.variable import Value
from workbench.model.base import Model
from workbench.model.described_model import DescribedModel

__all__ = ["Varied", "set_to", "with_parameters"]

_KEPT = 4  # opened models


def with_parameters(model: Model, parameters: Mapping[str, Value]) -> Model:
    """Return the model with other parameters; it is closed with this one.

    Raises:
        InputError: see `set_to`; or the model is not a file.
    """
    if not parameters:
        return model
    if not isinstance(model, DescribedModel):
        raise InputError(f"{model.name}: its parameters cannot be set, for it is not a file")
    return set_to(model, parameters)


def set_to(model: DescribedModel, values: Mapping[str, Value]) -> DescribedModel:
    """Return a model with other parameters or start values, here and in every worker; it is closed with this one.

    The FMU is not reopened: each session sets these values before initialisation.

    Raises:
        InputError: no such variable, it cannot be set, or the value is not of its type.
    """
    return model.with_values(values)


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
