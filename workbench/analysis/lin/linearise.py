"""The public function: linearise a model at a point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from workbench.analysis.lin.auto import choose
from workbench.analysis.lin.methods import METHODS
from workbench.analysis.lin.realise import hold_inverse
from workbench.analysis.lin.result import LinearModel, LinResult
from workbench.analysis.lin.task import LinTask, Width, make_task
from workbench.core.operating_point import At
from workbench.errors import InputError, suggest
from workbench.model import Model
from workbench.model.placing import named
from workbench.origin import with_origin

__all__ = ["lin", "run"]


@with_origin("result")
def lin(
    model: Model,
    *,
    at: At | None = None,
    x0: Mapping[str, float] | None = None,
    u0: Mapping[str, float] | None = None,
    dx: Width = None,
    du: Width = None,
    method: str = "auto",
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    time: float | None = None,
    periods: Sequence[float] | None = None,
    btptol: float = 1e-6,
    period: float | None = None,
    points: int = 400,
    order: int | None = None,
    continuous: bool = False,
) -> LinearModel:
    """Linearise a model at an operating point.

    ```python
    with wb.load("fmu:Rudder") as rudder:
        point = wb.trim(rudder, u0={"delC": 2.0}, floating=["p1", "p2"]).point
        model = wb.lin(rudder, at=point, inputs=["delC"])
    print(model.poles(), model.result.method, model.result.why)
    ```

    Not a statement about large motions: see `workbench.nfr` for gain and phase over the amplitude. Each method's
    own limits stand in its docstring (`workbench.analysis.lin.methods.METHODS`).

    Args:
        model: what to linearise; it stays open.
        at: where: a point, a result that has one, or the file of either; None: where the model starts.
        x0: states and discrete states → value, beside or instead of those of `at`.
        u0: inputs → value, likewise.
        dx: total width of the perturbation of the states: one for all, by name, or in the order of the
            states; None: chosen and verified.
        du: of the inputs, likewise.
        method: "exact", "difference", "kalman-bertram", "response", or "auto", which chooses and says why.
        inputs: inputs of the linear model, in this order; None: all real inputs.
        outputs: outputs (or states) of the linear model; None: all real outputs.
        time: session time of the point [s]; None: that of `at`, else where the model starts.
        periods: sample periods for kalman-bertram [s]; None: found from the time events.
        btptol: relative tolerance in which sample periods have a common multiple.
        period: over which `response` holds its inputs [s]; None: the communication step.
        points: how many periods `response` records.
        order: of the model that `response` finds; None: chosen.
        continuous: turn a discrete result into the continuous model whose hold equivalent it is.

    Returns:
        A `control.StateSpace` with names (see `LinearModel`); its `result` tells how it was made, what is
        doubtful and which rows and columns are zero and why.

    Raises:
        InputError: unknown name or method, bad width, a method that does not apply.
        FmuError, SimulationError: the model cannot be opened, initialised or evaluated.

    Source: the source report, chapter 3.
    """
    task = make_task(
        model,
        at=at,
        x0=x0,
        u0=u0,
        inputs=inputs,
        outputs=outputs,
        time=time,
        dx=dx,
        du=du,
        periods=tuple(periods) if periods is not None else None,
        btptol=btptol,
        period=period,
        points=points,
        order=order,
        continuous=continuous,
    )
    if not task.inputs:
        raise InputError(f"{task.model.name}: a linear model needs an input, and there is none; poles: workbench modes")
    return LinearModel(run(task, method))


def run(task: LinTask, method: str) -> LinResult:
    """Linearise with a method by name.

    Raises:
        InputError: unknown method, or it does not apply.
        FmuError, SimulationError: see `lin`.
    """
    if method != "auto" and method not in METHODS:
        raise InputError(f"method '{method}' is unknown; {suggest(method, ('auto', *METHODS))}")
    name, why = choose(task) if method == "auto" else (method, f"{method} was asked for")
    result = METHODS[name](task).because(why)
    notes = (*task.notes, *result.notes, *task.model.remarks())
    result = replace(result, notes=notes, point=named(task.model, result.point))
    if task.continuous and result.dt > 0.0:
        A, B = hold_inverse(result.A, result.B, result.dt)
        note = f"made continuous from a period of {result.dt:.6g} s, the input held over it"
        result = replace(result, A=A, B=B, dt=0.0, intersample=None, notes=(*result.notes, note))
    return result
