"""The published figures: target, tolerance, place in the source report, and why some cannot be met."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from workbench.errors import InputError
from workbench.system.toml_schema import Table, read_table

__all__ = ["MET", "MISSED", "NOT_REACHABLE", "Number", "Target", "parse_targets", "read_targets"]

Number = float | list[float]

# What is found of a target.
MET, MISSED, NOT_REACHABLE = "met", "missed", "not reachable"

_FILE = Path(__file__).with_name("targets.toml")


class Target(Table):
    """One figure of the source report.

    Attributes:
        name: of the table in the file, and a word for the command line.
        chapter: of the source report, such as "8.3".
        figures: of the source report.
        what: is measured.
        value: published; None: there are limits only.
        absolute, relative: how far each number may be from `value`.
        low, high: limits, without `value`; None: none on that side.
        unit: of all of these; empty: none.
        origin: "printed": a number of the source report; "described": its words, the limits are our reading; "asked":
            a bound of our own where the source report gives no number.
        note: how it is read.
        reason: why it cannot be met; None: it can.
    """

    model_config = ConfigDict(frozen=True)

    name: str
    chapter: str
    figures: list[int] = Field(default_factory=list)
    what: str
    value: Number | None = None
    absolute: float | None = None
    relative: float | None = None
    low: Number | None = None
    high: Number | None = None
    unit: str = ""
    origin: Literal["printed", "described", "asked"] = "printed"
    note: str | None = None
    reason: str | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        widths = [w for w in (self.absolute, self.relative) if w is not None]
        limits = self.low is not None or self.high is not None
        if (self.value is None) != limits or (self.value is None) != (not widths) or len(widths) > 1:
            raise ValueError("needs value with either absolute or relative, or low, high, or both of these")
        if any(w < 0.0 for w in widths):
            raise ValueError("has a negative tolerance")
        return self

    @property
    def limits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest numbers accepted, each a scalar or shape (n,)."""
        if self.value is not None:
            middle = np.asarray(self.value, dtype=np.float64)
            width = self.absolute if self.absolute is not None else np.abs(middle) * (self.relative or 0.0)
            return middle - width, middle + width
        low = -np.inf if self.low is None else self.low
        high = np.inf if self.high is None else self.high
        return np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)

    def accepts(self, measured: float | Sequence[float] | NDArray[np.float64]) -> bool:
        """Whether a measured number, or every one of a list, is within the tolerance; NaN never is.

        Args:
            measured: as many as the target has; any number of them where it has one.

        Raises:
            InputError: not as many numbers as the target has, or none.
        """
        found = np.asarray(measured, dtype=np.float64)
        low, high = self.limits
        wanted = max(low.size, high.size)
        if found.size == 0 or ((low.ndim or high.ndim) and found.size != wanted):
            raise InputError(f"target {self.name}: {found.size} numbers measured, {wanted} wanted")
        return bool(np.all((found >= low) & (found <= high)))

    @property
    def text(self) -> str:
        """What is asked, in words: number and unit, or limits."""
        return _with_unit(_numbers(self.value) if self.value is not None else self._between(), self.unit)

    @property
    def tolerance(self) -> str:
        """How far off it may be, in words."""
        if self.relative is not None:
            return f"± {100.0 * self.relative:.4g} %"
        if self.absolute is not None:
            return f"± {self.absolute:.4g}" if self.absolute else "exact"
        return "limits" if self.low is not None and self.high is not None else "limit"

    def _between(self) -> str:
        if self.low is None:
            return f"≤ {_numbers(self.high)}"
        if self.high is None:
            return f"≥ {_numbers(self.low)}"
        low, high = np.broadcast_arrays(*(np.atleast_1d(x) for x in (self.low, self.high)))
        return ", ".join(f"{a:.7g} … {b:.7g}" for a, b in zip(low.tolist(), high.tolist(), strict=True))


def _numbers(value: Number | None) -> str:
    return ", ".join(f"{x:.8g}" for x in np.atleast_1d(np.asarray(value, dtype=np.float64)).tolist())


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {unit}" if unit else text


@cache
def read_targets() -> Mapping[str, Target]:
    """Return all targets by name, in the order of the source report."""
    return MappingProxyType(parse_targets(_FILE.read_text(encoding="utf-8"), _FILE.name))


def parse_targets(text: str, where: str) -> dict[str, Target]:
    """Return the targets that a file holds.

    Args:
        text: of the file, TOML.
        where: its name, for messages.

    Raises:
        InputError: not TOML, a key that is unknown or missing, a value of the wrong type.
    """
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where}: {error}") from None
    found = {}
    for name, table in tables.items():
        if not isinstance(table, Mapping):
            raise InputError(f"{where}: '{name}' is not a table; a target is a table [{name}]")
        found[name] = read_table(Target, {**table, "name": name}, f"{where}: [{name}]")
    return found
