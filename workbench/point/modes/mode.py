"""One mode over a parameter, and where it becomes unstable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.poles import damped_frequency_hz, damping_ratio, natural_frequency_hz

__all__ = ["Critical", "Mode"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Mode:
    """One mode over the parameter.

    Attributes:
        number: from 1 on, by rising damped frequency at the first value; what appears later (two real poles of what
            was a pair) comes after.
        pole: of a pair the one with the positive imaginary part, shape (k,) [1/s]; NaN where it does not exist.
        uncertain: how far rounding may have moved it, shape (k,) [1/s].
        states: those that take most part in it, at its first value.
    """

    number: int
    pole: Complex
    uncertain: Floats
    states: tuple[str, ...]

    @property
    def natural_frequency_hz(self) -> Floats:
        """|pole|/2π, shape (k,) [Hz]; 0 for a pole at 0."""
        return np.asarray(np.where(self._rests, 0.0, natural_frequency_hz(self.pole)), dtype=np.float64)

    @property
    def damped_frequency_hz(self) -> Floats:
        """|Im pole|/2π, of the free motion; 0 for a real pole; shape (k,) [Hz]."""
        return damped_frequency_hz(self.pole)

    @property
    def frequency_hz(self) -> Floats:
        """The damped frequency, under its name of version 0.1; shape (k,) [Hz]."""
        return self.damped_frequency_hz

    @property
    def damping(self) -> Floats:
        """Damping ratio −Re/|pole|, shape (k,); NaN for a pole at 0."""
        return np.asarray(np.where(self._rests, np.nan, damping_ratio(self.pole)), dtype=np.float64)

    @property
    def _rests(self) -> NDArray[np.bool_]:
        """Where the pole is 0 within rounding, shape (k,)."""
        return np.asarray(np.abs(self.pole) <= self.uncertain)


@dataclass(frozen=True, kw_only=True)
class Critical(RecordPart):
    """A value of the parameter at which a mode becomes unstable or stable.

    Attributes:
        mode: number.
        value: value of the parameter, to `ModesResult.tolerance`.
        frequency_hz: frequency of the mode there [Hz]; 0: it does not oscillate (divergence).
        becomes: "unstable" or "stable", the parameter rising.
        real: real part of the pole there [1/s]; what the tolerance leaves.
    """

    mode: int
    value: float
    frequency_hz: float
    becomes: str
    real: float

    @property
    def kind(self) -> str:
        """Return "flutter" for an oscillation, "divergence" for a real pole."""
        return "flutter" if self.frequency_hz > 0.0 else "divergence"

    def derived(self) -> dict[str, Any]:
        """Return what happens there."""
        return {"kind": self.kind}
