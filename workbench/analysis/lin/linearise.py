"""Linearise a model at a point."""

from __future__ import annotations

from dataclasses import replace

from workbench.analysis.lin.auto import choose
from workbench.analysis.lin.methods import METHODS
from workbench.analysis.lin.request import Lin
from workbench.analysis.lin.result import LinResult
from workbench.analysis.lin.task import LinTask, make_task
from workbench.core.job import Job
from workbench.core.matrices import unheld
from workbench.errors import InputError
from workbench.model import Model
from workbench.model.placing import named

__all__ = ["linearise", "run"]


def linearise(model: Model, asked: Lin, _job: Job) -> LinResult:
    """Linearise a model; see `Lin`."""
    task = make_task(model, asked)
    if not task.inputs:
        raise InputError(
            f"{task.model.name}: a linear model needs an input, and there is none; for poles use workbench modes"
        )
    return run(task, asked.method)


def run(task: LinTask, method: str) -> LinResult:
    """Linearise with a method by name, one of `METHOD_NAMES`.

    Raises:
        InputError: it does not apply.
        FmuError, SimulationError: see `lin`.
    """
    name, why = choose(task) if method == "auto" else (method, f"{method} was asked for")
    result = METHODS[name](task).because(why)
    notes = (*task.notes, *result.notes, *task.model.remarks())
    result = replace(result, notes=notes, point=named(task.model, result.point))
    if task.continuous and result.dt > 0.0:
        A, B = unheld(result.A, result.B, result.dt)
        note = f"converted to continuous time from a period of {result.dt:.6g} s, the input held over it"
        result = replace(result, A=A, B=B, dt=0.0, intersample=None, notes=(*result.notes, note))
    return result
