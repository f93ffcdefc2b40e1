"""What the integration of a model leaves in its estimated parameters."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import FmuError, InputError
from workbench.identification.calibrate.information import Information
from workbench.identification.calibrate.search import Estimate
from workbench.jobs.options import Workers
from workbench.jobs.runner_choice import at_work
from workbench.jobs.store import Store
from workbench.model import Model

__all__ = ["integration_shift", "note_of_integration"]

_TIGHTER = 1e-2  # of the tolerance: what is left of the error is a hundredth of it


def integration_shift(
    found: Estimate, known: Information, workers: Workers, store: Callable[[Model, ExitStack], Store | None]
) -> Floats:
    """Return how far each coordinate of an estimate is off because runs are integrated to a tolerance, shape (q,).

    At the estimate z the model is run with a hundredth of the tolerance. With e its whitened residuals there,
    J⁺ψ(e)/mean ψ' is the Gauss-Newton step that a search with exact runs would still make (Huber 1981, section 7.6;
    ψ(e) = e without a robust loss). Where noise is larger than what the integration leaves, the step is far below a
    standard error. Zeros: the tolerance is not known (a co-simulation integrates itself), or the model fails with
    another one.

    Args:
        found: the estimate.
        known: its information.
        workers: where runs are made.
        store: returns where runs of another model are kept, open until the stack ends.
    """
    problem, place = found.problem, found.problem.runs.place
    shift, recipe = np.zeros(len(found.z)), place.model.recipe
    if recipe is None or not problem.rtol or not known.free.any():
        return shift
    place.doing = "a run with a hundredth of the tolerance"
    try:
        with ExitStack() as stack:
            exact = stack.enter_context(recipe.tighter(_TIGHTER).open())
            runner = stack.enter_context(at_work(exact, workers, place.job))
            other = replace(place, model=exact, runner=runner, joint=None, store=store(exact, stack))
            e = replace(problem, runs=problem.runs.elsewhere(other)).residuals(found.z)
            place.count = other.count
    except (FmuError, InputError):  # it was opened before: one that cannot be a second time keeps its regions
        return shift
    J = problem.whitened(found.gradient)[0][:, known.free]
    if np.all(np.isfinite(e)):
        psi, slope = problem.loss.psi(e)
        shift[known.free] = np.linalg.lstsq(J, psi, rcond=None)[0] / float(np.mean(slope))
    return shift


def note_of_integration(found: Estimate, known: Information) -> str:
    """Return a note where the integration leaves more than the noise does; "": nowhere."""
    far = np.flatnonzero(known.free & ~known.open & (np.abs(known.shift) > known.errors))
    if not len(far):
        return ""
    names = ", ".join(found.problem.quantities[int(k)].name for k in far)
    return (
        f"{names}: the integration leaves more than the noise does; standard errors and regions hold it, and a smaller "
        "`tolerance` makes them narrower"
    )
