"""What a master costs: which connections carry a delay, the phase lost, the error at this communication step.

A value that is held over a step of length h is h/2 late on average, which turns a sine of frequency f by 360·f·h/2
[deg]. Source: G. Franklin, J. Powell, M. Workman, Digital Control of Dynamic Systems, 3rd ed., section 6.3.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.operating_point import OperatingPoint
from workbench.errors import InputError, WorkbenchError
from workbench.model.placing import standing
from workbench.origin import Reportable
from workbench.signals import Signal
from workbench.system.master.crossover import crossover
from workbench.system.master.instance import MasterInstance
from workbench.system.master.richardson import Halving, halving
from workbench.system.master.units import Units, moves

if TYPE_CHECKING:
    from workbench.system.master.model import MasterModel

__all__ = ["ConnectionDelay", "DelayReport", "LoopDelay", "delay_report"]

_STEPS = 500  # where nothing says how long to run
_MOST_POINTS = 500
_MOST_LOOPS = 20
_SMALL = 0.01  # of the span: errors below that are called small


@dataclass(frozen=True)
class ConnectionDelay:
    """One connection between components that are stepped by themselves.

    Attributes:
        connection: "component.output → component.input".
        how: what the destination sees over a step.
        mean_s: how late the value is on average [s]; negative: early.
        longest_s: how old it gets [s].
        phase_lost_deg: at the report's frequency [deg]; None without one.
    """

    connection: str
    how: str
    mean_s: float
    longest_s: float
    phase_lost_deg: float | None


@dataclass(frozen=True)
class LoopDelay:
    """One loop through several components.

    Attributes:
        components: in the direction of the signals.
        mean_s: once around [s].
        crossover_hz: where the gain of the loop, opened at one connection, falls through 1 [Hz]; None: not known.
        phase_lost_deg: at the report's frequency, else at the crossover [deg]; None if neither is known.
    """

    components: tuple[str, ...]
    mean_s: float
    crossover_hz: float | None
    phase_lost_deg: float | None


@dataclass(frozen=True)
class DelayReport(Reportable):
    """What the master costs at this communication step.

    Attributes:
        system: its name.
        order: "gauss-seidel" or "jacobi".
        stages: the units in the order in which they are stepped; those of one stage side by side.
        step: communication step [s].
        fixed: why the step is not controlled; empty if it is, in runs without a given step.
        periods: sampled components → [s] (the longest time between two instants).
        frequency: for which phases are given [Hz]; None: each loop's crossover.
        connections: all that lead from one unit to another.
        loops: through several units.
        outputs: how they change when the step is halved, and their estimated error.
        stop: length of the runs [s].
        operating_point: where they start; None: not known.
    """

    system: str
    order: str
    stages: tuple[tuple[str, ...], ...]
    step: float
    fixed: str
    periods: Mapping[str, float]
    frequency: float | None
    connections: tuple[ConnectionDelay, ...]
    loops: tuple[LoopDelay, ...]
    outputs: tuple[Halving, ...]
    stop: float
    operating_point: OperatingPoint | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, ready for JSON."""
        return asdict(self)

    def lines(self) -> tuple[str, ...]:
        """Return the report in plain words, one statement a line."""
        return (
            self._head(),
            *(
                f"{name} is sampled, at most {1e3 * p:.6g} ms apart; it is stepped then"
                for name, p in self.periods.items()
            ),
            *(_connection_words(c, self.frequency) for c in self.connections),
            *(_loop_words(loop, self.frequency) for loop in self.loops),
            *(_output_words(o, self.step) for o in self.outputs),
            *self._conclusion(),
        )

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _head(self) -> str:
        order = " → ".join(" | ".join(stage) for stage in self.stages)
        control = f"fixed: {self.fixed}" if self.fixed else "controlled in runs without a given step"
        return f"{self.system}: {self.order}, {order}; communication step {1e3 * self.step:.6g} ms ({control})"

    def _conclusion(self) -> list[str]:
        found = []
        late = [c for c in self.connections if c.mean_s != 0.0]
        orders = [o.order for o in self.outputs if o.order is not None]
        if not late and orders and min(orders) < 1.5:
            found.append(
                "no connection is late on average, and still the error falls only as the step does: an FMU makes one "
                "simple step of its own (explicit Euler) in each communication step, or ignores its inputs' slopes"
            )
        worst = max(self.outputs, key=lambda o: o.error / o.span if o.span else 0.0, default=None)
        if worst is not None and worst.error > _SMALL * worst.span:
            found.append(f"the error of {worst.name} is more than {100 * _SMALL:g} % of its range: use a shorter step")
        return found


