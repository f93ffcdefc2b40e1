"""Functions of matrices that linear models are made of: responses, balance, held inputs and back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError

__all__ = [
    "as_sparse",
    "balance",
    "exponentials",
    "held",
    "is_sparse",
    "light",
    "places_of",
    "product",
    "resolvent",
    "resolvents",
    "rounding_of_poles",
    "unheld",
]


# Matrices from this size on, with no more than this part of their entries, are eliminated as sparse ones.
_LARGE, _SPARSE = 128, 0.05
# Above so many operations (points · n³) one Schur form serves all points.
_DIRECT = 2e7
_AT_ZERO = 1e-9  # a sampled pole this small has decayed by nine decades within one sample
_ON_REAL_AXIS = 1e-9


def resolvent(A: Floats, right: NDArray[Any], points: Complex) -> Complex:
    """Return (pI − A)⁻¹ R at points p, shape (k, n, m); NaN where a point is a pole.

    Large sparse matrices are solved by sparse elimination at each point, with a step of refinement.
    Few points are solved by elimination, which keeps the digits of matrices of very different entries; for many, one
    Schur form of the balanced matrix serves all, and a step of refinement gives these digits back.

    Args:
        A: shape (n, n).
        right: R, shape (n, m).
        points: shape (k,).

    Source: N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., section 12.2 (one step of refinement
    in the same precision makes the backward error small entry by entry).
    """
    n, k = len(A), len(points)
    if not n or not k:
        return np.zeros((k, n, right.shape[1]), dtype=np.complex128)
    if is_sparse(A):
        return _by_sparse(A, [(right, "N")], points)[0]
    with np.errstate(all="ignore"):
        if k > 1 and k * n**3 > _DIRECT and np.isfinite(A).all():
            return _by_schur(A, right, points)
        try:
            result = np.linalg.solve(points[:, None, None] * np.eye(n) - A, right[None].astype(np.complex128))
            return np.asarray(result, dtype=np.complex128)
        except np.linalg.LinAlgError:  # on a pole
            if k == 1:
                return np.full((1, n, right.shape[1]), np.nan, dtype=np.complex128)
            return np.concatenate([resolvent(A, right, points[i : i + 1]) for i in range(k)])


def resolvents(A: Floats, right: NDArray[Any], left: NDArray[Any], points: Complex) -> tuple[Complex, Complex]:
    """Return (pI − A)⁻¹ R and (pI − Aᵀ)⁻¹ Lᵀ: what inputs do to states, and states to outputs; see `resolvent`.

    Args:
        A: shape (n, n).
        right: R, shape (n, m).
        left: L, shape (q, n).
        points: shape (k,).

    Returns:
        Shapes (k, n, m) and (k, n, q).
    """
    if len(points) and is_sparse(A):
        forth, back = _by_sparse(A, [(right, "N"), (left.T, "T")], points)
        return forth, back
    return resolvent(A, right, points), resolvent(A.T, left.T, points)


def is_sparse(A: Floats) -> bool:
    """Whether a matrix is so large, and has so few entries, that it is worth to keep to them.

    Args:
        A: shape (m, n).
    """
    return bool(len(A) >= _LARGE and np.count_nonzero(A != 0.0) <= _SPARSE * A.size and np.isfinite(A).all())


def as_sparse(A: Floats, form: str) -> Any:  # noqa: ANN401 - SciPy's sparse arrays have no types
    """Return a matrix as a sparse array; faster than SciPy, which looks at the entries as numbers.

    Args:
        A: shape (m, n).
        form: SciPy's name of it, "csc" or "csr".
    """
    from scipy.sparse import coo_array  # noqa: PLC0415  slow to import

    places = places_of(A)
    return coo_array((A[places], places), shape=A.shape).asformat(form)


def places_of(A: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of the entries that are not zero, row by row; faster than `np.nonzero` on numbers.

    Args:
        A: shape (m, n).
    """
    rows, columns = np.divmod(np.flatnonzero(A != 0.0), A.shape[1])
    return rows, columns


