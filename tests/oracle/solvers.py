"""Solvers for model exchange, by the names that the kernel has for them."""

from __future__ import annotations

from collections.abc import Mapping

from tests.oracle.algebraic import Algebraic
from tests.oracle.cvode import Gear
from tests.oracle.merson import KuttaMerson
from tests.oracle.solver import Solver, Tolerance

__all__ = ["SOLVERS", "Solver", "Tolerance"]

SOLVERS: Mapping[str, type[Solver]] = {"gear": Gear, "vkm": KuttaMerson, "none": Algebraic}
