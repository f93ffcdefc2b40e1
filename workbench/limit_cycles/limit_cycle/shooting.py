"""Shooting: the periodic motion of the simulated system itself, and its Floquet multipliers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError, SimulationError
from workbench.limit_cycles.limit_cycle.branch import Bifurcation, Branch, BranchPoint
from workbench.limit_cycles.limit_cycle.request import SHOOTING
from workbench.limit_cycles.limit_cycle.result import LimitCycle
from workbench.model.described_model import DescribedModel
from workbench.response.periodic.continuation import ContinuedBranch, Manner, both_ways
from workbench.response.periodic.fourier import fundamental
from workbench.response.periodic.monodromy import VariationalEquation
from workbench.response.periodic.period_map import NUDGE, Lap, PeriodMap, differences
from workbench.response.periodic.place import Family, Place, arrive
from workbench.response.periodic.stability import is_stable, largest
from workbench.response.simulate.zero_crossings import half_range, told_mean
from workbench.session.compiled import CompiledMeSession

__all__ = ["Orbits", "follow_orbits", "shoot"]

_TOLERANCE = 1e-10
_MOST_STATES = 200
_SAMPLES = 1000
_DOUBT = 1e-3  # by which the flow may fail to be mapped onto itself where the slopes along the orbit are believed


def shoot(
    model: DescribedModel,
    *,
    states: Mapping[str, float],
    sizes: Mapping[str, float],
    frequency: float,
    inputs: Mapping[str, float],
    watch: Sequence[str],
    time: float,
) -> LimitCycle | str:
    """Return the closed orbit near a predicted state; in words why there is none.

    Newton's method on φ(x, T) = x, the step kept orthogonal to the flow; the Jacobian by the slopes along the orbit, or
    by differences of whole periods where jumps of the flow make the slopes fail. It finds unstable orbits as well.

    Args:
        model: continuous model exchange.
        states: predicted.
        sizes: how far each state moves in a period.
        frequency: predicted [Hz].
        inputs: held values.
        watch: variables that are measured over the orbit, the block's input first.
        time: session time at which the period begins [s].

    Source: Seydel, Practical Bifurcation and Stability Analysis, 7.3.
    """
    if len(states) > _MOST_STATES:
        return f"{len(states)} states are too many for shooting"
    orbits = Orbits(lambda _: model, tuple(states), sizes, inputs, watch[0], time)
    try:
        return orbits.orbit(orbits.arrive(states, frequency), further=watch[1:])
    except (SimulationError, InputError) as error:
        return str(error)


@dataclass
class Orbits(Family):
    """Closed orbits over a parameter, fixed points of the map (x, ln T) → (φ(x, T), ln T + phase condition).

    The phase condition keeps x on a plane across the orbit. Every period is run in a session of its own, so that
    connections that close later stay open.

    Attributes:
        open: parameter → the model there.
        names: of the states.
        sizes: how far each moves in a period.
        inputs: held values.
        watch: variable that is measured.
        time: session time at which each period begins [s].
        varied: whether the parameter is.
    """

    open: Callable[[float], DescribedModel]
    names: tuple[str, ...]
    sizes: Mapping[str, float]
    inputs: Mapping[str, float]
    watch: str
    time: float
    varied: bool = False
    _anchor: tuple[Floats, Floats] | None = None
    _first: float | None = None
    _start: Floats | None = None
    _size: float = 0.0
    _begun: float = 0.0

    coarse: ClassVar[int] = 20
    fine: ClassVar[int] = 200

    def arrive(self, states: Mapping[str, float], frequency: float, p: float = 0.0) -> Place:
        """Return the orbit near a predicted one.

        Raises:
            SimulationError: there is none.
        """
        start = np.append([states[n] for n in self.names], -np.log(frequency))
        try:
            place = arrive(self, start, p, exact=True)
            if place.at.doubt <= _DOUBT:
                return place
        except SimulationError:
            place = None
        self.by_differences, self._anchor = True, None
        return arrive(self, start if place is None else place.x, p, exact=True)

    def moved_on(self, place: Place) -> str:
        """Take the plane across the orbit at the newest place from now on; the branch ends at a point, or far out."""
        self._anchor = None
        size = abs(fundamental(place.lap.period.harmonics))
        if self._start is None:
            self._start, self._begun = place.x, size
        self._size = size if place.x is self._start else max(self._size, size)  # the walk the other way begins anew
        if size > _BEYOND * self._begun:
            return f"the cycle grows beyond {_BEYOND:.0f} times the first one"
        return VANISHES if size < _VANISHED * self._size else ""

    def lap(self, x: Floats, p: float, *, exact: bool = False) -> tuple[Lap, Floats]:
        """Run one period; see `Family`."""
        if self._first is None:
            self._first = float(x[-1])
        if x[-1] - self._first > _LONGER:
            raise SimulationError(f"the period grows beyond {np.exp(_LONGER):.0f} times that of the first cycle")
        lap = self._run(x, p, self.fine if exact else self.intervals)
        if not self.varied:
            return lap, np.zeros(len(x))
        moved = self._run(x, p + NUDGE, 0)
        return lap, (moved.x1 - lap.x1) / NUDGE

    def _run(self, z: Floats, p: float, intervals: int) -> Lap:
        """Run one period of the extended map, with its derivative if that takes intervals."""
        x, period = z[:-1], float(np.exp(z[-1]))
        model = self.open(p)
        lap = self._period(model, x, period, intervals)
        if intervals and lap.tangent is None:  # between contact and play of a stiff block a coarse rule overflows
            self.intervals = self.fine
            lap = self._period(model, x, period, self.fine)
        unit = np.append(lap.unit, 1.0)
        if self._anchor is None:
            away = (lap.flow if lap.flow is not None else lap.defect) / lap.unit
            self._anchor = x.copy(), away / max(float(np.linalg.norm(away)), 1e-300) / lap.unit
        start, across = self._anchor
        phase = float(across @ (x - start))
        whole = replace(lap, x0=z, x1=np.append(lap.x1, z[-1] - phase), unit=unit)
        if not intervals:
            return whole
        if lap.flow is None or lap.tangent is None:
            raise SimulationError("the model cannot be linearised along its motion")
        at, flow = lap.tangent, lap.flow
        if self.by_differences:
            at = differences(lap, lambda x: self._period(model, x, period, 0), _APART)
        Phi, rows = at.Phi, at.rows
        others, doubt = _across(Phi * lap.unit / lap.unit[:, None], flow / lap.unit)
        extended = np.block([[Phi, (flow * period)[:, None]], [-across[None, :], np.ones((1, 1))]])
        n = len(x)
        tangent = VariationalEquation(
            extended, np.column_stack([rows, np.zeros(3)]), np.zeros(n + 1), others=others, off=doubt
        )
        return replace(whole, tangent=tangent)

    def _period(self, model: DescribedModel, x: Floats, period: float, intervals: int) -> Lap:
        with self._session(model, x) as session:
            lap = PeriodMap(session, self.watch, derived=False).lap(1.0 / period, intervals=intervals)
        order = self._order(model)
        sizes = np.array([self.sizes[n] for n in self.names])
        least = np.maximum(sizes, 1e-9 * max(float(sizes.max(initial=0.0)), 1e-300))
        unit = least if lap.tangent is None else np.maximum(lap.unit[order], _SMALLEST * least)
        tangent = lap.tangent
        if tangent is not None:
            Phi = tangent.Phi[np.ix_(order, order)]
            tangent = replace(tangent, Phi=Phi, rows=tangent.rows[:, order], stretch=tangent.stretch[order])
        flow = None if lap.flow is None else lap.flow[order]
        return replace(lap, x0=x, x1=lap.x1[order], unit=unit, tangent=tangent, flow=flow)

    def _session(self, model: DescribedModel, x: Floats) -> CompiledMeSession:
        values = {**self.inputs, **dict(zip(self.names, x.tolist(), strict=True))}
        session = model.open_at(time=self.time, values=values, tolerance=_TOLERANCE)
        if not isinstance(session, CompiledMeSession):
            session.close()
            raise InputError("shooting needs model exchange")
        return session

    def _order(self, model: DescribedModel) -> list[int]:
        place = {v.name: i for i, v in enumerate(model.states)}
        return [place[n] for n in self.names]

    def orbit(self, place: Place, p: float = 0.0, *, further: Sequence[str] = ()) -> LimitCycle:
        """Return what a place is, measured along it, `further` variables, too."""
        names = [self.watch, *further]
        x, period = place.x[:-1], float(np.exp(place.x[-1]))
        points = self.time + period * np.arange(1, _SAMPLES + 1) / _SAMPLES
        with self._session(self.open(p), x) as session:
            record = session.advance(float(points[-1]), signals={}, record=names, points=points)
        values = record.right_limits(points).values
        v = values[self.watch]
        residual = float(np.max(np.abs(place.lap.defect[:-1] / place.lap.unit[:-1])))
        return LimitCycle(
            method=SHOOTING,
            crossing=None,
            frequency_hz=1.0 / period,
            states=dict(zip(self.names, x.tolist(), strict=True)),
            stable=is_stable(place.multipliers, doubt=place.at.doubt),
            multiplier=largest(place.multipliers),
            mean=told_mean(float(np.mean(v)), amplitude=half_range(v), residual=residual),
            amplitude=half_range(v),
            amplitudes={n: half_range(values[n]) for n in names},
            fundamental=float(2.0 * np.abs(np.fft.rfft(v)[1]) / len(v)),
            residual=residual,
        )


_SMALLEST = 1e-5  # of the first cycle's motion: what a state of one that vanishes is measured by
_APART = 1e-5  # of the motion of each state, for differences


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
    result = np.linalg.eigvals(across.T @ jacobian @ across).astype(np.complex128)
    return result[np.argsort(-np.abs(result))], float(np.linalg.norm(jacobian @ along - along))


def follow_orbits(
    orbits: Orbits,
    first: Place,
    *,
    parameter: str,
    limits: tuple[float, float],
    manner: Manner,
    begun: Callable[[Callable[[], Branch]], None],
    noted: Callable[[str], None],
) -> Branch:
    """Return the orbits over a parameter through one of them, around folds.

    Args:
        orbits: over p in 0 … 1, between the limits.
        first: one of them.
        parameter: its name.
        limits: lowest and highest value.
        manner: how to follow them.
        begun: is given what returns the branch as far as it goes.
        noted: is told what could not be located.
    """
    measured: dict[bytes, BranchPoint] = {}

    def value(p: float) -> float:
        return limits[0] + (limits[1] - limits[0]) * p

    def point(place: Place) -> BranchPoint:
        key = np.append(place.x, place.p).tobytes()  # a place that is turned is another object
        if key not in measured:
            p = min(max(place.p, 0.0), 1.0)
            cycle = orbits.orbit(place, p)
            names = ("frequency_hz", "amplitude", "fundamental", "mean", "stable")
            measured[key] = BranchPoint(value=value(p), **{n: getattr(cycle, n) for n in names})
        return measured[key]

    def turning(place: Place) -> BranchPoint:
        return replace(point(place), stable=None)

    begin = point(first)

    def branch(track: ContinuedBranch) -> Branch:
        points, special = tuple(map(point, track.places)), [(s.kind, turning(s.place)) for s in track.special]
        outwards = [points[::step] for why, step in zip(track.ends, (1, -1), strict=True) if why == VANISHES]
        return Branch(
            parameter=parameter,
            points=points,
            folds=tuple(p for kind, p in special if kind == "fold"),
            bifurcations=tuple(Bifurcation(**vars(p), kind=kind) for kind, p in special if kind != "fold"),
            hopf=tuple(h for way in outwards for h in _vanished(way)),
            ends=track.ends,
            start=begin,
        )

    manner = replace(manner, most=_MOST_ORBITS, begun=lambda so_far: begun(lambda: branch(so_far())))
    track = both_ways(orbits, first, manner)
    for missed in track.missed:
        low, high = map(value, sorted(missed.p))
        noted(f"{parameter}: a {missed.kind} between the places at {low:.6g} and {high:.6g} could not be located")
    return branch(track)


def _vanished(points: Sequence[BranchPoint]) -> Iterator[BranchPoint]:
    """Yield the Hopf point beyond the end of a branch, if it has points enough to tell it from.

    Near it all changes with even powers of the amplitude a, or, where the nonlinearity has a kink, with a itself.

    Args:
        points: of the branch, the smallest cycle first.
    """
    sizes = [points[0].fundamental * factor for factor in _GROWN]
    result = [next((p for p in points if p.fundamental >= size), None) for size in sizes]
    chosen = [p for p in result if p is not None]
    if len(chosen) < len(_GROWN):
        return
    a = np.array([p.fundamental for p in chosen]) / chosen[-1].fundamental
    powers = np.column_stack([np.ones_like(a), a, a**2, a**4])
    known = [(p.value, p.frequency_hz, p.mean) for p in chosen]
    value, frequency, mean = np.linalg.solve(powers, known)[0].tolist()
    yield BranchPoint(value=value, frequency_hz=frequency, amplitude=0.0, fundamental=0.0, mean=mean)


_GROWN = 1.0, 1.3, 1.7, 2.2  # times the smallest cycle
_MOST_ORBITS = 200
_VANISHED = 0.01  # of the largest cycle of a branch: nothing is left of it
_BEYOND = 1000.0  # times the first cycle: beside a value at which the linear loop loses its stability there is no end
VANISHES = "the cycle shrinks to a point"
_LONGER = np.log(8.0)  # a branch on which the period grows so much ends there