def light(A: Floats) -> Any:  # noqa: ANN401 - SciPy's sparse arrays have no types
    """Return a matrix as a sparse array where it is large and sparse: products with vectors, and `abs`, are as before.

    Args:
        A: shape (m, n).
    """
    return as_sparse(A, "csr") if is_sparse(A) else A


def product(matrix: Any, stack: NDArray[Any]) -> NDArray[Any]:  # noqa: ANN401 - SciPy's sparse arrays have no types
    """Return a matrix times each of some others, shape (k, n, m).

    Args:
        matrix: shape (n, n), as `light` gives it.
        stack: shape (k, n, m).
    """
    if isinstance(matrix, np.ndarray):
        return np.asarray(matrix @ stack)
    k, n, m = stack.shape
    flat = matrix @ stack.transpose(1, 0, 2).reshape(n, k * m)
    return np.asarray(flat).reshape(n, k, m).transpose(1, 0, 2)


def _by_sparse(A: Floats, sides: Sequence[tuple[NDArray[Any], str]], points: Complex) -> list[Complex]:
    """Return the solutions for several right sides, each of the matrix ("N") or of its transpose ("T")."""
    from scipy.sparse import eye_array  # noqa: PLC0415  slow to import
    from scipy.sparse.linalg import splu  # noqa: PLC0415

    inner, unit = as_sparse(A, "csc"), eye_array(len(A), format="csc")
    wanted = [np.asarray(right, dtype=np.complex128) for right, _ in sides]
    results = [np.full((len(points), *right.shape), np.nan, dtype=np.complex128) for right in wanted]
    for i, point in enumerate(points):
        matrix = (point * unit - inner).tocsc()
        try:
            factors = splu(matrix)
        except RuntimeError:  # on a pole
            continue
        for result, right, (_, way) in zip(results, wanted, sides, strict=True):
            first = factors.solve(right, way)
            applied = (matrix if way == "N" else matrix.T) @ first
            result[i] = first + factors.solve(right - applied, way)
    return results


def _by_schur(A: Floats, right: NDArray[Any], points: Complex) -> Complex:
    from scipy.linalg import schur  # noqa: PLC0415  slow to import

    balanced, scale = balance(A)
    # All points are columns of one matrix; with a stack of small matrices each step is slow.
    k, m = len(points), right.shape[1]
    over, p = np.tile(right / scale[:, None], k), np.repeat(points, m)

    def solved(r: NDArray[Any]) -> Complex:
        r = z.conj().T @ r
        x = np.zeros((len(A), k * m), dtype=np.complex128)
        for i in range(len(A) - 1, -1, -1):
            x[i] = (r[i] + t[i, i + 1 :] @ x[i + 1 :]) / (p - t[i, i])
        return np.asarray(z @ x, dtype=np.complex128)

    with one_thread():
        t, z = schur(balanced.astype(np.complex128), output="complex")
        x = solved(over)
        x = scale[:, None] * (x + solved(over - p * x + balanced @ x))
    return np.ascontiguousarray(x.reshape(-1, k, m).transpose(1, 0, 2))


def balance(A: Floats) -> tuple[Floats, Floats]:
    """Return A with states in units that make rows and columns alike in size, and the unit of each, shape (n,).

    The units are powers of 2, so that nothing is rounded: LAPACK's GEBAL.

    Args:
        A: shape (n, n).
    """
    if not len(A):
        return A, np.ones(0)
    from scipy.linalg import matrix_balance  # noqa: PLC0415  slow to import

    result: tuple[Any, Any] = matrix_balance(A, permute=False, separate=True)
    matrix, (scale, _) = result
    return np.ascontiguousarray(matrix, dtype=np.float64), np.asarray(scale, dtype=np.float64)