def _connection_words(c: ConnectionDelay, frequency: float | None) -> str:
    if c.mean_s == 0.0:
        return f"{c.connection}: {c.how}: no delay on average"
    side = "late" if c.mean_s > 0.0 else "early"
    phase = "" if c.phase_lost_deg is None else f", {c.phase_lost_deg:+.3g}° lost at {frequency:g} Hz"
    return f"{c.connection}: {c.how}: {1e3 * abs(c.mean_s):.4g} ms {side} on average{phase}"


def _loop_words(loop: LoopDelay, frequency: float | None) -> str:
    way = " → ".join([*loop.components, loop.components[0]])
    delay = f"loop {way}: {1e3 * loop.mean_s:.4g} ms in all"
    if loop.phase_lost_deg is None:
        return delay + ("; its crossover is not known, give a frequency for the phase" if loop.mean_s else "")
    if frequency is not None:
        return f"{delay}, {loop.phase_lost_deg:.3g}° lost at {frequency:g} Hz"
    return f"{delay}, {loop.phase_lost_deg:.3g}° of its phase margin lost at its crossover, {loop.crossover_hz:.4g} Hz"


def _output_words(o: Halving, step: float) -> str:
    if o.change == 0.0:
        return f"{o.name}: the same with half the step"
    order = "unevenly, the error is a guess" if o.order is None else f"with order {o.order:.2f}"
    return (
        f"{o.name}: changes by {o.change:.3g} when the step of {1e3 * step:.6g} ms is halved, falling {order}; "
        f"estimated error {o.error:.3g}, of a range of {o.span:.3g}"
    )


# -- making it ----------------------------------------------------------------------------------


def delay_report(
    model: MasterModel,
    *,
    stop: float | None,
    inputs: Mapping[str, Signal],
    step: float | None,
    frequency: float | None,
) -> DelayReport:
    """Return the report; see `MasterModel.delays`."""
    for name, value in (("step", step), ("stop", stop), ("frequency", frequency)):
        if value is not None and not 0.0 < value < float("inf"):
            raise InputError(f"{name} must be positive, not {value:g}")
    if stop is None and model.stop_time is not None and model.stop_time > model.start_time:
        stop = model.stop_time - model.start_time
    step = step or _usual_step(model, stop, inputs)
    stop = stop or _STEPS * step
    outputs, takes = _outputs(model, stop, inputs, step)
    decided = model.decided
    connections = _connections(model, takes, step, frequency)
    names = [u.name for u in decided.units.units]
    return DelayReport(
        system=model.name,
        order=model.order,
        stages=tuple(tuple(names[k] for k in stage) for stage in decided.stages),
        step=step,
        fixed=model.why_fixed_step(),
        periods={names[k]: t.longest for k, t in decided.ticks.items()},
        frequency=frequency,
        connections=tuple(connections.values()),
        loops=tuple(_loops(model, connections, frequency)),
        outputs=outputs,
        stop=stop,
        operating_point=standing(model),
    )


def _usual_step(model: MasterModel, stop: float | None, inputs: Mapping[str, Signal]) -> float:
    """Return the communication step that a run uses [s]."""
    with model.open_session(signals=inputs) as session:
        session.advance(session.time + (stop or 1.0), signals=inputs)
        return session.communication_step or (stop or 1.0) / _STEPS


