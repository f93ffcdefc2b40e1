"""Trim by running: let the model go until nothing moves any more."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.analysis.trim_balance import Balance, Slot, by_name, slot_of
from workbench.core.operating_point import OperatingPoint
from workbench.errors import SimulationError
from workbench.model import Model, Variable
from workbench.session.base import Floats, Session

__all__ = ["RunBalance", "Settled", "settle"]

FIRST_STEPS = 64  # communication steps of the first stretch
LEAST_STEPS = 4096  # communication steps that are watched at least: a slow sampler stands still between samples
MAX_STEPS = 200_000  # communication steps of one run
SAMPLES = 64  # looked at per stretch
RUNAWAY = 1e30  # nominal values
DECAY = 0.2  # from one stretch to the next, twice as long, of what settles


@dataclass(frozen=True, eq=False)
class Settled:
    """Where a run ended.

    Attributes:
        time: [s].
        values: shape (n,), of the watched variables at the end.
        ranges: shape (n,), by how much each moved in the last half of the run.
        settled: whether all stand still.
    """

    time: float
    values: Floats
    ranges: Floats
    settled: bool


def settle(
    session: Session,
    names: Sequence[str],
    nominal: Floats,
    *,
    first: float,
    longest: float,
    tolerance: float,
    least: float = 0.0,
) -> Settled:
    """Run a session in stretches, each as long as all before it, until nothing moves.

    It stands still when in the last stretch no variable has moved by more than `tolerance`, relative to its
    magnitude or nominal value, and that less than 0.2 of the stretch before: a slow drift moves twice as far in twice
    the time and is not taken for rest.

    Not for undamped models, which never rest, and no proof for models that wait longer than they have been
    watched.

    Args:
        session: stands anywhere; it is advanced with its inputs as they are.
        names: variables to watch.
        nominal: shape (n,), their nominal values.
        first: length of the first stretch [s].
        longest: of the whole run [s].
        tolerance: see above.
        least: of the whole run [s].

    Raises:
        SimulationError: the model fails on the way.
    """
    begin, stretch = session.time, first
    before = np.full(len(names), math.inf)
    while True:
        start = session.time
        points = np.linspace(start, start + stretch, SAMPLES + 1)[1:]
        record = session.advance(float(points[-1]), signals={}, record=names, points=points)
        table = np.array([record.values[n] for n in names]).reshape(len(names), -1)
        values, ranges = table[:, -1], np.ptp(table, axis=1)
        scale = np.maximum(np.abs(values), nominal)
        if not (np.abs(table) < RUNAWAY * nominal[:, None]).all():
            raise SimulationError("the model runs away", time=session.time)
        still = (ranges <= tolerance * scale) & ((ranges <= DECAY * before) | (ranges <= 1e-3 * tolerance * scale))
        if still.all() and np.isfinite(before).all() and session.time - begin >= least:
            return Settled(session.time, values, ranges, settled=True)
        if session.time + 2.0 * stretch - begin > longest:
            return Settled(session.time, values, ranges, settled=False)
        before, stretch = ranges, session.time - begin


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
    """

    derivative = "movement of {}"
    per = ""
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
    ) -> None:
        self._model, self.time, self.step, self._tolerance = model, time, step, tolerance
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
        nominal = np.array([s.nominal for s in self.states])
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
                )
        except SimulationError as error:
            return str(error)

    def _pick(self, end: Settled, slots: Sequence[Slot]) -> Floats:
        values = dict(zip(self._watched, end.values.tolist(), strict=True))
        return np.array([values[s.name] for s in slots])

    def point(self, states: Floats, inputs: Floats) -> OperatingPoint:
        end = self.end(inputs)
        if isinstance(end, str):
            end = Settled(self.time, np.full(len(self._watched), np.nan), np.zeros(0), settled=False)
        return OperatingPoint(
            x=by_name(self._x, self._pick(end, self._x)),
            u=by_name(self.inputs, inputs),
            y=by_name(self.outputs, self._pick(end, self.outputs)),
            units=self.units(),
            time=end.time,
        )

    def units(self) -> dict[str, str | None]:
        return {s.name: s.unit for s in (*self._x, *self.inputs, *self.outputs)}
