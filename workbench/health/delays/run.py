"""What a master costs: which connections carry a delay, the phase lost, the error at this communication step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from workbench.errors import InputError, WorkbenchError
from workbench.health.delays.request import Delays
from workbench.health.delays.result import ConnectionDelay, DelayReport, LoopDelay, NoDelays
from workbench.jobs.job import Job
from workbench.model import Model
from workbench.model.names import forced_inputs
from workbench.model.operating_point import standing, start_at
from workbench.signals.kinds import Signal
from workbench.system.master.crossover import crossover
from workbench.system.master.model import MasterModel
from workbench.system.master.richardson import Halving, halving
from workbench.system.master.session import MasterSession
from workbench.system.master.units import Units, moves

__all__ = ["run"]

_STEPS = 500  # where nothing says how long to run
_MOST_POINTS = 500
_MOST_LOOPS = 20
_EXTRAPOLATED = {1: "extrapolated from the step before", 2: "extrapolated from the two steps before"}
_DIVISORS = (1.0, 2.0, 4.0)  # of the step: the error is told from how the answers differ


def run(model: Model, request: Delays, job: Job) -> DelayReport | NoDelays:
    """Tell what the master of a system costs; see `Delays`."""
    if not isinstance(model, MasterModel):
        if model.interface == "me":
            return NoDelays(model=model.name, interface=model.interface, solver=model.solver)
        raise InputError(f"{model.name}: a single co-simulation FMU has no connections; connect it into a system first")
    system, remarks = start_at(model, request.at)
    return _report(system, request, forced_inputs(system, request.inputs), remarks, job)


def _report(
    model: MasterModel, request: Delays, inputs: Mapping[str, Signal], remarks: tuple[str, ...], job: Job
) -> DelayReport:
    stop, frequency = request.stop, request.frequency
    if stop is None and model.stop_time is not None and model.stop_time > model.start_time:
        stop = model.stop_time - model.start_time
    step = request.step or _usual_step(model, stop, inputs)
    stop = stop or _STEPS * step
    outputs, takes = _outputs(model, stop, inputs, step, job)
    decided = model.decided
    connections = _connections(model, takes, step, frequency)
    names = [u.name for u in decided.units.units]
    loops, unknown = _loops(model, connections, frequency)
    return DelayReport(
        system=model.name,
        order=model.order,
        stages=tuple(tuple(names[k] for k in stage) for stage in decided.stages),
        step=step,
        fixed=model.why_fixed_step(),
        periods={names[k]: result.ticks.longest_gap for k, result in decided.sampled.items()},
        frequency=frequency,
        connections=tuple(connections.values()),
        loops=tuple(loops),
        outputs=outputs,
        stop=stop,
        interface=model.interface,
        solver=model.solver,
        notes=(*remarks, *model.remarks(), *unknown),
        operating_point=standing(model),
    )


def _usual_step(model: MasterModel, stop: float | None, inputs: Mapping[str, Signal]) -> float:
    """Return the communication step that a run uses [s]."""
    with model.open_session(signals=inputs) as session:
        session.advance(session.time + (stop or 1.0), signals=inputs)
        return session.communication_step or (stop or 1.0) / _STEPS


def _outputs(
    model: MasterModel, stop: float, inputs: Mapping[str, Signal], step: float, job: Job
) -> tuple[tuple[Halving, ...], dict[int, str]]:
    """Run with the step, half of it and a quarter; also return how the units took their inputs."""
    names = [v.name for v in model.outputs if v.is_number and not model.shows_input(v.name)]
    count = max(1, round(stop / step))
    points = model.start_time + stop * np.arange(1, count + 1)[:: max(1, count // _MOST_POINTS)] / count
    result, takes = [], dict[int, str]()
    for divisor in _DIVISORS:
        with model.open_session(step=stop / count / divisor, signals=inputs) as session:
            at = points + (session.time - model.start_time)
            record = session.advance(session.time + stop, signals=inputs, record=names, points=at)
            first = np.searchsorted(record.time, at, side="left")
            result.append({n: record.values[n][first] for n in names})
            if isinstance(session, MasterSession):
                takes = {k: session.takes(k) for k in range(len(model.decided.units.units))}
        job.done(f"step {1e3 * stop / count / divisor:.4g} ms", len(result), len(_DIVISORS))
    return tuple(halving(n, *(f[n] for f in result)) for n in names), takes


def _connections(
    model: MasterModel, takes: Mapping[int, str], step: float, frequency: float | None
) -> dict[int, ConnectionDelay]:
    units = model.decided.units
    place = {k: i for i, stage in enumerate(model.decided.stages) for k in stage}
    result = {}
    for i in sorted(units.outer()):
        how, mean, longest = _judged(model, i, takes, place, step)
        lost = None if frequency is None else 360.0 * frequency * mean
        result[i] = ConnectionDelay(units.connections[i].label, how, mean, longest, lost)
    return result


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
    if decided.hold_inputs and known:
        return "held at the value that its source has reached at the end of the step", -0.5 * step, 0.0
    if not known and (decided.hold_inputs or decided.extrapolation == 0):
        return "held at the value from the start of the step", 0.5 * step, step
    came = "interpolated, its source is stepped first" if known else _EXTRAPOLATED[decided.extrapolation]
    shape = "linear" if takes.get(b) == "slope" else "held at the value in the middle of the step"
    return f"{shape}, {came}", 0.0, 0.0 if known else step


def _loops(
    model: MasterModel, connections: Mapping[int, ConnectionDelay], frequency: float | None
) -> tuple[list[LoopDelay], list[str]]:
    """Return the loops, and in words why a crossover is not known."""
    units = model.decided.units
    result, notes = [], list[str]()
    for way in _cycles(units):
        numbers = [_slowest(units, connections, a, b) for a, b in zip(way, [*way[1:], way[0]], strict=True)]
        mean = _around(units, connections, numbers)
        at, why = (None, "") if frequency is not None else _crossover(model, numbers[0])
        reference = frequency if frequency is not None else at
        lost = None if reference is None else 360.0 * reference * mean
        names = tuple(units.units[k].name for k in way)
        result.append(LoopDelay(names, mean, at, lost))
        notes += [f"loop {', '.join(names)}: its crossover is not known: {why}"] if why else []
    return result, notes


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


def _crossover(model: MasterModel, number: int) -> tuple[float | None, str]:
    """Return where the linear loop crosses 1 [Hz], and what went wrong."""
    if model.decided.sampled:
        return None, ""
    opened = model.all_me(number)
    if opened is None:
        return None, ""
    with opened:
        try:
            return crossover(opened, model.decided.units.connections[number].gain), ""
        except (WorkbenchError, np.linalg.LinAlgError) as error:
            return None, str(error)


def _cycles(units: Units) -> list[tuple[int, ...]]:
    """Return the elementary loops of units, each once, beginning with its lowest number; the first few of many."""
    after: dict[int, set[int]] = {k: set() for k in range(len(units.units))}
    for i in units.outer():
        a, b = units.ends(i)
        after[a].add(b)
    result: list[tuple[int, ...]] = []

    def walk(way: Sequence[int]) -> None:
        for following in sorted(after[way[-1]]):
            if len(result) >= _MOST_LOOPS:
                return
            if following == way[0]:
                result.append(tuple(way))
            elif following > way[0] and following not in way:
                walk([*way, following])

    for k in after:
        walk([k])
    return result
