"""Poles of a model over one of its parameters, inputs or states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.records.option import recast
from workbench.core.values.modal import Poles, poles_near, poles_of
from workbench.core.values.operating_point import OperatingPoint
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.model import Model
from workbench.point.lin.delay_roots import delay_roots
from workbench.point.lin.grid import LinPoint
from workbench.point.lin.request import Lin, LinOver
from workbench.point.lin.result import DelayFreePart, Doubt, LinResult
from workbench.point.lin.sweep import points_over

__all__ = ["ModelSource"]

_HERE = Workers(in_process=True)
_SPARE = 4  # modes beside the wanted ones, at least

# How accurate the entries of A are, relative to its size, by method; those not named: rounding.
_ACCURACY = {"difference": 1e-8, "kalman-bertram": 1e-8, "response": 1e-5}


@dataclass(frozen=True, eq=False)
class Known:
    """What is kept of a linear model; large matrices at many values would not fit into memory.

    Attributes:
        poles: of it.
        state_names, operating_point, notes, doubts: its own.
    """

    poles: Poles
    state_names: tuple[str, ...]
    operating_point: OperatingPoint
    notes: tuple[str, ...]
    doubts: tuple[Doubt, ...]


class ModelSource:
    """Linearises at each value that is asked for, once.

    Args:
        model: stays open.
        vary: parameter, input or state.
        lin: how, and about which operating point.
        trimmed: find the equilibrium at each value; the search begins at that point.
        count: so many modes are wanted; some more are found, which may take their places; None: all.
        about: frequency near which they lie [Hz].

    Attributes:
        results: value → what is known of the linear model.
        failed: value → reason.
    """

    def __init__(
        self, model: Model, vary: str, lin: Lin, *, trimmed: bool, count: int | None = None, about: float = 0.0
    ) -> None:
        self._model, self._vary, self._lin, self._trimmed = model, vary, lin, trimmed
        self._count, self._about = count, about
        self.results: dict[float, Known] = {}
        self.failed: dict[float, str] = {}

    def prepare(self, values: Sequence[float], workers: Workers, job: Job, *, label: str) -> None:
        """Linearise at many values, several at a time.

        Args:
            values: of the parameter.
            workers: where.
            job: is told each, and can end it.
            label: words for it.
        """
        for done, point in enumerate(self._points(values, workers, job), 1):
            self._take(point)
            job.done(label, done, len(values) + 1)  # they are still to be followed

    def __call__(self, value: float) -> Poles | None:
        """Return the poles at a value; None: there is no linear model.

        Args:
            value: of the parameter.
        """
        value = float(value)
        if value in self.failed:
            return None
        if value not in self.results:
            self._take(next(iter(self._points([value], _HERE, Job()))))
            if value in self.failed:
                return None
        return self.results[value].poles

    def _take(self, point: LinPoint) -> None:
        value = point.values[self._vary]
        if point.result is None:
            self.failed[value] = point.reason or "no linear model"
        else:
            result = point.result
            poles = self._poles(result)
            self.results[value] = Known(poles, result.state_names, result.operating_point, result.notes, result.doubts)

    def _poles(self, linear: LinResult) -> Poles:
        accuracy = _ACCURACY.get(linear.method, 0.0)
        if self._count is None:
            poles = poles_of(linear.A, dt=linear.dt, accuracy=accuracy)
        else:
            some = self._count + max(self._count // 2, _SPARE)
            poles = poles_near(linear.A, some, self._about, dt=linear.dt, accuracy=accuracy)
        return poles if linear.delayed is None else _with_delays(poles, linear.delayed)

    def _points(self, values: Sequence[float], workers: Workers, job: Job) -> Iterator[LinPoint]:
        """Return the linear models as they are finished."""
        over = recast(LinOver, self._lin, over={self._vary: values})
        return points_over(self._model, over, workers, job, explained=False, trimmed=self._trimmed)


def _with_delays(approximate: Poles, part: DelayFreePart) -> Poles:
    """Return the poles with delays as they are in place of those of approximations, the rightmost ones first of all.

    Each takes the vectors of the nearest that is left. Poles of approximations beyond those that are found stay.
    """
    value = approximate.value.copy()
    left = list(range(len(value)))
    for root in delay_roots(part, value).roots:
        alike = [i for i in left if (approximate.value[i].imag > 0.0) == (root.imag > 0.0)] if root.imag >= 0.0 else []
        if alike:
            nearest = min(alike, key=lambda i: abs(approximate.value[i] - root))
            value[nearest] = root
            left.remove(nearest)
    order = np.lexsort((-value.real, value.imag))
    return Poles(value[order], approximate.right[:, order], approximate.left[:, order], approximate.uncertain[order])
