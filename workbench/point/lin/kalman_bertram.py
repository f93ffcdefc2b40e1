"""Linearise a sampled, hybrid or multirate model over its basic time period."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.model.names import declared_units
from workbench.model.sample_rates import NoRatesError, Rates, rates_of
from workbench.point.lin.columns import AGREE
from workbench.point.lin.period_map import SampledPeriodMap
from workbench.point.lin.period_slopes import slopes_of
from workbench.point.lin.result import Doubt, Intersample, LinResult
from workbench.point.lin.task import LinTask, moving_note, no_equations, open_base
from workbench.point.lin.zero_entries import LargePerturbation, zeros_of

__all__ = ["kalman_bertram", "period_map"]

Flags = NDArray[np.bool_]


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
    setting, rates = period_map(task)
    return _linearise(setting, rates)


def period_map(task: LinTask) -> tuple[SampledPeriodMap, Rates]:
    """Return the map over one basic period of a task's model, and its rates.

    Raises:
        InputError, SimulationError: see `kalman_bertram`.
    """
    if task.model.interface == "cs":
        raise no_equations(task)
    rates = rates_of(task.model, time=task.time, values=task.values, btptol=task.btptol)
    if not rates.periods and rates.notes:
        raise NoRatesError(f"{rates.notes[0].partition(':')[0]}; use difference, or give periods")
    if not rates.periods:
        raise InputError("method kalman-bertram: the model asks for no time events; use difference, or give periods")
    with open_base(task) as point:
        return SampledPeriodMap(task, point, rates.start(task.time), rates.period, rates.ticks), rates


def _linearise(setting: SampledPeriodMap, rates: Rates) -> LinResult:
    n = len(setting.states)
    slopes = slopes_of(setting)
    dx, dy, jacobian = slopes.dx, slopes.dy, slopes.jacobian
    keep = _influential(dx[:, :n], dy[..., :n], setting.continuous)
    result = _result(setting, dx, dy, keep)
    reach = LargePerturbation.none(setting.rows, setting.names)
    inputs = range(n, len(setting.names))
    setting.look_far(jacobian, setting.alone(j for j in inputs if not jacobian[:, j].all()), reach)
    known = {*result.state_names, *result.output_names}
    return replace(
        result,
        zeros=zeros_of(result, reach),
        doubts=(*slopes.doubts, *_check(setting, jacobian), *(d for d in setting.flat(reach) if d.row in known)),
        notes=(*_notes(setting, keep, rates), *slopes.notes),
    )


def _notes(setting: SampledPeriodMap, keep: Flags, rates: Rates) -> tuple[str, ...]:
    listed = ", ".join(f"{p:.12g}" for p in rates.periods)
    notes = [f"basic time period {setting.period:.9g} s out of sample periods {listed} s", *rates.notes]
    left_out = [v.name for v, k in zip(setting.states, keep, strict=True) if not k]
    if left_out:
        notes.append(f"left out, because they are overwritten before anything reads them: {', '.join(left_out)}")
    values, after = setting.point_values[: len(keep)], setting.base[0]
    moves = np.flatnonzero((np.abs(after - values) > 1e-6 * (np.abs(values) + 1e-6)) & keep)
    shown = [f"{setting.names[i]} goes from {values[i]:.4g} to {after[i]:.4g} in one period" for i in moves]
    return (*notes, *moving_note(shown))


def _influential(phi: Floats, outer: Floats, continuous: int) -> Flags:
    """Return which states matter: continuous ones, and discrete ones that reach another state or an output."""
    n = len(phi)
    keep = np.ones(n, dtype=bool)
    for _ in range(n):
        for i in range(continuous, n):
            keep[i] = keep[i] and bool(phi[keep, i].any() or outer[..., i].any())
    return keep


def _point(setting: SampledPeriodMap) -> OperatingPoint:
    task, n, c = setting.task, len(setting.states), setting.continuous
    values = setting.point_values.tolist()
    return OperatingPoint(
        x=dict(zip(setting.names[:c], values[:c], strict=True)),
        u=dict(setting.inputs),
        y=dict(zip(task.outputs, setting.base[1][0, 0].tolist(), strict=True)),
        discrete=dict(zip(setting.names[c:n], values[c:n], strict=True)),
        units=declared_units(task.model, [*setting.names[:n], *task.inputs, *task.outputs]),
        time=setting.start,
        period=setting.period,
    )


def _result(setting: SampledPeriodMap, dx: Floats, dy: Floats, keep: Flags) -> LinResult:
    task, n = setting.task, len(setting.states)
    between = _between(setting, keep)
    C, D = dy[..., :n][..., keep], dy[..., n:]
    point = _point(setting)
    return LinResult(
        model=task.model.name,
        interface=task.model.interface,
        method="kalman-bertram",
        why="it was asked for",
        A=dx[:, :n][np.ix_(keep, keep)],
        B=dx[:, n:][keep],
        C=C[0, 0],
        D=D[0, 0],
        dt=setting.period,
        state_names=tuple(v.name for v, k in zip(setting.states, keep, strict=True) if k),
        input_names=task.inputs,
        output_names=task.outputs,
        units=point.units,
        operating_point=point,
        calls={"runs": 2 * len(setting.names) + 2},
        intersample=Intersample(setting.nodes, C, D, **between),
    )


def _between(setting: SampledPeriodMap, keep: Flags) -> dict[str, Any]:
    """Return what inputs do within the period: by their values at the samples, or along all of it."""
    columns = range(len(setting.states), len(setting.names))
    if setting.acts_at_samples() or not all(setting.variables[j].is_continuous_input for j in columns):
        if len(setting.instants) == 1 or not columns:
            return {"sampled": True, "smooth": True}
        nodes, sampled = setting.instants, True
        result = [[setting.pulse(k, j) for j in columns] for k in range(len(nodes))]
    else:
        nodes, sampled = setting.nodes, False
        result = [[setting.respond(k, j) for j in columns] for k in range(len(nodes))]
    B = np.array([np.column_stack([x[keep] for x, _ in row]) for row in result])
    D = np.array([np.stack([y for _, y in row], axis=-1) for row in result])
    return {"sampled": sampled, "nodes": nodes, "B_nodes": B, "D_nodes": D, "smooth": True}


def _check(setting: SampledPeriodMap, jacobian: Floats) -> tuple[Doubt, ...]:
    """Compare the linear map with the FMU where everything is perturbed at once."""
    random = np.random.default_rng(3)
    shift = 0.5 * setting.widths * random.choice([-1.0, 1.0], len(setting.names))
    real, expected = setting.values(shift) - setting.here, jacobian @ shift
    scale = np.abs(jacobian) @ np.abs(shift)
    noise = 1e-9 * np.abs(setting.here) * (setting.continuous > 0) + 1e-13
    why = "with everything perturbed at once the result differs: not linear over the widths"
    bad = np.flatnonzero(np.abs(real - expected) > 2.0 * AGREE * scale + noise)
    return tuple(Doubt(setting.rows[i], "all", float(expected[i]), float(real[i]), why) for i in bad)
