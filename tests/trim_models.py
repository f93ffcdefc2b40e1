"""Models written as equations, with closed-form equilibria: what the trim is tested on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import Sampler, exact
from workbench.errors import EndedError, InputError, SimulationError
from workbench.fmi.variable import Variable
from workbench.model import Model
from workbench.model.base import DeclaredRates
from workbench.session import Recorded, Session, Snapshot
from workbench.session.point import Evaluation, ModelPoint
from workbench.session.start_values import NotReachedError
from workbench.signals.kinds import Signal

Values = dict[str, float]
Function = Callable[[Values], Sequence[float]]


def nothing(_: Values) -> Sequence[float]:
    return ()


@dataclass
class Equations:
    """dx/dt = f, y = g, and every `period` memory = tick; each a function of all values by name.

    `takes` says which start values a session takes; it ends its run at `ends`.
    """

    x: Values = field(default_factory=dict)
    u: Values = field(default_factory=dict)
    memory: Values = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    f: Function = nothing
    g: Function = nothing
    tick: Function = nothing
    period: float | None = None
    nominal: Values = field(default_factory=dict)
    jacobian: Callable[[Floats, Floats], Floats] | None = None
    settable: bool = True
    whole: tuple[str, ...] = ()
    domain: Callable[[Values], bool] = lambda _: True
    takes: Callable[[Values], bool] = lambda _: True
    ends: float = np.inf

    def rates(self, values: Values) -> Floats:
        if not self.domain(values):
            raise SimulationError("outside the domain")
        try:
            return np.array(self.f(values), dtype=float)
        except OverflowError:
            raise SimulationError("overflow") from None


class Plant(Model):
    """A model of `Equations`."""

    def __init__(self, equations: Equations, *, interface: str = "me", step: float = 1e-3) -> None:
        e = self.equations = equations
        self.step = step
        self.name, self.interface, self.solver, self.notes = "Plant", interface, "none", ()
        self.inputs = tuple(self._variable(n, "input", e.u[n], "Integer" if n in e.whole else "Real") for n in e.u)
        self.outputs = tuple(self._variable(n, "output", None) for n in e.outputs)
        self.parameters = ()
        self.states = tuple(self._variable(n, "local", e.x[n] if e.settable else None) for n in e.x)
        self.held = tuple(self._variable(n, "local", e.memory[n]) for n in e.memory)
        self.runs: list[float | None] = []

    def _variable(self, name: str, causality: str, start: float | None, kind: str = "Real") -> Variable:
        nominal = self.equations.nominal.get(name)
        return Variable(name=name, type=kind, causality=causality, start=start, nominal=nominal, unit="m")

    def starts(self, values: Mapping[str, float] | None) -> Values:
        e = self.equations
        given = {n: v for n, v in (values or {}).items() if e.settable or n not in e.x}
        return {**e.x, **e.u, **e.memory, **given}

    def open_session(
        self, *, start_time: float | None = None, step: float | None = None, signals: Mapping[str, Signal] | None = None
    ) -> Session:
        return self.open_at(time=start_time, step=step)

    def open_at(
        self,
        *,
        time: float | None = None,
        values: Mapping[str, float] | None = None,
        outputs: Mapping[str, float] | None = None,
        step: float | None = None,
        tolerance: float | None = None,
        approach: bool = True,
    ) -> Session:
        self.runs.append(step)
        starts = self.starts(values)
        if not self.equations.takes(starts):
            raise NotReachedError(f"{self.name}: cannot be started at {starts}")
        return PlantSession(self, starts, time or 0.0, step)

    def open_point(self, *, time: float | None = None, values: Mapping[str, float] | None = None) -> ModelPoint:
        if self.interface != "me":
            raise InputError("no point")
        return PlantPoint(self, self.starts(values), time or 0.0)

    def declared_rates(self) -> DeclaredRates:
        period = self.equations.period
        return DeclaredRates() if period is None else DeclaredRates((Sampler(exact(period)),))

    def close(self) -> None:
        return


class PlantSession(Session):
    """Explicit Euler at `step` (co-simulation), else in small steps; ticks at whole multiples of the period."""

    def __init__(self, plant: Plant, values: Values, time: float, step: float | None) -> None:
        self.plant, self.now, self.time = plant, dict(values), time
        self.step = step if step is not None and plant.interface == "cs" else plant.step
        self.count = 0

    def advance(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str] = (),
        points: Floats | None = None,
    ) -> Recorded:
        assert not signals
        rows = []
        for end in [until] if points is None else points.tolist():
            self._to(end)
            rows.append(list(self.values(record).values()))
        table = np.array(rows).T
        times = np.array([until]) if points is None else points
        return Recorded(times, dict(zip(record, table, strict=True)), {})

    def _to(self, end: float) -> None:
        e = self.plant.equations
        period = e.period or np.inf
        while self.time < end - 1e-9:
            if self.time >= self.count * period - 1e-9:
                self.now.update(zip(e.memory, e.tick(self.now), strict=True))
                self.count += 1
            stop = min(end, self.count * period) if e.period else end
            if stop > e.ends:
                raise EndedError("the FMU ended its run", time=e.ends)
            for _ in range(max(1, round((stop - self.time) / self.step)) if e.x else 0):
                dx = e.rates(self.now)
                for name, slope in zip(e.x, dx.tolist(), strict=True):
                    self.now[name] += self.step * slope
            self.time = stop

    def values(self, names: Sequence[str]) -> Values:
        e = self.plant.equations
        every = {**self.now, **dict(zip(e.outputs, e.g(self.now), strict=True))}
        if not all(abs(v) < 1e150 for v in every.values()):
            raise SimulationError("runs away", time=self.time)
        return {n: float(every[n]) for n in names}

    def snapshot(self) -> Snapshot:
        raise AssertionError("no trim needs one")

    def restore(self, snapshot: Snapshot) -> None:
        raise AssertionError("no trim needs one")

    def close(self) -> None:
        return


class PlantPoint(ModelPoint):
    def __init__(self, plant: Plant, values: Values, time: float) -> None:
        self.plant, self.values, self.time = plant, values, time
        e = plant.equations
        self.states, self.inputs, self.outputs, self.memory = plant.states, plant.inputs, plant.outputs, plant.held
        self.x0, self.u0 = np.array([values[n] for n in e.x]), np.array([values[n] for n in e.u])
        self.nominal = np.array([e.nominal.get(n, 1.0) for n in e.x])
        self.smallest = 1e-3 * self.nominal
        self.calls = Counter()

    def move(self, x: Floats, u: Floats) -> None:
        self.x0, self.u0 = x.copy(), u.copy()

    def at(self, x: Floats, u: Floats) -> Evaluation:
        self.calls["derivatives"] += 1
        e = self.plant.equations
        now = {**self.values, **dict(zip(e.x, x.tolist(), strict=True)), **dict(zip(e.u, u.tolist(), strict=True))}
        return Evaluation(e.rates(now), np.array(e.g(now), dtype=float))

    def ticks(self, most: int, until: float) -> Floats:
        period = self.plant.equations.period
        return np.array([i * period for i in range(1, most + 1)] if period else [])

    def discrete(self) -> Values:
        return {n: self.values[n] for n in self.plant.equations.memory}

    def jacobian(self) -> Floats:
        assert self.plant.equations.jacobian is not None
        self.calls["directional"] += 1
        return self.plant.equations.jacobian(self.x0, self.u0)

    def why_not_exact(self) -> str:
        return "" if self.plant.equations.jacobian else "none offered"

    def close(self) -> None:
        return
