"""Linear models of so many states that only some of their poles are found."""

from __future__ import annotations

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.matrices import is_sparse
from workbench.core.values.poles import continuous, vanished
from workbench.errors import SimulationError

__all__ = ["corners_hz", "is_large", "poles_about"]

_LARGE = 1000  # states: up to here dense algebra takes a second
_SHOWN = 50  # so many poles are found, one of each pair


def is_large(A: Floats, dt: float) -> bool:
    """Whether there are so many states, and so few entries, that dense algebra takes longer than all the rest.

    Args:
        A: shape (n, n).
        dt: period [s]; 0: continuous. Discrete models have all of their poles found.
    """
    return dt == 0.0 and len(A) > _LARGE and is_sparse(A)


def poles_about(A: Floats, frequency_hz: float) -> Complex:
    """Return the poles of dx/dt = A x nearest to ±j2πf, shape (k,) [1/s], by `workbench.core.values.modal.poles_near`.

    Where its Arnoldi method does not converge all are found, and these taken.

    Args:
        A: shape (n, n), large and sparse.
        frequency_hz: f [Hz].
    """
    from workbench.core.values.modal import poles_near  # noqa: PLC0415  slow to import

    try:
        result = poles_near(A, _SHOWN, frequency_hz).value
    except SimulationError:
        with one_thread():
            every = np.linalg.eigvals(A).astype(np.complex128)
        upper = every[every.imag >= 0.0]
        result = upper[np.argsort(np.abs(upper - 2j * np.pi * frequency_hz))[:_SHOWN]]
    return np.concatenate([result, result[result.imag > 0.0].conj()])


def corners_hz(poles: Complex, A: Floats, dt: float, *, least: float = 0.0) -> tuple[float, float] | None:
    """Return the lowest and the highest natural frequency [Hz], of a large model a bound of it; None: there is none.

    Args:
        poles: all, or of a large model the slowest, shape (k,).
        A: shape (n, n).
        dt: period [s]; 0: continuous.
        least: what is no higher counts as 0 [Hz].
    """
    sizes = np.abs(continuous(poles[~vanished(poles, dt)], dt)) / (2.0 * np.pi)
    known = sizes[(sizes > least) & np.isfinite(sizes)]
    if not len(known):
        return None
    # No eigenvalue is larger than the norm.
    bound = float(np.abs(A).sum(axis=1).max()) / (2.0 * np.pi) if is_large(A, dt) else 0.0
    return float(known.min()), max(float(known.max()), bound)
