"""Requirements on identified models."""

from __future__ import annotations

from typing import ClassVar, Literal

from workbench.errors import InputError, suggest
from workbench.study.kinds.base import Limited, NotMeasured, Result, Value

__all__ = ["Fit"]


class Fit(Limited):
    """How well a model follows data [%].

    Attributes:
        data: "validation" (other data) or "identification" (data of the fit, which flatters).
        output: only this one; None: all, and the worst decides.
    """

    commands: ClassVar[tuple[str, ...]] = ("identify",)
    units = ("%",)

    data: Literal["validation", "identification"] = "validation"
    output: str | None = None

    def values(self, result: Result) -> list[Value]:
        part = result[self.data]
        if part is None:
            raise NotMeasured("the model was not validated; give the analysis validate = {from = ..}")
        fits = part["fit_percent"]
        if self.output is not None and self.output not in fits:
            raise InputError(f"{self.name}: output '{self.output}' is unknown; {suggest(self.output, fits)}")
        chosen = {name: fit for name, fit in fits.items() if self.output in (None, name)}
        if None in chosen.values():
            raise NotMeasured("the model has no fit: its simulation grows without bound")
        return [Value(value=fit, where=f"{name}, order {result['order']}", unit="%") for name, fit in chosen.items()]
