"""Search for an equilibrium: from the start values, else from where the model goes when it runs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.model import Model
from workbench.point.trim.balance import by_name
from workbench.point.trim.map import MapBalance
from workbench.point.trim.problem import TrimProblem
from workbench.point.trim.scaled import ScaledEquations
from workbench.point.trim.scales import clear_of_zero, resized
from workbench.point.trim.solve import Report, Solution, nobody, solve

__all__ = ["exact_agrees", "search"]

RUNS_S = (0.1, 1.0, 10.0, 100.0)  # [s] of continuous models
RUNS_PERIODS = (8, 64, 512)
AGREES = 1e-3  # of derivatives and differences: these are good to 1e-10 of a smooth equation
SMALL = 1e-3  # of the size that was assumed


def search(
    model: Model, problem: TrimProblem, *, tolerance: float, slowest: bool, exact: bool, report: Report = nobody
) -> tuple[Solution, str]:
    """Return the solution, and a note where it was found from the end of a run; else the best that was found.

    Slopes at the start values may lead nowhere (a rate limiter, a saturated actuator) while the model itself
    finds its way; it is then run with the inputs at their start, longer and longer, and the search begins again there.
    """
    start = problem.base[problem.columns]
    best = solve(problem, start, tolerance=tolerance, slowest=slowest, exact=exact, report=report)
    if best.converged:
        return _closer(problem, best, tolerance=tolerance, slowest=slowest, exact=exact), ""
    if not any(k.column < len(problem.balance.states) for k in problem.unknowns):
        return best, ""
    for moved, after in _elsewhere(model, problem):
        result = solve(problem, moved, tolerance=tolerance, slowest=slowest, exact=exact, report=report)
        if result.converged:
            result = _closer(problem, result, tolerance=tolerance, slowest=slowest, exact=exact)
            return result, f"found from the state of the model after running for {after}, not from the start values"
        best = min(best, result, key=_left)
    return best, ""


def _closer(problem: TrimProblem, solution: Solution, *, tolerance: float, slowest: bool, exact: bool) -> Solution:
    """Return the solution with the unknowns that came out far below their assumed sizes measured by what they are."""
    sizes = {
        i: abs(x)
        for i, (k, x) in enumerate(zip(problem.unknowns, solution.values.tolist(), strict=True))
        if not k.slot.declared and abs(x) < SMALL * k.slot.nominal
    }
    if not sizes or solution.open.shape[1] or solution.flat.shape[1]:
        return solution
    clear = clear_of_zero(
        solution.jacobian[: len(problem.equations)], solution.values / solution.nominal, problem.balance.precision
    )
    sizes = {i: size for i, size in sizes.items() if clear[i]}
    if not sizes:
        return solution
    again = solve(resized(problem, sizes), solution.values, tolerance=tolerance, slowest=slowest, exact=exact)
    return again if again.converged else solution


def _left(solution: Solution) -> float:
    worst = float(np.abs(solution.residuals / solution.verdict.scales).max(initial=0.0))
    return worst if worst == worst else np.inf  # noqa: PLR0124 - NaN


def _elsewhere(model: Model, problem: TrimProblem) -> Iterator[tuple[Floats, str]]:
    """Yield the unknowns after runs of growing length, and how long those were."""
    low, high = (np.array([getattr(k, name) for k in problem.unknowns]) for name in ("low", "high"))
    try:
        for states, after in _runs(model, problem):
            whole = problem.base.copy()
            whole[: len(states)] = states
            yield np.clip(whole[problem.columns], low, high), after
    except (SimulationError, InputError):  # it fails on the way: there is nothing further on
        return


def _runs(model: Model, problem: TrimProblem) -> Iterator[tuple[Floats, str]]:
    balance, n = problem.balance, len(problem.balance.states)
    states, inputs = problem.base[:n], problem.base[n:]
    if isinstance(balance, MapBalance):
        for periods in RUNS_PERIODS:
            yield balance.run(states, inputs, periods=periods)[-1][0], f"{periods} periods"
        return
    names = [s.name for s in balance.states]
    values = {**by_name(balance.states, states), **by_name(balance.inputs, inputs)}
    with model.open_at(values=values) as session:
        begin = session.time
        for seconds in RUNS_S:
            session.advance(begin + seconds, signals={})
            result = session.values(names)
            yield np.array([result[name] for name in names]), f"{seconds:g} s"


def exact_agrees(problem: TrimProblem) -> bool:
    """Whether the balance's Jacobian agrees with differences at the start, in one direction of all unknowns."""
    scaled = ScaledEquations(problem, exact=True)
    w = problem.base[problem.columns] / scaled.nominal
    direction = np.random.default_rng(1).choice([-1.0, 1.0], size=len(w))
    width = 1e-5 * np.maximum(1.0, np.abs(w))
    given = scaled.jacobian(w)
    ends = [scaled.residuals(w + sign * width * direction) for sign in (1.0, -1.0)]
    error = np.abs(given @ (2.0 * width * direction) - (ends[0] - ends[1]))
    return bool((error <= AGREES * (np.abs(given) @ (2.0 * width)) + 1e-12 * np.abs(ends[0])).all())
