"""An operating point: where a model stands, as trim finds it and lin uses it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.errors import InputError

__all__ = ["OperatingPoint"]

_SETS = ("x", "u", "y", "dx", "discrete")


@dataclass(frozen=True, kw_only=True)
class OperatingPoint:
    """States, inputs and outputs of a model at one instant.

    Not a full state of a black box: a co-simulation FMU shows no states, so `x` may be empty, and
    a point of a hybrid model holds those discrete states alone that the FMU shows.

    Attributes:
        x: continuous state → value, in the model's order.
        u: input → value; Booleans as 0.0 and 1.0.
        y: output → value.
        dx: continuous state → its time derivative [unit of the state / s].
        discrete: discrete state → value.
        units: any of these names → unit, None where the model names none.
        time: session time of the point [s].
        period: basic time period of a sampled or hybrid model, whose discrete states repeat after
            it [s]; None: continuous.
    """

    x: dict[str, float]
    u: dict[str, float]
    y: dict[str, float] = field(default_factory=dict)
    dx: dict[str, float] = field(default_factory=dict)
    discrete: dict[str, float] = field(default_factory=dict)
    units: dict[str, str | None] = field(default_factory=dict)
    time: float = 0.0
    period: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the point as plain dictionaries, ready for JSON."""
        sets = {name: dict(getattr(self, name)) for name in _SETS}
        return {**sets, "units": dict(self.units), "time": self.time, "period": self.period}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> OperatingPoint:
        """Return the point that `to_dict` or a trim's JSON describes; further keys are ignored.

        Args:
            data: with "x" and "u" at least.

        Raises:
            InputError: a key is missing, a value is no finite number.
        """
        for key in ("x", "u"):
            if key not in data:
                raise InputError(f"this is no operating point: '{key}' is missing")
        sets = {key: _numbers(key, data.get(key) or {}) for key in _SETS}
        period = data.get("period")
        return cls(
            **sets,
            units=_units(data.get("units") or {}),
            time=_number("time", data.get("time", 0.0)),
            period=None if period is None else _number("period", period),
        )

    @classmethod
    def read(cls, path: str | Path) -> OperatingPoint:
        """Return the point in a JSON file, e.g. one that `workbench trim --json` wrote.

        Args:
            path: of the file.

        Raises:
            InputError: no such file, not JSON, no operating point.
        """
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
        except ValueError as error:
            raise InputError(f"{path}: is not JSON: {error}") from None
        if not isinstance(data, Mapping):
            raise InputError(f"{path}: is no operating point: an object with x and u is needed")
        try:
            return cls.from_dict(data)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None


def _numbers(key: str, values: object) -> dict[str, float]:
    if not isinstance(values, Mapping):
        raise InputError(f"{key} must give a value to each name")
    return {str(name): _number(f"{key}: {name}", value) for name, value in values.items()}


def _number(what: str, value: object) -> float:
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{what} must be a finite number, not {json.dumps(value, default=str)}")
    return float(value)


def _units(units: object) -> dict[str, str | None]:
    if not isinstance(units, Mapping):
        raise InputError("units must give a unit to each name")
    return {str(name): None if unit is None else str(unit) for name, unit in units.items()}
