"""After how many periods the map that a model makes of itself repeats: rates that its events do not show.

Two samplers at 0.1 and 0.2 s ask for events every 0.1 s, and so does a counter that lets every third one pass. What
tells them apart is what the events do. The same random sequence of perturbations of states and inputs, one a period, is
played from the start, and once more m periods later. If the map repeats after m periods, the deviations from the
unperturbed run are the same, m periods later; nothing need be known of states that the model does not show. All runs
begin at the start, so that hidden counters stand as they do there.

Variables that are held give a lower bound at once: one that moves at every third period belongs to a rate three times
slower.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.model import Model
from workbench.session.base import Session
from workbench.session.compiled import CompiledMeSession
from workbench.session.start_values import NotReachedError
from workbench.signals.kinds import Constant, Signal, Table

__all__ = ["BEFORE", "Repetition", "repetition"]

BEFORE = 1e-9  # of the period: how long before the next sample a run ends, whatever rounding does to its time
_EVENTS = 400  # that a run may have: it is so long that rates of one to a hundred show
_MOST = 32  # multiples of the least number of periods that are tried
_SHORTEST = 8  # periods of a run at least
_WIDTH = 1e-3  # of a variable's size: models are linear within it, and errors of the integration small beside it
_TOLERANCE = 1e-9  # of the integration
_ALIKE = 1e-3  # of the largest deviation: two runs' deviations are the same; twice that of widths and tolerances
_SPREAD = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144, 233)  # periods after which states are moved too, where inputs are
_UNDECLARED = 1e-2  # size of a variable that declares none


@dataclass(frozen=True)
class Repetition:
    """When a model repeats.

    Attributes:
        count: of periods; None: within reason it was not seen to repeat.
        late: the first period is another one: what ticks in all others does not tick at its begin.
        periods: how many were looked at.
    """

    count: int | None = 1
    late: bool = False
    periods: int = 0


def repetition(
    model: Model, start: float, period: float, values: Mapping[str, float] | None, *, events: int = 1
) -> Repetition:
    """Return after how many periods a model repeats.

    Args:
        model: of model exchange; it stays open.
        start: where the runs begin, just before a sample [s].
        period: [s].
        values: of states, discrete states and inputs there, where they are not the model's own.
        events: in a period.

    Raises:
        SimulationError: the model cannot be run.
    """
    length = int(np.clip(_EVENTS // max(events, 1), _SHORTEST, _EVENTS))
    runs = _Runs(model, start, period, dict(values or {}), length)
    least = runs.least
    if least == 1 and runs.alike(0, 1):
        return Repetition(1, periods=length)
    half = length // 2
    for count in range(least, min(half, _MOST * least) + 1, least):
        if runs.alike(1, 1 + count):
            return Repetition(count, late=not runs.alike(0, count), periods=length)
        if count == least and runs.alike(half, half + least):  # a motion on the way has come to rest
            return Repetition(least, periods=length)
    return Repetition(None, periods=length)


@dataclass(eq=False)
class _Runs:
    """Runs of a model from its start.

    Attributes:
        model, start, period, values: see `repetition`.
        length: periods of a run.
    """

    model: Model
    start: float
    period: float
    values: dict[str, float]
    length: int

    def __post_init__(self) -> None:
        with self.model.open_point(time=self.start, values=self.values) as point:
            self._x0, self._u0 = point.x0, point.u0
            self._inputs = [v for v in point.inputs if v.type in FLOAT_TYPES]
            u = dict(zip((v.name for v in point.inputs), point.u0.tolist(), strict=True))
            self._memory, known = point.memory, point.discrete()
            self._held = list(known)
            # States of FMI 1.0 may be no variables: they are moved, but neither set nor shown.
            shown = {v.name for v in self.model.states}
            named = [v.name for v in point.states if v.name in shown]
            self._names = list(dict.fromkeys([*named, *(v.name for v in point.outputs), *known]))
            self._dx = _widths(point.states, point.x0)
            self._du = _widths(self._inputs, np.array([u[v.name] for v in self._inputs]))
            self._states = [v.name if v.name in shown else "" for v in point.states]
        self._rest = {v.name: u[v.name] for v in self._inputs}
        random = np.random.default_rng(1)
        most = 2 * self.length + 2
        self._moves = [(random.uniform(-1.0, 1.0, len(self._dx)), random.uniform(-1.0, 1.0, len(self._du)))
                       for _ in range(most)]  # fmt: skip
        self._kept: dict[int | None, Floats] = {}

    def alike(self, a: int, b: int) -> bool:
        """Whether the sequence played from period `a` on does the same as from period `b` on."""
        count = self.length - max(a, b)
        one, other = (self._played(k)[k : k + count] - self._played(None)[k : k + count] for k in (a, b))
        sizes = np.maximum(np.abs(one), np.abs(other)).max(axis=0)
        return bool((np.abs(one - other) <= _ALIKE * sizes + 1e-12 * self._sizes).all())

    @cached_property
    def _sizes(self) -> Floats:
        result: Floats = np.abs(self._played(None)).max(axis=0)
        return result

    @property
    def least(self) -> int:
        """Least common multiple of the numbers of periods after which held variables move."""
        rows = self._run(0, memory=True) - self._played(None)
        columns = [self._names.index(n) for n in self._held]
        moved = np.diff(rows[:, columns], axis=0) != 0.0
        result = 1
        for column in moved.T:
            at = np.flatnonzero(column)
            if len(at) > 2:  # two say nothing of a rate
                result = math.lcm(result, int(np.gcd.reduce(np.diff(at))))
        return result if result <= self.length // 2 else 1

    def _played(self, first: int | None) -> Floats:
        if first not in self._kept:
            self._kept[first] = self._run(first)
        return self._kept[first]

    def _run(self, first: int | None, *, memory: bool = False) -> Floats:
        """Return what the model shows at the end of each period, shape (length, k)."""
        values = {**self._rest, **self.values}
        if first == 0:
            dx, du = self._moves[0]
            values |= {n: x for n, x in zip(self._states, (self._x0 + dx * self._dx).tolist(), strict=True) if n}
            values |= self._forced(du)
        if memory:
            random = np.random.default_rng(2)
            old = [values.get(v.name, float(v.start or 0.0)) for v in self._memory]
            moves = random.choice([-1.0, 1.0], len(old)) * _widths(self._memory, np.array(old))
            values |= {v.name: x for v, x in zip(self._memory, np.array(old) + moves, strict=True)}
        rows = []
        with self.model.open_at(time=self.start, values=values, tolerance=_TOLERANCE) as session:
            signals = self._signals(first)
            for begin, end in pairwise(self._stops(first)):
                points = self._ends[begin:end]
                result = session.advance(float(points[-1]), signals=signals, record=self._names, points=points)
                rows.append(np.column_stack(list(result.values.values()))[np.searchsorted(result.time, points)])
                if first is not None and first <= end < self.length:
                    self._jump(session, self._moves[end - first][0])
        return np.concatenate(rows)

    @cached_property
    def _ends(self) -> Floats:
        """Ends of the periods, just before their last sample, shape (length,) [s]."""
        result: Floats = self.start + (np.arange(1.0, self.length + 1.0) - BEFORE) * self.period
        return result

    def _stops(self, first: int | None) -> list[int]:
        """Return the numbers of periods after which a run is stopped, so that states can be moved."""
        if first is None or not self._states:
            return [0, self.length]
        each = range(1, self.length) if not self._inputs else _SPREAD
        return [0, *(stop for k in [0, *each] if 0 < (stop := first + k) < self.length), self.length]

    def _signals(self, first: int | None) -> dict[str, Signal]:
        """Return the inputs: as they are at the point, and moved in each period from the first one on."""
        if first is None:
            return {n: Constant(u) for n, u in self._rest.items()}
        times = [self.start - self.period, *self._ends[max(first - 1, 0) :].tolist()]
        begins = 0 if first else 1
        rows = [self._rest, *(self._forced(self._moves[k + begins][1]) for k in range(len(times) - 1))]
        if first == 0:
            rows[0] = self._forced(self._moves[0][1])
        return {n: Table(times, [row[n] for row in rows], interpolate="hold") for n in self._rest}

    def _forced(self, du: Floats) -> dict[str, float]:
        moved = np.array(list(self._rest.values())) + du * self._du
        return dict(zip(self._rest, moved.tolist(), strict=True))

    def _jump(self, session: Session, dx: Floats) -> None:
        """Move the continuous states where they let themselves be moved."""
        if not isinstance(session, CompiledMeSession) or not len(dx):
            return
        try:
            session.jump(session.stand() + dx * self._dx)
        except NotReachedError:
            return


def _widths(variables: Sequence[Variable], values: Floats) -> Floats:
    nominal = np.array([v.nominal or _UNDECLARED for v in variables], dtype=np.float64)
    result: Floats = _WIDTH * np.maximum(np.abs(values), nominal)
    return result
