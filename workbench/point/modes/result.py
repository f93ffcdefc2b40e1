"""What the analysis of modes over a parameter found."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart, complex_of, entry, numbers
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.fmi.variable import Value
from workbench.point.modes.mode import Critical, Mode
from workbench.point.modes.ranges import USUAL_TOLERANCE, unstable_ranges
from workbench.show.result import Result

__all__ = ["CRITERION", "ModeSet", "ModesMeeting", "ModesResult"]

CRITERION = (
    "critical: the real part of a mode's pole passes zero (or leaves it, for a mode that was neutral), by more than "
    "rounding may have moved the pole"
)


@dataclass(frozen=True, kw_only=True)
class ModesMeeting:
    """Modes that meet.

    Attributes:
        value: value of the parameter, in the middle of the smallest step that was tried.
        width: width of that step, or of several in a row.
        modes: numbers.
        kind: "real axis" (a pair becomes two real poles, or the reverse: nothing is uncertain but which of the two goes
            on under the number of the pair) or "unclear" (they coalesce, or pass closer than the last step resolves:
            which goes on as which is not certain).
    """

    value: float
    width: float
    modes: tuple[int, ...]
    kind: str


@dataclass(frozen=True, eq=False, kw_only=True)
class ModeSet(RecordPart):
    """The modes of one configuration.

    Attributes:
        label: for pictures; "": the model as it is.
        settings: parameters that differ from the model as it is.
        value: value of the parameter, with those put in between; rising, shape (k,).
        modes: modes by number.
        critical: critical values, rising.
        unstable_ranges: lowest and highest value of each range in which at least one mode is unstable, rising; borders
            are critical values or the ends of `value`.
        meetings: meetings of modes, rising.
        failed: value → why there is no linear model.
    """

    label: str
    settings: Mapping[str, Value]
    value: Floats
    modes: tuple[Mode, ...] = field(metadata=entry(kept=False))
    critical: tuple[Critical, ...]
    unstable_ranges: tuple[tuple[float, float], ...]
    meetings: tuple[ModesMeeting, ...] = ()
    failed: Mapping[float, str] = field(metadata=entry(kept=False))

    @property
    def stable_ranges(self) -> tuple[tuple[float, float], ...]:
        """The ranges between the first and the last value in which no mode is unstable."""
        ends = [float(self.value[0]), *(v for pair in self.unstable_ranges for v in pair), float(self.value[-1])]
        return tuple((a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if a < b)

    @property
    def least_damped(self) -> tuple[Mode, float, float] | None:
        """Mode with the smallest damping ratio, the ratio, and the value of the parameter; None: there is no ratio."""
        known = [
            (float(d), m.number, float(v))
            for m in self.modes
            for d, v in zip(m.damping, self.value, strict=True)
            if not math.isnan(d)
        ]
        if not known:
            return None
        ratio, number, value = min(known)
        return self.mode(number), ratio, value

    @property
    def first_unstable(self) -> Critical | None:
        """Where the first mode becomes unstable, the parameter rising; None: nowhere in the range."""
        return next((c for c in self.critical if c.becomes == "unstable"), None)

    @property
    def unstable_count(self) -> tuple[int, ...]:
        """How many modes are unstable at each value, shape (k,)."""
        table = np.array([m.pole.real > m.uncertain for m in self.modes])
        return tuple(table.sum(axis=0).tolist()) if len(table) else (0,) * len(self.value)

    @property
    def unstable_throughout(self) -> tuple[int, ...]:
        """Numbers of the modes that are unstable at every value at which they exist."""
        return tuple(
            m.number for m in self.modes if np.all(m.pole.real[~np.isnan(m.pole)] > m.uncertain[~np.isnan(m.pole)])
        )

    @property
    def reached_beyond(self) -> tuple[tuple[int, float], ...]:
        """Number of each mode that reaches zero damping within one more step beyond an end, and about where.

        The real part of its pole, stable at the end, is continued by a straight line through the last two values there.
        """
        if len(self.value) < 2:
            return ()
        result = []
        for end, before in ((0, 1), (-1, -2)):
            step = float(self.value[end] - self.value[before])
            for m in self.modes:
                real = m.pole.real
                rise = real[end] - real[before]  # NaN, where the mode does not exist, is not above anything
                if -m.uncertain[end] > real[end] and rise > m.uncertain[end] and real[end] + rise >= 0.0:
                    result.append((m.number, float(self.value[end]) - step * float(real[end] / rise)))
        return tuple(sorted(result, key=lambda one: one[1]))

    def relevant(self, most: int = 6) -> tuple[int, ...]:
        """Return the numbers of the modes worth a look: unstable somewhere, and at least the two with least damping.

        Args:
            most: largest number of modes, those with the least damping.
        """
        least = {m.number: float(np.nanmin(m.damping)) for m in self.modes if not np.all(np.isnan(m.damping))}
        ranked = sorted(least, key=lambda n: least[n])
        unstable = [n for n in ranked if least[n] < 0.0 or any(c.mode == n for c in self.critical)]
        return tuple(sorted(ranked[: min(max(len(unstable), 2), most)]))

    def mode(self, number: int) -> Mode:
        """Return a mode by its number.

        Args:
            number: number of the mode, from 1.
        """
        return self.modes[number - 1]

    def derived(self) -> dict[str, Any]:
        """Return the modes column by column."""
        columns = (
            "number",
            "states",
            "frequency_hz",
            "natural_frequency_hz",
            "damped_frequency_hz",
            "damping",
            "uncertain",
        )
        return {
            **{name: [getattr(m, name) for m in self.modes] for name in columns},
            "real": [m.pole.real for m in self.modes],
            "imag": [m.pole.imag for m in self.modes],
            "unstable_modes": self.unstable_count,
            "failed": [{"value": v, "reason": why} for v, why in self.failed.items()],
        }

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the modes one by one; in files of earlier versions nothing says where any is unstable."""
        modes = [
            {
                "number": number,
                "states": states,
                "uncertain": uncertain,
                "pole": complex_of({"real": real, "imag": imag}),
            }
            for number, states, uncertain, real, imag in zip(
                *(data[key] for key in ("number", "states", "uncertain", "real", "imag")), strict=True
            )
        ]
        known = {**data, "modes": modes, "failed": {f["value"]: f["reason"] for f in data["failed"]}}
        return known if "unstable_ranges" in data else {**known, "unstable_ranges": _ranges(known)}

    def rows(self) -> Iterator[list[Any]]:
        """Yield label, value, mode, damped frequency, damping, real and imaginary part, natural frequency."""
        for m in self.modes:
            columns = (m.frequency_hz, m.damping, m.pole.real, m.pole.imag, m.natural_frequency_hz)
            table = np.column_stack([self.value, *columns])
            for value, *rest in table[~np.isnan(m.pole)].tolist():
                yield [self.label, value, m.number, *(None if math.isnan(x) else x for x in rest)]


