"""Linearise by central differences of derivatives and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.model.names import declared_units
from workbench.point.lin.columns import PointColumns
from workbench.point.lin.result import Doubt, LinResult
from workbench.point.lin.task import LinTask, open_base, sampled_note
from workbench.point.lin.zero_entries import zeros_of

__all__ = ["continuous_result", "difference"]


def difference(task: LinTask) -> LinResult:
    """Linearise a model exchange FMU by finite differences.

    ∂f/∂x_j ≈ (f(x + e_j·dx_j/2) − f(x − e_j·dx_j/2)) / dx_j, the given value being the TOTAL width; likewise
    for inputs. At each perturbed point relations (branches, floors) are evaluated anew, but discrete
    states keep their values: where a perturbation would make a `when` fire, the values before it are
    taken and the entries are marked doubtful.

    Widths that are not given are 2·ε^(1/3) times the larger of magnitude and nominal value (1e-2 where no
    nominal value is declared), and verified: all columns together at eight times the width, in one random direction;
    where that disagrees, each column for itself, and entries that depend on the width are marked doubtful. Of a
    variable without nominal value such a column is taken again over a width that suits how far the model is straight
    (a state of 1e-8 that nobody scaled), and a note says so. Entries
    that are 0 but not when the variable moves as far as its own scale are marked locally flat. With n
    states and m inputs this takes 2·(n + m) + 5 evaluations when there is nothing to doubt. Large models that declare
    their dependencies take a handful: columns of different rows move at once, as long as nothing is doubtful.

    Not for: co-simulation (no states); sampled models, whose discrete states do not move with a
    perturbation (use kalman-bertram); given widths are not verified, they are what the user wants.

    Args:
        task: the linearisation.

    Raises:
        InputError: the model has no derivatives, or a width is bad.
        SimulationError: the model cannot be evaluated at the point or at a perturbed point.

    Source: the source report, chapters 3.1.2 and 3.3.
    """
    with open_base(task) as point:
        columns = PointColumns(task, point)
        jacobian = columns.together()
        doubts: list[Doubt] = []
        if jacobian is None:
            jacobian = columns.central(columns.widths)
            doubts = columns.narrowed(jacobian, columns.doubts(jacobian))
        return continuous_result(columns, jacobian, doubts, method="difference")


def continuous_result(
    columns: PointColumns, jacobian: Floats, doubts: Sequence[Doubt], *, method: str, notes: Sequence[str] = ()
) -> LinResult:
    """Return the result of a matrix ∂(dx, y)/∂(x, u), shape (n + q, n + m), with what it hides far from the point.

    Args:
        columns: of the matrix.
        jacobian: the matrix.
        doubts: about its entries.
        method: by which it was made.
        notes: on the way there.
    """
    task, point = columns.task, columns.point
    reach = columns.reach(jacobian)
    states, n = [v.name for v in point.states], len(point.states)
    rows = [*(v.name for v in point.outputs), *states]
    outer = np.vstack([jacobian[n:], np.eye(n, jacobian.shape[1])])[[rows.index(name) for name in task.outputs]]
    result = LinResult(
        model=task.model.name,
        interface=task.model.interface,
        method=method,
        why="it was asked for",
        A=jacobian[:n, :n],
        B=jacobian[:n, n:],
        C=outer[:, :n],
        D=outer[:, n:],
        dt=0.0,
        state_names=tuple(states),
        input_names=task.inputs,
        output_names=task.outputs,
        units=declared_units(task.model, [*states, *task.inputs, *task.outputs]),
        operating_point=_operating_point(columns),
        calls=dict(point.calls),
        notes=(*notes, *columns.notes(), *sampled_note(point), *columns.moving(jacobian)),
    )
    known = {*states, *task.outputs}
    every = (*doubts, *columns.flat(reach))
    return replace(result, doubts=tuple(d for d in every if d.row in known), zeros=zeros_of(result, reach))


def _operating_point(columns: PointColumns) -> OperatingPoint:
    task, point = columns.task, columns.point
    states = [v.name for v in point.states]
    x = dict(zip(states, point.x0.tolist(), strict=True))
    values = {**x, **{v.name: float(y) for v, y in zip(point.outputs, columns.base.y, strict=True)}}
    return OperatingPoint(
        x=x,
        u=dict(zip([v.name for v in point.inputs], point.u0.tolist(), strict=True)),
        y={n: values[n] for n in task.outputs},
        dx=dict(zip(states, columns.base.dx.tolist(), strict=True)),
        discrete=point.discrete(),
        units={v.name: v.unit for v in (*task.model.states, *task.model.inputs, *task.model.outputs)},
        time=point.time,
    )
