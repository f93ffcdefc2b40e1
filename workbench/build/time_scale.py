"""What the poles of a linear model say about its scales: a default experiment, and how far each state moves."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.build.describe import BuiltExperiment
from workbench.build.matrices import StateSpaceFile
from workbench.core.values.arrays import Floats
from workbench.core.values.matrices import resolvent
from workbench.model.loading import DEFAULT_TOLERANCE

__all__ = ["default_experiment", "nominals"]


_AT_REST = 1e-9  # a pole so much slower than the fastest is an integrator
_A_CYCLE = 20.0  # steps in a cycle of the fastest pole
_DECAYS = 10.0  # time constants of the slowest pole until the stop
_MOST_STEPS = 10_000


def default_experiment(matrices: StateSpaceFile) -> BuiltExperiment:
    """Return FMI's default experiment: the slowest pole decays, a step resolves the fastest one.

    A discrete model steps by its period. Without poles to go by, the stop time and the step of a continuous model stay
    open.
    """
    speeds = _speeds(matrices)
    if not speeds.size:
        return BuiltExperiment(None, DEFAULT_TOLERANCE, matrices.dt or None)
    stop = _round(_DECAYS / float(speeds.min()), up=True)
    if matrices.dt > 0.0:
        return BuiltExperiment(max(stop, 100.0 * matrices.dt), DEFAULT_TOLERANCE, matrices.dt)
    step = max(2.0 * math.pi / (_A_CYCLE * float(speeds.max())), stop / _MOST_STEPS)
    return BuiltExperiment(stop, DEFAULT_TOLERANCE, _round(step, up=False))


def _speeds(matrices: StateSpaceFile) -> Floats:
    """Return the distances of the poles from 0 [rad/s], without those at 0."""
    speeds = np.abs(matrices.continuous_poles)
    moving = speeds[speeds > _AT_REST * float(np.max(speeds, initial=0.0))]
    return np.asarray(moving[moving > 0.0], dtype=np.float64)


def _round(value: float, *, up: bool) -> float:
    """Return the next of 1, 2, 5, 10, … times a power of ten."""
    power = math.floor(math.log10(value))
    steps = [float(f"{d}e{power}") for d in (1, 2, 5, 10)]
    if up:
        return next(s for s in steps if s >= value * (1.0 - 1e-12))
    return next(s for s in reversed(steps) if s <= value * (1.0 + 1e-12))


def nominals(matrices: StateSpaceFile) -> Sequence[float | None]:
    """Return how far each state typically moves, for the integrators' absolute tolerance; None where nothing moves it.

    For a continuous model: the largest gain from an input of amplitude 1 over the frequencies of the poles; over
    several inputs the geometric mean, because their units may be far apart.
    """
    A, B = matrices.A, matrices.B
    if not A.size or not B.size:
        return [None] * len(A)
    # At its own frequency an undamped pole has no finite gain; a little beside it every pole has.
    speeds = _speeds(matrices) if _speeds(matrices).size else np.array([1.0 / 1.1])
    gains = np.abs(resolvent(A, B, np.asarray(1.1j * speeds, dtype=np.complex128))).max(axis=0)
    return [_mean(row[row > 0.0]) for row in gains]


def _mean(gains: Floats) -> float | None:
    if not gains.size:
        return None
    mean = float(np.exp(np.mean(np.log(gains))))
    return float(f"{mean:.2g}") if math.isfinite(mean) and mean > 0.0 else None
