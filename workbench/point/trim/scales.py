"""Sizes of unknowns that have neither a nominal value nor a start value: read off the model."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.point.scales import straight_over
from workbench.point.trim.problem import TrimProblem

__all__ = ["clear_of_zero", "pseudo_inverse", "resized", "sized"]

_FAR = 1e3  # a step is taken as size where it differs from 1 by more than this factor
_NARROW = 0.03  # a width is taken as size below this
_ROUNDS = 20
_NEAR = 1e-3  # nominal values: width of the slopes of the first step
_CLEARLY = 16.0  # times a rounding error
_EPS = float(np.finfo(np.float64).eps)


def sized(problem: TrimProblem) -> TrimProblem:
    """Return the problem with a nominal value from the model for each unknown that has none.

    It is the largest width, from 1 downwards, over which the equations are straight: their slope over it is that over
    a tenth of it. Where they are straight up to about 1, it is the first Gauss-Newton step if that is off from 1 by a
    factor of 1000: states of 1e-9 mol or 1e7 Pa that start at 0.

    Args:
        problem: its unknowns at their start.
    """
    silent = [i for i, k in enumerate(problem.unknowns) if not k.slot.known]
    here = _values(problem, np.zeros(len(problem.unknowns)))
    if not silent or not np.isfinite(here).all():
        return problem
    widths = np.ones(len(problem.unknowns))
    for i in silent:
        widths[i] = straight_over(partial(_slope, problem, here, i), here, 1.0)
    steps = _first_step(problem, here, silent, widths)
    sizes = {i: float(widths[i]) for i in silent if widths[i] < _NARROW}
    far = {i: s for i, s in steps.items() if s > _FAR or 0.0 < s * _FAR < 1.0}
    return resized(problem, {**far, **sizes})


def resized(problem: TrimProblem, sizes: dict[int, float]) -> TrimProblem:
    """Return the problem with other nominal values of unknowns, and of the rates of these.

    Args:
        problem: as it is.
        sizes: position of an unknown → its nominal value.
    """
    if not sizes:
        return problem
    unknowns = tuple(
        replace(k, slot=replace(k.slot, nominal=float(sizes[i]))) if i in sizes else k
        for i, k in enumerate(problem.unknowns)
    )
    by_row = {problem.unknowns[i].column: float(s) for i, s in sizes.items()}
    states = len(problem.balance.states)
    rates = [
        tuple(replace(e, nominal=by_row[e.row]) if e.row < states and e.row in by_row else e for e in group)
        for group in (problem.equations, problem.floating)
    ]
    return replace(problem, unknowns=unknowns, equations=rates[0], floating=rates[1])


def _values(problem: TrimProblem, moved: Floats) -> Floats:
    start = np.array([k.start for k in problem.unknowns])
    result = problem.evaluate(start + moved)
    return np.array([e.residual(result[e.row]) for e in problem.equations])


def _slope(problem: TrimProblem, here: Floats, i: int, width: float) -> Floats:
    """Return the slope of the equations over a width, to the side that the bounds allow."""
    moved = np.zeros(len(problem.unknowns))
    k = problem.unknowns[i]
    moved[i] = width if k.start + width <= k.high else -width
    return np.asarray((_values(problem, moved) - here) / moved[i], dtype=np.float64)


def _first_step(problem: TrimProblem, here: Floats, silent: list[int], widths: Floats) -> dict[int, float]:
    """Return the size of the first Gauss-Newton step of the unknowns without a size."""
    straight = [i for i in silent if widths[i] >= _NARROW]
    if not straight or not here.any():
        return {}
    nominal = np.array([k.slot.nominal for k in problem.unknowns]) * widths
    near = _NEAR * nominal
    slopes = [_slope(problem, here, i, near[i]) * nominal[i] for i in range(len(problem.unknowns))]
    jacobian = np.nan_to_num(np.column_stack(slopes))
    back = pseudo_inverse(jacobian)
    step = back @ -here
    error = np.abs(back) @ _left_open(problem, here, jacobian, step, nominal) + _dust(jacobian, here)
    return {i: float(abs(step[i]) * nominal[i]) for i in straight if abs(step[i]) > error[i]}


def _left_open(problem: TrimProblem, here: Floats, jacobian: Floats, step: Floats, nominal: Floats) -> Floats:
    """Return what rounding leaves of the equations after a step, shape (e,): a size is not to be read off that.

    The terms of an equation are known as well as it is computed, its slopes as their differences allow.

    Args:
        problem: what is solved.
        here: shape (e,), residuals before the step.
        jacobian: shape (e, k), differences over `_NEAR` nominal values.
        step: shape (k,), in nominal values.
        nominal: shape (k,).
    """
    start = np.array([k.start for k in problem.unknowns]) / nominal
    terms = np.abs(here) + np.abs(jacobian) @ (np.abs(start) + np.abs(step))
    error = max(_EPS, problem.balance.precision)
    return np.asarray(error * terms * (1.0 + 2.0 * np.abs(step).sum() / _NEAR))


def _dust(jacobian: Floats, here: Floats) -> Floats:
    """Return what rounding of the pseudo-inverse itself makes of a step, shape (k,): a relative ε·κ of its norm.

    Without it an unknown that no equation depends on, as the position at the end of an integrator, has a tiny step.
    """
    rows, columns = _even(jacobian)
    even = rows[:, None] * jacobian * columns
    norm = float(np.linalg.norm(np.linalg.pinv(even, rcond=1e-7)))
    return np.asarray(columns * (_EPS * float(np.linalg.norm(even)) * norm**2 * float(np.linalg.norm(rows * here))))


def clear_of_zero(jacobian: Floats, values: Floats, precision: float) -> NDArray[np.bool_]:
    """Return which values of a root are more than the errors of the equations' terms leave of a zero.

    Args:
        jacobian: shape (e, k), at the root.
        values: shape (k,), there, in the units of its columns.
        precision: relative error of a term; a model that integrates has more than rounding.
    """
    noise = max(_EPS, precision) * (np.abs(jacobian) @ np.abs(values))
    return np.asarray(np.abs(values) > _CLEARLY * (np.abs(pseudo_inverse(jacobian)) @ noise))


def pseudo_inverse(jacobian: Floats) -> Floats:
    """Return the pseudo-inverse; its rank is seen with rows and columns of even size."""
    rows, columns = _even(jacobian)
    even = rows[:, None] * jacobian * columns
    return np.asarray(columns[:, None] * np.linalg.pinv(even, rcond=1e-7) * rows)


def _even(matrix: Floats) -> tuple[Floats, Floats]:
    """Return factors of rows and of columns that make the largest entry of each about 1."""
    rows, columns = np.ones(matrix.shape[0]), np.ones(matrix.shape[1])
    for _ in range(_ROUNDS):
        rows = rows * _towards_one(np.abs(rows[:, None] * matrix * columns).max(axis=1, initial=0.0))
        columns = columns * _towards_one(np.abs(rows[:, None] * matrix * columns).max(axis=0, initial=0.0))
    return rows, columns


def _towards_one(largest: Floats) -> Floats:
    return np.asarray(1.0 / np.sqrt(np.where(largest > 0.0, largest, 1.0)))
