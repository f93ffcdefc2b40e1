"""A Nyquist curve with its crossings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart, complex_of, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.show.result import Result

__all__ = ["CRITERION", "Crossing", "NyquistResult"]

CRITERION = (
    "stable: with the block replaced by its gain N(A), no pole lies in the right half-plane at an amplitude a little "
    "above that of the crossing, and at least one pair does a little below"
)


@dataclass(frozen=True, kw_only=True)
class Crossing(RecordPart):
    """Where L(jω) meets −1/N(A), or the negative real axis without an amplitude that belongs to it.

    Attributes:
        frequency_hz: [Hz].
        real: real part of L there; minus infinity at a pole of L on the imaginary axis.
        imag: imaginary part; 0 where N is real.
        gain: −1/L, real part where N is real, else its size: the equivalent gain of the block.
        amplitude: amplitude at the block's input; None: N takes this gain at no amplitude that was looked at.
        stable: whether the oscillation is, by `NyquistResult.criterion`; None: there is none.
        unstable_below: poles in the right half-plane with an equivalent gain a little below.
        unstable_above: the same a little above.
        distortion: largest harmonic that comes back to the block's input over its fundamental, by the linear part;
            the describing function supposes that it is small. None: not known.
    """

    frequency_hz: float = field(metadata=entry(dims=("frequency_hz",), unit="Hz"))
    real: float
    imag: float = 0.0
    gain: float
    amplitude: float | None = None
    stable: bool | None = None
    unstable_below: int
    unstable_above: int
    distortion: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class NyquistResult(Result):
    """L(jω) of a loop 1 + N·L = 0, and all its crossings in a band.

    Attributes:
        name: name of the loop.
        block: name of the nonlinear block; "": none, crossings of the negative real axis alone.
        frequency_hz: adaptive, shape (k,) [Hz].
        response: L, shape (k,), complex.
        crossings: rising in frequency.
        amplitude: amplitudes at which −1/N was evaluated, shape (n,).
        minus_inverse: −1/N there, shape (n,), complex (at the first crossing's frequency where N depends on it).
        criterion: what "stable" means.
        unstable_open: poles of L in the right half-plane.
    """

    _page = "workbench.loops.nyquist.page:nyquist_page"
    _picture = "workbench.loops.nyquist.picture:plot_nyquist"

    name: str
    block: str
    frequency_hz: Floats
    response: Complex = field(metadata=entry(kept=False, dims=("frequency_hz",)))
    crossings: tuple[Crossing, ...]
    amplitude: Floats
    minus_inverse: Complex
    criterion: str = CRITERION
    unstable_open: int = 0

    @property
    def negative(self) -> tuple[Crossing, ...]:
        """The crossings of the negative real axis, each frequency once."""
        result = {c.frequency_hz: c for c in self.crossings if c.imag == 0.0 and c.real < 0.0}
        return tuple(result.values())

    def derived(self) -> dict[str, Any]:
        """Return the response by its parts."""
        return {"real": self.response.real, "imag": self.response.imag}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the complex response."""
        return {**data, "response": complex_of(data)}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each crossing."""
        yield tuple(Crossing.__dataclass_fields__)
        yield from (tuple(vars(c).values()) for c in self.crossings)

    def band(self, low: float, high: float) -> NyquistResult:
        """Return the part of the curve between two frequencies.

        Args:
            low: [Hz].
            high: [Hz].
        """
        inside = (self.frequency_hz >= low) & (self.frequency_hz <= high)
        kept = tuple(c for c in self.crossings if low <= c.frequency_hz <= high)
        fields = {
            **vars(self), "frequency_hz": self.frequency_hz[inside], "response": np.asarray(self.response)[inside],
        }  # fmt: skip
        return NyquistResult(**{**fields, "crossings": kept})
