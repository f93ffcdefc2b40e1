"""From a matrix of partial derivatives to a result with names."""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.model.names import declared_units
from workbench.point.lin.result import LinResult
from workbench.point.lin.task import LinTask
from workbench.session.point import Evaluation, ModelPoint

__all__ = ["continuous_result", "operating_point", "output_rows"]


def operating_point(task: LinTask, point: ModelPoint, base: Evaluation) -> OperatingPoint:
    """Return the point that was linearised."""
    states = [v.name for v in point.states]
    outputs = {v.name: float(y) for v, y in zip(point.outputs, base.y, strict=True)}
    rates = dict(zip(states, base.dx.tolist(), strict=True))
    x = dict(zip(states, point.x0.tolist(), strict=True))
    return OperatingPoint(
        x=x,
        u=dict(zip([v.name for v in point.inputs], point.u0.tolist(), strict=True)),
        y={n: outputs[n] if n in outputs else x[n] for n in task.outputs},
        dx=rates,
        discrete=point.discrete(),
        units={v.name: v.unit for v in (*task.model.states, *task.model.inputs, *task.model.outputs)},
        time=point.time,
    )


def output_rows(task: LinTask, point: ModelPoint) -> list[int]:
    """Return where the chosen outputs stand among the outputs; −1 − i for state i."""
    outputs = [v.name for v in point.outputs]
    states = [v.name for v in point.states]
    return [outputs.index(n) if n in outputs else -1 - states.index(n) for n in task.outputs]


def _unit(place: int, size: int) -> Floats:
    row = np.zeros(size)
    row[place] = 1.0
    return row


def continuous_result(
    task: LinTask, point: ModelPoint, jacobian: Floats, where: OperatingPoint, *, method: str
) -> LinResult:
    """Return the result of a matrix ∂(dx, y)/∂(x, u), shape (n + q, n + m)."""
    n = len(point.states)
    rows = [_unit(-1 - i, jacobian.shape[1]) if i < 0 else jacobian[n + i] for i in output_rows(task, point)]
    outer = np.array(rows).reshape(len(rows), jacobian.shape[1])
    return LinResult(
        model=task.model.name,
        interface=task.model.interface,
        method=method,
        why="it was asked for",
        A=jacobian[:n, :n],
        B=jacobian[:n, n:],
        C=outer[:, :n],
        D=outer[:, n:],
        dt=0.0,
        state_names=tuple(v.name for v in point.states),
        input_names=task.inputs,
        output_names=task.outputs,
        units=declared_units(task.model, [*(v.name for v in point.states), *task.inputs, *task.outputs]),
        operating_point=where,
        calls=dict(point.calls),
    )
