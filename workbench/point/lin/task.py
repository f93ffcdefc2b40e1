"""What is to be linearised, where, and how widely it is perturbed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.forms import Widths
from workbench.core.records.names_in_text import check_names
from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import TOGETHER
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.fmi.variable import FLOAT_TYPES
from workbench.jobs.job import Job
from workbench.model import Model, Variable
from workbench.model.names import Kind, check_variables, found_variables
from workbench.model.operating_point import find_point
from workbench.point.lin.request import Lin, PointOptions
from workbench.session.point import ModelPoint

__all__ = [
    "HELD",
    "NOT_AT_REST",
    "LinTask",
    "columns_of",
    "moving_note",
    "no_equations",
    "open_base",
    "pass_states",
    "sampled_note",
    "width_for",
]


@dataclass(frozen=True, kw_only=True)
class LinTask:
    """One linearisation.

    Attributes:
        model: what to linearise.
        inputs, outputs: names, in the order of the result.
        values: states, discrete states and inputs → value, where they are not the model's own.
        time: session time of the point [s].
        dx, du: total widths of the perturbations: for all, by name, or in order; None: chosen.
        btptol: relative tolerance in which sample periods have a common multiple.
        period: over which `response` holds its input [s]; None: the communication step.
        points: how many such periods it records.
        order: of the model that `response` finds; None: chosen.
        continuous: turn a discrete result into a continuous one.
        notes: on the operating point.
        explained: also say of entries that are 0 whether they stay so farther away; that is most of the evaluations.
        job: is told of the runs of `response`.
    """

    model: Model
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    values: Mapping[str, float] = field(default_factory=dict)
    time: float = 0.0
    dx: Widths | None = None
    du: Widths | None = None
    btptol: float = TOGETHER
    period: float | None = None
    points: int = 400
    order: int | None = None
    continuous: bool = False
    notes: tuple[str, ...] = ()
    explained: bool = True
    job: Job = field(default_factory=Job)


def make_task(model: Model, request: Lin) -> LinTask:
    """Return the task that a request describes.

    Raises:
        InputError: unknown name, a point of another model.
    """
    point, notes = point_in_full(model, request)
    check_variables(model, point["u0"], "input", what="u0")
    return LinTask(
        model=model,
        inputs=_chosen(model, request.inputs, model.inputs, "input"),
        outputs=_chosen(model, request.outputs, model.outputs or model.states, "output", "state"),
        values={**point["x0"], **point["u0"]},
        time=point["time"],
        dx=request.dx,
        du=request.du,
        btptol=request.btptol,
        period=request.period,
        points=request.points,
        order=request.order,
        continuous=request.continuous,
        notes=notes,
    )


def point_in_full(model: Model, request: PointOptions) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return x0, u0 and time of a request that names a point besides, and remarks on that point.

    Raises:
        InputError: a point of another model.
    """
    point, notes = find_point(model, request.at)
    where = point or OperatingPoint(x={}, u={}, time=model.start_time)
    x0, u0 = request.x0 or {}, request.u0 or {}
    full = {
        "x0": {**where.x, **where.discrete, **x0},
        "u0": {**where.u, **u0},
        "time": where.time if request.time is None else request.time,
    }
    return full, (*notes, *_moved(where, {**x0, **u0}))


def _moved(where: OperatingPoint, given: Mapping[str, float]) -> tuple[str, ...]:
    """Say where x0 and u0 take the place of what the operating point says."""
    others = {name: value for name, value in given.items() if name in where.values and value != where.values[name]}
    words = (f"{name} is {value:g} as asked for, not {where.values[name]:g}" for name, value in others.items())
    return (f"{', '.join(words)}, as the operating point says: it may not be an equilibrium",) if others else ()


def _chosen(model: Model, wanted: Sequence[str] | None, usual: Iterable[Variable], *kinds: Kind) -> tuple[str, ...]:
    if wanted is None:
        return tuple(v.name for v in usual if v.type in FLOAT_TYPES)
    return tuple(found_variables(model, wanted, *kinds, what=f"{kinds[0]}s"))


