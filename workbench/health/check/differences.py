"""Derivatives and outputs around points of a test run, by differences: what two checks need."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.variable import Variable
from workbench.health.check.subject import CheckedFmu
from workbench.session.point import ModelPoint

__all__ = ["MOST_COLUMNS", "EvaluationPoint", "places"]

MOST_COLUMNS = 200  # of large models so many states and inputs are looked at, spread evenly
_AT = (0.0, 0.35, 0.8)  # of a test run
_UNDECLARED = 1e-2  # least size of a variable that does not move and whose nominal value is not declared


@dataclass(frozen=True)
class EvaluationPoint:
    """A point around which the model is evaluated.

    Attributes:
        point: it stands there.
        time: of the test run from which states and inputs were taken [s].
        rows: derivatives of the states, then outputs.
        columns: states, then continuous inputs.
        chosen: numbers of the columns that are looked at.
        sizes: of the columns: the larger of nominal value, magnitude and what was seen in the test run, shape (k,).
    """

    point: ModelPoint
    time: float
    rows: tuple[Variable, ...]
    columns: tuple[Variable, ...]
    chosen: tuple[int, ...]
    sizes: Floats

    def at(self, shift: Floats) -> Floats | None:
        """Return all rows with the columns shifted; None where that cannot be evaluated or a `when` would fire."""
        n = len(self.point.states)
        u = self.point.u0.copy()
        u[list(_fast(self.point))] += shift[n:]
        try:
            result = self.point.at(self.point.x0 + shift[:n], u)
        except SimulationError:
            return None
        return None if result.latched else np.concatenate([result.dx, result.y])

    def along(self, column: int, length: float) -> Floats | None:
        """Return all rows with one column shifted."""
        shift = np.zeros(len(self.columns))
        shift[column] = length
        return self.at(shift)


def places(subject: CheckedFmu) -> Iterator[EvaluationPoint]:
    """Yield the start of a test run with swinging inputs and two points on its way.

    Relations are evaluated anew at every shifted point; discrete states stay as they are at the start.

    Args:
        subject: model exchange.

    Raises:
        InputError: the model shows no derivatives.
    """
    result = _visited(subject)
    seen = np.abs(np.array([x for x, _ in result])).max(axis=0, initial=0.0)
    with subject.model.open_point(time=subject.start) as point:
        fast = _fast(point)
        columns = (*point.states, *(point.inputs[i] for i in fast))
        chosen = np.unique(np.linspace(0, len(columns) - 1, min(len(columns), MOST_COLUMNS)).round().astype(int))
        for (x, inputs), share in zip(result, _AT, strict=True):
            u = np.array([inputs.get(v.name, u) for v, u in zip(point.inputs, point.u0, strict=True)])
            try:
                point.move(x, u)
            except SimulationError:
                continue
            sizes = np.concatenate([_state_sizes(point, seen), _input_sizes(subject, point)])
            rows = (*subject.model.description.derivatives, *point.outputs)
            time = subject.start + share * subject.span
            yield EvaluationPoint(point, time, rows, columns, tuple(chosen.tolist()), sizes)


def _visited(subject: CheckedFmu) -> list[tuple[Floats, dict[str, float]]]:
    """Return states and inputs at some instants of a test run."""
    result = []
    signals = subject.sines()
    with subject.model.open_session(start_time=subject.start) as session:
        for share in _AT:
            session.advance(subject.start + share * subject.span, signals=signals)
            session.instance.get_states()
            result.append((session.instance.x.copy(), session.values(list(signals))))
    return result


def _fast(point: ModelPoint) -> tuple[int, ...]:
    return tuple(i for i, v in enumerate(point.inputs) if v.is_continuous_input)


def _state_sizes(point: ModelPoint, seen: Floats) -> Floats:
    """A nominal value of 1 that the file does not declare says nothing."""
    declared = np.array([v.nominal is not None for v in point.states], dtype=bool) | (point.nominal != 1.0)
    nominal = np.where(declared, point.nominal, 0.0)
    sizes: Floats = np.maximum(np.maximum(np.abs(point.x0), nominal), seen)
    return np.where(sizes > 0.0, sizes, _UNDECLARED)


def _input_sizes(subject: CheckedFmu, point: ModelPoint) -> Floats:
    sizes = [subject.inputs[point.inputs[i].name] for i in _fast(point)]
    return np.array([max(abs(middle), amplitude) or _UNDECLARED for middle, amplitude in sizes])
