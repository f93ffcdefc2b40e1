"""What a trim tells about its end: the table of residuals, the open directions, one line in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.point.trim.problem import TrimProblem, TrimUnknown
from workbench.point.trim.result import NullDirection, Residual
from workbench.point.trim.scales import pseudo_inverse
from workbench.point.trim.solve import Solution

__all__ = ["carried_along", "degenerate", "directions", "in_words", "residual_table", "without_influence"]

_SHOWN = 4
_ALSO_FAR = 0.1  # of the farthest way


def residual_table(problem: TrimProblem, solution: Solution) -> tuple[Residual, ...]:
    """Return one residual for each equation, required ones first."""
    equations = (*problem.equations, *problem.floating)
    idle = [not row.any() for row in solution.jacobian]
    scaled = solution.residuals / solution.verdict.scales
    return tuple(
        Residual(name=e.name, value=v, unit=e.unit, scaled=s, required=e.required, idle=i)
        for e, v, s, i in zip(equations, solution.residuals.tolist(), scaled.tolist(), idle, strict=True)
    )


def directions(problem: TrimProblem, solution: Solution) -> tuple[NullDirection, ...]:
    """Return the directions along which there are other solutions, in units."""
    return tuple(_direction(problem, solution, column) for column in solution.open.T)


def _direction(problem: TrimProblem, solution: Solution, column: Floats) -> NullDirection:
    pairs = zip(problem.unknowns, (column * solution.nominal).tolist(), strict=True)
    return NullDirection(components={k.slot.name: c for k, c in pairs if c})


def degenerate(problem: TrimProblem, solution: Solution) -> str:
    """Return a remark on directions in which the slopes vanish, but not along a family; "": there are none."""
    if not solution.flat.shape[1]:
        return ""
    ways = "; ".join(", ".join(_direction(problem, solution, c).components) for c in solution.flat.T[:_SHOWN])
    return f"the equilibrium is degenerate: slopes vanish there too ({ways}), and its position is less certain"


def in_words(
    problem: TrimProblem,
    solution: Solution,
    residuals: Sequence[Residual],
    nulls: Sequence[NullDirection],
    *,
    chosen: str,
) -> str:
    """Return what came out, in one line.

    Args:
        problem: what was solved.
        solution: where the search ended.
        residuals: there.
        nulls: directions left open there.
        chosen: how the member of a family was chosen.
    """
    if solution.converged and not nulls:
        return "equilibrium found"
    if solution.converged:
        open_ = "; ".join(", ".join(d.components) for d in nulls[:_SHOWN])
        more = f"; {len(nulls) - _SHOWN} more" if len(nulls) > _SHOWN else ""
        ways = "1 direction is" if len(nulls) == 1 else f"{len(nulls)} directions are"
        return f"a family of equilibria: {ways} left open ({open_}{more}); this one {chosen}"
    bad = [r for r, b in zip(residuals, solution.verdict.bad, strict=False) if b]
    if solution.verdict.ran_away:
        return f"no equilibrium found; the search diverged: {_way(problem, solution)} while {_gone(bad)}"
    if solution.verdict.faded:
        names = ", ".join(r.name for r in bad[:_SHOWN])
        return (
            f"no equilibrium found, but there may be one: {names} cannot be distinguished from rounding where the "
            "search ended"
        )
    return f"no equilibrium found: {_what_is_left(bad)}"


def _way(problem: TrimProblem, solution: Solution) -> str:
    """Return where the unknowns went that moved farthest."""
    start = np.array([k.start for k in problem.unknowns])
    moved = np.abs(solution.values - start) / np.maximum(solution.nominal, np.abs(start))
    first = [i for i in np.argsort(-moved).tolist() if moved[i] > _ALSO_FAR * moved.max()][:_SHOWN]
    return ", ".join(f"{problem.unknowns[i].slot.name} → {solution.values[i]:.4g}" for i in first)


def _gone(bad: Sequence[Residual]) -> str:
    return ", ".join(f"{r.name} → {r.value:.4g}{_unit(r)}" for r in bad[:_SHOWN])


def _what_is_left(bad: Sequence[Residual]) -> str:
    if not bad:
        return "the equations are satisfied, but a run from there does not confirm it (see the notes)"
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


# -- states that nothing depends on ---------------------------------------------------------------

_MOVES = (0.37, -1.3, 3.1)  # sizes of a state by which it is moved to see whether anything depends on it
_SAME = 1e-9  # of the change that an equation makes around the point


def without_influence(problem: TrimProblem, solution: Solution) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the states that do not rest where the search ended and on which no rate depends, their own neither.

    First those on which no output depends either, then the others.
    """
    n = len(problem.balance.states)
    moving = {
        e.row for e, bad in zip(problem.equations, solution.verdict.bad.tolist(), strict=False) if bad and e.row < n
    }
    here = problem.evaluate(solution.values)
    slots = (*problem.balance.states, *problem.balance.outputs)
    sizes = np.maximum(np.abs(here), [s.nominal for s in slots])
    sizes[[e.row for e in problem.equations]] = np.abs(solution.verdict.scales[: len(problem.equations)])
    level = max(_SAME, 10.0 * problem.balance.precision) * sizes
    hidden, shown = list[str](), list[str]()
    for place, unknown in enumerate(problem.unknowns):
        if unknown.column not in moving or np.isfinite([unknown.low, unknown.high]).any():
            continue
        size = _reach(float(solution.values[place]), unknown.slot.nominal)
        moved = [solution.values + part * size * (np.arange(len(problem.unknowns)) == place) for part in _MOVES]
        ends = np.array([problem.evaluate(values) for values in moved])
        same = np.asarray(np.abs(ends - here).max(axis=0) <= level)
        if same[:n].all():
            (hidden if same.all() else shown).append(unknown.slot.name)
    return tuple(hidden), tuple(shown)


# -- states carried along by floating ones -------------------------------------------------------

_STEP = 1e-4  # of the size of a state


def carried_along(problem: TrimProblem, solution: Solution) -> str:
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
    rows = {e.row: i for i, e in enumerate(problem.equations)}
    columns = [k.column for k in rest]
    slopes = solution.jacobian * solution.verdict.scales[:, None] / solution.nominal
    back = pseudo_inverse(slopes[np.ix_([rows[c] for c in columns], [problem.unknowns.index(k) for k in rest])])
    motion = np.zeros(n)
    motion[floating] = here[floating]
    sizes = np.array([_reach(x[s], problem.balance.states[s].nominal) for s in floating])
    part = _STEP * float(np.min(sizes / np.maximum(np.abs(here[floating]), 1e-300)))
    push = (problem.balance.evaluate(x + part * motion, u)[0] - here)[columns] / part
    behind = back @ (back @ push) / [_reach(x[c], problem.balance.states[c].nominal) for c in columns]
    return _carried(problem, rest, behind, floating, here) if np.isfinite(behind).all() else ""


def _carried(problem: TrimProblem, rest: list[TrimUnknown], behind: Floats, floating: list[int], here: Floats) -> str:
    far = [i for i in np.argsort(-np.abs(behind)).tolist() if abs(behind[i]) > 1.0][:_SHOWN]
    if not far:
        return ""
    moving = ", ".join(f"der({problem.balance.states[s].name}) = {here[s]:.4g}" for s in floating[:_SHOWN])
    carried = ", ".join(f"{rest[i].slot.name} by {abs(behind[i]):.2g} times its size" for i in far)
    return (
        f"floating states move ({moving}) and carry others along ({carried}); float only states on which these do "
        "not depend"
    )


def _reach(value: float, nominal: float) -> float:
    return max(abs(value), nominal)