def _outputs(
    model: MasterModel, stop: float, inputs: Mapping[str, Signal], step: float
) -> tuple[tuple[Halving, ...], dict[int, str]]:
    """Run with the step, half of it and a quarter; also return how the units took their inputs."""
    names = [v.name for v in model.outputs if v.is_number and not model.shows_input(v.name)]
    count = max(1, round(stop / step))
    points = model.start_time + stop * np.arange(1, count + 1)[:: max(1, count // _MOST_POINTS)] / count
    found, takes = [], dict[int, str]()
    for divisor in (1.0, 2.0, 4.0):
        with model.open_session(step=stop / count / divisor, signals=inputs) as session:
            at = points + (session.time - model.start_time)
            record = session.advance(session.time + stop, signals=inputs, record=names, points=at)
            first = np.searchsorted(record.time, at, side="left")
            found.append({n: record.values[n][first] for n in names})
            if isinstance(session.instance, MasterInstance):
                takes = {k: session.instance.takes(k) for k in range(len(model.decided.units.units))}
    return tuple(halving(n, *(f[n] for f in found)) for n in names), takes


def _connections(
    model: MasterModel, takes: Mapping[int, str], step: float, frequency: float | None
) -> dict[int, ConnectionDelay]:
    units = model.decided.units
    place = {k: i for i, stage in enumerate(model.decided.stages) for k in stage}
    found = {}
    for i in sorted(units.outer()):
        how, mean, longest = _judged(model, i, takes, place, step)
        lost = None if frequency is None else 360.0 * frequency * mean
        found[i] = ConnectionDelay(units.connections[i].label, how, mean, longest, lost)
    return found


def _judged(
    model: MasterModel, number: int, takes: Mapping[int, str], place: Mapping[int, int], step: float
) -> tuple[str, float, float]:
    """Return in words how a connected value goes on over a step, its mean delay and its largest age [s]."""
    decided = model.decided
    connection, (a, b) = decided.units.connections[number], decided.units.ends(number)
    known = place[a] < place[b]
    if a in decided.held:
        return "held since its sample, as it is", 0.0, 0.0
    if b in decided.held:
        return "read at the instants of its sampled destination", 0.0, 0.0
    if not moves(connection.source) or not connection.destination.is_continuous_input:
        return "passed on at communication points, events between them are seen then", 0.5 * step, step
    if decided.hold_inputs:
        if known:
            return "held at the value that its source has reached at the end of the step", -0.5 * step, 0.0
        return "held at the value from the start of the step", 0.5 * step, step
    came = "interpolated, its source is stepped first" if known else "extrapolated from the step before"
    shape = "linear" if takes.get(b) == "slope" else "held at the value in the middle of the step"
    return f"{shape}, {came}", 0.0, 0.0 if known else step


def _loops(model: MasterModel, connections: Mapping[int, ConnectionDelay], frequency: float | None) -> list[LoopDelay]:
    units = model.decided.units
    found = []
    for way in _cycles(units):
        numbers = [_slowest(units, connections, a, b) for a, b in zip(way, [*way[1:], way[0]], strict=True)]
        mean = _around(units, connections, numbers)
        at = None if frequency is not None else _crossover(model, numbers[0])
        reference = frequency if frequency is not None else at
        lost = None if reference is None else 360.0 * reference * mean
        found.append(LoopDelay(tuple(units.units[k].name for k in way), mean, at, lost))
    return found


def _around(units: Units, connections: Mapping[int, ConnectionDelay], numbers: Sequence[int]) -> float:
    """Return the delay around a loop [s].

    What a unit passes straight on is passed on at every communication point, too: its way in adds no delay of its
    own to a value that is held from the start of the step, and decides how late one from its end is.
    """
    direct = [following in units.direct[i] for i, following in zip(numbers, [*numbers[1:], numbers[0]], strict=True)]
    means = [connections[i].mean_s for i in numbers]
    if all(direct):
        return sum(means)
    begin = direct.index(False) + 1
    total = late = 0.0
    for k in range(begin, begin + len(numbers)):
        i = k % len(numbers)
        late = late if direct[i - 1] and means[i] <= 0.0 else means[i]
        total += 0.0 if direct[i] else late
    return total


def _slowest(units: Units, connections: Mapping[int, ConnectionDelay], a: int, b: int) -> int:
    return max((i for i in connections if units.ends(i) == (a, b)), key=lambda i: connections[i].mean_s)


def _crossover(model: MasterModel, number: int) -> float | None:
    if model.decided.ticks:
        return None
    opened = model.all_me(number)
    if opened is None:
        return None
    with opened:
        try:
            return crossover(opened, model.decided.units.connections[number].gain)
        except (WorkbenchError, np.linalg.LinAlgError):
            return None


def _cycles(units: Units) -> list[tuple[int, ...]]:
    """Return the elementary loops of units, each once, beginning with its lowest number; the first few of many."""
    after: dict[int, set[int]] = {k: set() for k in range(len(units.units))}
    for i in units.outer():
        a, b = units.ends(i)
        after[a].add(b)
    found: list[tuple[int, ...]] = []

    def walk(way: Sequence[int]) -> None:
        for following in sorted(after[way[-1]]):
            if len(found) >= _MOST_LOOPS:
                return
            if following == way[0]:
                found.append(tuple(way))
            elif following > way[0] and following not in way:
                walk([*way, following])

    for k in after:
        walk([k])
    return found
