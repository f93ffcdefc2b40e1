"""The estimator of a bootstrap: the same identification again, on another record."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from workbench.analysis.subspace import SubspaceEstimate, estimate
from workbench.session.base import Floats

__all__ = ["Estimator", "same_settings"]

Complex = NDArray[np.complex128]

# Of u (N, m) and y (N, p), operating point taken off → poles, shape (n,).
Estimator = Callable[[Floats, Floats], Complex]


def same_settings(result: SubspaceEstimate) -> Estimator:
    """Return what identifies poles as `result` was made: method, basis, order, horizon, delay, bias.

    The horizon is that which was taken; replicates do not search for one again. Poles outside the unit circle stay
    there, also where the result's were moved: a region that reaches across the circle is to be seen.

    Args:
        result: of the subspace identification.
    """
    delay = result.model.delay or 0

    def poles(u: Floats, y: Floats) -> Complex:
        found = estimate(
            u,
            y,
            result.model.dt,
            order=result.order,
            method=result.method,
            basis=result.basis,
            horizon=result.horizon,
            delay=delay,
            biased=result.biased,
        )
        return found.model.poles

    return poles
