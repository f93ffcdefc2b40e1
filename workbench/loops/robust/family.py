"""The linear models of a model over its parameters, each linearised once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import Linear
from workbench.errors import InputError, SimulationError
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.model import Model
from workbench.point.lin.grid import LinPoint
from workbench.point.lin.request import Lin
from workbench.point.lin.result import LinResult
from workbench.point.lin.sweep import points_at

__all__ = ["Place", "UncertainFamily", "UncertainParameter"]

Place = tuple[float, ...]  # deviation of each parameter from its middle, in half its range

_ACCURACY = {"difference": 1e-8, "kalman-bertram": 1e-8}  # of the entries, relative to their size; others: rounding


@dataclass(frozen=True, kw_only=True)
class UncertainParameter(RecordPart):
    """A parameter with its range.

    Attributes:
        name: of a parameter, an input or a state.
        low, high: ends of its range [its unit].
        unit: of both; None: none is named.
    """

    name: str
    low: float
    high: float
    unit: str | None = None

    def value(self, deviation: float) -> float:
        """Return the value at a deviation from the middle.

        Args:
            deviation: in half the range.
        """
        return 0.5 * (self.low + self.high) + 0.5 * (self.high - self.low) * deviation


class UncertainFamily:
    """Linear models at deviations of the parameters, each made once.

    Args:
        model: stays open.
        parameters: with their ranges.
        common: how it is linearised.
        workers: where.
        job: can end it, and is told how many there are.
        trimmed: whether the equilibrium is found anew at each.
        changed: what is made of each linear model.

    Attributes:
        failed: deviations → why there is no linear model.
    """

    def __init__(
        self, model: Model, parameters: Sequence[UncertainParameter], common: Lin, workers: Workers, job: Job, *,
        trimmed: bool, changed: Callable[[LinResult], Linear] = lambda linear: linear,
    ) -> None:  # fmt: skip
        self.parameters = tuple(parameters)
        self._model, self._common, self._workers, self._job = model, common, workers, job
        self._trimmed, self._changed = trimmed, changed
        self._known: dict[Place, Linear] = {}
        self.failed: dict[Place, str] = {}
        self._chosen = common
        self.centre: LinResult = self._first()
        self._chosen = replace(common, method=self.centre.method)

    @property
    def accuracy(self) -> float:
        """What the entries are known to, relative to their size."""
        return _ACCURACY.get(self.centre.method, 1e-13)

    def values(self, place: Iterable[float]) -> dict[str, float]:
        """Return parameter → value at deviations."""
        return {p.name: p.value(d) for p, d in zip(self.parameters, place, strict=True)}

    def at(self, places: Iterable[Iterable[float]]) -> list[Linear | None]:
        """Return the linear models at deviations; None: there is none, and `failed` says why.

        Args:
            places: deviations of all parameters, each in half its range.
        """
        wanted = [tuple(float(d) for d in place) for place in places]
        fresh = [p for p in dict.fromkeys(wanted) if p not in self._known and p not in self.failed]
        if fresh:
            self._make(fresh)
        return [self._known.get(p) for p in wanted]

    @property
    def count(self) -> int:
        """Number of linear models that were made."""
        return len(self._known)

    def _first(self) -> LinResult:
        middle = (0.0,) * len(self.parameters)
        self._make([middle])
        if middle in self.failed:
            words = ", ".join(f"{name} = {value:g}" for name, value in self.values(middle).items())
            hint = "; `hold=True` keeps the operating point as the parameters move" if self._trimmed else ""
            raise SimulationError(f"robust: there is no linear model in the middle of the ranges ({words}): "
                                  f"{self.failed[middle]}{hint}")  # fmt: skip
        return self._newest

    def _make(self, fresh: Sequence[Place]) -> None:
        named = {tuple(self.values(p).items()): p for p in fresh}
        todo = [dict(items) for items in named]
        for point in self._points(todo):
            place = named[tuple(point.values.items())]
            if point.result is None:
                self.failed[place] = point.reason or "no linear model"
                continue
            self._newest = point.result
            linear = self._changed(point.result)
            if self._known and (len(linear.A), linear.dt) != (len(self._any.A), self._any.dt):
                raise InputError(
                    f"robust: the linear model has {len(linear.A)} states at {point} and {len(self._any.A)} in the "
                    "middle, or another period; models of different order have no common uncertainty"
                )
            self._known[place] = linear
            self._job.done(str(point), self.count, self.count + 1)

    def _points(self, todo: Sequence[dict[str, float]]) -> Iterator[LinPoint]:
        """Yield the linear models by the method of the middle; where that fails, by the one that is chosen there."""
        again = list[dict[str, float]]()
        for common in (self._chosen, self._common):
            made = points_at(
                self._model, todo, common, self._workers, self._job, explained=False, trimmed=self._trimmed
            )
            for point in made if todo else ():
                if point.result is None and common.method != self._common.method:
                    again.append(point.values)
                else:
                    yield point
            if common.method == self._common.method:
                return
            todo = again

    @property
    def _any(self) -> Linear:
        return next(iter(self._known.values()))


def stacked(linear: Linear, scale: Floats) -> Floats:
    """Return [A B; C D] with its states in other units, shape (n + q, n + m).

    Args:
        linear: the model.
        scale: unit of each state.
    """
    return np.block([
        [linear.A * scale / scale[:, None], linear.B / scale[:, None]],
        [linear.C * scale, linear.D],
    ])  # fmt: skip