@dataclass(frozen=True, eq=False, kw_only=True)
class ModesResult(Result):
    """Frequency and damping of every mode over a parameter: a flutter diagram, where it is an airspeed.

    Attributes:
        model, interface: what was linearised.
        parameter: what was varied.
        unit: unit of the parameter; None: the model declares none.
        sets: one for each configuration, the model as it is first.
        tolerance: tolerance of the critical values, in the unit of the parameter.
        criterion: what "critical" means.
        notes: what should be known, one line each.
        operating_point: operating point of the first value.
        followed: so many modes were asked for; None: all.
    """

    _page = "workbench.point.modes.page:modes_page"
    _picture = "workbench.point.modes.picture:plot_modes"

    model: str
    interface: str
    parameter: str
    unit: str | None
    sets: tuple[ModeSet, ...]
    tolerance: float
    criterion: str = CRITERION
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None
    followed: int | None = None

    _WHAT, _COMMAND = "a result of modes", "modes"

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return {self.parameter: self.unit}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each mode of each configuration at each value."""
        rest = ("mode", "frequency_hz", "damping", "real", "imag", "natural_frequency_hz")
        yield ("configuration", self.parameter, *rest)
        for member in self.sets:
            yield from member.rows()


def _ranges(data: Mapping[str, Any]) -> tuple[tuple[float, float], ...]:
    """Return the unstable ranges of what a file has."""
    values = numbers(data, "value")
    modes = [
        Mode(number=m["number"], pole=m["pole"], uncertain=numbers(m, "uncertain"), states=()) for m in data["modes"]
    ]
    critical = [Critical.from_dict(c) for c in data["critical"]]
    return unstable_ranges(values, modes, critical, tolerance=USUAL_TOLERANCE * float(values[-1] - values[0]))
