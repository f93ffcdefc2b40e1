"""What a trim tells about its end: the table of residuals, the open directions, one line in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.analysis.trim_family import null_space, readable
from workbench.analysis.trim_problem import Problem
from workbench.analysis.trim_result import NullDirection, Residual
from workbench.analysis.trim_solve import Solution

__all__ = ["directions", "in_words", "residual_table"]

_SHOWN = 4


def residual_table(problem: Problem, solution: Solution) -> tuple[Residual, ...]:
    """Return one residual for each equation, required ones first."""
    equations = (*problem.equations, *problem.floating)
    idle = [not row.any() for row in solution.jacobian]
    scaled = solution.residuals / solution.scales
    return tuple(
        Residual(name=e.name, value=v, unit=e.unit, scaled=s, required=e.required, idle=i)
        for e, v, s, i in zip(equations, solution.residuals.tolist(), scaled.tolist(), idle, strict=True)
    )


def directions(problem: Problem, solution: Solution) -> tuple[NullDirection, ...]:
    """Return the directions that the required equations leave open at the solution, in units."""
    if not problem.unknowns:
        return ()
    hard = solution.jacobian[: len(problem.equations)]
    basis = readable(null_space(hard))
    names = [k.slot.name for k in problem.unknowns]
    nominal = np.array([k.slot.nominal for k in problem.unknowns])
    columns = (basis * nominal[:, None]).T
    return tuple(
        NullDirection(components={n: float(c) for n, c in zip(names, col, strict=True) if c}) for col in columns
    )


def in_words(
    residuals: Sequence[Residual],
    nulls: Sequence[NullDirection],
    *,
    converged: bool,
    chosen: str,
    tolerance: float,
) -> str:
    """Return what came out, in one line.

    Args:
        residuals: at the end of the search.
        nulls: directions left open there.
        converged: whether every equation holds.
        chosen: how the member of a family was chosen.
        tolerance: of the scaled residuals.
    """
    if converged and not nulls:
        return "equilibrium found"
    if converged:
        open_ = "; ".join(", ".join(d.components) for d in nulls[:_SHOWN])
        more = f"; {len(nulls) - _SHOWN} more" if len(nulls) > _SHOWN else ""
        ways = "1 direction is" if len(nulls) == 1 else f"{len(nulls)} directions are"
        return f"a family of equilibria: {ways} left open ({open_}{more}); this one {chosen}"
    return f"no equilibrium found: {_what_is_left(residuals, tolerance)}"


def _what_is_left(residuals: Sequence[Residual], tolerance: float) -> str:
    bad = [r for r in residuals if r.required and not abs(r.scaled) <= tolerance]
    if not bad:
        return "nothing is left of the equations, but the model does not stay there"
    if any(r.value != r.value for r in bad):
        return "the model cannot be evaluated where the search begins"
    worst = sorted(bad, key=lambda r: -abs(r.scaled))[:_SHOWN]
    text = ", ".join(f"{r.name} is off by {r.value:.4g}{_unit(r)}" for r in worst)
    idle = [r.name for r in worst if r.idle]
    if not idle:
        return text
    verb = "do" if len(idle) > 1 else "does"
    why = "saturated, or an integrator with an input that is held"
    return f"{text}; {', '.join(idle)} {verb} not react to any unknown there ({why})"


def _unit(residual: Residual) -> str:
    return f" {residual.unit}" if residual.unit and residual.unit != "1" else ""
