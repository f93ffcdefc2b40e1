"""Linearise a sampled, hybrid or multirate model over its basic time period."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from workbench.analysis.lin.assemble import units_of
from workbench.analysis.lin.explain import Reach, zeros_of
from workbench.analysis.lin.rates import basic_period, sample_periods
from workbench.analysis.lin.result import Doubt, Intersample, LinResult
from workbench.analysis.lin.task import LinTask, columns_of, open_base, width_for
from workbench.analysis.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.session.base import Floats, Record
from workbench.session.point import Point

__all__ = ["kalman_bertram"]

MOST_EVENTS = 2000
INTERVALS = 16  # of the basic period, for the output between samples
TOLERANCE = 1e-10  # of the integration over one period
WIDTH_SAMPLED = 1e-5  # total width over scale where nothing is integrated
WIDTH_HYBRID = 1e-3  # and where integration errors of 1e-10 must stay small beside it
UNDECLARED = 1e-2
AGREE = 1e-3


def kalman_bertram(task: LinTask) -> LinResult:
    """Linearise the map over one basic time period; the result is a discrete model with that period.

    All rates of a hybrid or multirate model are taken together into the basic time period T, the least common
    multiple of the sample periods within the tolerance `btptol`. With the inputs held over T, let F be the
    transition of the continuous states while the discrete ones are constant (e^(FT)), and G
    that of the discrete states at the samples while the continuous ones are constant. Kalman and
    Bertram's overall transition is Φ = G·e^(FT) from just after one sample to just after the next.

    Here Φ and Γ are differences of the map that the FMU itself makes of one period, begun just before a sample:
    Φ = e^(FT)·G, similar to the above and with the same eigenvalues, but exact also where faster samplers update
    within the period (which the classical merging holds constant) and with the input of the sample instant
    itself reaching the samplers. FMI lets discrete states be set only before initialisation ends; so each
    perturbed run is a new one, initialised at a multiple of T with changed start values. Discrete states
    that have no influence (they are overwritten before they are read) are left out.

    At the end the linear model is compared with the FMU over one more period from a point where everything is
    perturbed at once.

    Not for: discrete states that the FMU does not show or does not let one start elsewhere (the final comparison or
    a missing influence shows it; use response); models without time events of constant rate; modes
    (integers, Booleans), which stay as they are; amplitudes at which limits are reached.

    Args:
        task: the linearisation.

    Raises:
        InputError: no sample rates, co-simulation, or a continuous state that cannot be started elsewhere.
        SimulationError: a run fails.

    Source: the source report, chapter 3.1.3; R. E. Kalman and J. E. Bertram, A unified approach to the theory of
    sampling systems, J. Franklin Inst. 267 (1959).
    """
    with open_base(task) as point:
        periods, times = _periods(task, point)
        period = basic_period(periods, task.btptol)
        start = _start(task.time, period)
        setting = _Setting.of(task, point, start, period, times)
    return _linearise(task, setting, periods)


def _periods(task: LinTask, point: Point) -> tuple[tuple[float, ...], Floats]:
    """Return the sample periods and the event times they were found in."""
    times = point.ticks(MOST_EVENTS, np.inf)
    if task.periods is not None:
        return task.periods, times
    if not len(times):
        raise InputError("method kalman-bertram: the model asks for no time events; use difference, or give periods")
    return sample_periods(times), times


def _start(time: float, period: float) -> float:
    """Return the first multiple of the period not before `time` [s]."""
    return float(np.ceil(time / period - 1e-9)) * period


@dataclass(frozen=True)
class _Setting:
    """What the runs over one period have in common.

    Attributes:
        task: the linearisation.
        start, period: [s].
        states: continuous and discrete states.
        names: of states, then inputs.
        values: of them at the point.
        widths: of them.
        grid: sample times of the output, shape (k + 1,), absolute [s].
        given: start values of everything else.
        continuous: number of continuous states.
    """

    task: LinTask
    start: float
    period: float
    states: tuple[Variable, ...]
    names: tuple[str, ...]
    values: Floats
    widths: Floats
    grid: Floats
    given: Mapping[str, float]
    continuous: int
    inputs: Mapping[str, float]

    @classmethod
    def of(cls, task: LinTask, point: Point, start: float, period: float, ticks: Floats) -> _Setting:
        """Collect them at a point."""
        states = (*point.states, *point.memory)
        for state in point.states:
            if state.start is None:
                raise InputError(f"method kalman-bertram: state {state.name} cannot be started elsewhere; use response")
        chosen = [point.inputs[i] for i in columns_of(task, point)]
        inputs = {v.name: float(u) for v, u in zip(point.inputs, point.u0, strict=True)}
        # Discrete states begin at their own start values: those after the first event are already the next ones.
        memory = [task.values.get(v.name, float(v.start or 0.0)) for v in point.memory]
        values = np.array([*point.x0, *memory, *(inputs[v.name] for v in chosen)])
        variables = (*states, *chosen)
        wanted = np.concatenate([
            width_for(task.dx, [v.name for v in states], what="dx"), width_for(task.du, task.inputs, what="du")
        ])  # fmt: skip
        relative = WIDTH_HYBRID if point.states else WIDTH_SAMPLED
        usual = [_default(v, x, relative) for v, x in zip(variables, values.tolist(), strict=True)]
        return cls(
            task=task,
            start=start,
            period=period,
            states=states,
            names=tuple(v.name for v in variables),
            values=values,
            widths=np.where(np.isnan(wanted), usual, wanted),
            grid=_grid(start, period, np.mod(ticks - start, period)),
            given={**inputs, **dict(zip([v.name for v in states], values, strict=False))},
            continuous=len(point.states),
            inputs=inputs,
        )

    def run(self, shift: Floats) -> tuple[Floats, Floats]:
        """Return the states after one period and the outputs (k, 2, q) within it, from a shifted start."""
        task = self.task
        values = {**self.given, **dict(zip(self.names, self.values + shift, strict=True))}
        with task.model.open_at(time=self.start, values=values, tolerance=TOLERANCE) as session:
            record = session.advance(
                float(self.grid[-1]), signals={}, record=task.outputs, points=self.grid[1:]
            )
            reached = session.values([v.name for v in self.states])
        return np.array(list(reached.values())), _within(record, self.grid, task.outputs)


def _default(variable: Variable, value: float, relative: float) -> float:
    if variable.type not in FLOAT_TYPES:
        return 2.0
    return relative * max(abs(value), variable.nominal or UNDECLARED)


def _grid(start: float, period: float, ticks: Floats) -> Floats:
    """Return a uniform grid over the period together with the samples inside it, absolute times [s]."""
    end = start + period
    uniform = start + period * np.arange(INTERVALS + 1) / INTERVALS
    uniform[-1] = end
    inner = start + ticks[(ticks > 0.0) & (ticks < period * (1.0 - 1e-9))]
    every = np.unique(np.concatenate([uniform, inner]))
    apart = np.concatenate([[True], np.diff(every) > 1e-9 * period])
    kept: Floats = every[apart]
    kept[-1] = end
    return kept


def _within(record: Record, grid: Floats, outputs: tuple[str, ...]) -> Floats:
    """Return the outputs at the beginning (right limit) and end (left limit) of each interval, (k, 2, q)."""
    near = 1e-9 * (grid[-1] - grid[0])
    right = np.searchsorted(record.time, grid[:-1] + near, side="right") - 1
    left = np.searchsorted(record.time, grid[1:] - near, side="left")
    table = np.column_stack([record.values[n] for n in outputs])
    return np.stack([table[right], table[left]], axis=1)


def _linearise(task: LinTask, setting: _Setting, periods: tuple[float, ...]) -> LinResult:
    n, m = len(setting.states), len(task.inputs)
    base_x, base_y = setting.run(np.zeros(n + m))
    slopes_x, slopes_y = [], []
    for j, width in enumerate(setting.widths.tolist()):
        (x1, y1), (x0, y0) = (setting.run(s * 0.5 * width * np.eye(n + m)[j]) for s in (1.0, -1.0))
        slopes_x.append((x1 - x0) / width)
        slopes_y.append((y1 - y0) / width)
    jx, jy = np.array(slopes_x).T.reshape(n, n + m), np.moveaxis(np.array(slopes_y), 0, -1)
    keep = _influential(jx[:, :n], jy[:, :, :, :n], setting.continuous)
    point = _point(task, setting, base_x, base_y)
    doubts = _check(setting, jx, jy, base_x, base_y)
    result = _result(task, setting, jx, jy, keep, point, calls={"runs": 2 * (n + m) + 3})
    left_out = [v.name for v, k in zip(setting.states, keep, strict=True) if not k]
    notes = [f"basic time period {setting.period:.9g} s out of sample periods {_listed(periods)} s"]
    if left_out:
        notes.append(f"left out, because they are set anew before anything reads them: {', '.join(left_out)}")
    drift = np.abs(base_x - setting.values[:n])[keep]
    if (drift > 1e-6 * (np.abs(setting.values[:n][keep]) + 1e-6)).any():
        notes.append("the point is no equilibrium over the basic period; the model is that of deviations from its path")
    return replace(result, notes=tuple(notes), doubts=doubts)


def _listed(periods: tuple[float, ...]) -> str:
    return ", ".join(f"{p:.6g}" for p in periods)


def _influential(phi: Floats, outer: Floats, continuous: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which states matter: continuous ones, and discrete ones that reach another state or an output."""
    n = len(phi)
    keep = np.ones(n, dtype=bool)
    for _ in range(n):
        for i in range(continuous, n):
            keep[i] = keep[i] and bool(phi[keep, i].any() or outer[..., i].any())
    return keep