def open_base(task: LinTask) -> ModelPoint:
    """Return the point of the task; states that the FMU does not let one start elsewhere are moved there.

    Raises:
        InputError: unknown state, or the model has no points.
    """
    if task.model.interface == "cs":
        raise no_equations(task)
    point = task.model.open_point(time=task.time, values=task.values)
    try:
        known = [v.name for v in (*point.states, *point.inputs)] + list(point.discrete())
        check_names(task.values, known, kinds=("state", "input"), what="x0", model=task.model.name)
        x = np.array([task.values.get(v.name, old) for v, old in zip(point.states, point.x0, strict=True)])
        u = np.array([task.values.get(v.name, old) for v, old in zip(point.inputs, point.u0, strict=True)])
        if not (np.array_equal(x, point.x0) and np.array_equal(u, point.u0)):
            point.move(x, u)
    except BaseException:
        point.close()
        raise
    return point


def no_equations(task: LinTask) -> InputError:
    """Return the refusal of a method that needs states and derivatives."""
    way = task.model.way_out("use method response")
    return InputError(f"co-simulation shows neither states nor derivatives; {way}")


HELD = "the model is sampled: its discrete states are held here"


def sampled_note(point: ModelPoint) -> tuple[str, ...]:
    """Return a remark where derivatives are half the truth: the model has samplers, which hold."""
    if not (len(point.ticks(1, np.inf)) and point.memory):
        return ()
    return (HELD,)


NOT_AT_REST = "the point is not at rest"


def moving_note(moves: Sequence[str]) -> tuple[str, ...]:
    """Return the remark on a point that is not at rest; nothing where nothing moves.

    Args:
        moves: what moves and how fast, each in a few words.
    """
    if not moves:
        return ()
    more = f" and {len(moves) - 3} more" if len(moves) > 3 else ""
    shown = f"{', '.join(moves[:3])}{more}"
    return (
        (
            f"{NOT_AT_REST}: {shown}; the linear model describes small deviations from that motion; trim "
            "finds a point at rest"
        ),
    )


def pass_states(point: ModelPoint, jacobian: Floats) -> None:
    """Write the rows of outputs that are states, of ∂(dx, y)/∂(x, …), in place: what an FMU says of them is of no use.

    FMUs that derive equations only, as the Reference FMUs, answer 0 there.

    Args:
        point: the model.
        jacobian: shape (n + q, k), states first in its columns.
    """
    n, states = len(point.states), {v.name: i for i, v in enumerate(point.states)}
    for i, output in enumerate(point.outputs):
        if output.name in states:
            jacobian[n + i] = 0.0
            jacobian[n + i, states[output.name]] = 1.0


def columns_of(task: LinTask, point: ModelPoint) -> list[int]:
    """Return where the task's inputs stand among the point's."""
    names = [v.name for v in point.inputs]
    return [names.index(n) for n in task.inputs]


def width_for(widths: Widths | None, names: Sequence[str], *, what: str) -> Floats:
    """Return a total width for each name, NaN where one is to be chosen, shape (len(names),).

    Raises:
        InputError: unknown name, wrong number of widths, a width that is not positive.
    """
    if widths is None:
        return np.full(len(names), np.nan)
    if isinstance(widths, Mapping):
        check_names(widths, names, kinds=("state", "input"), what=what)
        listed = [float(widths.get(n, np.nan)) for n in names]
    elif isinstance(widths, int | float):
        listed = [float(widths)] * len(names)
    else:
        listed = [float(w) for w in widths]
        if len(listed) != len(names):
            raise InputError(
                f"{what}: {len(listed)} widths for {len(names)} variables; give one for all, widths by name, or one "
                f"for each, in this order: {', '.join(names[:8])}"
            )
    for name, width in zip(names, listed, strict=True):
        if width <= 0.0 or np.isinf(width):
            raise InputError(f"{what}: the width of {name} must be positive and finite, not {width:g}")
    return np.array(listed)
