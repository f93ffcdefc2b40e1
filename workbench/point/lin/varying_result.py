"""A parameter-varying linear model: the result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import Linear
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.point.lin.interpolation import Axis, coefficients, products
from workbench.point.lin.varying_error import VaryingErrors
from workbench.show.result import Result

__all__ = ["MATRICES", "HeldOut", "SchedulingParameter", "VaryingModel"]

MATRICES = ("A", "B", "C", "D")
_POINT = ("x0", "u0", "y0")


@dataclass(frozen=True)
class SchedulingParameter(RecordPart):
    """What a model is scheduled by.

    Attributes:
        name: of a parameter, an input or a state.
        low, high: ends of its range [its unit].
        unit: of both; None: none is named.
    """

    name: str
    low: float
    high: float
    unit: str | None = None


@dataclass(frozen=True)
class HeldOut(RecordPart):
    """Errors at a point that is not in the grid.

    Attributes:
        values: scheduling parameter → value.
        errors: of the model there.
    """

    values: dict[str, float]
    errors: VaryingErrors = field(metadata=entry(inline=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class VaryingModel(Result):
    """A linear model whose matrices and operating point are functions of scheduling parameters p.

    dx/dt = A(p) (x − x0(p)) + B(p) (u − u0(p)), y = y0(p) + C(p) (x − x0(p)) + D(p) (u − u0(p)); x, u, y are those of
    the model itself, not deviations. All entries are interpolated over the grid.

    Attributes:
        model, interface, method: what was linearised, and how.
        scheduling: the parameters and their ranges.
        grid: parameter → its values; the last one varies fastest in the k points of the arrays.
        interpolation: "chebyshev" (polynomials) or "spline" (cubic).
        asked_error: largest error that was asked for.
        errors: largest errors over the ranges: those found at points beside the grid, and a quarter more.
        held_out: the points beside the grid, with the errors found there.
        linear_models: number of linear models that were made.
        trimmed: whether the equilibrium was found anew at each point, as the given one is not at rest everywhere.
        state_names, input_names, output_names: names of rows and columns.
        A: shape (k, n, n).
        B: shape (k, n, m).
        C: shape (k, q, n).
        D: shape (k, q, m).
        x0, u0, y0: states, inputs and outputs at the operating point, shapes (k, n), (k, m), (k, q).
        units: any of these names → unit, None where the model names none.
        notes: what else should be known, one line each.
    """

    _page = "workbench.point.lin.page:varying_page"
    _picture = "workbench.point.lin.picture:plot_varying"
    _WHAT, _COMMAND = "a parameter-varying model", "lin --over NAME=LO:HI"

    model: str
    interface: str
    method: str
    scheduling: tuple[SchedulingParameter, ...]
    grid: dict[str, tuple[float, ...]]
    interpolation: str
    asked_error: float
    errors: VaryingErrors
    held_out: tuple[HeldOut, ...]
    linear_models: int
    trimmed: bool
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    A: Floats
    B: Floats
    C: Floats
    D: Floats
    x0: Floats
    u0: Floats
    y0: Floats
    units: Mapping[str, str | None] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Bring the arrays into shape, also those without states or inputs."""
        n, m, q = len(self.state_names), len(self.input_names), len(self.output_names)
        shapes = {"A": (n, n), "B": (n, m), "C": (q, n), "D": (q, m), "x0": (n,), "u0": (m,), "y0": (q,)}
        k = int(np.prod([len(nodes) for nodes in self.grid.values()]))
        for name, shape in shapes.items():
            table = np.asarray(getattr(self, name), dtype=np.float64)
            if table.size != k * int(np.prod(shape)) or not np.isfinite(table).all():
                raise InputError(f"{name}: the parameter-varying model needs {k} times {shape} finite numbers")
            object.__setattr__(self, name, table.reshape(k, *shape))

    @property
    def complete(self) -> bool:
        """Whether the errors are as small as was asked for."""
        return self.errors.largest <= self.asked_error

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The parameters' nodes, with the functions that interpolate between them."""
        return tuple(Axis(np.array(nodes), self.interpolation) for nodes in self.grid.values())

    def factors(self, name: str) -> tuple[Floats, Floats]:
        """Return an array at the first point of the grid, and the factors of `products` that add what varies.

        Args:
            name: "A", "B", "C", "D", "x0", "u0" or "y0".

        Returns:
            Shapes (…) and (k, …); factors of entries that do not vary are 0.
        """
        table: Floats = getattr(self, name)
        varied = (table - table[0]).reshape(len(table), -1)
        return table[0], coefficients(self.axes, varied).reshape(table.shape)

    @cached_property
    def _factors(self) -> dict[str, tuple[Floats, Floats]]:
        return {name: self.factors(name) for name in (*MATRICES, *_POINT)}

    def at(self, values: Mapping[str, float]) -> Linear:
        """Return the linear model at values of the scheduling parameters; beyond a range that at its end.

        Args:
            values: scheduling parameter → value.

        Raises:
            InputError: a parameter is missing or unknown.
        """
        if set(values) != set(self.grid):
            raise InputError(f"values: give {', '.join(self.grid)}")
        weights = products(self.axes, np.array([[values[name] for name in self.grid]]))[0]
        found = {name: base + np.tensordot(weights, more, 1) for name, (base, more) in self._factors.items()}
        names = {"x0": self.state_names, "u0": self.input_names, "y0": self.output_names}
        x, u, y = (dict(zip(names[key], found[key].tolist(), strict=True)) for key in _POINT)
        return Linear(
            *(found[name] for name in MATRICES), state_names=self.state_names, input_names=self.input_names,
            output_names=self.output_names, units=self.units, operating_point=OperatingPoint(x=x, u=u, y=y),
        )  # fmt: skip

    def rows(self) -> Iterator[list[Any]]:
        """Yield one row for each entry of a matrix, behind the scheduling parameters."""
        yield [*self.grid, "matrix", "row", "column", "value"]
        points = np.stack(np.meshgrid(*self.grid.values(), indexing="ij"), axis=-1).reshape(-1, len(self.grid))
        sides = {"A": (self.state_names, self.state_names), "B": (self.state_names, self.input_names)}
        sides |= {"C": (self.output_names, self.state_names), "D": (self.output_names, self.input_names)}
        for k, point in enumerate(points.tolist()):
            for name, (left, top) in sides.items():
                table = getattr(self, name)[k]
                yield from ([*point, name, a, b, table[i, j]] for i, a in enumerate(left) for j, b in enumerate(top))
