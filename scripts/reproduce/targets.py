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
from workbench.system.files.toml_schema import TomlTable, read_table

__all__ = [
    "BASES", "MET", "MISSED", "NOT_REACHABLE", "VERDICTS", "Instead", "Number", "PublishedTarget", "parse_targets",
    "read_targets",
]  # fmt: skip

Number = float | list[float]

# What is found of a target.
VERDICTS = MET, MISSED, NOT_REACHABLE = "met", "missed", "not reachable"

# What it says about the workbench that a target is met: most first.
Basis = Literal["predicted", "fitted", "structural"]
BASES: tuple[Basis, ...] = ("predicted", "fitted", "structural")

_FILE = Path(__file__).with_name("targets.toml")


class Instead(TomlTable):
    """What is measured in place of a published figure that is not met: to leave it is a failure, too.

    Attributes:
        low, high: limits, of each number where the target is a list.
        why: where these limits come from.
    """

    model_config = ConfigDict(frozen=True)

    low: Number
    high: Number
    why: str

    def accepts(self, measured: float | Sequence[float] | NDArray[np.float64]) -> bool:
        """Whether every number lies within the limits; NaN never does.

        Args:
            measured: as many as the limits, or any number of them where the limits are one number each.
        """
        found = np.asarray(measured, dtype=np.float64)
        return bool(np.all((found >= np.asarray(self.low)) & (found <= np.asarray(self.high))))

    @property
    def text(self) -> str:
        """The limits in words."""
        return _range(self.low, self.high)


class PublishedTarget(TomlTable):
    """One figure of the source report.

    Attributes:
        name: of the table in the file, and a word for the command line.
        chapter: of the source report, such as "8.3".
        figures: of the source report.
        what: is measured.
        value: published; None: there are limits only.
        absolute, relative: how far each number may be from `value`; a list: one for each number.
        low, high: limits, without `value`; None: none on that side.
        unit: of all of these; empty: none.
        origin: "printed": a number of the source report; "described": its words, the limits are our reading; "asked":
            a bound of our own where the source report gives no number.
        basis: "fitted": data of a bundled model, or of the experiment, were chosen to give it; "structural": it
            follows from how model or filter are made, or is a printed number that the model was given; "predicted":
            neither, so that it could have come out otherwise.
        fmu: bundled model whose data were chosen; None: not fitted.
        fitted_by: which data were chosen, and by what; None: not fitted.
        note: how it is read.
        reason: why it cannot be met: the source report contradicts itself or keeps its data to itself; None: it can.
        shortfall: why the bundled model does not meet it, though another could; None: it does.
        instead: what is measured where there is a reason or a shortfall.
    """

    model_config = ConfigDict(frozen=True)

    name: str
    chapter: str
    figures: list[int] = Field(default_factory=list)
    what: str
    value: Number | None = None
    absolute: Number | None = None
    relative: float | None = None
    low: Number | None = None
    high: Number | None = None
    unit: str = ""
    origin: Literal["printed", "described", "asked"] = "printed"
    basis: Basis
    fmu: str | None = None
    fitted_by: str | None = None
    note: str | None = None
    reason: str | None = None
    shortfall: str | None = None
    instead: Instead | None = None

    @model_validator(mode="after")
    def _explained(self) -> Self:
        if (self.basis == "fitted") != (self.fitted_by is not None) or (self.fmu is None) != (self.fitted_by is None):
            raise ValueError('needs fmu and fitted_by where its basis is "fitted", and nowhere else')
        if self.reason is not None and self.shortfall is not None:
            raise ValueError("has either a reason or a shortfall")
        if (self.instead is None) != (self.reason is None and self.shortfall is None):
            raise ValueError("needs instead = {low, high, why} where it has a reason or a shortfall, and nowhere else")
        return self

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        widths = [w for w in (self.absolute, self.relative) if w is not None]
        limits = self.low is not None or self.high is not None
        if (self.value is None) != limits or (self.value is None) != (not widths) or len(widths) > 1:
            raise ValueError("needs value with either absolute or relative, or low, high, or both of these")
        if any(np.any(np.asarray(w) < 0.0) for w in widths):
            raise ValueError("has a negative tolerance")
        if isinstance(self.absolute, list) and not (
            isinstance(self.value, list) and len(self.absolute) == len(self.value)
        ):
            raise ValueError("needs one tolerance, or as many as it has numbers")
        return self

    @property
    def limits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest numbers accepted, each a scalar or shape (n,)."""
        if self.value is not None:
            middle = np.asarray(self.value, dtype=np.float64)
            width = np.abs(middle) * (self.relative or 0.0) if self.absolute is None else np.asarray(self.absolute)
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

    def expects(self, measured: float | Sequence[float] | NDArray[np.float64]) -> bool:
        """Whether a measured number is accepted, or is what the target says is measured instead.

        Args:
            measured: see `accepts`.

        Raises:
            InputError: see `accepts`.
        """
        return self.accepts(measured) or (self.instead is not None and self.instead.accepts(measured))

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
            return f"± {_numbers(self.absolute, 4)}" if np.any(self.absolute) else "exact"
        return "limits" if self.low is not None and self.high is not None else "limit"

    def _between(self) -> str:
        if self.low is None:
            return f"≤ {_numbers(self.high)}"
        if self.high is None:
            return f"≥ {_numbers(self.low)}"
        return _range(self.low, self.high)


def _range(low: Number, high: Number) -> str:
    lows, highs = np.broadcast_arrays(*(np.atleast_1d(np.asarray(x, dtype=np.float64)) for x in (low, high)))
    pairs = zip(lows.tolist(), highs.tolist(), strict=True)
    return ", ".join(f"{a:.7g}" if a == b else f"{a:.7g} … {b:.7g}" for a, b in pairs)


def _numbers(value: Number | None, digits: int = 8) -> str:
    return ", ".join(f"{x:.{digits}g}" for x in np.atleast_1d(np.asarray(value, dtype=np.float64)).tolist())


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {unit}" if unit else text


@cache
def read_targets() -> Mapping[str, PublishedTarget]:
    """Return all targets by name, in the order of the source report."""
    return MappingProxyType(parse_targets(_FILE.read_text(encoding="utf-8"), _FILE.name))


def parse_targets(text: str, where: str) -> dict[str, PublishedTarget]:
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
        found[name] = read_table(PublishedTarget, {**table, "name": name}, f"{where}: [{name}]")
    return found
