"""From a sampled model to the continuous one behind it."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from workbench.errors import InputError
from workbench.session.base import Floats

__all__ = ["continuous_matrices"]

_AT_ZERO = 1e-9  # a pole this small has decayed by nine decades within one sample
_ON_AXIS = 1e-9


def continuous_matrices(A: Floats, B: Floats, dt: float) -> tuple[Floats, Floats]:
    """Return A and B of the continuous model whose samples under a held input are those of A and B.

    exp([Ac Bc; 0 0] dt) = [A B; 0 I] (Van Loan 1978), solved by the principal logarithm: of all continuous models the
    one whose poles lie below the Nyquist frequency.

    Args:
        A: shape (n, n).
        B: shape (n, m).
        dt: sampling interval [s].

    Raises:
        InputError: a pole at 0 or on the negative real axis, which no sampled real system has.
    """
    n, m = B.shape
    for pole in np.linalg.eigvals(A):
        _check(complex(pole))
    whole = np.block([[A, B], [np.zeros((m, n)), np.eye(m)]])
    logarithm = np.real(scipy.linalg.logm(whole)) / dt
    return np.asarray(logarithm[:n, :n]), np.asarray(logarithm[:n, n:])


def _check(pole: complex) -> None:
    if abs(pole) < _AT_ZERO:
        why = "a pole at z = 0 (a pure delay) has no continuous counterpart; take the delay out with `delay`"
    elif pole.real < 0.0 and abs(pole.imag) <= _ON_AXIS * abs(pole):
        why = (
            f"the pole at z = {pole.real:.6g} lies on the negative real axis, which no sampled continuous system of "
            "this order has; take a lower order or sample faster"
        )
    else:
        return
    raise InputError(f"no continuous model: {why}")
