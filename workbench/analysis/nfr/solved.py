"""One point of a nonlinear frequency response, solved for: Newton's method on the period map in place of waiting."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeGuard

import numpy as np

from workbench.analysis.harmonics import distortion, fundamental
from workbench.analysis.nfr.certificate import Certificate, finite
from workbench.analysis.nfr.error import CANCELLED, INTEGRATION, Evidence, quadrature, relative_to_true  # fmt: skip
from workbench.analysis.nfr.point import NfrPoint, PointTask
from workbench.analysis.periodic.monodromy import Tangent
from workbench.analysis.periodic.period_map import Lap, PeriodMap, correction, resolvent_rows
from workbench.core.matrices import Complex
from workbench.session.base import Floats, Session
from workbench.session.compiled import CompiledMeSession

__all__ = ["NotSolvedError", "Solved", "can_solve", "solve_point"]

# Intervals in which the slopes along a period are taken, one level after the other: a coarse derivative does for
# Newton's method while it converges.
_LEVELS = (2, 10, 20, 100)

# So many periods at most, those of differences not counted.
_MOST = 16

# With more states than this the derivative is not taken by differences of whole periods.
_FEW_STATES = 24

# With no more, the slopes of the first period cost next to nothing.
_CHEAP = 12

# The response of the linear model, and its transient, are believed where its response is this near to the model's.
_ALIKE = 0.02

# A step that leaves more than this of the defect asks for a better derivative; one that leaves more than `_WORSE`
# times is taken back in part.
_POOR, _WORSE = 0.2, 2.0

# The periodic motion is reached where the states are no farther from it than this part of their motion.
_REACHED = 0.02

# What of a defect may lie in directions that a period leaves as they are.
_LEFT = 0.05

# The error is so many times what one more step would have changed.
_MARGIN = 2.0

# A multiplier this near to 1 is that of an integrator.
_INTEGRATES = 1e-6

# Of the slopes that a state has an error this part of the tolerance in each period, as a bound; see `INTEGRATION`.
_PER_PERIOD = 30.0


def can_solve(session: Session, task: PointTask) -> TypeGuard[CompiledMeSession]:
    """Return whether a point can be solved for: by setting the states of a model that does not sample.

    Args:
        session: where it would be run.
        task: what is asked for.
    """
    return task.method == "auto" and isinstance(session, CompiledMeSession) and not task.rates


class NotSolvedError(Exception):
    """The point cannot be solved for; `message` says why, and it is to be waited for."""


@dataclass(frozen=True, eq=False)
class Solved:
    """A periodic motion that was solved for.

    Attributes:
        lap: the period that is reported.
        at: the derivative of the map there.
        harmonics: of the output, what is left of the transient removed.
        error: of the response, relative to the true one.
        periods: number run.
        multipliers: Floquet multipliers, largest first; None: they are not known.
        stable: whether the motion is; None: that is not known.
    """

    lap: Lap
    at: Tangent
    harmonics: Floats
    error: float
    periods: int
    multipliers: Complex
    stable: bool | None

    def point(self, task: PointTask) -> NfrPoint:
        """Return it as a point of the sweep."""
        harmonics, drive = distortion(self.harmonics), self.lap.period.drive
        known = [h for h in harmonics if h is not None]
        return NfrPoint(
            frequency=task.frequency,
            amplitude=task.amplitude,
            response=fundamental(self.harmonics) / drive,
            offset=float(self.harmonics[0]),
            periods=self.periods,
            error=finite(self.error),
            stable=self.stable,
            resolved=True,
            certificate=Certificate(
                errcrit=task.errcrit,
                max_periods=task.max_periods,
                method="solved",
                multipliers=tuple(self.multipliers[:_SHOWN].tolist()),
                fold_distance=finite(float(np.min(np.abs(self.multipliers - 1.0), initial=math.inf))),
                defect=finite(float(np.linalg.norm(self.lap.defect / self.lap.unit))) if len(self.lap.unit) else 0.0,
                harmonics=tuple(finite(h) for h in harmonics),
                thd=finite(math.hypot(*known)) if known else None,
            ),
        )


_SHOWN = 6  # multipliers


def solve_point(session: CompiledMeSession, task: PointTask, evidence: Evidence, *, warm: int = 0) -> Solved:
    """Solve for the periodic response.

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

    Raises:
        NotSolvedError: it does not converge, or there is no response.
        SimulationError: the model cannot be run there; the session cannot be continued.
        KeyboardInterrupt: `task.stopped`.

    Source: R. Seydel, Practical Bifurcation and Stability Analysis, 7.3 (shooting); A. H. Nayfeh, B. Balachandran,
    Applied Nonlinear Dynamics, 6.5.
    """
    return _Search(session, task, evidence).run(warm=warm)


class _Search:
    def __init__(self, session: CompiledMeSession, task: PointTask, evidence: Evidence) -> None:
        self._map = PeriodMap(session, task.output, task.input, task.centre, task.rows)
        self._task, self._evidence, self._count = task, evidence, 0
        self._linear = self._linear_tangent()
        n = session.instance.nx
        self._level = -1 if self._linear is not None and n > _CHEAP else 0
        self._differ = False

    def _linear_tangent(self) -> Tangent | None:
        twin = self._evidence.twin
        if twin is None:
            return None
        return Tangent(twin.forced.phi, twin.forced.rows, np.zeros(len(twin.forced.phi)))

    def run(self, *, warm: int) -> Solved:
        x = None if warm else self._start()
        for _ in range(warm - 1):
            self._lap(None)
        before: tuple[Lap, float] | None = None
        quiet = 0
        for _ in range(_MOST):
            lap = self._lap(x)
            at = self._derivative(lap)
            e, left = correction(lap, at.Phi)
            distance = float(np.max(np.abs(e / lap.unit), initial=0.0))
            if not math.isfinite(distance):
                raise NotSolvedError("the period map has no finite derivative")
            change = abs(complex(*(at.rows @ e)[1:])) / abs(fundamental(lap.period.harmonics))
            rate = 0.0 if before is None else distance / max(before[1], 1e-300)
            good = change <= self._tolerance and distance <= _REACHED
            good = good and (left <= _LEFT or self._is_small(lap, at))
            quiet = quiet + 1 if good else 0
            if quiet > (lap.events > 0) and (at is not self._linear or self._alike(lap)):
                found = self._solved(lap, at, e)
                if found.stable is not None or not self._finer():
                    return found
            elif rate > _POOR or (at is self._linear and not self._alike(lap)):
                self._finer()
            if before is not None and rate > _WORSE:
                x = before[0].x0 + 0.25 * (lap.x0 - before[0].x0)
                before = (before[0], before[1])
                continue
            before, x = (lap, distance), lap.x0 + e
            if good:
                x = None if quiet and lap.events else x
        raise NotSolvedError(f"Newton's method did not converge in {_MOST} periods")

    def _start(self) -> Floats | None:
        """Return the periodic motion of the linear model; None: begin where the session stands."""
        twin = self._evidence.twin
        if twin is None:
            return None
        start: Floats = self._map.session.stand() + twin.periodic
        return start if np.isfinite(start).all() else None

    def _lap(self, x: Floats | None) -> Lap:
        if self._task.stopped():
            raise KeyboardInterrupt
        self._count += 1
        intervals = 0 if self._level < 0 else _LEVELS[self._level]
        lap = self._map.lap(self._task.frequency, self._task.amplitude, x, intervals=intervals)
        floor = self._evidence.floor(abs(lap.period.drive), lap.period.size)
        twin = self._evidence.twin
        if self._level < 0 and twin is not None:
            motion = self._task.amplitude * np.abs(twin.forced.states)
            lap = replace(lap, unit=np.maximum(motion, 1e-9 * np.maximum(np.abs(lap.x0), 1e-300)))
        if not lap.period.responds(floor) or lap.period.drive == 0.0:
            raise NotSolvedError("there is no response at the frequency of the input")
        return lap

    def _derivative(self, lap: Lap) -> Tangent:
        if self._differ:
            self._count += len(lap.x0)
            found = self._map.by_differences(lap, self._task.frequency, self._task.amplitude).tangent
        else:
            found = self._linear if self._level < 0 else lap.tangent
        if len(lap.x0) == 0:
            return Tangent(np.empty((0, 0)), np.empty((3, 0)), np.empty(0))
        if found is None:
            raise NotSolvedError("the model cannot be linearised along its motion")
        return found

    def _finer(self) -> bool:
        """Ask for a better derivative; False: there is none."""
        if self._level + 1 < len(_LEVELS):
            self._level += 1
            return True
        if self._differ or self._map.session.instance.nx > _FEW_STATES:
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

    def _is_small(self, lap: Lap, at: Tangent) -> bool:
        """Whether what is left of the defect hardly moves the states in a period."""
        del at
        return float(np.max(np.abs(lap.defect / lap.unit), initial=0.0)) <= 1e-2 * self._tolerance

    def _solved(self, lap: Lap, at: Tangent, e: Floats) -> Solved:
        harmonics = lap.period.harmonics.copy()
        step = at.rows @ e
        harmonics[:3] += step
        change = _MARGIN * abs(complex(step[1], step[2])) / abs(fundamental(harmonics))
        multipliers = at.multipliers if len(e) else np.empty(0, dtype=np.complex128)
        error = relative_to_true(
            change + self._integration(lap, at, harmonics) + quadrature(harmonics, self._task.rows)
        )
        return Solved(lap, at, harmonics, error, self._count, multipliers, _is_stable(multipliers, at.doubt))

    def _integration(self, lap: Lap, at: Tangent, harmonics: Floats) -> float:
        """Return what the integration gets wrong, relative to the response."""
        rtol, size = self._evidence.rtol, abs(fundamental(harmonics))
        twin = self._evidence.twin
        if not rtol:
            return 0.0
        found = math.inf
        if twin is not None and self._alike(lap):
            drive, forced = abs(lap.period.drive), twin.forced
            found = INTEGRATION * rtol * (1.0 + forced.sensitivity) * max(1.0, lap.period.size / size)
            found += CANCELLED * rtol * max(0.0, drive * forced.terms / size - 1.0)
        if at.through is None:
            return found
        slip = rtol * _PER_PERIOD * (np.abs(lap.x0) + lap.unit)
        return min(found, float((np.abs(resolvent_rows(lap, at)) + at.through) @ slip) / size)


def _is_stable(multipliers: Complex, doubt: float) -> bool | None:
    """Whether all multipliers lie inside the unit circle; that of an integrator is 1. None: not known."""
    moving = multipliers[np.abs(multipliers - 1.0) > _INTEGRATES]
    largest = float(np.max(np.abs(moving), initial=0.0))
    if largest + doubt < 1.0:
        return True
    return False if largest - doubt > 1.0 else None
