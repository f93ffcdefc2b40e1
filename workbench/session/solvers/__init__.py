"""Solvers for model exchange: one table; `auto` takes the first that can be used."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.errors import FmuError, InputError, suggest
from workbench.session.solvers.algebraic import Algebraic
from workbench.session.solvers.base import Solver, Tolerance
from workbench.session.solvers.cvode import Gear
from workbench.session.solvers.cvode_library import why_missing
from workbench.session.solvers.merson import KuttaMerson

__all__ = ["SOLVERS", "Solver", "Tolerance", "choose_solver"]

SOLVERS: Mapping[str, type[Solver]] = {"gear": Gear, "vkm": KuttaMerson, "none": Algebraic}


def choose_solver(wanted: str, *, states: int) -> tuple[str, str]:
    """Return the name of the solver to use and a note about the choice (may be empty).

    Raises:
        InputError: unknown name.
        FmuError: `gear` is wanted where its libraries are missing.
    """
    if wanted != "auto" and wanted not in SOLVERS:
        raise InputError(f"solver '{wanted}' is unknown; {suggest(wanted, ('auto', *SOLVERS))}")
    if states == 0:
        return "none", "solver: none, the model has no continuous states"
    if wanted == "none":
        raise InputError(f"solver none: the model has {states} continuous states; use vkm or gear")
    if wanted == "gear" and why_missing():
        raise FmuError(f"solver gear is not available: {why_missing()}; use solver vkm")
    if wanted != "auto":
        return wanted, ""
    if why_missing():
        return "vkm", f"solver: vkm, because gear is not available: {why_missing()}"
    return "gear", "solver: gear (chosen by auto)"
