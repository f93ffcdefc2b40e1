"""A and C from the extended observability matrix; the size of A, and a stable one in its place."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from workbench.core.values.arrays import Floats

__all__ = ["STABLE_RADIUS", "radius", "shifted_observability", "stabilise"]


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


# -- a stable model in place of one that is not ---------------------------------------------------

# Poles outside the unit circle are mirrored at it, in the real Schur form (an orthogonal change of basis, so that well
# and badly separated poles are treated alike); B, D and x0 are estimated again afterwards, so that the fit is the best
# one for the new A. Mirroring keeps a pole's frequency and, up to a constant, the size of its frequency response. The
# alternative, a zero block below the shifted observability matrix (Chui & Maciejowski 1996), moves all poles, also the
# good ones.
STABLE_RADIUS = 1.0 - 1e-6  # poles at the unit circle itself are drawn in to here


def stabilise(A: Floats) -> tuple[Floats, int]:
    """Return A with all eigenvalues inside the unit circle, and how many were moved.

    Args:
        A: shape (n, n).
    """
    T, Q = scipy.linalg.schur(A, output="real")
    moved = 0
    for block in _blocks(T):
        size = float(np.sqrt(abs(np.linalg.det(T[block, block]))))
        size = size if T[block, block].shape == (2, 2) else size**2
        if size > STABLE_RADIUS:
            T[block, block] *= min(1.0 / size, STABLE_RADIUS) / size
            moved += T[block, block].shape[0]
    return (Q @ T @ Q.T, moved) if moved else (A, 0)


def _blocks(T: Floats) -> list[slice]:
    """Return the diagonal blocks of a real Schur form: one real eigenvalue or one complex pair each."""
    blocks, k = [], 0
    while k < len(T):
        size = 2 if k + 1 < len(T) and T[k + 1, k] != 0.0 else 1
        blocks.append(slice(k, k + size))
        k += size
    return blocks
