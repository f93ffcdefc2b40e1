"""The map that a model makes of its states over one period, run from start to start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.model.repetition import BEFORE
from workbench.point.lin.difference import size_of
from workbench.point.lin.task import LinTask, columns_of, width_for
from workbench.session.base import Recorded
from workbench.session.point import ModelPoint
from workbench.signals.kinds import Signal, Table

__all__ = ["NotSettableError", "SampledPeriodMap"]

SAME = 1e-9  # of the period: two times as near are one
LEAD = 1e-7  # of the period: by how much an input moves before a sample; shorter, solvers give up in between
INTERVALS = 16  # of the basic period, for the output between samples
TOLERANCE = 1e-10  # of the integration over one period
WIDTH_SAMPLED = 1e-5  # total width over scale where nothing is integrated
WIDTH_HYBRID = 1e-3  # and where integration errors of 1e-10 must stay small beside it
UNDECLARED = 1e-2


class NotSettableError(InputError):
    """A state that has no start value to be given another."""


@dataclass(frozen=True)
class SampledPeriodMap:
    """States just before a sample and held inputs → states one period later, and the outputs on the way.

    Attributes:
        task: the linearisation.
        start, period: [s].
        states: continuous and discrete states.
        names: of states, then inputs.
        values: of them at the point.
        widths: of them.
        grid: sample times of the output, shape (k + 1,), absolute [s].
        instants: times since the start at which anything samples, 0 first, shape (s,) [s].
        given: start values of everything else.
        continuous: number of continuous states.
        inputs: all inputs → value.
        inputs_chosen: those of the linear model.
        sizes: how far a variable of `names` moves when it moves far.
    """

    task: LinTask
    start: float
    period: float
    states: tuple[Variable, ...]
    names: tuple[str, ...]
    values: Floats
    widths: Floats
    grid: Floats
    instants: Floats
    given: Mapping[str, float]
    continuous: int
    inputs: Mapping[str, float]
    inputs_chosen: tuple[Variable, ...]
    sizes: Floats

    @classmethod
    def of(cls, task: LinTask, point: ModelPoint, start: float, period: float, ticks: Floats) -> SampledPeriodMap:
        """Collect them at a point."""
        states = (*point.states, *point.memory)
        for state in point.states:
            if state.start is None:
                raise NotSettableError(f"method kalman-bertram: state {state.name} cannot be set; use response")
        chosen = [point.inputs[i] for i in columns_of(task, point)]
        inputs = {v.name: float(u) for v, u in zip(point.inputs, point.u0, strict=True)}
        # Discrete states begin at their own start values: those after the first event are already the next ones.
        memory = [task.values.get(v.name, float(v.start or 0.0)) for v in point.memory]
        values = np.array([*point.x0, *memory, *(inputs[v.name] for v in chosen)])
        variables = (*states, *chosen)
        wanted = np.concatenate([
            width_for(task.dx, [v.name for v in states], what="dx"), width_for(task.du, task.inputs, what="du")
        ])  # fmt: skip
        relative = WIDTH_HYBRID if point.states else WIDTH_SAMPLED
        usual = [_default(v, x, relative) for v, x in zip(variables, values.tolist(), strict=True)]
        return cls(
            task=task,
            start=start,
            period=period,
            states=states,
            names=tuple(v.name for v in variables),
            values=values,
            widths=np.where(np.isnan(wanted), usual, wanted),
            grid=_grid(start, period, inner := _inside(period, ticks - start)),
            instants=np.append(0.0, inner),
            given={**inputs, **dict(zip([v.name for v in states], values, strict=False))},
            continuous=len(point.states),
            inputs=inputs,
            inputs_chosen=tuple(chosen),
            sizes=np.array([size_of(v, x) for v, x in zip(variables, values.tolist(), strict=True)]),
        )

    def run(self, shift: Floats) -> tuple[Floats, Floats]:
        """Return the states after one period and the outputs (k, 2, q) within it, from a shifted start."""
        return self._advance({**self.given, **dict(zip(self.names, self.values + shift, strict=True))}, {})

    def _advance(self, values: Mapping[str, float], signals: Mapping[str, Signal]) -> tuple[Floats, Floats]:
        task = self.task
        with task.model.open_at(time=self.start, values=values, tolerance=TOLERANCE) as session:
            record = session.advance(float(self.grid[-1]), signals=signals, record=task.outputs, points=self.grid[1:])
            reached = session.values([v.name for v in self.states])
        return np.array(list(reached.values())), _within(record, self.grid, task.outputs)

    def nodes(self) -> Floats:
        """Return the nodes of `respond`, times since the sample, shape (p,) [s]."""
        return self.period * np.arange(INTERVALS + 1) / INTERVALS

    def respond(self, column: int, node: int) -> tuple[Floats, Floats]:
        """Return what `run` returns, per unit, for an input that is a hat around one node: a line up and down.

        Args:
            column: of `names`, an input.
            node: which; the first hat has its falling side only, and begins with its value at the sample; the last
                has its rising side only, and the sample at its end is the next period's.
        """
        name, width = self.names[column], float(self.widths[column])
        value, times = float(self.values[column]), self.start + self.nodes()
        found = []
        for sign in (1.0, -1.0):
            hat = np.full(len(times), value)
            hat[node] += sign * 0.5 * width
            values = {**self.given, **dict(zip(self.names, self.values, strict=True)), name: float(hat[0])}
            found.append(self._advance(values, {name: Table(times.tolist(), hat.tolist())}))
        (x1, y1), (x0, y0) = found
        return (x1 - x0) / width, (y1 - y0) / width

    def pulse(self, instant: int) -> tuple[Floats, Floats]:
        """Return what `run` returns, per unit, for the one input moved from one instant to the next only.

        Args:
            instant: number of the instant.
        """
        column = len(self.states)
        name, width, value = self.names[column], float(self.widths[column]), float(self.values[column])
        ends = self.start + self.instants - LEAD * self.period  # ahead of what samples there
        found = []
        for sign in (1.0, -1.0):
            levels = np.full(len(self.instants), value)
            levels[instant] += sign * 0.5 * width
            values = {**self.given, **dict(zip(self.names, self.values, strict=True)), name: float(levels[0])}
            found.append(self._advance(values, {name: Table(ends.tolist(), levels.tolist(), interpolate="hold")}))
        (x1, y1), (x0, y0) = found
        return (x1 - x0) / width, (y1 - y0) / width

    def acts_at_samples(self) -> bool:
        """Whether inputs are only read at samples: between two samples nothing follows them."""
        task = self.task
        between = self.start + 0.5 * float(np.min(np.diff(self.grid)))
        values = {**self.given, **dict(zip(self.names, self.values, strict=True))}
        with task.model.open_point(time=between, values=values) as point:
            first = point.at(point.x0, point.u0)
            for i in columns_of(task, point):
                u = point.u0.copy()
                u[i] += self.widths[len(self.states) + task.inputs.index(point.inputs[i].name)]
                moved = point.at(point.x0, u)
                if not (np.array_equal(moved.dx, first.dx) and np.array_equal(moved.y, first.y)):
                    return False
        return True


def _default(variable: Variable, value: float, relative: float) -> float:
    if variable.type not in FLOAT_TYPES:
        return 2.0
    return relative * max(abs(value), variable.nominal or UNDECLARED)


def _inside(period: float, ticks: Floats) -> Floats:
    """Return the events inside the first period, times since its start, rising, each once [s]."""
    found = ticks[(ticks > SAME * period) & (ticks < period * (1.0 - SAME))]
    return _apart(np.sort(found), period)


def _apart(times: Floats, period: float) -> Floats:
    kept: Floats = times[np.diff(times, prepend=-np.inf) > SAME * period]
    return kept


def _grid(start: float, period: float, inner: Floats) -> Floats:
    """Return a uniform grid over the period together with the samples inside it, absolute times [s]."""
    uniform = period * np.arange(INTERVALS + 1) / INTERVALS
    # The model's own times first: of two that are one they are kept.
    every = np.concatenate([inner, uniform])
    kept = start + _apart(np.sort(every), period)
    kept[-1] = start + period - BEFORE * period
    return kept


def _within(record: Recorded, grid: Floats, outputs: tuple[str, ...]) -> Floats:
    """Return the outputs at the beginning (right limit) and end (left limit) of each interval, (k, 2, q)."""
    near = 1e-10 * (grid[-1] - grid[0])
    right = np.searchsorted(record.time, grid[:-1] + near, side="right") - 1
    left = np.searchsorted(record.time, grid[1:] - near, side="left")
    table = np.array([record.values[n] for n in outputs]).T.reshape(len(record.time), len(outputs))
    return np.stack([table[right], table[left]], axis=1)
