"""Trim as a fixed point: the states after a period, less the states before it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import SimulationError
from workbench.model import Model, Variable
from workbench.point.scales import MODELS_OWN_ERROR
from workbench.point.trim.balance import Balance, by_name, slot_of
from workbench.session.base import Session
from workbench.session.start_values import NotReachedError

__all__ = ["MapBalance"]


class MapBalance(Balance):
    """r = Φ(s, u) − s, where Φ starts the model at s and lets one period pass with the inputs held.

    s holds continuous and discrete states as they are just before the first instant of the period; the model's own
    initialisation then handles what is due at that instant. FMI lets discrete states be given before
    initialisation alone, hence a new session for every evaluation.

    Not for states that cannot be given a start value: see `RunBalance`.

    Args:
        model: the model.
        states: continuous states, then discrete ones; each has a start value.
        period: [s], a multiple of every sample period; for co-simulation that has none, a communication step.
        time: start of the period [s].
        values: state or input → where the search begins.
        discrete: names of those states that are discrete.
        tolerance: relative tolerance of the integration.
    """

    derivative = "change of {}"
    rates = False

    def __init__(
        self,
        model: Model,
        states: Sequence[Variable],
        *,
        period: float,
        time: float,
        values: Mapping[str, float],
        discrete: Sequence[str] = (),
        tolerance: float | None = None,
    ) -> None:
        self._model, self.period, self.time = model, period, time
        self._discrete = frozenset(discrete)
        self._tolerance = tolerance
        self.precision = 1e-15 if len(discrete) == len(states) else MODELS_OWN_ERROR
        self.states = tuple(slot_of(v, values[v.name]) for v in states)
        self.inputs = tuple(slot_of(v, values[v.name]) for v in model.inputs if v.is_number)
        self.outputs = tuple(slot_of(v, 0.0) for v in model.outputs if v.is_number)

    def evaluate(self, states: Floats, inputs: Floats) -> tuple[Floats, Floats]:
        try:
            after, y = self.run(states, inputs, periods=1)[-1]
        except (SimulationError, NotReachedError):  # the model fails, or puts itself elsewhere
            return np.full(len(self.states), np.nan), np.full(len(self.outputs), np.nan)
        return after - states, y

    def begin(self, states: Floats, inputs: Floats) -> None:
        """Check that the model takes the values that the search begins with.

        Raises:
            NotReachedError: it does not.
        """
        with suppress(SimulationError), self._open(states, inputs):  # a failure shows itself in `evaluate`
            pass

    def rounding(self, states: Floats) -> Floats:
        return np.asarray(np.spacing(np.abs(states)))

    def run(self, states: Floats, inputs: Floats, *, periods: int) -> list[tuple[Floats, Floats]]:
        """Return states and outputs after each of so many periods.

        Raises:
            SimulationError: the model fails on the way.
        """
        self.evaluations += periods
        with self._open(states, inputs) as session:
            return [self._period(session, i) for i in range(1, periods + 1)]

    def _open(self, states: Floats, inputs: Floats) -> Session:
        values = {**by_name(self.states, states), **by_name(self.inputs, inputs)}
        return self._model.open_at(
            time=self.time, values=values, step=self._step(), tolerance=self._tolerance, approach=False
        )

    def _step(self) -> float | None:
        return self.period if self._model.interface == "cs" and not self._discrete else None

    def _period(self, session: Session, number: int) -> tuple[Floats, Floats]:
        session.advance(self.time + number * self.period, signals={})
        values = session.values(list(dict.fromkeys(s.name for s in (*self.states, *self.outputs))))
        states, outputs = (np.array([values[s.name] for s in slots]) for slots in (self.states, self.outputs))
        return states, outputs

    def drift(self, states: Floats, inputs: Floats, *, periods: int) -> dict[str, tuple[float, float]]:
        """Return by how much states and outputs move from the end of the first period to those of later ones.

        Beside it is the value at the end of the first.

        The states may all come back after one period while something that they do not show has moved on.

        Raises:
            SimulationError: the model fails on the way.
        """
        rows = np.array([np.concatenate(ends) for ends in self.run(states, inputs, periods=periods)])
        moved = np.abs(rows - rows[0]).max(axis=0)
        names = [s.name for s in (*self.states, *self.outputs)]
        return dict(zip(names, zip(moved.tolist(), rows[0].tolist(), strict=True), strict=True))

    def point(self, states: Floats, inputs: Floats) -> OperatingPoint:
        _, y = self.evaluate(states, inputs)
        here = self.where(states, inputs)
        return replace(here, y=by_name(self.outputs, y), dx=self._slopes(here.x, states, inputs))

    def where(self, states: Floats, inputs: Floats) -> OperatingPoint:
        every = by_name(self.states, states)
        return OperatingPoint(
            x={n: v for n, v in every.items() if n not in self._discrete},
            u=by_name(self.inputs, inputs),
            discrete={n: v for n, v in every.items() if n in self._discrete},
            units=self.units(),
            time=self.time,
            period=self.period if self._discrete else None,
        )

    def _slopes(self, x: Mapping[str, float], states: Floats, inputs: Floats) -> dict[str, float]:
        """Return the derivatives at the start of the period; where the model shows none, the mean ones."""
        if self._model.interface != "me":
            rates = by_name(self.states, self.evaluate(states, inputs)[0] / self.period)
            return {n: rates[n] for n in x}
        if not x:
            return {}
        values = {**by_name(self.states, states), **by_name(self.inputs, inputs)}
        with self._model.open_point(time=self.time, values=values) as point:
            result = point.at(np.array(list(x.values())), inputs)
        return dict(zip(x, result.dx.tolist(), strict=True))
