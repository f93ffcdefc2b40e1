"""From a linear state-space model to a :class:`~workbench.build.scalar_model.ScalarModel`.

No Modelica in between: names such as "a.b" and "x[1]" are variables of an FMU but no Modelica identifiers, and
the front end would read each matrix only to unroll it again. Entries that are zero disappear, so the model
description tells the true dependencies.

A discrete model is one clock. At each tick y = y0 + C pre(x) + D (u − u0) and x = A pre(x) + B (u − u0), the scheme of
Modelica.Blocks.Discrete.StateSpace: y[k] holds the effect of u[k], and the variable x has, from tick k to tick k + 1,
the value x[k + 1] that the next tick will use.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from workbench.build.expressions import CONDITION, MATRIX, MATRIX_PRE, PRE, TICK, VARIABLE, ExpressionGraph
from workbench.build.ir import SourceLocation
from workbench.build.matrices import StateSpaceFile
from workbench.build.scalar_model import (
    ConditionalBranch,
    DiscreteEquation,
    ModelClock,
    ResidualEquation,
    ScalarModel,
    ScalarVariable,
)
from workbench.build.time_scale import nominals
from workbench.build.units import rate_unit
from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = ["Builder", "naming", "state_space"]


_NAME = r"[A-Za-z_]\w*(\[\d+(,\d+)*\])?"
_IDENTIFIER = rf"{_NAME}(\.{_NAME})*"
_STRUCTURED = re.compile(rf"({_IDENTIFIER}|der\({_IDENTIFIER}\))", flags=re.ASCII)

_LONG = 16  # a row of so many numbers becomes a loop,
_DENSE = 0.25  # where so many of them are not 0
# A period is written as a quotient of whole numbers, the simplest that is this close.
_SAME_PERIOD = Fraction(1, 10**15)
_MOST_DENOMINATOR = 10**15  # the runtime counts in 64 bits


def state_space(matrices: StateSpaceFile, name: str) -> ScalarModel:
    """Return the scalar model of a linear model.

    Args:
        matrices: the linear model, checked.
        name: of the FMU's model.

    Raises:
        InputError: the period cannot be written as a quotient of whole numbers.
    """
    return Builder(matrices, ScalarModel(name, _description(matrices), ExpressionGraph())).run()


def naming(model: ScalarModel) -> str:
    """Return FMI's variable naming convention that all names of `model` follow: "structured" or "flat"."""
    return "structured" if all(_STRUCTURED.fullmatch(v.name) for v in model.variables) else "flat"


def _description(matrices: StateSpaceFile) -> str:
    order = f"order {len(matrices.state_names)}"
    if matrices.dt > 0.0:
        return f"Discrete linear state-space model, {order}, sampled at {matrices.dt:.9g} s"
    return f"Continuous linear state-space model, {order}"


