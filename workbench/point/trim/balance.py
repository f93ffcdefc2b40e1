"""What a trim balances: the rates of change of states at given states and inputs, of whatever kind of model."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.conversion import rate_unit
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import SimulationError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.kernel.native_slopes import Pattern
from workbench.session.point import ModelPoint

__all__ = ["Balance", "ContinuousBalance", "Slot", "by_name", "slot_of"]


@dataclass(frozen=True, kw_only=True)
class Slot:
    """One number that a balance takes or gives.

    Attributes:
        name: of the variable.
        unit: its unit, None where the model names none.
        start: where a search begins, and what an input is held at.
        nominal: magnitude that counts as a change of it, above 0.
        known: whether the model declares it or its start value tells it; else it is 1 until the model shows more.
        declared: whether the model declares it.
        settable: whether it can be given a value.
        whole: whether it takes whole numbers only (Integer, Boolean), and so cannot be searched for.
    """

    name: str
    unit: str | None = None
    start: float = 0.0
    nominal: float = 1.0
    known: bool = True
    declared: bool = True
    settable: bool = True
    whole: bool = False


class Balance(ABC):
    """A model seen as rates r(s, u) and outputs y(s, u); an equilibrium has r = 0.

    Obligations of a subclass:
      1. `evaluate` depends on its arguments only, not on what was evaluated before.
      2. It returns NaN where the model cannot be evaluated, and raises only if it cannot continue.
      3. The attributes are fixed after construction, except `evaluations`.

    Attributes:
        states: what is balanced, continuous states first.
        inputs: every input that stands for a number.
        outputs: likewise.
        derivative: how the rate of a state is written, "der({})" or "change of {}".
        rates: whether they are per second; else per period.
        precision: relative error of `evaluate`; differences are taken over widths that suit it.
        evaluations: how often the model was evaluated.
    """

    states: tuple[Slot, ...]
    inputs: tuple[Slot, ...]
    outputs: tuple[Slot, ...]
    derivative: str = "der({})"
    rates: bool = True
    precision: float = 1e-15
    evaluations: int = 0

    @abstractmethod
    def evaluate(self, states: Floats, inputs: Floats) -> tuple[Floats, Floats]:
        """Return rates, shape (n,), and outputs, shape (p,), at states (n,) and inputs (m,)."""

    @property
    def pattern(self) -> Pattern | None:
        """Which states and inputs move which rates and outputs, as declared; None: unknown. It is not believed."""
        return None

    def rounding(self, states: Floats) -> Floats:
        """Return the rounding errors of rates that are differences of states, shape (n,); 0 where they are none."""
        return np.zeros(len(states))

    def jacobian(self, states: Floats, inputs: Floats) -> Floats | None:
        """Return ∂(rates, outputs)/∂(states, inputs), shape (n + p, n + m), where it is known exactly; else None."""
        return None

    @abstractmethod
    def point(self, states: Floats, inputs: Floats) -> OperatingPoint:
        """Return the operating point there."""

    def where(self, states: Floats, inputs: Floats) -> OperatingPoint:
        """Return the same without what only an evaluation shows."""
        return OperatingPoint(x=by_name(self.states, states), u=by_name(self.inputs, inputs), units=self.units())

    def units(self) -> dict[str, str | None]:
        """Return the unit of every state, input and output."""
        return {s.name: s.unit for s in (*self.states, *self.inputs, *self.outputs)}

    def rate_unit(self, state: Slot) -> str | None:
        """Return the unit of a state's rate."""
        return (rate_unit(state.unit) or "1/s") if self.rates else state.unit


def slot_of(variable: Variable, start: float, *, nominal: float = 0.0) -> Slot:
    """Return the slot of a variable; `nominal`: what the model said at run time, 0 or 1 if nothing."""
    known = variable.nominal or (nominal if nominal != 1.0 else 0.0)
    return Slot(
        name=variable.name,
        unit=variable.unit,
        start=start,
        nominal=abs(known or start) or 1.0,
        known=bool(known or start),
        declared=bool(known),
        whole=variable.type not in FLOAT_TYPES,
    )


def by_name(slots: Sequence[Slot], values: Floats) -> dict[str, float]:
    """Return values, shape (len(slots),), under their names."""
    return dict(zip((s.name for s in slots), np.asarray(values, dtype=float).tolist(), strict=True))


class ContinuousBalance(Balance):
    """r = dx/dt with discrete states held, relations evaluated anew at every point.

    Not for sampled models, whose discrete states must be in balance as well: see `MapBalance`.

    Args:
        point: the model at one instant; whoever opened it closes it.

    Attributes:
        why_not_exact: why the FMU's directional derivatives are not used; empty: they are.
    """

    derivative = "der({})"
    rates = True
    precision = 1e-15

    def __init__(self, point: ModelPoint) -> None:
        self._point = point
        self.states = tuple(
            slot_of(v, x, nominal=n)
            for v, x, n in zip(point.states, point.x0.tolist(), point.nominal.tolist(), strict=True)
        )
        self.inputs = tuple(slot_of(v, u) for v, u in zip(point.inputs, point.u0.tolist(), strict=True))
        self.outputs = tuple(slot_of(v, 0.0) for v in point.outputs)
        self.why_not_exact = point.why_not_exact()
        if not self.why_not_exact and point.discrete():
            self.why_not_exact = "the model has discrete states, which cannot be set during the search"

    @property
    def pattern(self) -> Pattern | None:
        return self._point.pattern

    def evaluate(self, states: Floats, inputs: Floats) -> tuple[Floats, Floats]:
        self.evaluations += 1
        try:
            result = self._point.at(states, inputs)
        except SimulationError:
            return np.full(len(self.states), np.nan), np.full(len(self.outputs), np.nan)
        return result.dx, result.y

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
