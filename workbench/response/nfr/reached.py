"""Whether the run from the operating point ends in the periodic motion that was solved for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.eigenmodes import Eigenmodes
from workbench.errors import WorkbenchError
from workbench.response.nfr.period_solver import REACHED, Solved
from workbench.response.nfr.point import NfrPoint, PointTask
from workbench.response.nfr.prior_knowledge import DECAYED, GONE, GRID, LinearSineResponse
from workbench.response.periodic.fourier import Period, fundamental
from workbench.response.periodic.stability import NEUTRAL
from workbench.session.compiled import CompiledMeSession
from workbench.session.evaluated_point import Stand

__all__ = ["Approach", "contracts"]

# A run follows a linear model of itself where what the model leaves out, added up over all time to come, moves it by
# less than this part of the way: it then contracts as the linear one does, and ever more so.
_FOLLOWS = 0.2


# Instants of the linear run at which the model itself is asked; besides, the extremes of so many states.
_EVENLY, _EXTREMES = 8, 8


def contracts(session: CompiledMeSession, task: PointTask, result: Solved, origin: Floats) -> bool:
    """Return whether the run from the operating point is known to contract onto a motion, without running it.

    The linear model predicts the run, x = x0 + Re V·e^(Λt)·c + the forced motion, in closed form. Where the model has
    no events, and its derivatives along that run are the linear ones but for w (in modal coordinates), the run itself
    stays within Σ|V|·|w|/|Re λ| of the predicted one: with that small against the run, it decays as predicted.

    Args:
        session: where it was solved for; it cannot be continued.
        task: what was asked for.
        result: the motion.
        origin: states at the operating point, shape (n,).

    Source: H. K. Khalil, Nonlinear Systems, 9.1 (perturbed exponentially stable systems).
    """
    linear, instance = task.linear, session.instance
    forced = None if linear is None else linear.forced(task.frequency)
    if linear is None or forced is None or linear.modes is None or instance.nz or result.lap.events:
        return False
    rates = -linear.modes.poles.real
    if (rates < -NEUTRAL * task.frequency).any():
        return False
    times, moves = _linear_run(task, linear.modes, forced)
    far = np.abs(moves).max(axis=1)
    looked, stand = _telling(moves, far / np.maximum(linear.smallest, 1e-300)), Stand(instance)
    drive = task.amplitude * np.sin(2.0 * np.pi * task.frequency * times[looked])
    try:
        dx = [
            _slope(session, stand, origin + moves[:, i], task.input, task.centre + u)
            for i, u in zip(looked, drive, strict=True)
        ]
    except WorkbenchError:  # the model cannot be evaluated there
        return False
    with one_thread():
        wanted = linear.dx0[:, None] + linear.part.A @ moves[:, looked] + linear.part.B * drive
    shift = linear.modes.bound(np.transpose(dx) - wanted, np.maximum(rates, task.frequency / task.max_periods))
    away = np.abs(result.x - origin - task.amplitude * forced.states.imag + forced.rest)
    return bool((shift + away <= _FOLLOWS * np.maximum(far, linear.smallest)).all())


def _linear_run(task: PointTask, modes: Eigenmodes, forced: LinearSineResponse) -> tuple[Floats, Floats]:
    """Return times [s], shape (k,), and the linear model's states there, from the operating point, shape (n, k)."""
    poles, vectors, inverse = modes.poles, modes.vectors, modes.inverse
    last, omega = task.max_periods / task.frequency, 2.0 * np.pi * task.frequency
    times = np.linspace(0.0, min(last, DECAYED / max(-poles.real.max(), DECAYED / last)), GRID)
    start = forced.rest - task.amplitude * forced.states.imag
    left = poles.real * times[1] > np.log(GONE)  # quicker modes are seen at the first instant only
    rates = (poles if poles.imag.any() else poles.real)[left]
    with one_thread():
        free = (vectors[:, left] @ ((inverse[left] @ start)[:, None] * np.exp(np.outer(rates, times)))).real
    free[:, 0] = start
    parts = np.column_stack([forced.states.real, forced.states.imag])  # of Im X·e^(jωt)
    steady = task.amplitude * parts @ np.array([np.sin(omega * times), np.cos(omega * times)])
    return times, free + steady - forced.rest[:, None]


def _telling(moves: Floats, far: Floats) -> list[int]:
    """Return the instants at which a run is compared: some evenly spaced, and the extremes of the largest states."""
    largest = np.argsort(-far)[:_EXTREMES]
    even = np.linspace(0, GRID - 1, _EVENLY, dtype=int)
    result: list[int] = np.unique([*even, *moves[largest].argmax(axis=1), *moves[largest].argmin(axis=1)]).tolist()
    return result


def _slope(session: CompiledMeSession, stand: Stand, x: Floats, name: str, value: float) -> Floats:
    """Return the derivatives at other states and another value of an input, at the present time."""
    _, u = stand.read()
    u[[v.name == name for v in stand.inputs]] = value
    stand.put(session.time, x, u)
    session.instance.get_derivatives()
    return session.instance.dx.copy()