@dataclass(slots=True)
class Builder:
    """Makes the variables and equations of a linear model; one that varies puts its own in place of the latter."""

    matrices: StateSpaceFile
    model: ScalarModel
    taken: set[str] = field(default_factory=set)
    inputs: list[int] = field(default_factory=list)
    outputs: list[int] = field(default_factory=list)
    states: list[int] = field(default_factory=list)
    rates: list[int] = field(default_factory=list)

    @property
    def sampled(self) -> bool:
        return self.matrices.dt > 0.0

    @property
    def graph(self) -> ExpressionGraph:
        return self.model.graph

    def run(self) -> ScalarModel:
        self._declare()
        if self.sampled:
            self._discrete_equations()
        else:
            self._continuous_equations()
        return self.model

    # Variables

    def _declare(self) -> None:
        m = self.matrices
        self.taken = {*m.input_names, *m.output_names}
        self._variable(self._free("time", "simulation"), "time", 0.0, unit="s", description="Simulation time")
        for name, start in zip(m.input_names, m.u0, strict=True):
            self.inputs.append(self._variable(name, "input", start))
        rest = m.y0 + m.C @ m.x0
        for name, start in zip(m.output_names, rest, strict=True):
            self.outputs.append(self._variable(name, "discrete" if self.sampled else "algebraic", start, output=True))
        self._declare_states()

    def _declare_states(self) -> None:
        m = self.matrices
        names = [self._free(name, "state") for name in m.state_names]
        typical: Sequence[float | None] = [None] * len(names) if self.sampled else nominals(m)
        for i, name in enumerate(names):
            unit = m.units.get(m.state_names[i])
            about = _about(m.state_points[i], unit)
            kind = "discrete" if self.sampled else "state"
            self.states.append(self._variable(name, kind, m.x0[i], unit=unit, description=about, nominal=typical[i]))
        if self.sampled:
            return
        for i, name in enumerate(names):
            rate = self._free(f"der({name})", "rate")
            unit = rate_unit(m.units.get(m.state_names[i]))
            about = f"Time derivative of {name}"
            self.rates.append(
                self._variable(rate, "derivative", 0.0, unit=unit, description=about, derivative_of=self.states[i])
            )

    def _variable(
        self,
        name: str,
        kind: str,
        start: float,
        *,
        output: bool = False,
        unit: str | None = None,
        description: str | None = None,
        nominal: float | None = None,
        derivative_of: int | None = None,
    ) -> int:
        self.taken.add(name)
        # Inputs of a sampled model are continuous: what is between the samples is allowed and not looked at.
        self.model.variables.append(
            ScalarVariable(
                name,
                "real",
                kind,
                output,
                self.graph.number(0.0 if kind == "algebraic" else float(start)),
                unit=unit or self.matrices.units.get(name),
                description=description,
                nominal=nominal,
                continuous=kind != "discrete",
                derivative_of=derivative_of,
            )
        )
        return len(self.model.variables) - 1

    def _free(self, name: str, owner: str) -> str:
        """Return `name`, or "owner.name" where something else has it."""
        while name in self.taken:
            name = f"{owner}.{name}"
        return name

    # Equations

    def _continuous_equations(self) -> None:
        m = self.matrices
        for i, rate in enumerate(self.rates):
            self._residual(rate, self._row(float(m.dx0[i]), m.A[i], m.B[i]), "der(x) = A x + B (u - u0)", i)
        for i, output in enumerate(self.outputs):
            self._residual(output, self._row(float(m.y0[i]), m.C[i], m.D[i]), "y = C x + D (u - u0)", i)

    def _residual(self, target: int, value: int, text: str, row: int) -> None:
        expression = self.graph.subtract(self.graph.leaf(VARIABLE, target), value)
        self.model.residuals.append(ResidualEquation(expression, _place(text, row)))

    def _discrete_equations(self) -> None:
        m = self.matrices
        self.model.clocks.append(ModelClock(_quotient(m.dt), (0, 1)))
        self.model.conditions.append(self.graph.leaf(TICK, 0))
        for i, state in enumerate(self.states):
            self._at_tick(state, self._row(0.0, m.A[i], m.B[i]), "x = A pre(x) + B (u - u0)", i)
        for i, output in enumerate(self.outputs):
            self._at_tick(output, self._row(float(m.y0[i]), m.C[i], m.D[i]), "y = C pre(x) + D (u - u0)", i)

    def _at_tick(self, target: int, value: int, text: str, row: int) -> None:
        branch = ConditionalBranch(self.graph.leaf(CONDITION, 0), value)
        self.model.discrete.append(DiscreteEquation(target, _place(text, row), [branch]))

    def _row(self, constant: float, by_state: Floats, by_input: Floats) -> int:
        """Return the expression constant + Σ by_state·x + Σ by_input·(u − u0)."""
        graph = self.graph
        total = self._by_state(by_state)
        for factor, reference, rest in zip(by_input.tolist(), self.inputs, self.matrices.u0.tolist(), strict=True):
            moved = graph.subtract(graph.leaf(VARIABLE, reference), graph.number(rest))
            total = graph.add(total, graph.multiply(graph.number(factor), moved))
        return graph.add(total, graph.number(constant))

    def _by_state(self, factors: Floats) -> int:
        """Return Σ factors·x; a row with many entries becomes a loop, which compiles faster and is smaller."""
        graph = self.graph
        row, leaf = (MATRIX_PRE, PRE) if self.sampled else (MATRIX, VARIABLE)
        some = np.flatnonzero(factors)
        if len(some) >= _LONG:
            first, last = int(some[0]), int(some[-1])
            if len(some) >= _DENSE * (last - first + 1):
                return graph.matrix_row(row, factors[first : last + 1].tolist(), self.states[first])
        total = graph.number(0.0)
        for i in some.tolist():
            term = graph.multiply(graph.number(float(factors[i])), graph.leaf(leaf, self.states[i]))
            total = graph.add(total, term)
        return total


def _place(text: str, row: int) -> SourceLocation:
    return SourceLocation("state space", row + 1, text)


def _about(point: float | None, unit: str | None) -> str:
    if point is None:
        return "State"
    return f"State, deviation from {point:.9g}{f' {unit}' if unit else ''}"


def _quotient(dt: float) -> tuple[int, int]:
    """Return the simplest quotient of whole numbers that is the period, rounding in `dt` allowed for."""
    exact = Fraction(dt)
    limit = 1
    while limit <= _MOST_DENOMINATOR:
        result = exact.limit_denominator(limit)
        if abs(result - exact) <= _SAME_PERIOD * exact:
            return result.numerator, result.denominator
        limit *= 10
    raise InputError(f"dt: {dt:.17g} s is too short a period to be counted exactly; use at least 1e-9 s")
