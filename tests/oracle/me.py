"""Model exchange in plain readable Python, with event handling: what the kernel's me.c and me_event.c do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tests.oracle.completed_step import completed_step
from tests.oracle.forcing import discrete_differ, next_break
from tests.oracle.problem import Problem
from tests.oracle.rows import Rows
from tests.oracle.solvers import SOLVERS, Solver, Tolerance
from tests.oracle.turned import Turned
from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import is_due
from workbench.errors import InputError, SimulationError
from workbench.fmi.variable import Variable
from workbench.session.base import Recorded
from workbench.session.compiled_errors import MAX_STEPS, chattering, too_many_steps, zeno
from workbench.session.forcing import Forcing
from workbench.session.me import MeSession
from workbench.signals.kinds import Signal

__all__ = ["OracleMeSession"]

# The rules of events, as in workbench/build/runtime/event_rules.h.
MOST_CLOSE_EVENTS = 1000  # in a row, each closer to the last than CLOSE_EVENTS of the time scale
CLOSE_EVENTS = 1e-10
STILL = 1e5  # longer gaps are close where nothing moves: at most so many fit into a run
SAME_EVENT = 1e-3  # a gap of less than this part of the one before is none
SHRINKING = 0.99  # two gaps of less than this part of the two before are told from equal ones
DWINDLED = 1e-3  # gaps that shrink are Zeno behaviour from this part of the longest two on ...
DWINDLING_REST = 1e-6  # ... where what they add up to, as a geometric series, is this part of the time scale ...
DROWNING = 0.1  # ... or an indicator takes this part of the gap before to leave its zero ...
DROWNING_REST = 1e-3  # ... and they add up to this part
CAUTION_GROWS = 8.0
AHEAD_MOST = 1e-3  # of the time scale: no rate of an indicator is looked at farther ahead
NO_GAPS = (math.inf,) * 7


@dataclass(frozen=True)
class _Memory:
    """What a restored session needs besides the FMU's state."""

    next_time: float
    scale: Floats
    signals: dict[str, Signal]


