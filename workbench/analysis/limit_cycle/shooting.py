"""Shooting: the periodic motion of the simulated system itself, and its Floquet multipliers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.analysis.describing.base import Complex, Floats
from workbench.analysis.passes import half_range, told_mean
from workbench.errors import InputError, SimulationError
from workbench.model.described import DescribedModel

__all__ = ["Orbit", "shoot"]

_TOLERANCE = 1e-10
_NUDGE = 1e-5  # of the size of each state
_CLOSE = 1e-7
_ROUNDS = 16
_CLOSING = 0.2
_NEARBY = 2e-3
_MOST_STATES = 200
_SAMPLES = 1000
_FARTHEST = 0.5  # relative change of the period in one step


@dataclass(frozen=True, eq=False)
class Orbit:
    """A closed orbit of a system.

    Attributes:
        frequency: [Hz].
        states: state → value at one point of it.
        multipliers: Floquet multipliers besides the one at 1, largest first, shape (n − 1,), complex.
        doubt: by how much the flow after a period is not what it was, relative: that multiplier is 1, exactly.
        mean: of the watched variable over the orbit.
        amplitude: half its peak-to-peak value.
        fundamental: amplitude of its fundamental.
        residual: distance after one period over the size of the orbit.
    """

    frequency: float
    states: Mapping[str, float]
    multipliers: Complex
    doubt: float
    mean: float
    amplitude: float
    fundamental: float
    residual: float


def shoot(
    model: DescribedModel,
    *,
    states: Mapping[str, float],
    sizes: Mapping[str, float],
    frequency: float,
    inputs: Mapping[str, float],
    watch: str,
    time: float,
) -> Orbit | str:
    """Return the closed orbit near a predicted state; in words why there is none.

    Newton's method on φ(x, T) = x, the step kept orthogonal to the flow; the Jacobian by differences of
    whole periods. It finds unstable orbits as well.

    Args:
        model: continuous model exchange.
        states: predicted.
        sizes: how far each state moves in a period.
        frequency: predicted [Hz].
        inputs: held values.
        watch: variable that is measured over the orbit.
        time: session time at which the period begins [s].

    Source: Seydel, Practical Bifurcation and Stability Analysis, 7.3.
    """
    names = list(states)
    if len(names) > _MOST_STATES:
        return f"{len(names)} states are too many for differences of whole periods"
    try:
        shooting = _Shooting(_Task(model, inputs, watch, time), names, sizes)
        return shooting.run(np.array([states[n] for n in names]), 1.0 / frequency)
    except (SimulationError, InputError) as error:
        return str(error)


@dataclass(frozen=True)
class _Task:
    """What is run."""

    model: DescribedModel
    inputs: Mapping[str, float]
    watch: str
    time: float


class _Shooting:
    def __init__(self, task: _Task, names: list[str], sizes: Mapping[str, float]) -> None:
        self._model, self._names, self._inputs, self._time = task.model, names, task.inputs, task.time
        self._watch = task.watch
        size = np.array([sizes[n] for n in names])
        self._size = np.maximum(size, 1e-9 * max(float(size.max(initial=0.0)), 1e-300))

    def run(self, x: Floats, period: float) -> Orbit | str:
        flow, residual, origin = self._direction(x), np.inf, x
        jacobian: Floats | None = None
        for _ in range(_ROUNDS):
            end = self._after(x, period)
            distance = (end - x) / self._size
            before, residual = residual, float(np.abs(distance).max())
            moved = float(np.abs((x - origin) / self._size).max())
            # A Jacobian is good for the steps after it as long as they close in, and for the multipliers nearby.
            if jacobian is None or (residual > _CLOSING * before or moved > _NEARBY):
                jacobian, origin = self._jacobian(x, period, end), x
            if residual < _CLOSE:
                return self._orbit(x, period, jacobian, residual)
            step, stretch = self._newton(jacobian, self._direction(end), flow, distance, period)
            x, period = x + step * self._size, period + stretch
        return f"shooting did not arrive in {_ROUNDS} steps: distance {residual:.1e} of the orbit's size"

    def _newton(
        self, jacobian: Floats, end_flow: Floats, flow: Floats, distance: Floats, period: float
    ) -> tuple[Floats, float]:
        n = len(distance)
        system = np.zeros((n + 1, n + 1))
        system[:n, :n] = jacobian - np.eye(n)
        system[:n, n] = end_flow * period
        system[n, :n] = flow / max(float(np.linalg.norm(flow)), 1e-300)
        found = np.linalg.lstsq(system, np.append(-distance, 0.0), rcond=1e-12)[0]
        shrink = min(1.0, _FARTHEST / max(abs(found[n]), 1e-300), 1.0 / max(float(np.abs(found[:n]).max()), 1e-300))
        return shrink * found[:n], float(shrink * found[n] * period)

    def _jacobian(self, x: Floats, period: float, end: Floats) -> Floats:
        """Return ∂φ/∂x in units of the sizes."""
        columns = []
        for i in range(len(x)):
            moved = x.copy()
            moved[i] += _NUDGE * self._size[i]
            columns.append((self._after(moved, period) - end) / self._size / _NUDGE)
        return np.array(columns, dtype=np.float64).T

    def _orbit(self, x: Floats, period: float, jacobian: Floats, residual: float) -> Orbit:
        found, doubt = _across(jacobian, self._direction(x))
        states = dict(zip(self._names, x.tolist(), strict=True))
        v = self._along(x, period)
        return Orbit(
            frequency=1.0 / period,
            states=states,
            multipliers=found,
            doubt=doubt,
            mean=told_mean(float(np.mean(v)), amplitude=half_range(v), residual=residual),
            amplitude=half_range(v),
            fundamental=float(2.0 * np.abs(np.fft.rfft(v)[1]) / len(v)),
            residual=residual,
        )

    # -- the system -------------------------------------------------------------------------

    def _values(self, x: Floats) -> dict[str, float]:
        return {**self._inputs, **dict(zip(self._names, x.tolist(), strict=True))}

    def _after(self, x: Floats, period: float) -> Floats:
        """Return the states a period later."""
        with self._model.open_at(time=self._time, values=self._values(x), tolerance=_TOLERANCE) as session:
            session.advance(self._time + period, signals={})
            found = session.values(self._names)
        return np.array([found[n] for n in self._names], dtype=np.float64)

    def _along(self, x: Floats, period: float) -> Floats:
        """Return the watched variable at equidistant times of one period."""
        points = self._time + period * np.arange(1, _SAMPLES + 1) / _SAMPLES
        with self._model.open_at(time=self._time, values=self._values(x), tolerance=_TOLERANCE) as session:
            record = session.advance(float(points[-1]), signals={}, record=[self._watch], points=points)
        return record.right_limits(points).values[self._watch]

    def _direction(self, x: Floats) -> Floats:
        """Return dx/dt in units of the sizes."""
        with self._model.open_point(time=self._time, values=self._values(x)) as point:
            place = {v.name: i for i, v in enumerate(point.states)}
            dx = point.at(point.x0, point.u0).dx
        return np.asarray(np.array([dx[place[n]] for n in self._names]) / self._size, dtype=np.float64)


def _across(jacobian: Floats, flow: Floats) -> tuple[Complex, float]:
    """Return the multipliers across the flow, largest first, and how far the flow is from being mapped onto itself.

    The flow f is an eigenvector, M f = f; what M does on the quotient by f has the other eigenvalues. Taken
    like this they stay apart from 1, where differences of a motion with jumps mix two eigenvalues that are near.
    """
    length = float(np.linalg.norm(flow))
    if not length > 0.0:
        return np.linalg.eigvals(jacobian).astype(np.complex128), np.inf
    along = flow / length
    across = np.linalg.svd(along[None, :])[2][1:].T
    found = np.linalg.eigvals(across.T @ jacobian @ across).astype(np.complex128)
    return found[np.argsort(-np.abs(found))], float(np.linalg.norm(jacobian @ along - along))
