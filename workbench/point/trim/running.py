"""Trim by running: let the model go until nothing moves any more."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import EndedError, SimulationError
from workbench.model import Model, Variable
from workbench.point.trim.balance import Balance, Slot, by_name, slot_of
from workbench.session.settle import FIRST_STEPS, LEAST_STEPS, MAX_STEPS, Settled, settle

__all__ = ["RunBalance"]


class RunBalance(Balance):
    """r = movement of the observed variables at the end of a run under held inputs; the states cannot be set.

    For black boxes: co-simulation FMUs whose states have no start values. It finds the one equilibrium that the model
    goes to from its start, and only if it goes there by itself. A model that waits longer than it is watched (`least`)
    looks as if it were at rest.

    Args:
        model: the model.
        states: what is observed besides the outputs.
        time: start of every run [s].
        values: state or input → value.
        step: communication step [s].
        longest: of one run [s].
        least: how long a run is watched at least [s], within `longest`.
        tolerance: see `settle`.
        report: called during a run with this balance, its inputs, where it is, and the seconds that one takes.
    """

    derivative = "movement of {}"
    rates = False
    precision = 1e-6

    def __init__(
        self,
        model: Model,
        states: Sequence[Variable],
        *,
        time: float,
        values: Mapping[str, float],
        step: float,
        longest: float | None = None,
        least: float = 0.0,
        tolerance: float,
        report: Callable[[RunBalance, Floats, Settled, float], None],
    ) -> None:
        self._model, self.time, self.step, self._tolerance = model, time, step, tolerance
        self._report = report
        self.longest = step * MAX_STEPS if longest is None else longest
        self.least = min(max(step * LEAST_STEPS, least), 0.25 * self.longest)
        self.inputs = tuple(slot_of(v, values[v.name]) for v in model.inputs if v.is_number)
        self.outputs = tuple(slot_of(v, 0.0) for v in model.outputs if v.is_number)
        self._x = tuple(slot_of(v, values[v.name]) for v in states)
        known = {v.name for v in states}
        others = [s for s in self.outputs if s.name not in known]
        self._watched = [s.name for s in (*self._x, *others)]
        seen = (*self._x, *(replace(s, name=f"output {s.name}") for s in others))
        self.states = tuple(replace(s, settable=False) for s in seen)
        self._kept: dict[tuple[float, ...], Settled | str] = {}

    def evaluate(self, states: Floats, inputs: Floats) -> tuple[Floats, Floats]:
        end = self.end(inputs)
        if isinstance(end, str):
            return np.full(len(self.states), np.nan), np.full(len(self.outputs), np.nan)
        return np.zeros(len(self.states)) if end.settled else end.ranges, self._pick(end, self.outputs)

    def end(self, inputs: Floats) -> Settled | str:
        """Return where the run under `inputs` ends or why it fails; every run is made once."""
        key = tuple(np.asarray(inputs, dtype=float).tolist())
        if key not in self._kept:
            self._kept[key] = self._run(inputs)
        return self._kept[key]

    def _run(self, inputs: Floats) -> Settled | str:
        self.evaluations += 1
        begun = time.monotonic()
        nominal = np.array([s.nominal if s.known else 0.0 for s in self.states])
        try:
            with self._model.open_at(time=self.time, values=by_name(self.inputs, inputs), step=self.step) as session:
                return settle(
                    session,
                    self._watched,
                    nominal,
                    first=FIRST_STEPS * self.step,
                    longest=self.longest,
                    least=self.least,
                    tolerance=self._tolerance,
                    told=lambda end: self._report(
                        self, inputs, end, (time.monotonic() - begun) / (end.time - self.time)
                    ),
                )
        except EndedError as error:
            lasted = (error.time or self.time) - self.time
            return f"{error} before it came to rest; longest below {lasted:g} s uses only the part before that"
        except SimulationError as error:
            return str(error)

    def _pick(self, end: Settled, slots: Sequence[Slot]) -> Floats:
        values = dict(zip(self._watched, end.values.tolist(), strict=True))
        return np.array([values[s.name] for s in slots])

    def point(self, states: Floats, inputs: Floats) -> OperatingPoint:
        end = self.end(inputs)
        if isinstance(end, str):
            raise SimulationError(end)
        return self.standing(end, inputs)

    def standing(self, end: Settled, inputs: Floats) -> OperatingPoint:
        """Return the operating point where a run under `inputs` is, or ended."""
        return OperatingPoint(
            x=by_name(self._x, self._pick(end, self._x)),
            u=by_name(self.inputs, inputs),
            y=by_name(self.outputs, self._pick(end, self.outputs)),
            units=self.units(),
            time=end.time,
        )

    def units(self) -> dict[str, str | None]:
        return {s.name: s.unit for s in (*self._x, *self.inputs, *self.outputs)}
