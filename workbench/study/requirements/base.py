"""What a requirement is: an analysis, a number of its result, limits."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import ConfigDict, Field

from workbench.errors import InputError, WorkbenchError
from workbench.system.files.toml_schema import TomlTable

__all__ = [
    "PASSED", "Compliance", "Limited", "NotMeasured", "Requirement", "Result", "Scalar", "Value", "convert", "judge",
    "number", "worst",
]  # fmt: skip

PASSED = "passed"

Scalar = bool | int | float | str
# What a command wrote as JSON.
Result = Mapping[str, Any]

# Of frequency responses and ratios; the system's units know no logarithms.
_PLAIN = (None, "1", "", "-")


class NotMeasured(WorkbenchError):  # noqa: N818 - it says what happened; the program goes on
    """The result does not hold the number: a point failed, the run is too short, the loop is unstable; says which."""


@dataclass(frozen=True, kw_only=True)
class Value:
    """One number of a result.

    Attributes:
        value: the number; a truth or a word where the requirement asks for equality; inf where there is no bound.
        where: at which frequency, amplitude, time; empty: there is only one.
        unit: None: it has none.
        error: how far off it may be, as far as the result tells; a limit within it is not met.
        remedy: what makes the error smaller.
    """

    value: float | bool | str
    where: str = ""
    unit: str | None = None
    error: float = 0.0
    remedy: str = ""


@dataclass(frozen=True, kw_only=True)
class Compliance:
    """How one requirement came out at one point.

    Attributes:
        value: what was measured: the worst, where there are several; None: nothing was.
        unit: of value, limit and margin; None: they have none.
        limit: "min", "max", "equal", "tolerance" → number, what applies at that place.
        margin: how far the value is inside the limit, negative outside; None: it has no distance.
        passed: whether the requirement is met.
        where: at which frequency, amplitude, time.
        reason: why nothing was measured, or what may explain that the requirement is not met; empty: nothing is to say.
    """

    value: float | bool | str | None
    unit: str | None = None
    limit: Mapping[str, float | bool | str] = field(default_factory=dict)
    margin: float | None = None
    passed: bool = False
    where: str = ""
    reason: str = ""

    @property
    def verdict(self) -> str:
        """Whether it "passed", is "violated", or "failed" where nothing was measured."""
        return PASSED if self.passed else "failed" if self.value is None else "violated"

    @property
    def value_words(self) -> str:
        """The value with its unit."""
        return self._with_unit(number(self.value)) if self.value is not None else "not measured"

    @property
    def limit_words(self) -> str:
        """The limit: "≥ 6 dB", "2 … 5 Hz", "1 ± 0.1"."""
        limit = {name: number(value) for name, value in self.limit.items()}
        if "equal" in limit:
            tolerance = f" ± {limit['tolerance']}" if "tolerance" in limit else ""
            return self._with_unit(f"{limit['equal']}{tolerance}")
        if "min" in limit and "max" in limit:
            return self._with_unit(f"{limit['min']} … {limit['max']}")
        return "".join(self._with_unit(f"{sign} {limit[n]}") for n, sign in (("min", "≥"), ("max", "≤")) if n in limit)

    @property
    def margin_words(self) -> str:
        """The margin with its sign."""
        if self.margin is None:
            return ""
        return "infinite" if math.isinf(self.margin) else f"{self.margin:+.4g}"

    @property
    def words(self) -> str:
        """How it came out: "-2.49 dB, limit ≥ -1 dB (2.5 Hz)", and the reason; or why nothing was measured."""
        where = f" ({self.where})" if self.where else ""
        said = f"{self.value_words}, limit {self.limit_words}{where}" if self.value is not None else ""
        return "; ".join(filter(None, [said, self.reason]))

    def _with_unit(self, words: str) -> str:
        return words if isinstance(self.value, str | bool) or self.unit in (None, "", "1") else f"{words} {self.unit}"


def number(value: float | bool | str | None) -> str:  # noqa: FBT001 - a value
    """Return a value with five digits, and a word where there is none."""
    if value is None:
        return "-"
    if isinstance(value, bool | str):
        return str(value).lower() if isinstance(value, bool) else value
    return "infinite" if math.isinf(value) else f"{value:.5g}"


class Requirement(TomlTable):
    """What every requirement has.

    Obligations of a subclass:
      1. `commands` names the commands whose results it reads; empty: any.
      2. `find` returns the worst of what applies, and raises `NotMeasured` where the result does not hold it.
      3. `check` refuses what can be seen in the file alone.
      4. `baseline` names a file whose record `find` takes as a last result, or none; `no_baseline` says which record
         must not become one.

    Attributes:
        name: one of a kind in the study.
        analysis: whose result.
        kind: name in `KINDS`.
        configurations: at which it applies; None: at all.
        grid: "model.parameter" → the value, or several, at which it applies; empty: at all.
        comment: for people; shown in the report.
        id: of the requirement in its specification, e.g. "ACT-REQ-012"; shown in the report.
    """

    # Only the kinds that a study uses are built: a study in its store is quick.
    model_config = ConfigDict(defer_build=True)

    commands: ClassVar[tuple[str, ...]] = ()
    between_rows: ClassVar[bool] = False  # whether it reads a time history between its rows, too

    name: str = Field(min_length=1)
    analysis: str
    kind: str
    configurations: list[str] | None = Field(default=None, min_length=1)
    grid: dict[str, Scalar | Annotated[list[Scalar], Field(min_length=1)]] = Field(default_factory=dict)
    comment: str = ""
    id: str = ""

    @property
    def analyses(self) -> tuple[str, ...]:
        """Names of the analyses that it reads."""
        return (self.analysis,)

    def baseline(self, usual: Path) -> Path | None:
        """Return the file of the record that the result is compared with, relative to the study; None: with none.

        Args:
            usual: its place where the study names none.
        """
        return None

    def no_baseline(self, result: Result) -> str:
        """Return why a record must not become the baseline: nothing was measured, or a point failed; empty: it may.

        Args:
            result: of the analysis.

        Raises:
            InputError: the requirement asks for what cannot be in such a result.
        """
        return ""

    def check(self, where: str, commands: Sequence[str]) -> None:
        """Check what the file alone shows.

        Args:
            where: the table, for messages.
            commands: of `analyses`.

        Raises:
            InputError: the analysis has another kind of result, or a limit is missing or senseless.
        """
        for analysis, command in zip(self.analyses, commands, strict=True):
            if self.commands and command not in self.commands:
                wanted = ", ".join(self.commands)
                raise InputError(
                    f"{where}: '{self.kind}' reads results of {wanted}; [analyses.{analysis}] runs {command}: "
                    f'take kind = "value" with the path of a number in its JSON'
                )

    @abstractmethod
    def find(self, results: Sequence[Result]) -> Compliance:
        """Hold results against the limits.

        Args:
            results: of `analyses`, in that order, then the baseline.

        Raises:
            NotMeasured: the result does not hold the number.
            InputError: what the requirement asks for cannot be in such a result, e.g. an output of another name.
        """


class Limited(Requirement):
    """A requirement on numbers: min, max, or equal with a tolerance.

    Attributes:
        min, max: smallest and largest value, in `unit`.
        equal: what it must be.
        tolerance: of equal, in `unit`.
        relative: of equal, as a fraction of it.
        unit: of the limits; None: that of the value.
    """

    units: ClassVar[tuple[str, ...]] = ()

    min: float | None = None
    max: float | None = None
    equal: float | bool | str | None = None
    tolerance: float | None = Field(default=None, ge=0.0)
    relative: float | None = Field(default=None, ge=0.0)
    unit: str | None = None

    def check(self, where: str, commands: Sequence[str]) -> None:
        super().check(where, commands)
        if self.min is None and self.max is None and self.equal is None:
            raise InputError(f"{where}: has no limit; give min, max, or equal with tolerance or relative")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise InputError(f"{where}: min {self.min:g} is above max {self.max:g}")
        if self.equal is not None and (self.min is not None or self.max is not None):
            raise InputError(f"{where}: equal and min or max: only one of them")
        self._check_tolerance(where)
        if self.unit is not None and self.units:
            convert(1.0, self.units[0], self.unit, where)

    def _check_tolerance(self, where: str) -> None:
        number = isinstance(self.equal, float | int) and not isinstance(self.equal, bool)
        given = self.tolerance is not None or self.relative is not None
        if given and not number:
            raise InputError(f"{where}: tolerance and relative belong to an equal that is a number")
        if number and not given:
            raise InputError(f"{where}: equal needs a tolerance, or relative as a fraction of it")

    @abstractmethod
    def values(self, result: Result) -> Sequence[Value]:
        """Return every value that must keep the limits.

        Args:
            result: of the analysis.

        Raises:
            NotMeasured: the result does not hold one.
        """

    def find(self, results: Sequence[Result]) -> Compliance:
        values = self.values(results[0])
        result = [self._judged(value) for value in values]
        if not result:
            raise NotMeasured("there is no such value in the result")
        found = worst(result)
        if found.passed:
            for one, value in zip(result, values, strict=True):
                self._check_known(one, value)
        return found

    def _check_known(self, found: Compliance, value: Value) -> None:
        """Raise where a value meets its limit by less than its error.

        Raises:
            NotMeasured: with the value, its error, and what makes that smaller.
        """
        error = value.error
        if found.margin is None or not isinstance(value.value, int | float):
            return
        if self.unit is not None and 0.0 < error < math.inf:
            ends = [convert(v, value.unit, self.unit, self.name) for v in (value.value + error, value.value)]
            error = abs(ends[0] - ends[1])
        if error > found.margin:
            raise NotMeasured(
                f"{found.value_words} is known to ± {error:.2g} only, {value.remedy.partition(': ')[0]}, and the limit "
                f"is {found.limit_words}: {value.remedy.partition(': ')[2]}"
            )

    def _judged(self, value: Value) -> Compliance:
        number, unit = value.value, value.unit
        if self.unit is not None and isinstance(number, int | float) and not isinstance(number, bool):
            number, unit = convert(float(number), value.unit, self.unit, self.name), self.unit
        return judge(number, self._limits(), unit=unit, where=value.where)

    def _limits(self) -> dict[str, float | bool | str]:
        given = {"min": self.min, "max": self.max, "equal": self.equal, "tolerance": self._tolerance()}
        return {name: value for name, value in given.items() if value is not None}

    def _tolerance(self) -> float | None:
        if self.relative is not None and isinstance(self.equal, int | float):
            return self.relative * abs(self.equal)
        return self.tolerance


def judge(
    value: float | bool | str,  # noqa: FBT001 - a value
    limit: Mapping[str, float | bool | str],
    *,
    unit: str | None = None,
    where: str = "",
) -> Compliance:
    """Compare a value with limits; the margin is that to the nearer one.

    Args:
        value: measured.
        limit: "min", "max", "equal", "tolerance".
        unit: of both; None: they have none.
        where: at which frequency, amplitude, time.
    """
    result = Compliance(value=value, unit=unit, limit=limit, where=where)
    if isinstance(value, str | bool) or isinstance(limit.get("equal"), str | bool):
        wanted = limit.get("equal")
        return replace(result, passed=type(value) is type(wanted) and value == wanted)
    margins = []
    if "min" in limit:
        margins.append(value - float(limit["min"]))
    if "max" in limit:
        margins.append(float(limit["max"]) - value)
    if "equal" in limit:
        margins.append(float(limit["tolerance"]) - abs(value - float(limit["equal"])))
    margin = min(margins)
    return result if math.isnan(margin) else replace(result, margin=margin, passed=margin >= 0.0)


def worst(findings: Sequence[Compliance]) -> Compliance:
    """Return the finding that is violated most, else that with the smallest margin."""
    return min(findings, key=lambda f: (f.passed, math.inf if f.margin is None else f.margin))


def convert(value: float, unit: str | None, wanted: str, where: str) -> float:
    """Return a value in another unit.

    Args:
        value: the number.
        unit: its unit; None: it has none.
        wanted: unit of the limits.
        where: for messages.

    Raises:
        InputError: one is not the other's kind, or is unknown.
    """
    if unit == wanted or (unit in _PLAIN and wanted in _PLAIN):
        return value
    from workbench.core.values.conversion import conversion, known_unit  # noqa: PLC0415 - seldom needed

    source, target = known_unit(unit or "1"), known_unit(wanted)
    if target is None and wanted not in ("dB", "%"):
        raise InputError(f"{where}: unit '{wanted}' is unknown")
    result = conversion(source, target) if source is not None and target is not None else None
    if result is None:
        raise InputError(f"{where}: unit '{wanted}' does not fit: the value is in {unit or 'no unit'}")
    factor, offset = result
    return factor * value + offset
