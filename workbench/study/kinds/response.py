"""Requirements on frequency responses at one frequency: gain, phase, offset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from workbench.study.kinds.base import Limited, Requirement, Result, Value
from workbench.study.kinds.curve import Curve
from workbench.study.kinds.curves import READERS, curves

__all__ = ["UNITS", "Gain", "OfResponse", "Offset", "Phase", "Positive"]

# Of a response; an offset has the unit of the output.
UNITS = {"gain": "dB", "phase": "deg"}

Positive = Annotated[float, Field(gt=0.0)]


class OfResponse(Requirement):
    """A requirement on frequency responses.

    Attributes:
        amplitude: only the response at this one; None: all, and the worst decides.
        source: "linear" or "measured", of a loop.
        input, output: of a linear model with several.
        plant: what an identified model stands for: "continuous" takes the hold of its data out, so that it can be held
            against sines; "sampled" adds the hold of a sampled plant; "held" leaves it as it is.
    """

    commands: ClassVar[tuple[str, ...]] = tuple(READERS)

    amplitude: Positive | None = None
    source: Literal["linear", "measured"] | None = None
    input: str | None = None
    output: str | None = None
    plant: Literal["continuous", "sampled", "held"] = "continuous"

    def responses(self, result: Result, at: Sequence[float] = ()) -> list[Curve]:
        """Return the responses that count.

        Args:
            result: of the analysis.
            at: frequencies at which a linear model is evaluated [Hz], besides those around its poles.
        """
        return curves(
            result, at=at, amplitude=self.amplitude, source=self.source, input=self.input, output=self.output,
            plant=self.plant,
        )  # fmt: skip


class _AtFrequency(OfResponse, Limited):
    """A value at one frequency, interpolated between the measured ones.

    Attributes:
        frequency: [Hz].
    """

    quantity: ClassVar[str]

    frequency: Positive

    def values(self, result: Result) -> list[Value]:
        return [self._value(curve) for curve in self.responses(result, (self.frequency,))]

    def _value(self, curve: Curve) -> Value:
        value = curve.at(self.quantity, self.frequency)
        return Value(value=value, where=curve.where(self.frequency), unit=UNITS.get(self.quantity, curve.unit))


class Gain(_AtFrequency):
    """Gain at a frequency [dB]."""

    quantity = "gain"
    units = ("dB",)


class Phase(_AtFrequency):
    """Phase at a frequency [deg]."""

    quantity = "phase"
    units = ("deg",)


class Offset(_AtFrequency):
    """Mean of the output at a frequency [its unit]."""

    commands: ClassVar[tuple[str, ...]] = ("nfr",)
    quantity = "offset"
