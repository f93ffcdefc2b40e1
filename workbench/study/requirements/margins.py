"""Requirements on the margins of a loop."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from workbench.study.requirements.base import Limited, NotMeasured, Result, Value
from workbench.study.requirements.curves import amplitude_words

__all__ = ["DelayMargin", "DiskMarginRequirement", "GainMargin", "PeakSensitivity", "PhaseMargin"]


class _Margin(Limited):
    """One number of `workbench loop`.

    A loop that is unstable when closed has no margins: the requirement fails. A margin that the linear loop does not
    have, since it never crosses, is infinite; in a measured loop it was not seen, which proves nothing and fails.

    Attributes:
        source: "linear" or "measured"; None: every one there is, and the worst decides.
        amplitude: of the measured loop; None: all.
    """

    commands: ClassVar[tuple[str, ...]] = ("loop",)
    number: ClassVar[str]
    place: ClassVar[str]

    source: Literal["linear", "measured"] | None = None
    amplitude: float | None = None

    def values(self, result: Result) -> list[Value]:
        values = [self._value(margins, label) for label, margins in _sources(result, self.source, self.amplitude)]
        if not values:
            raise NotMeasured("the result has no such loop: give the analysis an amplitude, or leave source out")
        return values

    def _value(self, margins: Mapping[str, Any], label: str) -> Value:
        if margins["closed_loop"] != "stable":
            raise NotMeasured(f"{label}: {margins['words']}")
        value = self.read(margins)
        if value is None:
            if label != "linear":
                raise NotMeasured(f"{label}: not seen in the measured band")
            return Value(value=math.inf, where=f"{label}, no crossing", unit=self.units[0])
        at = margins.get(self.place)
        return Value(value=value, where=f"{at:.4g} Hz, {label}" if at is not None else label, unit=self.units[0])

    def read(self, margins: Mapping[str, Any]) -> float | None:
        """Return the number; None: there is none."""
        value = margins[self.number]
        return None if value is None else float(value)


def _sources(result: Result, source: str | None, amplitude: float | None) -> list[tuple[str, Mapping[str, Any]]]:
    solution: list[tuple[str, Mapping[str, Any]]] = []
    if source != "measured" and amplitude is None and result["linear"] is not None:
        solution.append(("linear", result["linear"]["margins"]))
    if source != "linear":
        chosen = [m for m in result["measured"] if amplitude is None or math.isclose(m["amplitude"], amplitude)]
        solution += [(amplitude_words(m["amplitude"], result["unit"]), m["margins"]) for m in chosen]
    return solution


class GainMargin(_Margin):
    """By how much the gain may grow [dB]."""

    number, place = "gain_margin_db", "phase_crossover_hz"
    units = ("dB",)


class PhaseMargin(_Margin):
    """By how much the phase may fall or rise, whichever is less [deg].

    `loop` gives a margin that a lead would use up a negative sign; the loop is stable, so its size is what is left.
    """

    number, place = "phase_margin_deg", "gain_crossover_hz"
    units = ("deg",)

    def read(self, margins: Mapping[str, Any]) -> float | None:
        value = super().read(margins)
        return None if value is None else abs(value)


class DelayMargin(_Margin):
    """Which additional delay the loop tolerates [s]."""

    number, place = "delay_margin_s", "gain_crossover_hz"
    units = ("s",)


class DiskMarginRequirement(_Margin):
    """The symmetric disk margin α of simultaneous changes of gain and phase."""

    number, place = "disk_margin", ""
    units = ("1",)

    def read(self, margins: Mapping[str, Any]) -> float | None:
        disk = margins["disk_margin"]
        return None if disk is None else float(disk["alpha"])


class PeakSensitivity(_Margin):
    """The largest |S| = |1/(1 + L)|."""

    number, place = "peak_sensitivity", "peak_sensitivity_hz"
    units = ("1",)