def rounding_of_poles(A: Floats, factor: float = 100.0) -> float:
    """Return what rounding may move eigenvalues by: a factor times eps times the norm of A in units that suit it.

    LAPACK balances before it looks for eigenvalues; in raw units, as pascals beside radians, the norm says nothing.

    Args:
        A: shape (n, n).
        factor: of eps.
    """
    return factor * float(np.finfo(float).eps) * float(np.linalg.norm(balance(A)[0])) if len(A) else 0.0


def held(A: Floats, B: Floats, dt: float) -> tuple[Floats, Floats]:
    """Return e^(A·dt) and ∫ e^(A·t) dt B over a period: what a continuous model does with its inputs held.

    Args:
        A: shape (n, n).
        B: shape (n, m).
        dt: period [s].

    Source: C. F. Van Loan, Computing integrals involving the matrix exponential, IEEE Trans. Automatic Control 23
    (1978): both are parts of the exponential of [A B; 0 0].
    """
    from scipy.linalg import expm  # noqa: PLC0415  slow to import

    n, m = B.shape
    full = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * dt)
    return np.asarray(full[:n, :n], dtype=np.float64), np.asarray(full[:n, n:], dtype=np.float64)


def unheld(A: Floats, B: Floats, dt: float) -> tuple[Floats, Floats]:
    """Return A and B of the continuous model whose samples with held inputs are those of a discrete A and B.

    The principal logarithm undoes `held`: of all continuous models the one whose poles lie below the Nyquist frequency.

    Args:
        A: shape (n, n).
        B: shape (n, m).
        dt: period [s].

    Raises:
        InputError: a pole at 0 or on the negative real axis, which no sampled real system has.
    """
    from scipy.linalg import logm  # noqa: PLC0415  slow to import, and seldom needed

    for pole in np.linalg.eigvals(A).tolist():
        if abs(pole) < _AT_ZERO:
            raise InputError(
                "no continuous model: a pole at z = 0 (a pure delay) has no continuous counterpart; keep the model "
                "discrete, or take the delay out with `delay` when identifying"
            )
        if pole.real < 0.0 and abs(pole.imag) <= _ON_REAL_AXIS * abs(pole):
            raise InputError(
                f"no continuous model: the pole at z = {pole.real:.6g} lies on the negative real axis, which no "
                "sampled continuous system of this order has; take a lower order or a shorter period"
            )
    n, m = B.shape
    full = np.real(logm(np.block([[A, B], [np.zeros((m, n)), np.eye(m)]]))) / dt
    return np.asarray(full[:n, :n], dtype=np.float64), np.asarray(full[:n, n:], dtype=np.float64)


def exponentials(stack: Floats) -> Floats:
    """Return e^M of each of many small matrices at once, shape (k, n, n).

    SciPy takes them one by one, at a millisecond for twenty. Scaling and squaring with the Padé approximant of order
    6, all scaled alike: the error of each is a few 1e-15 times the largest norm among them.

    Args:
        stack: shape (k, n, n).

    Source: N. J. Higham, Functions of Matrices, 10.3.
    """
    norm = float(np.max(np.abs(stack).sum(axis=1), initial=0.0))
    halved = max(0, math.ceil(math.log2(norm / 0.25))) if 0.25 < norm < math.inf else 0
    M = stack / 2.0**halved
    unit = np.broadcast_to(np.eye(stack.shape[-1]), stack.shape)
    square = M @ M
    fourth = square @ square
    even = unit + _PADE[1] * square + fourth @ (_PADE[3] * unit + _PADE[5] * square)
    odd = M @ (_PADE[0] * unit + _PADE[2] * square + _PADE[4] * fourth)
    result = np.asarray(np.linalg.solve(even - odd, even + odd), dtype=np.float64)
    for _ in range(halved):
        result = np.asarray(result @ result, dtype=np.float64)
    return result


# Coefficients of M, M², … in the numerator of the Padé approximant of order (6, 6).
_PADE = (1 / 2, 5 / 44, 1 / 66, 1 / 792, 1 / 15840, 1 / 665280)
