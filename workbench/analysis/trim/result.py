"""The result of a trim."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from workbench.core.operating_point import OperatingPoint, point_in_json
from workbench.csv_file import write_csv
from workbench.origin import Reportable

__all__ = ["NullDirection", "Residual", "TrimResult"]


@dataclass(frozen=True, kw_only=True)
class Residual:
    """What is left of one equation at the point.

    Attributes:
        name: of the equation, e.g. "der(x)", "change of x" (over the basic period), "y = 2".
        value: [unit].
        unit: None where the model names none.
        scaled: `value` over the change that each unknown makes in it when it moves by its nominal value, or by itself
            where that is more; over its nominal value (per second) where no unknown changes it.
        required: False for a floating derivative, which need not vanish.
        idle: whether no unknown changes it at the point.
    """

    name: str
    value: float
    unit: str | None
    scaled: float
    required: bool = True
    idle: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, ready for JSON."""
        return dict(vars(self))


@dataclass(frozen=True, kw_only=True)
class NullDirection:
    """A direction in which the unknowns may change together and every equation still holds, at least at first.

    Attributes:
        components: unknown → its change [its unit]; the largest is one nominal value, those of no effect are left out.
    """

    components: dict[str, float]

    def __str__(self) -> str:
        return ", ".join(f"{name} {value:+.4g}" for name, value in self.components.items())


@dataclass(frozen=True, kw_only=True)
class TrimResult(Reportable):
    """An operating point, or where the search for one ended.

    Attributes:
        model: name of the model.
        interface: "me" or "cs".
        solver: integration method of the model's sessions.
        method: "equations" (derivatives set to zero), "period map" (fixed point over the basic period), "step map"
            (fixed point over a communication step), "running" (run until nothing moves).
        point: states, inputs, outputs and derivatives there.
        residuals: one for each equation, required ones first.
        null_directions: what the equations leave open at the point: a family of equilibria.
        converged: whether it is an equilibrium: every required equation vanishes against what it does around the point.
        message: what came out, one line.
        unknowns: names of what was searched for.
        iterations: of the search.
        evaluations: of the model: points, periods or runs.
        notes: remarks, one line each.
    """

    model: str
    interface: str
    solver: str
    method: str
    point: OperatingPoint
    residuals: tuple[Residual, ...]
    null_directions: tuple[NullDirection, ...]
    converged: bool
    message: str
    unknowns: tuple[str, ...]
    iterations: int
    evaluations: int
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, ready for JSON; `OperatingPoint.from_dict` reads the point back."""
        return {
            "interface": self.interface,
            "solver": self.solver,
            "method": self.method,
            **self.point.to_dict(),
            "model": self.model,
            **point_in_json(self.point),
            "residual": [r.to_dict() for r in self.residuals],
            "null_directions": [dict(d.components) for d in self.null_directions],
            "converged": self.converged,
            "message": self.message,
            "unknowns": list(self.unknowns),
            "iterations": self.iterations,
            "evaluations": self.evaluations,
            "notes": list(self.notes),
        }

    def to_csv(self, path: str | Path | TextIO) -> None:
        """Write one line per number: set (x, u, y, dx, discrete, residual), name, value, unit.

        Args:
            path: file to write, or an open text stream.

        Raises:
            InputError: the file cannot be written.
        """
        write_csv(path, self._rows())

    def _rows(self) -> Iterator[list[Any]]:
        yield ["set", "name", "value", "unit"]
        point = self.point
        for name in ("x", "discrete", "u", "y", "dx"):
            values: dict[str, float] = getattr(point, name)
            for variable, value in values.items():
                unit = point.units.get(variable) or ""
                yield [name, variable, value, f"{unit or '1'} / s" if name == "dx" else unit]
        for residual in self.residuals:
            left = residual.value if math.isfinite(residual.value) else ""
            yield ["residual", residual.name, left, residual.unit or ""]
