"""Poles of a model over one of its parameters, inputs or states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

from workbench.analysis.lin.linearise import run
from workbench.analysis.lin.request import Lin, LinOver
from workbench.analysis.lin.result import LinResult
from workbench.analysis.lin.sweep import LinPoint, over, with_parameters
from workbench.analysis.lin.task import make_task
from workbench.analysis.trim.request import trim
from workbench.core.job import Job
from workbench.core.modal import Poles, poles_of
from workbench.core.operating_point import OperatingPoint
from workbench.core.option import recast
from workbench.errors import InputError, SimulationError, suggest
from workbench.model import Model
from workbench.system.description import GainComponent
from workbench.system.recipe import SystemRecipe

__all__ = ["ModelSource", "check_parameter"]

# How accurate the entries of A are, relative to its size, by method; those not named: rounding.
_ACCURACY = {"difference": 1e-8, "kalman-bertram": 1e-8, "response": 1e-5}


def check_parameter(model: Model, name: str) -> None:
    """Refuse a name that cannot be varied.

    Args:
        model: whose it should be.
        name: of a parameter, input or state, or "component.gain" of a system's gain.

    Raises:
        InputError: it is none of these.
    """
    known = [v.name for v in (*model.parameters, *model.inputs, *model.states) if v.is_number] + _gains(model)
    if name not in known:
        raise InputError(f"modes: '{name}' is not a parameter, input or state of {model.name}; {suggest(name, known)}")


def _gains(model: Model) -> list[str]:
    """Return the gains of a system file, which are no variables of the system."""
    recipe = model.recipe
    if not isinstance(recipe, SystemRecipe):
        return []
    return [f"{c.name}.gain" for c in recipe.system.components if isinstance(c, GainComponent)]


def _with_gain(model: Model, name: str, value: float) -> AbstractContextManager[Model]:
    """Return the system with another gain, opened anew."""
    recipe = model.recipe
    if not isinstance(recipe, SystemRecipe):
        raise InputError(f"modes: {model.name} is not a system")
    parts = tuple(
        replace(c, gain=value) if isinstance(c, GainComponent) and f"{c.name}.gain" == name else c
        for c in recipe.system.components
    )
    return replace(recipe, system=replace(recipe.system, components=parts)).open()


class ModelSource:
    """Linearises at each value that is asked for, once.

    Args:
        model: stays open.
        vary: parameter, input or state.
        lin: how, and about which operating point.
        trimmed: find the equilibrium at each value; the search begins at that point.

    Attributes:
        results: value → linear model.
        failed: value → reason.
    """

    def __init__(self, model: Model, vary: str, lin: Lin, *, trimmed: bool) -> None:
        self._model, self._vary, self._lin, self._trimmed = model, vary, lin, trimmed
        self._is_parameter = vary in {v.name for v in model.parameters}
        self._is_gain = vary in _gains(model)
        self._one_by_one = trimmed or self._is_gain
        self.results: dict[float, LinResult] = {}
        self.failed: dict[float, str] = {}
        self._poles: dict[float, Poles] = {}

    def prepare(self, values: Sequence[float], *, jobs: int, progress: Callable[[int, int], None] | None) -> None:
        """Linearise at many values, several at a time.

        Args:
            values: of the parameter.
            jobs: worker processes.
            progress: called with the number done and in all.
        """
        if self._one_by_one:
            for number, value in enumerate(values, 1):
                self(value)
                if progress is not None:
                    progress(number, len(values))
            return
        shown = None if progress is None else lambda _p, done, total: progress(done, total)
        for point in self._over(values, jobs, shown):
            self._take(point)

    def __call__(self, value: float) -> Poles | None:
        """Return the poles at a value; None: there is no linear model.

        Args:
            value: of the parameter.
        """
        value = float(value)
        if value in self.failed:
            return None
        if value not in self.results:
            self._take(self._single(value) if self._one_by_one else self._over([value], 1, None)[0])
            if value in self.failed:
                return None
        if value not in self._poles:
            found = self.results[value]
            self._poles[value] = poles_of(found.A, dt=found.dt, accuracy=_ACCURACY.get(found.method, 0.0))
        return self._poles[value]

    def _take(self, point: LinPoint) -> None:
        value = point.values[self._vary]
        if point.result is None:
            self.failed[value] = point.reason or "no linear model"
        else:
            self.results[value] = point.result

    def _over(
        self, values: Sequence[float], jobs: int, progress: Callable[[LinPoint, int, int], None] | None
    ) -> tuple[LinPoint, ...]:
        asked = recast(LinOver, self._lin, over={self._vary: values}, jobs=jobs)
        return over(self._model, asked, Job(progress)).points

    def _single(self, value: float) -> LinPoint:
        """Linearise at one value what `lin_over` does not: about an equilibrium of its own, with another gain."""
        varied = {self._vary: value}
        try:
            with self._set(value) as model:
                point = self._point(model, value) if self._trimmed else None
                asked = self._lin if point is None else replace(self._lin, x0={**point.x, **point.discrete}, u0=point.u)
                return LinPoint(varied, run(make_task(model, asked), asked.method))
        except SimulationError as error:
            return LinPoint(varied, None, str(error))

    def _set(self, value: float) -> AbstractContextManager[Model]:
        if self._is_gain:
            return _with_gain(self._model, self._vary, value)
        return with_parameters(self._model, {self._vary: value} if self._is_parameter else {})

    def _point(self, model: Model, value: float) -> OperatingPoint:
        x0, u0, states = self._lin.x0 or {}, self._lin.u0 or {}, {v.name for v in model.states}
        held = {} if self._is_parameter or self._is_gain else {self._vary: value}
        fixed = {n: v for n, v in held.items() if n in states}
        forced = {**u0, **{n: v for n, v in held.items() if n not in states}}
        begin = {n: v for n, v in x0.items() if n in states}
        found = trim(model, x0=begin, u0=forced, fix=fixed, time=self._lin.time)
        if not found.converged:
            raise SimulationError("no equilibrium was found there")
        return found.operating_point
