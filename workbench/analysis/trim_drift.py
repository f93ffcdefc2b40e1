"""Whether states whose derivatives float let the others rest."""

from __future__ import annotations

import numpy as np

from workbench.analysis.trim_problem import Problem, Unknown
from workbench.analysis.trim_solve import Solution
from workbench.session.base import Floats

__all__ = ["carried_along"]

_STEP = 1e-4  # of the size of a state
_RANK = 1e-9
_SHOWN = 4


def carried_along(problem: Problem, solution: Solution) -> str:
    """Return which states cannot rest while floating ones move; "": they can, or very nearly.

    While the floating states f move, the others q follow: dq/dt = g(q, f) = 0 holds along q₀(f), which moves at
    q₁ = −(∂g/∂q)⁻¹ (∂g/∂f) df/dt, so they lag behind it by q₂ = (∂g/∂q)⁻¹ q₁. Where that is more than
    the size of a state (its value or its nominal value), the others do not rest at this point.

    Source: P. Kokotović, H. Khalil, J. O'Reilly, Singular Perturbation Methods in Control, 1986, section 1.5.
    """
    n = len(problem.balance.states)
    floating = [e.row for e in problem.floating if e.row < n]
    rest = [k for k in problem.unknowns if k.column < n and k.column not in floating]
    x, u = problem.at(solution.values)
    here = problem.balance.evaluate(x, u)[0]
    if not floating or not rest or not here[floating].any():
        return ""
    columns = [k.column for k in rest]
    reach = np.array([_reach(x[c], problem.balance.states[c].nominal) for c in columns])
    slopes = np.column_stack([_slope(problem, x, u, c, s)[columns] for c, s in zip(columns, reach, strict=True)])
    motion = np.zeros(n)
    motion[floating] = here[floating]
    sizes = np.array([_reach(x[s], problem.balance.states[s].nominal) for s in floating])
    part = _STEP * float(np.min(sizes / np.maximum(np.abs(here[floating]), 1e-300)))
    push = (problem.balance.evaluate(x + part * motion, u)[0] - here)[columns] / part
    scaled = slopes * reach / reach[:, None]
    behind = _solved(scaled, _solved(scaled, push / reach))
    return _words(problem, rest, behind, floating, here) if np.isfinite(behind).all() else ""


def _words(problem: Problem, rest: list[Unknown], behind: Floats, floating: list[int], here: Floats) -> str:
    far = [i for i in np.argsort(-np.abs(behind)).tolist() if abs(behind[i]) > 1.0][:_SHOWN]
    if not far:
        return ""
    moving = ", ".join(f"der({problem.balance.states[s].name}) = {here[s]:.4g}" for s in floating[:_SHOWN])
    carried = ", ".join(f"{rest[i].slot.name} by {abs(behind[i]):.2g} times its size" for i in far)
    return f"floating states move ({moving}) and carry others along ({carried}); float only what these do not depend on"


def _reach(value: float, nominal: float) -> float:
    return max(abs(value), nominal)


def _slope(problem: Problem, x: Floats, u: Floats, column: int, size: float) -> Floats:
    ends = []
    for side in (1.0, -1.0):
        moved = x.copy()
        moved[column] += side * _STEP * size
        ends.append(problem.balance.evaluate(moved, u)[0])
    return np.asarray((ends[0] - ends[1]) / (2.0 * _STEP * size), dtype=np.float64)


def _solved(matrix: Floats, right: Floats) -> Floats:
    """Return the solution of least norm, the rows made alike first."""
    largest = np.abs(matrix).max(axis=1, initial=0.0)
    rows = np.where(largest > 0.0, largest, 1.0)
    return np.asarray(np.linalg.lstsq(matrix / rows[:, None], right / rows, rcond=_RANK)[0], dtype=np.float64)
