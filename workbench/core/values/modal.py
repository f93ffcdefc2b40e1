"""Poles of a linear model with what tracking needs: both eigenvectors and how certain each pole is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig, schur
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.matrices import as_sparse, balance, is_sparse
from workbench.core.values.poles import VANISHED, continuous
from workbench.errors import SimulationError

__all__ = ["Poles", "at_rest", "poles_near", "poles_of", "uncertainty"]

_ROUNDING = 20.0
_LARGE = 300  # states; of fewer all poles are found as fast
_BESIDE = (1e-3, 3.7e-3)  # of its size, beside the point whose neighbours are looked for: if not the one, the other
_MOST = 3000  # states; of more not all poles are found instead: minutes, and gigabytes
_SMALLEST = 1e-9  # of the norm of A: what counts as the size of a pole at 0
_SAME = 1e-6  # relative: an eigenvalue of A and one of its transpose
_MORE = 4  # vectors than twice the poles wanted: an odd number of them halves a pair, and takes ten times as long
_MOST_EQUAL = 4  # eigenvalues that may coincide, as those of a chain of integrators


@dataclass(frozen=True, eq=False)
class Poles:
    """One pole of each conjugate pair, and the real ones; rising in frequency, then falling in real part.

    The vectors are scaled so that leftᴴ right = I.

    Attributes:
        value: shape (m,), imaginary parts ≥ 0 [1/s].
        right: right eigenvectors, shape (n, m).
        left: left eigenvectors, shape (n, m).
        uncertain: how far rounding may have moved each pole, shape (m,) [1/s].
    """

    value: Complex
    right: Complex
    left: Complex
    uncertain: Floats

    def __len__(self) -> int:
        return len(self.value)

    @property
    def real(self) -> NDArray[np.bool_]:
        """Which of them are real, shape (m,)."""
        return np.asarray(self.value.imag == 0.0)

    def nearest(self, count: int, aim: complex) -> Poles:
        """Return those that are nearest to a point, in the same order.

        Args:
            count: so many at most.
            aim: the point [1/s].
        """
        return self.some(np.argsort(np.abs(self.value - aim), kind="stable")[:count])

    def some(self, places: NDArray[np.intp]) -> Poles:
        """Return some of them, in the same order.

        Args:
            places: which.
        """
        kept = np.sort(places)
        return Poles(self.value[kept], self.right[:, kept], self.left[:, kept], self.uncertain[kept])

    def participation(self) -> Floats:
        """Return how much each state takes part in each mode, shape (n, m), columns with sum 1.

        Source: Pérez-Arriaga, Verghese & Schweppe, IEEE Trans. Power Apparatus and Systems 101 (1982), 3117-3125.
        """
        size = np.abs(self.left * self.right)
        total = size.sum(axis=0)
        return np.asarray(size / np.where(total > 0.0, total, 1.0), dtype=np.float64)


def poles_of(a: Floats, *, dt: float = 0.0, accuracy: float = 0.0) -> Poles:
    """Return the poles of dx/dt = A x, or those that the samples of x(k+1) = A x(k) show.

    Poles that coincide within rounding, such as the double zero of a rigid body, have no eigenvectors of their own:
    they get a basis of their common invariant subspace, and a pair that close to the real axis counts as two real ones.

    Args:
        a: shape (n, n).
        dt: 0 for a continuous model, else the period [s].
        accuracy: relative accuracy of the entries; 0: rounding.

    Source: uncertainty of an eigenvalue by its condition: Golub & Van Loan, Matrix Computations, 7.2.2; invariant
    subspaces by ordered Schur forms, 7.6.2.
    """
    if not len(a):
        none = np.zeros((0, 0), dtype=np.complex128)
        return Poles(np.zeros(0, dtype=np.complex128), none, none, np.zeros(0))
    with one_thread():
        balanced, scale = balance(a)
        value, left, right = (np.asarray(x, dtype=np.complex128) for x in eig(balanced, left=True, right=True))
        size = max(float(np.linalg.norm(balanced)), np.finfo(float).tiny)
        uncertain = _uncertain(size, value, left, right, accuracy)
        value = np.where(np.abs(value.imag) <= 2.0 * uncertain, value.real + 0.0j, value)
        along = np.einsum("ij,ij->j", left, right.conj())
        left = left / np.where(along == 0.0, 1.0, along)
        for members in _clusters(value, uncertain):
            right[:, members], left[:, members] = _bases(balanced, value, members)
    shown, uncertain = _continuous(value, uncertain, dt)
    keep = np.flatnonzero(value.imag >= 0.0)
    order = keep[np.lexsort((-shown[keep].real, shown[keep].imag))]
    right, left = (np.asarray(x, dtype=np.complex128) for x in (right * scale[:, None], left / scale[:, None]))
    return Poles(shown[order], right[:, order], left[:, order], uncertain[order])


def at_rest(a: Floats, poles: Complex, *, dt: float = 0.0) -> NDArray[np.bool_]:
    """Return which poles are 0 as far as rounding lets one know: integrators; a slow pole beside fast ones is none.

    Args:
        a: shape (n, n).
        poles: of it, all or some, as those of a continuous model, shape (m,) [1/s].
        dt: 0 for a continuous model, else the period [s].
    """
    # Rounding moves none by more: as many as may coincide, an ε^(1/m) of the norm.
    most = (_ROUNDING * np.finfo(float).eps) ** (1.0 / _MOST_EQUAL) * (
        1.0 / dt if dt > 0.0 else float(np.linalg.norm(a))
    )
    size = np.abs(poles)
    if not np.any((size > 0.0) & (size <= most)) or (is_sparse(a) and len(a) > _MOST):
        return np.asarray(size == 0.0)
    every = poles_of(a, dt=dt)
    upper = np.where(poles.imag < 0.0, poles.conj(), poles)
    nearest = np.argmin(np.abs(upper[:, None] - every.value), axis=1)
    return np.asarray(size <= every.uncertain[nearest])


def uncertainty(a: Floats, value: Complex, left: Complex, right: Complex) -> Floats:
    """Return how far rounding may have moved each eigenvalue, shape (n,).

    Args:
        a: shape (n, n).
        value: its eigenvalues, shape (n,).
        left: left eigenvectors in columns, of any length, shape (n, n).
        right: right eigenvectors, likewise.
    """
    balanced, scale = balance(a)
    left, right = left * scale[:, None], right / scale[:, None]
    left, right = (x / np.maximum(np.linalg.norm(x, axis=0), np.finfo(float).tiny) for x in (left, right))
    return _uncertain(max(float(np.linalg.norm(balanced)), np.finfo(float).tiny), value, left, right, 0.0)


def poles_near(a: Floats, count: int, about_hz: float = 0.0, *, dt: float = 0.0, accuracy: float = 0.0) -> Poles:
    """Return the poles of dx/dt = A x nearest to j2πf, or those that the samples of x(k+1) = A x(k) show.

    Of a large sparse matrix by the Arnoldi method on (A − σI)⁻¹, σ beside that point, with sparse elimination: time and
    memory grow with the entries, not with n³. Of others all are found, and these taken; also where the method leaves a
    doubt whether one that is as near is missing, as where several coincide.

    Args:
        a: shape (n, n).
        count: so many, of a pair the one with the positive imaginary part.
        about_hz: f [Hz].
        dt: 0 for a continuous model, else the period [s].
        accuracy: relative accuracy of the entries; 0: rounding.

    Source: R. Lehoucq, D. Sorensen, C. Yang, ARPACK Users' Guide, 1998, 3.2 (shift and invert).

    Raises:
        SimulationError: the Arnoldi method does not converge, and the states are too many to find all poles.
    """
    aim = 2j * np.pi * about_hz
    if not is_sparse(a) or len(a) < _LARGE or dt > 0.0 or 4 * (count + 2) > len(a):
        return poles_of(a, dt=dt, accuracy=accuracy).nearest(count, aim)
    from scipy.sparse.linalg import ArpackError  # noqa: PLC0415  slow to import

    why = "some coincide so nearly that the Arnoldi method does not tell them apart"
    with one_thread():
        balanced, scale = balance(a)
        for beside in _BESIDE:
            try:
                result, sure = _beside(balanced, count, aim, beside, accuracy)
            except (ArpackError, RuntimeError, np.linalg.LinAlgError) as error:
                why = str(error)
                continue
            if len(result) == count and np.abs(result.value - aim).max() < sure:
                units = scale[:, None]
                return replace(result, right=result.right * units, left=result.left / units)
    if len(a) > _MOST:
        raise SimulationError(f"the poles near {about_hz:g} Hz were not found: {why}")
    return poles_of(a, accuracy=accuracy).nearest(count, aim)


def _beside(a: Floats, count: int, aim: complex, beside: float, accuracy: float) -> tuple[Poles, float]:
    """Return the poles nearest to a point, of a balanced matrix, and the distance from where on some may be missing."""
    value, right, left, sure = _arnoldi(a, min(2 * count + 4, len(a) - 2), aim, beside)
    size = max(float(np.linalg.norm(a)), np.finfo(float).tiny)
    uncertain = _uncertain(size, value, left, right, accuracy)
    left = np.asarray(left @ np.linalg.inv(left.conj().T @ right).conj().T, dtype=np.complex128)
    value = np.where(np.abs(value.imag) <= 2.0 * uncertain, value.real + 0.0j, value)
    keep = np.flatnonzero(value.imag >= 0.0)
    order = keep[np.lexsort((-value[keep].real, value[keep].imag))]
    poles = Poles(value[order], right[:, order], left[:, order], uncertain[order])
    return poles.nearest(count, aim), sure


def _arnoldi(a: Floats, count: int, aim: complex, part: float) -> tuple[Complex, Complex, Complex, float]:
    """Return eigenvalues near a point with right and left vectors of length 1.

    Those whose left vector is not found are left out; the last value returned is how near the nearest of them is.
    """
    from scipy.sparse.linalg import eigs  # noqa: PLC0415

    # Of a real matrix and a complex σ ARPACK would take the real part of (A − σI)⁻¹, in which modes near σ may vanish.
    matrix = as_sparse(a, "csc").astype(np.complex128 if aim.imag else np.float64)
    start = np.random.default_rng(0).standard_normal(len(a))  # the same answer each time
    norm = float(abs(matrix).sum(axis=0).max())
    beside = aim + part * max(abs(aim), _SMALLEST * norm)  # on a pole there is no inverse
    sigma = beside if aim.imag else beside.real
    vectors = min(2 * count + _MORE, len(a))
    value, right = eigs(matrix, k=count, sigma=sigma, v0=start, ncv=vectors)
    other, left = eigs(matrix.T.tocsc(), k=count, sigma=sigma, v0=start, ncv=vectors)
    apart = np.abs(value[:, None] - other)
    rows, columns = linear_sum_assignment(apart)
    same = apart[rows, columns] <= _SAME * np.maximum(np.abs(value[rows]), _SMALLEST * norm)
    sure = float(np.min(np.abs(value[rows[~same]] - aim), initial=np.inf))
    value, right, left = value[rows[same]], right[:, rows[same]], left[:, columns[same]].conj()
    return value, right, left, sure


def _uncertain(size: float, value: Complex, left: Complex, right: Complex, accuracy: float) -> Floats:
    """Return how far each eigenvalue may be off: size of the error times condition.

    Of m eigenvalues that an error ε may have split, each is off by ε^(1/m) of the size of A at most (7.2.2, there).
    """
    relative = max(accuracy, _ROUNDING * np.finfo(float).eps)
    apart = np.sort(np.abs(value[:, None] - value), axis=1)
    most = relative ** (1.0 / np.arange(1, _MOST_EQUAL + 1))  # for 1, 2, … that coincide
    near = np.ones(len(value), dtype=np.intp)
    for m in range(2, min(_MOST_EQUAL, len(value)) + 1):
        near[apart[:, m - 1] <= size * most[m - 1]] = m
    bound = size * np.maximum(most[near - 1], most[1])
    along = np.maximum(np.abs(np.einsum("ij,ij->j", left.conj(), right)), np.finfo(float).tiny)
    return np.asarray(np.minimum(relative * size / along, bound), dtype=np.float64)


def _clusters(value: Complex, uncertain: Floats) -> list[list[int]]:
    """Return the sets of poles that coincide within rounding, conjugates apart."""
    near = np.abs(value[:, None] - value) <= 2.0 * np.maximum(uncertain[:, None], uncertain)
    count, label = connected_components(csr_matrix(near), directed=False)
    sets = [np.flatnonzero(label == k).tolist() for k in range(count)]
    return [s for s in sets if len(s) > 1]


def _bases(a: Floats, value: Complex, members: list[int]) -> tuple[Complex, Complex]:
    """Return bases of the right and left invariant subspace of a cluster, WᴴV = I, each of shape (n, members)."""
    centre, reach = value[members].mean(), float(np.abs(value[members] - value[members].mean()).max())
    others = np.delete(np.abs(value - centre), members)
    border = 0.5 * (reach + float(others.min())) if len(others) else np.inf

    def inside(pole: complex) -> bool:
        return bool(abs(pole - centre) <= border)

    def outside(pole: complex) -> bool:
        return inside(pole.conjugate())

    count = len(members)
    right = schur(a.astype(np.complex128), output="complex", sort=inside)[1][:, :count]
    left = schur(a.T.astype(np.complex128), output="complex", sort=outside)[1][:, :count]
    across = left.conj().T @ right
    return right, np.asarray(left @ np.linalg.inv(across).conj().T, dtype=np.complex128)


def _continuous(value: Complex, uncertain: Floats, dt: float) -> tuple[Complex, Floats]:
    """Return discrete poles as continuous ones; those that vanish within a sample have no end of damping."""
    if dt == 0.0:
        return value, uncertain
    size = np.maximum(np.abs(value), VANISHED)
    return continuous(value, dt), np.asarray(np.log1p(uncertain / size) / dt, dtype=np.float64)
