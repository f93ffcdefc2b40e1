"""Levenberg–Marquardt with a bound on the step (Nocedal, Wright, Numerical Optimization, 10.3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.core.values.arrays import Floats

Rows = Callable[[Floats], tuple[Floats, Floats]]

LARGEST_STEP = 1.0  # of any parameter, which are scaled
TRIALS = 7


def minimise(rows: Rows, start: Floats, *, damping: float, iterations: int, tolerance: float) -> tuple[Floats, float]:
    """Return where the sum of squares no longer falls by `tolerance` of itself, and the last damping.

    Args:
        rows: p ↦ (residuals, Jacobian); their number may change, for rows of inequalities that hold vanish.
        start: shape (n,).
        damping: first damping.
        iterations: at most.
        tolerance: relative decrease below which it ends.
    """
    p, (r, J) = start, rows(start)
    for _ in range(iterations):
        before = float(r @ r)
        hessian, slope = J.T @ J, J.T @ r
        for _ in range(TRIALS):
            step = -np.linalg.solve(hessian + damping * np.eye(len(p)), slope)
            step /= max(1.0, float(abs(step).max()) / LARGEST_STEP)
            tried = rows(p + step)
            if float(tried[0] @ tried[0]) < before:
                break
            damping *= 4.0
        else:
            return p, damping
        p, (r, J), damping = p + step, tried, max(damping / 3.0, 1e-5)
        if before - float(r @ r) < tolerance * before:
            break
    return p, damping
