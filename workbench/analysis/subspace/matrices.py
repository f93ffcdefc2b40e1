"""A and C from the extended observability matrix; the size of A."""

from __future__ import annotations

import numpy as np

from workbench.session.base import Floats

__all__ = ["radius", "shifted_observability"]


def shifted_observability(observability: Floats, outputs: int) -> tuple[Floats, Floats]:
    """Return A and C of the extended observability matrix [C; C A; C A²; …] by its shift (Kung 1978).

    In trials with noise at the output this was as good as the regression on the state sequence with all future
    inputs (Van Overschee & De Moor 1996, figure 4.8), and as exact without noise.

    Args:
        observability: shape (i p, n).
        outputs: p.
    """
    upper, below = observability[:-outputs], observability[outputs:]
    A = np.asarray(np.linalg.lstsq(upper, below, rcond=None)[0], dtype=np.float64)
    return A, observability[:outputs]


def radius(A: Floats) -> float:
    """Return the largest magnitude of an eigenvalue.

    Args:
        A: shape (n, n).
    """
    return float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0))