def _point(task: LinTask, setting: _Setting, base_x: Floats, base_y: Floats) -> OperatingPoint:
    n, c = len(setting.states), setting.continuous
    names = [v.name for v in setting.states]
    values = setting.values.tolist()
    return OperatingPoint(
        x=dict(zip(names[:c], values[:c], strict=True)),
        u=dict(setting.inputs),
        y=dict(zip(task.outputs, base_y[0, 0].tolist(), strict=True)),
        discrete=dict(zip(names[c:], values[c:n], strict=True)),
        units={**units_of(task, names[:c]), **{v.name: v.unit for v in setting.states[c:]}},
        time=setting.start,
        period=setting.period,
    )


def _result(
    task: LinTask,
    setting: _Setting,
    jx: Floats,
    jy: Floats,
    keep: np.ndarray[tuple[int], np.dtype[np.bool_]],
    point: OperatingPoint,
    *,
    calls: Mapping[str, int],
) -> LinResult:
    n = len(setting.states)
    C, D = jy[..., :n][..., keep], jy[..., n:]
    names = tuple(v.name for v, k in zip(setting.states, keep, strict=True) if k)
    result = LinResult(
        model=task.model.name,
        interface=task.model.interface,
        method="kalman-bertram",
        why="it was asked for",
        A=jx[:, :n][np.ix_(keep, keep)],
        B=jx[:, n:][keep],
        C=C[0, 0],
        D=D[0, 0],
        dt=setting.period,
        state_names=names,
        input_names=task.inputs,
        output_names=task.outputs,
        units=point.units,
        point=point,
        calls=calls,
        intersample=Intersample(setting.grid - setting.start, C, D, sampled=_acts_at_samples(setting)),
    )
    rows = [*names, *task.outputs]
    return replace(result, zeros=zeros_of(result, Reach.none(rows, [*names, *task.inputs], looked=False)))


