"""Algebraic loops: values that depend on each other without delay are found by Newton's method with damping."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.session.algebraic_error import unsolved

__all__ = ["AlgebraicLoop", "solve_loop"]


# Residual, of the largest magnitude that the value has had. Solutions go down to rounding where that is cheap: event
# indicators inside a loop must have one sign at one point, from wherever the solution came.
EXACT = 1e-15
CONVERGED = 1e-12  # enough if the kept Jacobian makes it no smaller
ACCEPTED = 1e-9  # enough if rounding lets it become no smaller
PASSED_ON = 2e-15  # of a value: its rounding, and that of what is computed from it
MAX_ITERATIONS = 50
SHORTEST = 1.0 / 1024.0  # damping
SLOW = 0.1  # a Jacobian that reduces the residual by less than this is found anew
PERTURBATION = 2.0**-26  # √ε
TINY = 1e-300
DAMPINGS = (0.0, 1e-6, 1e-3, 1.0)  # the first is Newton's method itself


@dataclass(frozen=True, eq=False)
class AlgebraicLoop:
    """One loop: residual r(v) = g(v) − v, where g is what the components answer to v.

    Attributes:
        respond: v, shape (m,) → g(v), shape (m,); leaves the components at v.
        labels: how messages name the m values.
        sizes: largest magnitude each value has had, shape (m,).
        typical: nominal values, shape (m,), for values that have always been zero.
        jacobian: ∂r/∂v, shape (m, m), kept from one solution to the next.
        known: whether `jacobian` can be used, shape (1,).
    """

    respond: Callable[[Floats], Floats]
    labels: Sequence[str]
    sizes: Floats
    typical: Floats
    jacobian: Floats
    known: NDArray[np.int32]


def solve_loop(loop: AlgebraicLoop, start: Floats, time: float) -> Floats:
    """Return the solution nearest to `start` that Newton's method finds, and leave the components at it.

    Newton's method with the Jacobian by differences, kept while it serves, and halving of steps that do not reduce
    the residual; where its matrix is singular, the method of Levenberg and Marquardt. Relations inside the components
    are those of the moment: at events the event iteration goes on until loop and relations agree. The twin of
    workbench/kernel/algebraic.c.

    Source: J. Dennis, R. Schnabel, Numerical Methods for Unconstrained Optimization and Nonlinear Equations, 1983,
    6.3 and 10.2.

    Args:
        loop: what is solved.
        start: first guess, shape (m,).
        time: for messages [s].

    Raises:
        SimulationError: no solution was found; the message names the values and the residual.
    """
    v = start.copy()
    g = loop.respond(v)
    fresh = False
    for _ in range(MAX_ITERATIONS):
        scale = _scale(loop, v, g)
        size = _norm(g - v, scale)
        if size <= EXACT:
            return _found(loop, v)
        if not loop.known[0]:
            _find_jacobian(loop, v, g, scale)
            fresh = True
        better = _step(loop, v, g, hard=size > CONVERGED)
        if better is not None:
            scale = _scale(loop, *better)
            if size > CONVERGED and _norm(better[1] - better[0], scale) > SLOW * _norm(g - v, scale):
                loop.known[0], fresh = 0, False
            v, g = better
        elif not fresh and size > CONVERGED:
            loop.known[0] = 0
        elif size <= ACCEPTED or _is_rounding(loop, v, g):
            loop.respond(v)
            return _found(loop, v)
        else:
            break
    residual = g - v
    worst = int(np.argmax(np.where(np.isfinite(residual), np.abs(residual) / _scale(loop, v, g), np.inf)))
    raise unsolved(loop.labels, loop.labels[worst], f"{v[worst]:.6g}", float(residual[worst]), time)


def _found(loop: AlgebraicLoop, v: Floats) -> Floats:
    np.maximum(loop.sizes, np.abs(v), out=loop.sizes)
    return v


def _scale(loop: AlgebraicLoop, v: Floats, g: Floats) -> Floats:
    magnitude = np.maximum(np.abs(v), np.where(np.isfinite(g), np.abs(g), 0.0))
    return np.maximum(np.maximum(loop.sizes, magnitude), TINY)


def _norm(r: Floats, scale: Floats) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.linalg.norm(r / scale))
    return size if np.isfinite(size) else np.inf


def _is_rounding(loop: AlgebraicLoop, v: Floats, g: Floats) -> bool:
    """Whether what is left is the rounding of the loop's values, passed on by the components.

    The scale of a value that has been 0 until now knows nothing of it, as behind a dead band that is just left.
    """
    scale = _scale(loop, v, g)
    noise = scale + np.abs(loop.jacobian + np.eye(len(v))) @ scale
    return bool((np.abs(g - v) <= PASSED_ON * noise).all())


def _find_jacobian(loop: AlgebraicLoop, v: Floats, g: Floats, scale: Floats) -> None:
    for j in range(len(v)):
        moved = v.copy()
        moved[j] += PERTURBATION * (scale[j] if scale[j] > TINY else loop.typical[j])
        loop.jacobian[:, j] = (loop.respond(moved) - g) / (moved[j] - v[j])
        loop.jacobian[j, j] -= 1.0
    loop.known[0] = 1


def _step(loop: AlgebraicLoop, v: Floats, g: Floats, *, hard: bool) -> tuple[Floats, Floats] | None:
    """Return the next v with g(v); None if no step reduces the residual.

    `hard`: try all that may help; else one step of Newton's, to come nearer to rounding.
    """
    for damping in DAMPINGS if hard else DAMPINGS[:1]:
        direction = _direction(loop, v, g, damping)
        better = None if direction is None else _along(loop, v, g, direction, SHORTEST if hard else 1.0)
        if better is not None:
            return better
    return None


def _direction(loop: AlgebraicLoop, v: Floats, g: Floats, damping: float) -> Floats | None:
    """Return Newton's direction; with damping that of Levenberg and Marquardt, in values relative to their scale."""
    scale = _scale(loop, v, g)
    moving = scale > TINY
    # So small that no elimination carries the rounding of others into a value that stays 0, which has no scale.
    still = EXACT * scale[moving].min(initial=np.inf) if not damping and moving.any() else loop.typical
    scale = np.where(moving, scale, still)
    matrix, right = loop.jacobian * scale / scale[:, None], (v - g) / scale
    if damping:
        square = matrix.T @ matrix
        matrix, right = square + damping * np.max(np.diag(square)) * np.eye(len(v)), matrix.T @ right
    try:
        direction: Floats = scale * np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return None
    return direction if np.isfinite(direction).all() else None


def _along(
    loop: AlgebraicLoop, v: Floats, g: Floats, direction: Floats, shortest: float
) -> tuple[Floats, Floats] | None:
    """Go along a direction as far as the residual becomes smaller."""
    part = 1.0
    while part >= shortest:
        new = v + part * direction
        answer = loop.respond(new)
        scale = np.maximum(_scale(loop, v, g), _scale(loop, new, answer))
        if _norm(answer - new, scale) < (1.0 - 1e-4 * part) * _norm(g - v, scale):
            return new, answer
        part *= 0.5
    return None
