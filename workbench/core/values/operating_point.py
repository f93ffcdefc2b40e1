"""An operating point: where a model stands. Trim finds it, every analysis can start there, every result names it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from workbench.core.records.forms import FILE
from workbench.core.records.option import Options, option
from workbench.core.records.record import RecordPart
from workbench.errors import InputError

__all__ = ["At", "AtPoint", "OperatingPoint", "Stands", "point_of_json", "told"]

_SETS = ("x", "u", "y", "dx", "discrete")
_ROUNDING = 1e-24  # what a search leaves of a speed or the like that is 0; no quantity of an FMU is so small
_KEY = "operating_point"
# What a linear model's file called these before it had an operating point of its own.
_OF_LINEAR = {"x": "x0", "u": "u0", "y": "y0", "dx": "dx0", "discrete": "discrete0"}


@dataclass(frozen=True, kw_only=True)
class OperatingPoint(RecordPart):
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
        """Return inputs and states in one line, e.g. for a table; what a search left by rounding, below 1e-24, is 0.

        Args:
            most: largest number of each that is named.
        """
        sets = {"inputs": self.u, "states": self.x, "discrete states": self.discrete}
        shown = [self._listed(kind, values, most) for kind, values in sets.items()]
        return "; ".join([*filter(None, shown), f"t = {self.time:g} s"])

    def _listed(self, kind: str, values: Mapping[str, float], most: int) -> str:
        if len(values) > most and not any(told(v) for v in values.values()):
            return f"all {len(values)} {kind} 0"
        units = {name: unit for name in values if (unit := self.units.get(name)) and unit != "1"}
        named = list(values.items())[:most]
        texts = [f"{n} = {told(v):.6g}" + (f" {units[n]}" if n in units else "") for n, v in named]
        more = [f"… ({len(values)} in all)"] if len(values) > most else []
        return ", ".join([*texts, *more])

    _WHAT, _COMMAND = "an operating point", "trim"

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the keys of a point: "operating_point", "x" and "u" (a point, a trim) or "x0" and "u0" (`lin`)."""
        known = {key: held for key, held in _inner(data).items() if held is not None}
        for key in (*_SETS, "time", "period"):
            _refuse_infinite(key, known.get(key))
        return known


def told(value: float) -> float:
    """Return a value as it is printed: 0 where a search left rounding alone, below 1e-24 in any unit.

    Args:
        value: of a state, an input, an output or a derivative [its unit].
    """
    return 0.0 if abs(value) < _ROUNDING else value


class Stands(Protocol):
    """A result that was measured at a point, or is one."""

    @property
    def operating_point(self) -> OperatingPoint | None:
        """The operating point; None: not known."""


# What `at` takes in every function: a point, a result that has one, or the file of either.
At = OperatingPoint | Stands | str | Path


class AtPoint(Options):
    """The part of a request that says where its runs start."""

    group = "Model"

    _: KW_ONLY
    at: At | None = option(
        "Operating point to start from: what trim --json wrote, or the JSON of any other result.",
        metavar="POINT.JSON",
        form=FILE,
        default=None,
        first=True,
    )


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


def _refuse_infinite(key: str, held: object) -> None:
    for name, number in held.items() if isinstance(held, Mapping) else [(None, held)]:
        if (number is None and name is not None) or (isinstance(number, float) and not math.isfinite(number)):
            what = key if name is None else f"{key}: {name}"
            raise InputError(f"{what} must be a finite number, not {json.dumps(number)}")
