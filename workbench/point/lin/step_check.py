"""A step of the input: the linear model beside the model itself."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workbench.core.records.names_in_text import check_names
from workbench.core.records.record import entry
from workbench.core.values.arrays import Floats
from workbench.core.values.matrices import held
from workbench.errors import InputError
from workbench.model import Model
from workbench.point.lin.result import LinResult
from workbench.point.scales import INTEGRATION
from workbench.requests.decorator import with_origin
from workbench.show.result import Result
from workbench.signals.kinds import Constant, Signal

__all__ = ["StepCheck", "step_check"]

POINTS = 400


@dataclass(frozen=True, eq=False)
class StepCheck(Result):
    """Responses to one step from the point of a linear model.

    Attributes:
        input, output: names.
        height: height of the step [unit of the input].
        unit: unit of the output, None where the model names none.
        time: since the step, shape (k,) [s].
        linear: the linear model's output with the offset of the point, shape (k,).
        nonlinear: the model's own, shape (k,).
        error: root mean square of the difference over that of the model's motion.
    """

    _page = "workbench.point.lin.page:step_check_page"
    _picture = "workbench.point.lin.picture:plot_step_check"

    input: str
    output: str
    height: float
    unit: str | None
    time: Floats = field(metadata=entry(dims=("time",), unit="s"))
    linear: Floats = field(metadata=entry(dims=("time",)))
    nonlinear: Floats = field(metadata=entry(dims=("time",)))
    error: float


@with_origin()
def step_check(model: Model, linear: LinResult, *, input: str, output: str, height: float, stop: float) -> StepCheck:
    """Compare a linear model with the model it came from after a step of one input.

    Args:
        model: the model; it stays open.
        linear: its linear model. In co-simulation that of the same interface and communication step (`dt`): a solver
            inside the FMU makes errors of its own, which another linear model does not have.
        input: which input steps at the point.
        output: which output is watched.
        height: height of the step [unit of the input].
        stop: how long [s].

    Raises:
        InputError: unknown name, height 0, or a model that cannot be started at the point.
        FmuError, SimulationError: the model cannot be run.

    Examples:
        The model is linear, so that both step responses agree.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     step = wb.step_check(lag, wb.lin(lag).result, input="u", output="y", height=1.0, stop=2.0)
        >>> print(f"{step.error:.5f}")
        0.00000
    """
    for kind, name, known in (("input", input, linear.input_names), ("output", output, linear.output_names)):
        check_names([name], known, kinds=(kind,), what=kind, model="the linear model")
    if not height or not stop > 0.0:
        raise InputError(f"a step needs a height other than 0 and a stop time above 0, not {height:g} and {stop:g} s")
    count = POINTS if linear.dt == 0.0 else max(1, round(stop / linear.dt))
    dt = linear.dt or stop / count
    time: Floats = dt * np.arange(count + 1.0)
    point, j, i = linear.operating_point, linear.input_names.index(input), linear.output_names.index(output)
    moved = point.y[output] + height * step_response(linear, j, dt, count)[:, i]
    values = {**point.x, **point.discrete, **point.u}
    with model.open_at(time=point.time, values=values, tolerance=INTEGRATION) as session:
        start = session.time
        signals: dict[str, Signal] = {input: Constant(point.u[input] + height)}
        record = session.advance(start + time[-1], signals=signals, record=[output], points=start + time[1:])
    rows = np.searchsorted(record.time, start + time + 1e-9 * dt, side="right") - 1
    real = record.values[output][rows]
    motion = float(np.sqrt(np.mean((real - point.y[output]) ** 2)))
    error = float(np.sqrt(np.mean((real - moved) ** 2))) / (motion or 1.0)
    return StepCheck(input, output, height, linear.units.get(output), time, moved, real, error)


def step_response(linear: LinResult, column: int, dt: float, count: int) -> Floats:
    """Return the response to a unit step of one input at 0, dt, … count·dt, shape (count + 1, q)."""
    A, B = (linear.A, linear.B) if linear.dt > 0.0 else held(linear.A, linear.B, dt)
    state, outputs = np.zeros(len(A)), []
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(count + 1):
            outputs.append(linear.C @ state + linear.D[:, column])
            state = A @ state + B[:, column]
    return np.array(outputs)