@dataclass
class Approach:
    """Watches a run from the operating point come near a periodic motion.

    With d the distance of the states from the motion at the begin of a period, and Φ the derivative of the period map
    there, a run near it has d(k+1) = Φ·d(k) + r. In modal coordinates a remainder r in each period moves what it tends
    to by Σ|r|/(1 − |μ|) at most; where that is small against |d|, the run contracts. Without events that is enough, as
    r falls at least with |d|². A wall that is not met in one period may be met in another: with events the run has to
    go on like that until it has come half the way, or has turned once through all its phases.

    Attributes:
        motions: what may be reached; the last one is watched for.
        seen: states at the end, and what the output did, of each period of the run.
        may_jump: whether there may be events: the model has event indicators, or there were some on the way.
    """

    motions: list[Solved] = field(default_factory=list)
    seen: list[tuple[Floats, Period]] = field(default_factory=list)
    may_jump: bool = False
    _last: _PeriodModes | None = None

    def add(self, session: CompiledMeSession, period: Period) -> bool:
        """Take one more period; return whether the motion is known to be reached."""
        self.seen.append((session.stand(), period))
        self.may_jump = session.events > 0 or session.instance.nz > 0
        return len(self.motions) > 0 and self.reaches(self.motions[-1])

    def reached(self, task: PointTask) -> NfrPoint:
        """Return the motion that is watched for as a point that is known to be reached."""
        point = self.motions[-1].point(task, reached="run")
        return replace(point, periods=point.periods + len(self.seen))

    def agrees(self, response: complex, error: float) -> bool:
        """Return whether a response is the one of the motion, as far as the errors of both tell."""
        if not self.motions:
            return False
        motion = self.motions[-1]
        mine = fundamental(motion.harmonics) / motion.lap.period.drive
        return abs(response - mine) <= (error + motion.error) * abs(mine)

    def reaches(self, motion: Solved) -> bool:
        """Return whether the run, as far as it has come, is known to end in a motion."""
        if self._last is None or self._last.motion is not motion:
            self._last = _PeriodModes(motion)
        modes = self._last
        distances = [modes.distance(x) for x, _ in self.seen]
        if len(distances) < 2:
            return False
        sizes = [modes.size(x) for x, _ in self.seen]
        if max(sizes[-2:]) <= REACHED and distances[-1] @ distances[-1].conj() <= distances[-2] @ distances[-2].conj():
            return modes.sounds(*self.seen[-2:])
        streak = 0
        while streak + 1 < len(distances) and modes.follows(*self.seen[-2 - streak :][:2]):
            streak += 1
        if streak == 0:
            return False
        if not self.may_jump:
            return True
        before, now = (float(np.abs(d).sum()) for d in (distances[-1 - streak], distances[-1]))
        return now <= 0.5 * before or streak >= modes.turn(distances[-1])


@dataclass
class _PeriodModes:
    """Deviations from a motion in coordinates in which its period map is diagonal; those that stand are left out."""

    motion: Solved

    @cached_property
    def _parts(self) -> tuple[Complex, Complex]:
        unit = self.motion.lap.unit
        with one_thread():
            mu, vectors = np.linalg.eig(self.motion.at.Phi * unit / unit[:, None])
            inverse = np.linalg.pinv(vectors)
        keep = np.abs(mu - 1.0) > NEUTRAL
        rows: Complex = inverse.astype(np.complex128)[keep] / unit
        return mu[keep].astype(np.complex128), rows

    def distance(self, x: Floats) -> Complex:
        """Return where states are, from the motion."""
        result: Complex = self._parts[1] @ (x - self.motion.x)
        return result

    def size(self, x: Floats) -> float:
        """Return how far states are from the motion, relative to how far they move; not along those that stand."""
        return float(np.max(np.abs(self.distance(x)), initial=0.0))

    def follows(self, before: tuple[Floats, Period], after: tuple[Floats, Period]) -> bool:
        """Return whether a period did what the linear map does, but for what does not matter."""
        mu, _ = self._parts
        if (np.abs(mu) >= 1.0).any():
            return False
        start, end = self.distance(before[0]), self.distance(after[0])
        moved = float((np.abs(end - mu * start) / (1.0 - np.abs(mu))).sum())
        return moved <= _FOLLOWS * float(np.abs(start).sum()) and self.sounds(before, after)

    def sounds(self, before: tuple[Floats, Period], after: tuple[Floats, Period]) -> bool:
        """Return whether the output did in a period what follows from the states at its begin."""
        harmonics = self.motion.harmonics[:3] + self.motion.at.rows @ (before[0] - self.motion.x)
        apart = np.abs(after[1].harmonics[:3] - harmonics)[1:].max()
        return bool(apart <= _FOLLOWS * abs(fundamental(self.motion.harmonics)))

    def turn(self, at: Complex) -> float:
        """Return in how many periods each mode that a deviation has most of turns once; real ones do not turn."""
        mu, _ = self._parts
        large = np.abs(at) >= 0.1 * np.abs(at).max(initial=0.0)
        angles = np.abs(np.angle(mu[large]))
        angles = angles[angles > 1e-9]
        return float(2.0 * np.pi / angles.min(initial=2.0 * np.pi))
