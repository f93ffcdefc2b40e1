"""From a parameter-varying linear model to a :class:`~workbench.build.scalar_model.ScalarModel`.

The scheduling parameters are inputs, held within their ranges. The functions of them that all entries are sums of,
products of Chebyshev polynomials or of B-splines, are variables of their own, so that each entry is one row of factors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.build.expressions import MATRIX, VARIABLE, ExpressionGraph
from workbench.build.matrices import StateSpaceFile, matrices_of
from workbench.build.scalar_model import ScalarModel
from workbench.build.state_space import Builder
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.point.lin.interpolation import Axis
from workbench.point.lin.varying_result import VaryingModel

__all__ = ["frozen", "varying_state_space"]


def frozen(varying: VaryingModel) -> StateSpaceFile:
    """Return the linear model in the middle of the ranges, where the FMU starts; its states are no deviations.

    Args:
        varying: the parameter-varying model.
    """
    linear = varying.at({p.name: 0.5 * (p.low + p.high) for p in varying.scheduling})
    point = linear.operating_point
    if point is None:
        raise InputError("this is not a parameter-varying model: it has no operating point")
    values = {name: getattr(linear, name) for name in ("A", "B", "C", "D", "dt", "state_names", "input_names")}
    start = [point.x[name] for name in linear.state_names]
    rest = [point.y[name] for name in linear.output_names]
    values |= {"output_names": linear.output_names, "u0": point.u, "x0": start, "y0": rest - linear.C @ start}
    return matrices_of({**values, "units": {n: u for n, u in varying.units.items() if u}})


def varying_state_space(varying: VaryingModel, matrices: StateSpaceFile, name: str) -> ScalarModel:
    """Return the scalar model of a parameter-varying model.

    Args:
        varying: the parameter-varying model.
        matrices: the model where the FMU starts.
        name: of the FMU's model.

    Raises:
        InputError: a scheduling parameter has the name of an input or output.
    """
    words = f"Linear model of {varying.model}, order {len(varying.state_names)}, varying with {', '.join(varying.grid)}"
    model = ScalarModel(name, words, ExpressionGraph())
    return _VaryingBuilder(matrices=matrices, model=model, varying=varying).run()


@dataclass(kw_only=True)
class _VaryingBuilder(Builder):
    varying: VaryingModel
    basis: list[int] = field(default_factory=list)
    scheduled: list[int] = field(default_factory=list)
    deviations: list[int] = field(default_factory=list)  # x − x0(p), then u − u0(p)

    def _declare(self) -> None:
        twice = {p.name for p in self.varying.scheduling} & {*self.varying.input_names, *self.varying.output_names}
        if twice:
            raise InputError(f"{min(twice)} is a scheduling parameter, and an input or output of the linear model, too")
        super()._declare()
        for p in self.varying.scheduling:
            name = self._free(p.name, "scheduling")
            middle = 0.5 * (p.low + p.high)
            words = f"Scheduling parameter, held between {p.low:g} and {p.high:g}"
            self.scheduled.append(self._variable(name, "input", middle, unit=p.unit, description=words))
        count = int(np.prod([len(axis.nodes) for axis in self.varying.axes]))
        names = (self._free(f"basis[{k + 1}]", "scheduling") for k in range(count))
        self.basis = [self._variable(n, "algebraic", 0.0, description="Function of the parameters") for n in names]

    def _continuous_equations(self) -> None:
        self._define_basis()
        leaf = [self.graph.leaf(VARIABLE, reference) for reference in (*self.states, *self.inputs)]
        rest = [*self._entries("x0"), *self._entries("u0")]
        self.deviations = [self.graph.subtract(a, b) for a, b in zip(leaf, rest, strict=True)]
        a, b, c, d, y0 = (self._entries(name) for name in ("A", "B", "C", "D", "y0"))
        n, m = len(self.states), len(self.inputs)
        for i, rate in enumerate(self.rates):
            row = [*a[i * n : (i + 1) * n], *b[i * m : (i + 1) * m]]
            self._residual(rate, self._sum(self.graph.number(0.0), row), "der(x) = A (x - x0) + B (u - u0)", i)
        for i, output in enumerate(self.outputs):
            row = [*c[i * n : (i + 1) * n], *d[i * m : (i + 1) * m]]
            self._residual(output, self._sum(y0[i], row), "y = y0 + C (x - x0) + D (u - u0)", i)

    def _sum(self, total: int, factors: Sequence[int]) -> int:
        for factor, moved in zip(factors, self.deviations, strict=True):
            total = self.graph.add(total, self.graph.multiply(factor, moved))
        return total

    def _entries(self, name: str) -> list[int]:
        """Return the expressions of all entries of a matrix or vector, row by row."""
        graph = self.graph
        base, factors = self.varying.factors(name)
        columns = factors.reshape(len(factors), -1).T
        return [
            graph.add(graph.number(start), graph.matrix_row(MATRIX, row.tolist(), self.basis[0]))
            if np.any(row) else graph.number(start)
            for start, row in zip(base.ravel().tolist(), columns, strict=True)
        ]  # fmt: skip

    def _define_basis(self) -> None:
        graph = self.graph
        terms = [graph.number(1.0)]
        for axis, reference in zip(self.varying.axes, self.scheduled, strict=True):
            own = self._chebyshev(axis, reference) if axis.kind == "chebyshev" else self._splines(axis, reference)
            terms = [graph.multiply(a, b) for a in terms for b in own]
        for k, (variable, term) in enumerate(zip(self.basis, terms, strict=True)):
            self._residual(variable, term, "basis of the scheduling parameters", k)

    def _held(self, axis: Axis, reference: int) -> int:
        low, high = (self.graph.number(float(axis.nodes[end])) for end in (0, -1))
        value = self.graph.apply("max", low, self.graph.leaf(VARIABLE, reference))
        return self.graph.apply("min", high, value)

    def _chebyshev(self, axis: Axis, reference: int) -> list[int]:
        """Return T_0, T_1, … by their recurrence, T_{k+1}(t) = 2 t T_k(t) − T_{k−1}(t)."""
        graph, low, high = self.graph, float(axis.nodes[0]), float(axis.nodes[-1])
        middle = graph.subtract(self._held(axis, reference), graph.number(0.5 * (low + high)))
        t = graph.multiply(graph.number(2.0 / (high - low)), middle)
        result = [graph.number(1.0), t]
        for _ in range(len(axis.nodes) - 2):
            twice = graph.multiply(graph.number(2.0), graph.multiply(t, result[-1]))
            result.append(graph.subtract(twice, result[-2]))
        return result

    def _splines(self, axis: Axis, reference: int) -> list[int]:
        """Return the B-splines, each a choice of polynomials: smooth where these meet, without an event."""
        graph, held = self.graph, self._held(axis, reference)
        result = [graph.number(0.0)] * len(axis.nodes)
        for begin, end, some in reversed(axis.pieces()):
            before = graph.apply("less", held, graph.number(end))
            here = {j: self._horner(graph.subtract(held, graph.number(begin)), powers) for j, powers in some}
            last = end == axis.nodes[-1]
            for j in range(len(result)):
                value = here.get(j, graph.number(0.0))
                result[j] = value if last else graph.select(before, value, result[j])
        return result

    def _horner(self, x: int, powers: Floats) -> int:
        graph, total = self.graph, self.graph.number(0.0)
        for factor in powers.tolist():
            total = graph.add(graph.multiply(total, x), graph.number(factor))
        return total
