"""The result of a trim."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.conversion import rate_unit
from workbench.core.values.operating_point import OperatingPoint
from workbench.show.result import Result

__all__ = ["NullDirection", "Residual", "TrimResult"]


@dataclass(frozen=True, kw_only=True)
class Residual(RecordPart):
    """What is left of one equation at the point.

    Attributes:
        name: name of the equation, e.g. "der(x)", "change of x" (over the basic period), "y = 2".
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


@dataclass(frozen=True, kw_only=True)
class NullDirection(RecordPart):
    """A direction in which the unknowns may change together and every equation still holds, at least at first.

    Attributes:
        components: unknown → its change [its unit]; the largest is one nominal value, those of no effect are left out.
    """

    components: dict[str, float] = field(metadata=entry(inline=True))

    def __str__(self) -> str:
        return ", ".join(f"{name} {value:+.4g}" for name, value in self.components.items())


@dataclass(frozen=True, kw_only=True)
class TrimResult(Result):
    """An operating point, or where the search for one ended.

    Attributes:
        model: name of the model.
        interface: "me" or "cs".
        solver: integration method of the model's sessions.
        method: "equations" (derivatives set to zero), "period map" (fixed point over the basic period), "step map"
            (fixed point over a communication step), "running" (run until nothing moves).
        operating_point: states, inputs, outputs and derivatives there.
        residuals: one for each equation, required ones first.
        null_directions: what the equations leave open at the point: a family of equilibria.
        converged: whether it is an equilibrium: every required equation vanishes against what it does around the point.
        message: what came out, one line.
        unknowns: names of what was searched for.
        iterations: number of iterations of the search.
        evaluations: number of evaluations of the model: points, periods or runs.
        notes: remarks, one line each.
    """

    _page = "workbench.point.trim.page:trim_page"
    _picture = "workbench.point.trim.picture:plot_residuals"

    model: str
    interface: str
    solver: str
    method: str
    operating_point: OperatingPoint
    residuals: tuple[Residual, ...] = field(metadata=entry(key="residual"))
    null_directions: tuple[NullDirection, ...]
    converged: bool
    message: str
    unknowns: tuple[str, ...]
    iterations: int
    evaluations: int
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a trim", "trim"

    def derived(self) -> dict[str, Any]:
        """Return the point's own keys, by which `OperatingPoint.from_dict` reads it, too.

        Keys:
            x, u, y, dx, discrete: name → value at the point.
            units, time, period: of these; session time [s]; basic period of a sampled model [s].
            model_sha256, parameters: whose point it is: hash of the model; parameters that were set.
        """
        return self.operating_point.to_dict()

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the point with the keys of the trim that it has, too."""
        return {**data, "operating_point": OperatingPoint.from_dict(data)}

    def rows(self) -> Iterator[list[Any]]:
        """Yield one row for each number: set (x, u, y, dx, discrete, residual), name, value, unit."""
        yield ["set", "name", "value", "unit"]
        point = self.operating_point
        for name in ("x", "discrete", "u", "y", "dx"):
            values: dict[str, float] = getattr(point, name)
            for variable, number in values.items():
                unit = point.units.get(variable) or ""
                yield [name, variable, number, rate_unit(unit) or "1/s" if name == "dx" else unit]
        for residual in self.residuals:
            yield ["residual", residual.name, residual.value, residual.unit or ""]
