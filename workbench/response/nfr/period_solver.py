"""One point of a nonlinear frequency response, solved for: Newton's method on the period map in place of waiting."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeGuard

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats
from workbench.errors import WorkbenchError
from workbench.response.nfr.certificate import Certificate, finite
from workbench.response.nfr.error import (
    BELIEVED,
    MARGIN,
    PER_PERIOD,
    ROUNDING,
    Evidence,
    below_scale,
    of_integration,
    quadrature,
    relative_to_true,
)
from workbench.response.nfr.point import NfrPoint, PointTask
from workbench.response.periodic.fourier import distortion, fundamental
from workbench.response.periodic.monodromy import VariationalEquation
from workbench.response.periodic.period_map import FEW_STATES, Lap, PeriodMap, correction, resolvent_rows
from workbench.response.periodic.stability import is_stable
from workbench.response.periodic.timed import changes_with_time
from workbench.session.base import Session
from workbench.session.compiled import CompiledMeSession

__all__ = ["REACHED", "NotSolvedError", "Search", "Solved", "can_solve", "solve_point"]

# Intervals in which the slopes along a period are taken, one level after the other: a coarse derivative does for
# Newton's method while it converges.
_LEVELS = (2, 10, 20, 100)

# With more states, the slopes along a period, and the derivative of the period map, would take gigabytes and minutes.
_MOST_STATES = 300

# Multipliers below this leave no doubt of stability, however coarsely they were taken.
_HARMLESS = 0.1

# So many periods at most, those of differences not counted.
_MOST = 16

# With no more, the slopes of the first period cost next to nothing.
_CHEAP = 12

# The response of the linear model, and its transient, are believed where its response is this near to the model's.
_ALIKE = 0.02

# A step that leaves more than this of the defect asks for a better derivative; one that leaves more than `_WORSE`
# times is taken back in part.
_POOR, _WORSE = 0.2, 2.0

# The periodic motion is reached where the states are no farther from it than this part of their motion.
REACHED = 0.02

# What of a defect may lie in directions that a period leaves as they are.
_LEFT = 0.05

# Why a point is not called settled: its integration is coarser than its motion.
_TOO_SMALL = (
    "the states move by too little of their nominal values for the tolerance: raise the amplitude or tighten it"
)


def can_solve(session: Session, task: PointTask) -> TypeGuard[CompiledMeSession]:
    """Return whether a point can be solved for: by setting the states of a model without samplers and delays.

    Args:
        session: where it would be run.
        task: what is asked for.
    """
    if task.method != "auto" or not isinstance(session, CompiledMeSession) or task.rates:
        return False
    if session.instance.has_history:
        return False
    return session.instance.nx <= _MOST_STATES or task.linear is not None


class NotSolvedError(Exception):
    """The point cannot be solved for; `message` says why, and it is to be waited for."""


class TimedError(NotSolvedError):
    """The model changes with time itself: each period has another map."""


@dataclass(frozen=True, eq=False)
class Solved:
    """A periodic motion that was solved for.

    Attributes:
        lap: the period that is reported.
        at: the derivative of the map there.
        harmonics: of the output, what is left of the transient removed.
        error: of the response, relative to the true one.
        periods: number run.
        stable: whether the motion is; None: that is not known.
        x: states at its begin, shape (n,).
        coarse: whether the states move by too little for the integration.
    """

    lap: Lap
    at: VariationalEquation
    harmonics: Floats
    error: float
    periods: int
    stable: bool | None
    x: Floats
    coarse: bool = False

    def point(self, task: PointTask, reached: str | None = None) -> NfrPoint:
        """Return it as a point of the sweep.

        Args:
            task: what was asked for.
            reached: see `Certificate`.
        """
        harmonics, drive = distortion(self.harmonics), self.lap.period.drive
        known = [h for h in harmonics if h is not None]
        return NfrPoint(
            frequency=task.frequency,
            amplitude=task.amplitude,
            response=fundamental(self.harmonics) / drive,
            offset=float(self.harmonics[0]),
            periods=self.periods,
            averaged=self.coarse,
            error=finite(self.error),
            stable=self.stable,
            resolved=True,
            certificate=Certificate(
                errcrit=task.errcrit,
                max_periods=task.max_periods,
                method="solved",
                reached=reached,
                multipliers=self.at.kept,
                fold_distance=finite(float(np.min(np.abs(self.at.multipliers - 1.0), initial=math.inf))),
                defect=finite(float(np.linalg.norm(self.lap.defect / self.lap.unit))) if len(self.lap.unit) else 0.0,
                harmonics=tuple(finite(h) for h in harmonics),
                thd=finite(math.hypot(*known)) if known else None,
                why=_TOO_SMALL if self.coarse else None,
            ),
        )


def solve_point(session: CompiledMeSession, task: PointTask, evidence: Evidence, *, warm: int = 0) -> Solved:
    """Solve for the periodic response; see `Search`.

    Raises:
        NotSolvedError: it does not converge, or there is no response.
        SimulationError: the model cannot be run there; the session cannot be continued.
        KeyboardInterrupt: `task.stopped`.
    """
    search = Search(session, task, evidence, warm=warm)
    while search.found is None:
        search.add(search.periods.lap(**search.next))
    return search.found


class Search:
    """Solves for the periodic response, period by period.

    The fixed point of the period map φ(x) = x(T) is found by Newton's method, x ← x + (I − Φ)⁻¹(φ(x) − x), beginning
    at the periodic motion of the linear model. Φ is that of the linear model while it describes the motion; then it
    follows from the slopes along the period, at more and more instants; then, for few states and jumps of the
    flow, from differences of whole periods. What the last step would still change is corrected, and is the error.

    Args:
        session: where to run, at the operating point.
        task: what to measure.
        evidence: what is known of the point.
        warm: run so many periods from where the session stands and begin there; 0: begin at the periodic motion of the
            linear model.

    Attributes:
        periods: the period map.
        found: the response, once it is known.
        failed: why it was not found, see `trying`; empty: it was, or may yet be.
        timed: whether that is because the model changes with time itself.

    Source: R. Seydel, Practical Bifurcation and Stability Analysis, 7.3 (shooting); A. H. Nayfeh, B. Balachandran,
    Applied Nonlinear Dynamics, 6.5.
    """

    def __init__(self, session: CompiledMeSession, task: PointTask, evidence: Evidence, *, warm: int = 0) -> None:
        self.periods = PeriodMap(session, task.output, task.input, task.centre, task.rows)
        self.found: Solved | None = None
        self.failed = ""
        self.timed = False
        self._task, self._evidence, self._count = task, evidence, 0
        self._linear = self._linear_tangent()
        self._level = -1 if self._linear is not None and session.instance.nx > _CHEAP else 0
        self._differ = False
        self._warm = max(warm - 1, 0)
        self._most = _MOST + self._warm
        self._x = None if warm else self._start()
        self._before: tuple[Lap, float] | None = None
        self._quiet = 0
        self._checking: Solved | None = None  # found, but for its stability

    @contextmanager
    def trying(self) -> Iterator[None]:
        """Keep as `failed` why the response cannot be solved for."""
        try:
            yield
        except (NotSolvedError, WorkbenchError) as error:
            self.failed, self.timed = str(error), isinstance(error, TimedError)

    @property
    def next(self) -> dict[str, Any]:
        """What `PeriodMap.lap` is asked for next.

        Raises:
            KeyboardInterrupt: the task is stopped.
            NotSolvedError: there were periods enough.
        """
        if self._task.stopped():
            raise KeyboardInterrupt
        if self._count >= self._most:
            raise NotSolvedError(f"Newton's method did not converge in {self._most} periods")
        intervals = 0 if self._level < 0 or self._warm else _LEVELS[self._level]
        task = self._task
        return {"frequency": task.frequency, "amplitude": task.amplitude, "x": self._x, "intervals": intervals}

    def add(self, lap: Lap) -> None:
        """Take the next period.

        Args:
            lap: what `next` has asked for.

        Raises:
            NotSolvedError: there is no response, or no derivative; or the model changes with time itself.
        """
        self._count += 1
        if self._warm:
            self._warm -= 1
            self._x = None
            return
        lap = self._checked(lap)
        at = self._derivative(lap)
        with one_thread():
            e, left = correction(lap, at)
        distance = float(np.max(np.abs(e / lap.unit), initial=0.0))
        if not math.isfinite(distance):
            raise NotSolvedError("the period map has no finite derivative")
        change = abs(complex(*(at.rows @ e)[1:])) / abs(fundamental(lap.period.harmonics))
        before, rate = self._before, 0.0
        if before is not None:
            rate = distance / max(before[1], 1e-300)
        near = distance <= REACHED
        noisy = not near and self._alike(lap) and bool((np.abs(e) <= self._unseen(lap)).all())
        good = change <= self._tolerance and (near or noisy) and (left <= _LEFT or self._is_small(lap))
        self._quiet = self._quiet + 1 if good else 0
        trusted = at is not self._linear or self._alike(lap)
        if self._checking is not None:
            self._check(self._checking, at)
            return
        if self._quiet > (lap.events > 0) and trusted:
            result = self._solved(lap, at, e, noisy=noisy)
            slopes = at is not self._linear and not self._differ and len(lap.x0) > 0
            if slopes and _largest(at) > _HARMLESS and self._more_instants():
                self._checking, self._x = result, lap.x0 + e
                return
            if result.stable is not None or not self._finer():
                self.found = result
                return
        elif rate > _POOR or not trusted:
            self._finer()
        if before is not None and rate > _WORSE:
            self._x = before[0].x0 + 0.25 * (lap.x0 - before[0].x0)
            return
        # With events the next period shows whether the discrete states repeat, too.
        self._before, self._x = (lap, distance), None if good and lap.events else lap.x0 + e

    def _check(self, result: Solved, finer: VariationalEquation) -> None:
        """Judge the stability of what was found by the derivative from more instants.

        What does for Newton's method may be wrong in the multipliers: two sets of instants tell by how much.
        """
        stable = is_stable(finer.multipliers, max(finer.doubt, abs(_largest(finer) - _largest(result.at))))
        result = replace(result, at=finer, stable=stable, periods=self._count)
        if stable is None and self._more_instants():
            self._checking = result
        else:
            self.found = result

    def _more_instants(self) -> bool:
        """Take the slopes at more instants; False: they are as many as there can be."""
        more = self._level + 1 < len(_LEVELS) and self.periods.session.instance.nx <= _MOST_STATES
        self._level += more
        return more

    def _linear_tangent(self) -> VariationalEquation | None:
        twin = self._evidence.twin
        if twin is None:
            return None
        forced = twin.forced
        still = np.zeros(len(forced.phi))
        return VariationalEquation(forced.phi, forced.rows, still, others=forced.multipliers, factors=forced.factors)

    def _start(self) -> Floats | None:
        """Return the periodic motion of the linear model; None: begin where the session stands."""
        twin = self._evidence.twin
        if twin is None:
            return None
        start: Floats = self.periods.session.stand() + twin.periodic
        return start if np.isfinite(start).all() else None

    def _checked(self, lap: Lap) -> Lap:
        """Return a lap in units of the motion, if there is a response, and all laps have the same map."""
        lap = self._in_units(lap)
        size, session = abs(fundamental(lap.period.harmonics)), self.periods.session
        if changes_with_time(session, self._task.output, lap.unit, size, 1.0 / self._task.frequency):
            raise TimedError("the model changes with time itself")
        return lap

    def _in_units(self, lap: Lap) -> Lap:
        floor = self._evidence.floor(abs(lap.period.drive), lap.period.size)
        if not lap.period.responds(floor) or lap.period.drive == 0.0:
            raise NotSolvedError("there is no response at the frequency of the input")
        twin = self._evidence.twin
        if self._level >= 0 or twin is None:
            return lap
        motion = self._task.amplitude * np.abs(twin.forced.states)
        return replace(lap, unit=np.maximum(motion, 1e-9 * np.maximum(np.abs(lap.x0), 1e-300)))

    def _derivative(self, lap: Lap) -> VariationalEquation:
        if self._differ:
            self._count += len(lap.x0)
            result = self.periods.by_differences(lap, self._task.frequency, self._task.amplitude).tangent
        else:
            result = self._linear if self._level < 0 else lap.tangent
        if len(lap.x0) == 0:
            return VariationalEquation(np.empty((0, 0)), np.empty((3, 0)), np.empty(0))
        if result is None:
            raise NotSolvedError("the model cannot be linearised along its motion")
        return result

    def _finer(self) -> bool:
        """Ask for a better derivative; False: there is none."""
        if self._more_instants():
            return True
        if self._differ or self.periods.session.instance.nx > FEW_STATES:
            return False
        self._differ = True
        return True

    @property
    def _tolerance(self) -> float:
        """What one more step may still change, relative to the response."""
        return min(self._task.errcrit, 1.0) / 100.0

    def _alike(self, lap: Lap) -> bool:
        """Whether the linear model describes the motion."""
        twin = self._evidence.twin
        if twin is None:
            return False
        measured = fundamental(lap.period.harmonics) / lap.period.drive
        return abs(measured - twin.forced.response) <= _ALIKE * abs(measured)

    def _is_small(self, lap: Lap) -> bool:
        """Whether what is left of the defect hardly moves the states in a period."""
        return float(np.max(np.abs(lap.defect / lap.unit), initial=0.0)) <= 1e-2 * self._tolerance

    def _solved(self, lap: Lap, at: VariationalEquation, e: Floats, *, noisy: bool = False) -> Solved:
        harmonics = lap.period.harmonics.copy()
        step = at.rows @ e
        harmonics[:3] += step
        size = abs(fundamental(harmonics))
        change = MARGIN * abs(complex(step[1], step[2])) / size + ROUNDING * lap.period.size / size
        if noisy:  # the next period would have another defect of that size
            change += float(np.abs(resolvent_rows(lap, at)) @ np.abs(lap.defect)) / size
        error = relative_to_true(
            change + self._integration(lap, at, harmonics) + quadrature(harmonics, self._evidence.over(lap.period))
        )
        twin = self._evidence.twin
        rtol = self._evidence.over(lap.period).rtol
        coarse = below_scale(None if twin is None else twin.forced, rtol, size) > BELIEVED
        stable = is_stable(at.multipliers, at.doubt)
        return Solved(lap, at, harmonics, error, self._count, stable, lap.x0 + e, coarse)

    def _integration(self, lap: Lap, at: VariationalEquation, harmonics: Floats) -> float:
        """Return what the integration gets wrong, relative to the response."""
        rtol, size = self._evidence.over(lap.period).rtol, abs(fundamental(harmonics))
        twin = self._evidence.twin
        if not rtol:
            return 0.0
        result = math.inf
        if twin is not None and self._alike(lap):
            drive, slow = abs(lap.period.drive), 1.0 + twin.forced.sensitivity
            result = of_integration(twin.forced, rtol, slow, drive=drive, size=size, largest=lap.period.size)
        if at.through is None:
            return result
        return min(result, float((np.abs(resolvent_rows(lap, at)) + at.through) @ self._slip(lap)) / size)

    def _slip(self, lap: Lap) -> Floats:
        """Return by how much the integration may have each state wrong at the end of a period, shape (n,)."""
        return self._evidence.over(lap.period).rtol * PER_PERIOD * self._weights(lap)

    def _unseen(self, lap: Lap) -> Floats:
        """Return how far each state may be off without the integration having seen it, shape (n,).

        Its test holds the root mean square over the states in each step, so that one may have √n times that.
        """
        allowed = self._evidence.rtol * lap.period.steps * math.sqrt(len(lap.x0)) * self._weights(lap)
        return np.maximum(REACHED * lap.unit, allowed)

    def _weights(self, lap: Lap) -> Floats:
        weights: Floats = np.abs(lap.x0) + np.maximum(lap.unit, self.periods.session.scales()[0])
        return weights


def _largest(at: VariationalEquation) -> float:
    return float(np.max(np.abs(at.multipliers), initial=0.0))
