"""Requirements on linear and identified models: poles, and how well they follow data."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from workbench.core.values.poles import damping_ratio, natural_frequency_hz
from workbench.errors import InputError, suggest
from workbench.study.requirements.base import Limited, NotMeasured, Result, Value
from workbench.study.requirements.curves import moving_poles

__all__ = ["Damping", "FitRequirement", "PoleFrequency", "StabilityRequirement"]


class _OfPoles(Limited):
    """A number of each pole inside a band.

    Attributes:
        band: natural frequencies that count [Hz]; None: all but integrators, poles that are 0 within their rounding.
    """

    commands: ClassVar[tuple[str, ...]] = ("lin", "identify")

    band: list[Annotated[float, Field(ge=0.0)]] | None = Field(default=None, min_length=2, max_length=2)

    def values(self, result: Result) -> list[Value]:
        every = self.known(result)
        low, high = self.band or (0.0, math.inf)
        chosen = [p for p in every if low <= _hz(p) <= high and p.imag >= 0.0]
        if not chosen:
            raise NotMeasured("the model has no pole there")
        return [self.value(p) for p in chosen]

    def known(self, result: Result) -> list[complex]:
        """Return the poles; of a model with transport delays the rightmost, proved to be all, delays as they are.

        Raises:
            NotMeasured: nothing is proved of them.
        """
        exact, line = result.get("delay_poles"), result.get("delay_poles_complete_to")
        if result.get("delayed") is None:
            return moving_poles(result)
        if line is None or not exact:
            raise NotMeasured("the model has transport delays, and its poles with them are not known")
        return moving_poles({**result, "poles": [p for p in exact if p[0] > line]})

    def value(self, pole: complex) -> Value:
        """Return the number of one pole [rad/s]."""
        raise NotImplementedError


def _hz(pole: complex) -> float:
    return float(natural_frequency_hz(pole))


class Damping(_OfPoles):
    """Damping ratio of the poles; below 0 a pole is unstable, 1 it is real."""

    units = ("1",)

    def value(self, pole: complex) -> Value:
        return Value(value=float(damping_ratio(pole)), where=f"pole at {_hz(pole):.4g} Hz", unit="1")


class PoleFrequency(_OfPoles):
    """Natural frequency of the poles [Hz]; of which ones, the band tells."""

    units = ("Hz",)

    def value(self, pole: complex) -> Value:
        return Value(value=_hz(pole), where=f"damping {float(damping_ratio(pole)):.4g}", unit="Hz")


class StabilityRequirement(_OfPoles):
    """Real part of the poles [1/s]; max = 0 is a stable model."""

    units = ("1/s",)

    def value(self, pole: complex) -> Value:
        return Value(value=pole.real, where=f"pole at {_hz(pole):.4g} Hz", unit="1/s")


class FitRequirement(Limited):
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
