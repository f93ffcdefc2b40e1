"""Trim by equations: the derivatives of model exchange, set to zero."""

from __future__ import annotations

import numpy as np

from workbench.analysis.trim_balance import Balance, by_name, slot_of
from workbench.core.operating_point import OperatingPoint
from workbench.errors import SimulationError
from workbench.session.base import Floats
from workbench.session.point import Point

__all__ = ["ContinuousBalance"]


class ContinuousBalance(Balance):
    """r = dx/dt with discrete states held, relations evaluated anew at every point.

    Not for sampled models, whose discrete states must be in balance as well: see `MapBalance`.

    Args:
        point: the model at one instant; whoever opened it closes it.

    Attributes:
        why_not_exact: why the FMU's directional derivatives are not used; empty: they are.
    """

    derivative = "der({})"
    per = " / s"
    precision = 1e-15

    def __init__(self, point: Point) -> None:
        self._point = point
        self.states = tuple(
            slot_of(v, x, nominal=n)
            for v, x, n in zip(point.states, point.x0.tolist(), point.nominal.tolist(), strict=True)
        )
        self.inputs = tuple(slot_of(v, u) for v, u in zip(point.inputs, point.u0.tolist(), strict=True))
        self.outputs = tuple(slot_of(v, 0.0) for v in point.outputs)
        self.why_not_exact = point.why_not_exact()
        if not self.why_not_exact and point.discrete():
            self.why_not_exact = "the model has discrete states, which must not be set on the way"

    def evaluate(self, states: Floats, inputs: Floats) -> tuple[Floats, Floats]:
        self.evaluations += 1
        try:
            found = self._point.at(states, inputs)
        except SimulationError:
            return np.full(len(self.states), np.nan), np.full(len(self.outputs), np.nan)
        return found.dx, found.y

    def jacobian(self, states: Floats, inputs: Floats) -> Floats | None:
        if self.why_not_exact:
            return None
        try:
            self._point.move(states, inputs)
            return self._point.jacobian()
        except SimulationError:
            return None

    def point(self, states: Floats, inputs: Floats) -> OperatingPoint:
        dx, y = self.evaluate(states, inputs)
        return OperatingPoint(
            x=by_name(self.states, states),
            u=by_name(self.inputs, inputs),
            y=by_name(self.outputs, y),
            dx=by_name(self.states, dx),
            discrete=self._point.discrete(),
            units=self.units(),
            time=self._point.time,
        )
