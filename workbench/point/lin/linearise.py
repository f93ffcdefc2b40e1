"""Linearise a model at a point."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.values.matrices import unheld
from workbench.errors import InputError, WorkbenchError
from workbench.jobs.job import Job
from workbench.model import Model
from workbench.model.described_model import DescribedModel
from workbench.model.operating_point import named
from workbench.model.sample_rates import NoRatesError
from workbench.point.lin.difference import difference
from workbench.point.lin.exact import NoDerivativesError, exact
from workbench.point.lin.kalman_bertram import kalman_bertram, period_map
from workbench.point.lin.period_map import NotSettableError
from workbench.point.lin.request import Lin
from workbench.point.lin.response import response
from workbench.point.lin.result import LinResult
from workbench.point.lin.task import HELD, LinTask, make_task, open_base

if TYPE_CHECKING:
    from workbench.system.description import Component

__all__ = ["METHODS", "choose", "linearise", "plain", "run"]

METHODS: Mapping[str, Callable[[LinTask], LinResult]] = {
    "exact": exact,
    "difference": difference,
    "kalman-bertram": kalman_bertram,
    "response": response,
}


def linearise(model: Model, request: Lin, job: Job) -> LinResult:
    """Linearise a model; see `Lin`."""
    task = replace(make_task(model, request), job=job)
    if not task.inputs and not _shows_states(task):
        raise InputError(
            f"{task.model.name}: a linear model needs an input or states, and this interface shows neither; "
            f"{task.model.way_out()}"
        )
    result = replace(run(task, request.method), about_hz=request.about)
    if result.shows_all_poles:
        return result
    some = (
        f"{len(result.A)} states: of the poles only those nearest to {request.about:g} Hz are shown, found by the "
        "Arnoldi method with shift and inversion; whether another one is unstable is not known"
    )
    return replace(result, notes=(*result.notes, some))


def run(task: LinTask, method: str) -> LinResult:
    """Linearise with a method by name, one of `METHOD_NAMES`.

    Raises:
        InputError: it does not apply.
        FmuError, SimulationError: see `lin`.
    """
    if _is_system(task.model):
        from workbench.point.lin.delayed import has_delays, through_delays  # noqa: PLC0415 - see `_is_system`

        if has_delays(task.model):
            return through_delays(task, lambda opened: plain(opened, method))
    return plain(task, method)


def plain(task: LinTask, method: str) -> LinResult:
    """Linearise as `run`, with what a transport delay shows at the point: what it stands at passes through.

    Args:
        task: the linearisation.
        method: one of `METHOD_NAMES`.
    """
    result = _automatic(task) if method == "auto" else METHODS[method](task).because(f"{method} was asked for")
    if HELD in result.notes and method != "auto" and _can_be_included(task):
        included = f"{HELD}; kalman-bertram includes them"
        result = replace(result, notes=tuple(included if note == HELD else note for note in result.notes))
    notes = (*task.notes, *result.notes, *_of_history(task.model), *task.model.remarks())
    result = replace(result, notes=notes, operating_point=named(task.model, result.operating_point))
    if task.continuous and result.dt > 0.0:
        A, B = unheld(result.A, result.B, result.dt)
        note = f"converted to continuous time from a period of {result.dt:.6g} s, the input held over it"
        result = replace(result, A=A, B=B, dt=0.0, intersample=None, notes=(*result.notes, note))
    return result


def _automatic(task: LinTask) -> LinResult:
    """Linearise by the method that `choose` finds; by differences where it gets no rates, derivatives or states set.

    Args:
        task: the linearisation.
    """
    name, why = choose(task)
    try:
        return METHODS[name](task).because(why)
    except NoDerivativesError as error:
        instead = f"auto: the FMU offers directional derivatives, but they fail: {error.__cause__}"
    except (NoRatesError, NotSettableError) as error:
        if not (_shows_states(task) or _has_history(task.model)):
            raise
        instead = f"auto: {str(error).partition(';')[0]}; what is discrete is held"
    return METHODS["difference"](task).because(instead)


def _can_be_included(task: LinTask) -> bool:
    """Return whether the map over a period can be had: there are rates, and the FMU starts where it is set."""
    try:
        setting, _ = period_map(task)
        setting.run(np.zeros(len(setting.names)))
    except WorkbenchError:
        return False
    return True


def _has_history(model: Model) -> bool:
    return isinstance(model, DescribedModel) and model.description.has_history


def _of_history(model: Model) -> list[str]:
    if not _has_history(model):
        return []
    note = (
        "delay() in an FMU: the linear model has none of its delays, at the start as if they were 0, later as if what "
        "comes out of them stood still; nfr has them, and a block `delay` of a system file is exact here, too"
    )
    return [note]


def _shows_states(task: LinTask) -> bool:
    """Whether there are continuous states to linearise by; FMI 1.0 shows them to a session only."""
    if task.model.interface == "cs" or task.model.states:
        return task.model.interface != "cs"
    with open_base(task) as point:
        return bool(point.states)


# -- choose a method and say why -------------------------------------------------------------------


def choose(task: LinTask) -> tuple[str, str]:
    """Return the name of the method for a task, and the reason in one line.

    Co-simulation shows no states: response. Time events and discrete states or sampled blocks: kalman-bertram, or
    difference where it finds no rates. Given widths: difference. Directional derivatives: exact. Else difference.

    Args:
        task: the linearisation.

    Raises:
        InputError, SimulationError: the model cannot be evaluated at the point.
    """
    if task.model.interface == "cs":
        return "response", "auto: a co-simulation interface provides neither states nor derivatives"
    try:
        point = open_base(task)
    except InputError:
        if task.model.states:
            raise
        return "response", "auto: the model provides no states"
    with point:
        # Without states, time events mean that something is sampled, unless they are those of a delay().
        no_states = not point.states and not _has_history(task.model)
        if len(point.ticks(1, np.inf)) and (point.memory or no_states or _has_samplers(task.model)):
            return "kalman-bertram", "auto: the model has time events and discrete states"
        if task.dx is not None or task.du is not None:
            return "difference", "auto: widths are given"
        if why := point.why_not_exact():
            return "difference", f"auto: {why}"
    return "exact", "auto: the FMU offers directional derivatives"


def _has_samplers(model: Model) -> bool:
    """Whether a system has sampled blocks; a hold has no discrete state, but what it holds is one."""
    if not _is_system(model):
        return False
    from workbench.system.description import SystemDescription  # noqa: PLC0415 - see `_is_system`

    system = getattr(model, "system", None)
    return isinstance(system, SystemDescription) and any(map(_is_sampled, system.components))


def _is_system(model: Model) -> bool:
    """Whether a model is a system; what systems consist of is imported for them alone."""
    return getattr(model, "system", None) is not None


def _is_sampled(component: Component) -> bool:
    from workbench.system.description import BlockComponent, LinearComponent  # noqa: PLC0415 - see `_is_system`

    if isinstance(component, BlockComponent):
        result = component.block.matrices()
        return result is not None and result.dt > 0.0
    return isinstance(component, LinearComponent) and component.dt > 0.0