def _acts_at_samples(setting: _Setting) -> bool:
    """Whether inputs are only read at samples: between two samples nothing follows them."""
    task = setting.task
    between = setting.start + 0.5 * float(np.min(np.diff(setting.grid)))
    values = {**setting.given, **dict(zip(setting.names, setting.values, strict=True))}
    with task.model.open_point(time=between, values=values) as point:
        first = point.at(point.x0, point.u0)
        for i in columns_of(task, point):
            u = point.u0.copy()
            u[i] += setting.widths[len(setting.states) + task.inputs.index(point.inputs[i].name)]
            moved = point.at(point.x0, u)
            if not (np.array_equal(moved.dx, first.dx) and np.array_equal(moved.y, first.y)):
                return False
    return True


def _check(setting: _Setting, jx: Floats, jy: Floats, base_x: Floats, base_y: Floats) -> tuple[Doubt, ...]:
    """Compare the linear map with the FMU where everything is perturbed at once."""
    random = np.random.default_rng(3)
    shift = 0.5 * setting.widths * random.choice([-1.0, 1.0], len(setting.names))
    x, y = setting.run(shift)
    real = np.concatenate([x - base_x, (y - base_y)[0, 0]])
    full = np.vstack([jx, jy[0, 0]])
    scale = np.abs(full) @ np.abs(shift)
    noise = 1e-9 * np.abs(np.concatenate([base_x, base_y[0, 0]])) * (setting.continuous > 0) + 1e-13
    rows = [*(v.name for v in setting.states), *setting.task.outputs]
    bad = np.flatnonzero(np.abs(real - full @ shift) > 2.0 * AGREE * scale + noise)
    why = "with everything perturbed at once it goes elsewhere: not linear over the widths"
    return tuple(Doubt(rows[i], "all", float((full @ shift)[i]), float(real[i]), why) for i in bad)
