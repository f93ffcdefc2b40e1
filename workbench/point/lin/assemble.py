"""From a matrix of partial derivatives to a result with names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.model.names import declared_units
from workbench.point.lin.columns import PointColumns
from workbench.point.lin.result import Doubt, LinResult
from workbench.point.lin.task import sampled_note
from workbench.point.lin.zero_entries import zeros_of

__all__ = ["continuous_result"]


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
