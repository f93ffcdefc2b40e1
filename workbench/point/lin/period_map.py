"""The map that a model makes of its states over one period, run from start to start."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Literal

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.fmi.variable import FLOAT_TYPES
from workbench.model.repetition import BEFORE
from workbench.point.lin.columns import UNDECLARED, Columns, relative_width, size_of, total_width
from workbench.point.lin.task import LinTask, columns_of, width_for
from workbench.point.scales import INTEGRATION
from workbench.session.base import Recorded
from workbench.session.point import ModelPoint
from workbench.signals.kinds import Signal, Table

__all__ = ["NotSettableError", "SampledPeriodMap"]

SAME = 1e-9  # of the period: two times as near are one
LEAD = 1e-7  # of the period: by how much an input moves before a sample; shorter, solvers give up in between
INTERVALS = 16  # of the basic period, for the output between samples


class NotSettableError(InputError):
    """A state that has no start value to be given another."""


class SampledPeriodMap(Columns):
    """States just before a sample and held inputs → states one period later, and the outputs on the way.

    Its rows are the states one period later, then the outputs at the sample.

    Args:
        task: the linearisation.
        point: its model.
        start: of the period [s].
        period: [s].
        ticks: times at which anything samples [s].

    Attributes:
        states: continuous states, then discrete ones.
        continuous: number of continuous states.
        tolerance: relative, of the integration.
        variables: states, then the chosen inputs.
        unscaled: those whose width nothing in the model tells: no nominal value, and no value beyond the least scale.
        point_values: of them at the point, shape (k,).
        grid: sample times of the output, shape (k + 1,), absolute [s].
        instants: times since the start at which anything samples, 0 first, shape (s,) [s].
        nodes: times since the start between which inputs are straight lines, the last one the period, shape (k + 1,)
            [s]. Nothing samples between every second of them, which lie at equal distances.
        inputs: all inputs → value.
    """

    def __init__(self, task: LinTask, point: ModelPoint, start: float, period: float, ticks: Floats) -> None:
        self.task, self.start, self.period, self.tolerance = task, start, period, INTEGRATION
        self.states, self.continuous = (*point.states, *point.memory), len(point.states)
        for state in point.states:
            if state.start is None:
                raise NotSettableError(f"method kalman-bertram: state {state.name} cannot be set; use response")
        self.variables = (*self.states, *(point.inputs[i] for i in columns_of(task, point)))
        self.names = [v.name for v in self.variables]
        self.rows = [*(v.name for v in self.states), *task.outputs]
        self.inputs = {v.name: float(u) for v, u in zip(point.inputs, point.u0, strict=True)}
        # Discrete states begin at their own start values: those after the first event are already the next ones.
        memory = [task.values.get(v.name, float(v.start or 0.0)) for v in point.memory]
        self.point_values = np.array([*point.x0, *memory, *(self.inputs[name] for name in task.inputs)])
        given = np.concatenate([width_for(task.dx, self.names[: len(self.states)], what="dx"),
                                width_for(task.du, task.inputs, what="du")])  # fmt: skip
        relative = relative_width(INTEGRATION if point.states else float(np.finfo(float).eps))
        both = list(zip(self.variables, self.point_values.tolist(), strict=True))
        self.widths = np.where(np.isnan(given), [total_width(v, x, relative) for v, x in both], given)
        silent = [v.nominal is None and v.type in FLOAT_TYPES and abs(x) <= UNDECLARED for v, x in both]
        self.unscaled = np.isnan(given) & np.array(silent, dtype=bool)
        self.sizes = np.array([size_of(v, x) for v, x in both])
        self.chosen = np.ones(len(both), dtype=bool)
        self.instants = np.append(0.0, _inside(period, ticks - start))
        self.nodes = _nodes(period, self.instants)
        # Before what samples at the end.
        self.grid = start + np.append(self.nodes[:-1], period * (1.0 - BEFORE))

    @cached_property
    def base(self) -> tuple[Floats, Floats]:
        """What `run` returns from the point itself."""
        return self.run(np.zeros(len(self.names)))

    @property
    def here(self) -> Floats:
        return np.concatenate([self.base[0], self.base[1][0, 0]])

    def values(self, shift: Floats) -> Floats:
        x, y = self.run(shift)
        return np.concatenate([x, y[0, 0]])

    def run(self, shift: Floats) -> tuple[Floats, Floats]:
        """Return the states after one period and the outputs (k, 2, q) within it, from a shifted start."""
        return self._advance(self._starts(shift), {})

    def _starts(self, shift: Floats | float = 0.0) -> dict[str, float]:
        """Return the start values of everything, from a shifted point."""
        return {**self.inputs, **dict(zip(self.names, (self.point_values + shift).tolist(), strict=True))}

    def _advance(self, values: Mapping[str, float], signals: Mapping[str, Signal]) -> tuple[Floats, Floats]:
        task = self.task
        with task.model.open_at(time=self.start, values=values, tolerance=self.tolerance) as session:
            record = session.advance(float(self.grid[-1]), signals=signals, record=task.outputs, points=self.grid[1:])
            reached = session.values([v.name for v in self.states])
        return np.array(list(reached.values())), _within(record, self.grid, task.outputs)

    def respond(self, node: int, column: int) -> tuple[Floats, Floats]:
        """Return what `run` returns, per unit, for an input that is a hat around one node: a line up and down.

        Args:
            node: which; the first hat has its falling side only, and begins with its value at the sample; the last
                has its rising side only, and the sample at its end is the next period's.
            column: of `names`, an input.
        """
        return self._answer(column, self.start + self.nodes, node, "linear")

    def pulse(self, instant: int, column: int | None = None) -> tuple[Floats, Floats]:
        """Return what `run` returns, per unit, for an input moved from one instant to the next only.

        Args:
            instant: number of the instant.
            column: of `names`, an input; None: the first.
        """
        ahead = LEAD * self.period  # of what samples there
        times = self.start + self.instants - ahead
        return self._answer(len(self.states) if column is None else column, times, instant, "hold")

    def _answer(self, column: int, times: Floats, place: int, how: Literal["linear", "hold"]) -> tuple[Floats, Floats]:
        """Return what `run` returns, per unit, for an input moved at one of the times of its table."""
        name, width = self.names[column], float(self.widths[column])
        sides = []
        for sign in (1.0, -1.0):
            levels = np.full(len(times), self.point_values[column])
            levels[place] += sign * 0.5 * width
            table = Table(times.tolist(), levels.tolist(), interpolate=how)
            sides.append(self._advance({**self._starts(), name: float(levels[0])}, {name: table}))
        (x1, y1), (x0, y0) = sides
        return (x1 - x0) / width, (y1 - y0) / width

    def acts_at_samples(self) -> bool:
        """Whether inputs are only read at samples: between two samples nothing follows them."""
        task = self.task
        between = self.start + 0.5 * float(np.min(np.diff(self.grid)))
        with task.model.open_point(time=between, values=self._starts()) as point:
            first = point.at(point.x0, point.u0)
            for i in columns_of(task, point):
                u = point.u0.copy()
                u[i] += self.widths[len(self.states) + task.inputs.index(point.inputs[i].name)]
                moved = point.at(point.x0, u)
                if not (np.array_equal(moved.dx, first.dx) and np.array_equal(moved.y, first.y)):
                    return False
        return True


def _inside(period: float, ticks: Floats) -> Floats:
    """Return the events inside the first period, times since its start, rising, each once [s]."""
    result = ticks[(ticks > SAME * period) & (ticks < period * (1.0 - SAME))]
    return _apart(np.sort(result), period)


def _apart(times: Floats, period: float) -> Floats:
    kept: Floats = times[np.diff(times, prepend=-np.inf) > SAME * period]
    return kept


def _nodes(period: float, instants: Floats) -> Floats:
    """Return each span between two instants in equal parts, two pairs of them or more, times since the start [s]."""
    ends = np.append(instants, period)
    parts = 4 * np.ceil(0.25 * INTERVALS * np.diff(ends) / period - SAME).astype(int)
    spans = zip(ends[:-1].tolist(), ends[1:].tolist(), parts.tolist(), strict=True)
    return np.append(np.concatenate([a + (b - a) * np.arange(k) / k for a, b, k in spans]), period)


def _within(record: Recorded, grid: Floats, outputs: tuple[str, ...]) -> Floats:
    """Return the outputs at the beginning (right limit) and end (left limit) of each interval, (k, 2, q)."""
    near = 1e-10 * (grid[-1] - grid[0])
    right = np.searchsorted(record.time, grid[:-1] + near, side="right") - 1
    left = np.searchsorted(record.time, grid[1:] - near, side="left")
    table = np.array([record.values[n] for n in outputs]).T.reshape(len(record.time), len(outputs))
    return np.stack([table[right], table[left]], axis=1)
