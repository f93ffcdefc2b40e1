"""The loop transfer of a nonlinear loop at given amplitudes, as it was measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import degrees
from workbench.core.values.margins import Margins

__all__ = ["LoopCurve", "LoopPoint"]


@dataclass(frozen=True, kw_only=True)
class LoopPoint(RecordPart):
    """L at one frequency and one amplitude.

    Attributes:
        frequency_hz: [Hz].
        amplitude: of the fundamental of the signal passed on behind the cut [unit of the source]; NaN where it failed.
        value: L, minus the fundamental returned over the fundamental passed on; None where the point failed.
        mean: of the signal passed on: where the loop is broken its value at the operating point; in closed loop a
            nonlinearity that is not symmetric there moves it. None: not known.
        thd_passed: total harmonic distortion of the signal passed on: how far it is from the sine that a describing
            function supposes; 0 where the loop is broken, None: not known.
        thd_returned: of the signal returned.
        harmonics: orders 2 … 10 of the signal returned, relative to its fundamental.
        injected: amplitude of the injected sine; None where the loop is broken.
        balance: injection: by how much passed - returned - injected fails to vanish, relative to the injected sine;
            all three are measured, so this is an error that was seen.
        status: "settled", "averaged" or "failed".
        error: of L, relative to the true one, with 95 % confidence; None: not known.
        periods: run.
        reason: why it failed.
        kind: what went wrong, see `WorkbenchError.kind`; None where nothing did.
    """

    frequency_hz: float
    amplitude: float
    value: complex | None
    mean: float | None = None
    thd_passed: float | None = None
    thd_returned: float | None = None
    harmonics: tuple[float | None, ...] = ()
    injected: float | None = None
    balance: float | None = None
    status: str = "settled"
    error: float | None = None
    periods: int = 0
    reason: str | None = None
    kind: str | None = None

    def __str__(self) -> str:
        return f"{self.frequency_hz:.4g} Hz"

    def derived(self) -> dict[str, Any]:
        """Return gain and phase."""
        value = self.value
        return {
            "gain": None if value is None else abs(value),
            "phase_deg": None if value is None else float(degrees(value)),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopCurve(RecordPart):
    """L over frequency at one amplitude.

    Attributes:
        how: "break" or "inject".
        amplitude: that was asked for [unit of the source].
        points: by rising frequency; those at crossovers were added by the search for them.
        margins: between the points; the closed loop's verdict is that of the quasi-linear loop at this amplitude.
        notes: one line each.
    """

    how: str
    amplitude: float
    points: tuple[LoopPoint, ...]
    margins: Margins
    notes: tuple[str, ...] = ()

    @property
    def frequency_hz(self) -> Floats:
        """Frequencies of the points with a value, shape (k,) [Hz]."""
        return np.array([p.frequency_hz for p in self.points if p.value is not None])

    @property
    def value(self) -> Complex:
        """L there, shape (k,)."""
        return np.array([p.value for p in self.points if p.value is not None], dtype=np.complex128)

    @property
    def failed(self) -> tuple[LoopPoint, ...]:
        """The points without a value."""
        return tuple(p for p in self.points if p.value is None)
