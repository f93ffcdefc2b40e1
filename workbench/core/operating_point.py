"""An operating point: where a model stands. Trim finds it, every analysis can start there, every result names it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from workbench.core.forms import FILE
from workbench.core.option import Options, option
from workbench.errors import InputError

__all__ = ["At", "AtPoint", "HasPoint", "OperatingPoint", "Stands", "point_in_json", "point_of_json"]

_SETS = ("x", "u", "y", "dx", "discrete")
_KEY = "operating_point"
# What a linear model's file called these before it had an operating point of its own.
_OF_LINEAR = {"x": "x0", "u": "u0", "y": "y0", "dx": "dx0", "discrete": "discrete0"}


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
        model: name of the model whose point it is; empty: not said.
        model_sha256: hash of that model's content, an FMU's file or a system with all its parts; empty: not known.
        parameters: parameters that were set when the point was found → value; the others had the model's own.
    """

    x: dict[str, float]
    u: dict[str, float]
    y: dict[str, float] = field(default_factory=dict)
    dx: dict[str, float] = field(default_factory=dict)
    discrete: dict[str, float] = field(default_factory=dict)
    units: dict[str, str | None] = field(default_factory=dict)
    time: float = 0.0
    period: float | None = None
    model: str = ""
    model_sha256: str = ""
    parameters: dict[str, Any] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        """States, discrete states and inputs → value: where a session has to be started."""
        return {**self.x, **self.discrete, **self.u}

    def words(self, most: int = 4) -> str:
        """Return inputs and states in one line, e.g. for a table.

        Args:
            most: so many of each are named.
        """
        shown = [self._listed(values, most) for values in (self.u, self.x, self.discrete)]
        return "; ".join([*filter(None, shown), f"t = {self.time:g} s"])

    def _listed(self, values: Mapping[str, float], most: int) -> str:
        units = {name: unit for name in values if (unit := self.units.get(name)) and unit != "1"}
        texts = [f"{n} = {v:.6g}" + (f" {units[n]}" if n in units else "") for n, v in list(values.items())[:most]]
        more = [f"… ({len(values)} in all)"] if len(values) > most else []
        return ", ".join([*texts, *more])

    def to_dict(self) -> dict[str, Any]:
        """Return the point as plain dictionaries, ready for JSON."""
        sets = {name: dict(getattr(self, name)) for name in _SETS}
        return {
            "model": self.model,
            "model_sha256": self.model_sha256,
            "parameters": dict(self.parameters),
            **sets,
            "units": dict(self.units),
            "time": self.time,
            "period": self.period,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> OperatingPoint:
        """Return the point that `to_dict` or the JSON of any result describes; further keys are ignored.

        Args:
            data: with "operating_point", or with "x" and "u" (a point, a trim) or "x0" and "u0" (a linear model).

        Raises:
            InputError: a key is missing, a value is not a finite number.
        """
        data = _inner(data)
        for key in ("x", "u"):
            if key not in data:
                raise InputError(f"is not an operating point: '{key}' is missing; workbench trim --json writes one")
        sets = {key: _numbers(key, data.get(key) or {}) for key in _SETS}
        period = data.get("period")
        return cls(
            **sets,
            units=_units(data.get("units") or {}),
            time=_number("time", data.get("time", 0.0)),
            period=None if period is None else _number("period", period),
            model=_text("model", data.get("model")),
            model_sha256=_text("model_sha256", data.get("model_sha256")),
            parameters=_mapping("parameters", data.get("parameters") or {}),
        )

    @classmethod
    def read(cls, path: str | Path) -> OperatingPoint:
        """Return the point in a JSON file: what `workbench trim --json` or any other command wrote.

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
            raise InputError(f"{path}: is not an operating point: an object with x and u is needed")
        try:
            return cls.from_dict(data)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None


class HasPoint(Protocol):
    """A result that is a point, or is about one: of `trim`, of `lin`."""

    @property
    def point(self) -> OperatingPoint:
        """The operating point."""


class Stands(Protocol):
    """A result that was measured at a point: all others."""

    @property
    def operating_point(self) -> OperatingPoint | None:
        """The operating point; None: not known."""


# What `at` takes in every function: a point, a result that has one, or the file of either.
At = OperatingPoint | HasPoint | Stands | str | Path


class AtPoint(Options):
    """The part of a request that says where its runs start."""

    group = "Model"

    _: KW_ONLY
    at: At | None = option(
        "Operating point to start from: what trim --json wrote, or the JSON of any other result.",
        metavar="POINT.JSON",
        form=FILE,
        default=None,
    )


def point_in_json(point: OperatingPoint | None) -> dict[str, Any]:
    """Return the entry by which every result says where it was measured, in the form that `from_dict` reads."""
    return {_KEY: None if point is None else point.to_dict()}


def point_of_json(data: Mapping[str, Any]) -> OperatingPoint | None:
    """Return the point of a result's JSON; None: it has none, as those of earlier versions.

    Raises:
        InputError: it is not a point.
    """
    return None if data.get(_KEY) is None else OperatingPoint.from_dict(data)


def _inner(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the mapping that holds x and u."""
    inner = data.get(_KEY)
    if isinstance(inner, Mapping):
        for key in ("x", "u"):
            _refuse_two_values(key, data.get(key), inner.get(key))
        return inner
    if "x" not in data and "x0" in data:
        return {**data, **{name: data[old] for name, old in _OF_LINEAR.items() if old in data}}
    return data


def _refuse_two_values(key: str, outer: object, inner: object) -> None:
    """A trim's file holds its point twice; a change by hand of one of them must not be lost.

    A record of an experiment holds samples under the same names, which are no second copy.
    """
    if not (isinstance(outer, Mapping) and isinstance(inner, Mapping)):
        return
    for name in outer.keys() & inner.keys():
        if not isinstance(outer[name], list) and outer[name] != inner[name]:
            raise InputError(
                f"holds two values of {name}: {outer[name]} in '{key}' and {inner[name]} in '{_KEY}'; "
                f"change '{_KEY}', and remove or change the other"
            )


def _numbers(key: str, values: object) -> dict[str, float]:
    return {name: _number(f"{key}: {name}", value) for name, value in _mapping(key, values).items()}


def _number(what: str, value: object) -> float:
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{what} must be a finite number, not {json.dumps(value, default=str)}")
    return float(value)


def _mapping(key: str, values: object) -> dict[str, Any]:
    if not isinstance(values, Mapping):
        raise InputError(f"{key} must give a value to each name")
    return {str(name): value for name, value in values.items()}


def _units(units: object) -> dict[str, str | None]:
    if not isinstance(units, Mapping):
        raise InputError("units must give a unit to each name")
    return {str(name): None if unit is None else str(unit) for name, unit in units.items()}


def _text(key: str, value: object) -> str:
    if value is None:
        return ""
    if not isinstance(value, str):
        raise InputError(f"{key} must be text, not {json.dumps(value, default=str)}")
    return value
