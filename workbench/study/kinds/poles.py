"""Requirements on the poles of a linear model."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from pydantic import Field

from workbench.core.poles import damping_ratio, natural_frequency_hz
from workbench.study.kinds.base import Limited, NotMeasured, Result, Value
from workbench.study.kinds.linear import poles

__all__ = ["Damping", "PoleFrequency", "Stability"]

_AT_REST = 1e-9  # of the fastest pole: what rounding makes of an integrator


class _OfPoles(Limited):
    """A number of each pole inside a band.

    Attributes:
        band: natural frequencies that count [Hz]; None: all but integrators.
    """

    commands: ClassVar[tuple[str, ...]] = ("lin", "identify")

    band: list[Annotated[float, Field(ge=0.0)]] | None = Field(default=None, min_length=2, max_length=2)

    def values(self, result: Result) -> list[Value]:
        every = poles(result)
        fastest = max((abs(p) for p in every), default=0.0)
        low, high = self.band or (0.0, math.inf)
        chosen = [p for p in every if abs(p) > _AT_REST * fastest and low <= _hz(p) <= high and p.imag >= 0.0]
        if not chosen:
            raise NotMeasured("the model has no pole there")
        return [self.value(p) for p in chosen]

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


class Stability(_OfPoles):
    """Real part of the poles [1/s]; max = 0 is a stable model."""

    units = ("1/s",)

    def value(self, pole: complex) -> Value:
        return Value(value=pole.real, where=f"pole at {_hz(pole):.4g} Hz", unit="1/s")