class OracleMeSession(MeSession):
    """`MeSession` step by step in Python."""

    _solver: Solver | None = None
    _crowd: int
    _last_event: float
    _cautious: float
    _counted: float
    _gaps: tuple[float, ...]
    _turned: Turned

    # -- start ----------------------------------------------------------------------------

    def _make_solver(self) -> None:
        self._forget_events()
        self._span = 1.0
        self.problem = Problem(self.instance, self.forcing)
        self._turned = Turned(self.problem)
        self._solver = SOLVERS[self.setup.solver](self.problem, Tolerance(self.setup.rtol, *self.scales()))
        self._restart()

    @property
    def solver(self) -> Solver:
        """The solver; its `problem.evaluations` counts right-hand sides."""
        if self._solver is None:
            raise SimulationError("the session is closed")
        return self._solver

    @property
    def _has_discrete(self) -> bool:
        """Whether some forced input may change at events only."""
        return any(not variable.is_continuous_input for variable, _, _ in self.forcing.inputs())

    def _restart(self, x: Floats | None = None) -> None:
        x = self.instance.x.copy() if x is None else x
        self.solver.restart(self.time, x)
        if self.problem.nz:
            self._turned.stand(self.time, x)

    # -- advance --------------------------------------------------------------------------

    def _forcing_changed(self, before: Forcing) -> None:
        super()._forcing_changed(before)
        self.problem.forcing = self.forcing

    def _advance(self, until: float, targets: Floats, variables: Sequence[Variable], *, new: bool) -> Recorded:
        rows = Rows(self.instance, variables, self.forcing)
        with rows.kept():
            self._run(until, targets.tolist(), rows, new=new)
        return rows.record()

    def _run(self, until: float, targets: list[float], rows: Rows, *, new: bool) -> None:
        self._span = max(until - self.time, abs(until), 1e-9)
        self._enter(new=new)
        rows.add(self.time)
        waiting = targets[::-1]
        while self.time < until:
            end = min(until, next_break(self.forcing, self.time))
            self.problem.limit = math.nextafter(end, -math.inf)
            if end == until and next_break(self.forcing, math.nextafter(until, -math.inf)) > until:
                self.problem.limit = math.inf
            stop = end if is_due(end, self._next_time) else self._next_time
            if self._has_discrete:
                stop = min(stop, waiting[-1])
            self._to_stop(stop, waiting, rows)
            if self.time < until and self.time == stop:
                self._at_stop(end, waiting, rows)
        self.problem.limit = math.inf

    def _enter(self, *, new: bool) -> None:
        """Take the right limit at the present time: inputs that jump, an event that is due."""
        wanted = self.forcing.at(self.time)
        if wanted != self.forcing.written or self._next_time <= self.time:
            self._event()
        elif new:
            self._put()
            self._restart()

    def _at_stop(self, end: float, waiting: list[float], rows: Rows) -> None:
        """Handle what the session stopped for before `until`."""
        due = self.time in (end, self._next_time)
        if due or discrete_differ(self.forcing, self.forcing.at(self.time)):
            self._event_rows(rows)
        elif waiting and waiting[-1] == self.time:
            rows.add(self.time)
        _drop(waiting, self.time)

    def _to_stop(self, stop: float, waiting: list[float], rows: Rows) -> None:
        """Step until `stop`, recording points on the way and handling events found on the way."""
        solver, longest = self.solver, self.forcing.longest_step
        if stop - self.time <= 1e-14 * max(abs(stop), abs(self.time)):
            self._hop(stop, waiting, rows)
            return
        steps = 0
        while self.time < stop:
            found = solver.step(stop, min(longest, self._cautious))
            self._cautious *= CAUTION_GROWS
            self._turned.check(solver.t, solver.x)
            steps = 0 if self._record_points(waiting, rows, before=solver.t) else steps + 1
            self._count(steps)
            self.time = solver.t
            self._put()
            if self._completed() or found:
                self._event_rows(rows, located=found)
                _drop(waiting, self.time)
                steps = 0
                if self._next_time < stop:
                    return
        self._record_end(waiting, rows)

    def _hop(self, stop: float, waiting: list[float], rows: Rows) -> None:
        """Cross a gap too small for any solver."""
        self.time = stop
        x = self.solver.x.copy()
        self.instance.x[:] = x
        self._put(x)
        self._restart(x)
        self._record_end(waiting, rows)

    def _record_points(self, waiting: list[float], rows: Rows, *, before: float) -> bool:
        """Record the points inside the last step; FMUs must not be asked about them later."""
        some = False
        while waiting and waiting[-1] < before:
            point = waiting.pop()
            self.problem.put(point, self.solver.interpolate(point))
            rows.add(point)
            some = True
        return some

    def _record_end(self, waiting: list[float], rows: Rows) -> None:
        """Record `until`; other stops are recorded with their event."""
        if len(waiting) == 1 and waiting[0] == self.time:
            rows.add(self.time)
            waiting.pop()

    def _count(self, steps: int) -> None:
        if steps > MAX_STEPS:
            raise too_many_steps(self.setup.solver, self.solver.t)

    def _put(self, x: Floats | None = None) -> None:
        self.problem.put(self.time, self.solver.x if x is None else x)

    def _completed(self) -> bool:
        """Report the accepted step; True if the FMU wants an event."""
        if not self.instance.capabilities.completed_step:
            return False
        event, terminate = completed_step(self.instance)
        if terminate:
            raise self._ended()
        return event

    # -- events ---------------------------------------------------------------------------

    def _event_rows(self, rows: Rows, *, located: bool = False) -> None:
        rows.add(self.time)
        self._event(located=located)
        rows.add(self.time)

    def _event(self, *, located: bool = False) -> None:
        """Handle an event at the present time, `located` at an indicator's zero; the FMU stands at its left limit."""
        self._guard_events(located=located)
        watched = located or self._turned.watches
        if watched:
            self._turned.before(self.time, self.solver.x, self._sizes(), AHEAD_MOST * self._span)
            self._put()
        limit, self.problem.limit = self.problem.limit, math.inf
        self.instance.enter_event_mode()
        if self.forcing.names:
            self.forcing.write_all(self.forcing.at(self.time))
        changed = self._iterate()
        if changed:
            self.instance.get_states()
        else:
            self.instance.x[:] = self.solver.x
        x = self.instance.x.copy()
        if watched:
            self._turned.after(self.time, x, restarted=changed)
            self._cautious = min(self._cautious, self._turned.caution)
        self._restart(x)
        self.problem.limit = limit if limit > self.time else math.inf

    def _sizes(self) -> Floats:
        return np.abs(self.solver.x) + self.solver.tolerance.scale

    def _iterate(self) -> bool:
        """Iterate in event mode and go to continuous time; True if the states jumped."""
        info = self.instance.iterate_events()
        if info.terminate:
            raise self._ended()
        self._next_time = info.next_time
        self.instance.enter_continuous_mode()
        return info.states_changed

    def _guard_events(self, *, located: bool) -> None:
        """Refuse to go on when events follow each other without end."""
        gap = self.time - self._last_event
        close = gap <= CLOSE_EVENTS * self._span * (STILL if located and self._stands_still() else 1.0)
        if self.problem.nz:
            # The next event may follow as quickly as this one did: a long first step would jump over it.
            self._cautious = max(0.25 * gap, 64.0 * math.ulp(self.time))
        self._crowd = self._crowd + 1 if close else 0
        self._last_event = self.time
        if self._crowd > MOST_CLOSE_EVENTS:
            raise chattering(self.time)
        if located:
            self._guard_dwindling()

    def _stands_still(self) -> bool:
        """Whether the last event turned some state back, and none moved since but within a hysteresis."""
        return self.solver.tolerance.stands_still() and self._turned.turned_a_state

    def _guard_dwindling(self) -> None:
        """Refuse to go on where the gaps between state events shrink so that infinitely many of them end right here.

        Told before the events drown in rounding, or in the width of the indicators' zeros: from then on the next one is
        missed, and a ball falls through. The end is that of the event before, which such a width does not touch.
        """
        gap = self.time - self._counted
        if gap < SAME_EVENT * self._gaps[0] < math.inf:
            return  # the indicator leaves its zero again
        self._counted = self.time
        self._gaps = (gap, *self._gaps[:-1])
        pair, ratio = sum(self._gaps[:2]), _shrinkage(self._gaps)
        self.solver.tolerance.new_flight(measured=pair < SHRINKING * sum(self._gaps[2:4]) < math.inf)
        if ratio >= 1.0:
            self._longest_pair, self._gathering = max(p for p in (0.0, *_pairs(self._gaps)) if p < math.inf), math.inf
            return
        rest = pair * ratio / (1.0 - ratio)
        known = self._gathering < math.inf
        drowning = known and gap < DROWNING * self._gaps[1] and rest <= DROWNING_REST * self._span
        end, self._gathering = self._gathering if known else self.time + rest, self.time + rest
        if pair <= DWINDLED * self._longest_pair and (drowning or rest <= DWINDLING_REST * self._span):
            raise zeno(end)

    # -- snapshots ------------------------------------------------------------------------

    def _memory(self) -> object:
        return _Memory(self._next_time, self.solver.tolerance.scale.copy(), dict(self.forcing.signals))

    def _resume(self, memory: object) -> None:
        if not isinstance(memory, _Memory):
            raise InputError("this snapshot belongs to another kind of session")
        self._next_time = memory.next_time
        self.solver.tolerance.scale[:] = memory.scale
        self.problem.forcing = self.forcing
        self.instance.get_states()
        self._forget()

    def _forget(self) -> None:
        self._forget_events()
        self._turned.forget()
        self.solver.tolerance.new_flight(measured=False)
        self._restart()

    def _forget_events(self) -> None:
        self._crowd, self._last_event, self._cautious = 0, -math.inf, math.inf
        self._counted, self._gaps = -math.inf, NO_GAPS
        self._longest_pair = self._gathering = math.inf

    def _close_solver(self) -> None:
        if self._solver is not None:
            self._solver.close()
            self._solver = None


def _shrinkage(gaps: Sequence[float]) -> float:
    """Return the largest ratio of two gaps to the two before, of the last few; 1 or more: they do not shrink.

    Two, because a ball may also have an event at the top of its flight.
    """
    pairs = _pairs(gaps)
    return max(a / b if 0.0 < b < math.inf else math.inf for a, b in zip(pairs, pairs[2:], strict=False))


def _pairs(gaps: Sequence[float]) -> list[float]:
    return [a + b for a, b in pairwise(gaps)]


def _drop(waiting: list[float], time: float) -> None:
    """Forget the points up to `time`: they have their rows."""
    while waiting and waiting[-1] <= time:
        waiting.pop()
