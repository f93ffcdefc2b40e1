"""Upper bound of the structured singular value of a matrix, with the scalings that prove it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, eigh

from workbench.core.values.arrays import Complex
from workbench.loops.mu.blocks import MuBlock
from workbench.loops.mu.centre import improved

__all__ = ["Scaling", "bound_of", "upper_bound"]


_LARGEST_G = 1000.0  # beside D, of a matrix of size 1: a bound is widened within 1/2000 of where M is real
_LOST = 1.01  # relative: a bound that a limit of G makes so much larger is sought again


@dataclass(frozen=True, eq=False)
class Scaling:
    """What proves an upper bound β of µ(M): Mᴴ D M + j (G M - Mᴴ G) ≤ β² D.

    Attributes:
        bound: β.
        d: D, positive definite, shape (n, n); it commutes with every perturbation of the structure.
        g: G, Hermitian, likewise; 0 in complex blocks.
    """

    bound: float
    d: Complex
    g: Complex


def upper_bound(matrix: Complex, blocks: Sequence[MuBlock], *, enough: float = 0.0, full: bool = True) -> Scaling:
    """Return an upper bound of µ(M), the inverse of the size of the smallest Δ with det(I - M Δ) = 0.

    The scalings are those of SLICOT's AB13MD, whose real blocks are single numbers: a number that stands several times
    on the diagonal is there several numbers, which is a larger set. For these D and G have full blocks, found from
    there by Newton's method, and where G is too large. The bound is computed from the scalings, so that it holds
    whatever they are.

    Args:
        matrix: M, shape (n, n).
        blocks: the structure.
        enough: a bound as small as this is not improved.
        full: whether to look for full blocks.

    Source: M. K. H. Fan, A. L. Tits, J. C. Doyle, Robustness in the presence of mixed parametric uncertainty and
    unmodeled dynamics, IEEE Trans. Automatic Control 36 (1991).
    """
    n = len(matrix)
    identity, zero = np.eye(n, dtype=np.complex128), np.zeros((n, n), dtype=np.complex128)
    plain = Scaling(bound_of(matrix, identity, zero), identity, zero)
    if plain.bound <= enough or not np.isfinite(plain.bound):
        return plain
    found = _diagonal(matrix / plain.bound, blocks, plain.bound)
    complex_only = Scaling(bound_of(matrix, found.d, zero), found.d, zero)
    result = min(plain, complex_only, _limited(matrix, found), key=lambda s: s.bound)
    lost = result.bound > _LOST * found.bound
    if full and result.bound > enough and (lost or any(b.real and b.size > 1 for b in blocks)):
        size = plain.bound
        for least in dict.fromkeys((enough, 0.0)):
            d, g = improved(matrix / size, blocks, result.d, result.g / size, enough=least / size)
            found = _limited(matrix, Scaling(bound_of(matrix, d, g * size), d, g * size))
            result = min(result, found, key=lambda s: s.bound)
            if result.bound <= enough:
                break  # else G was too large where the search ended, and it is smaller farther on
    return result


def _limited(matrix: Complex, scaling: Scaling) -> Scaling:
    """Return the scalings with a G that is not large beside D.

    Where M is nearly real µ of real numbers is not continuous in the frequency. A G that grows there without limit
    would prove less and less of an interval, and in the end what rounding makes of it.
    """
    values, vectors = np.linalg.eigh(scaling.d)
    if not (np.isfinite(values).all() and values[0] > 0.0):
        return Scaling(np.inf, np.eye(len(matrix), dtype=np.complex128), np.zeros_like(matrix, dtype=np.complex128))
    root = (vectors * np.sqrt(values)) @ vectors.conj().T
    inverse = (vectors / np.sqrt(values)) @ vectors.conj().T
    most = _LARGEST_G * float(np.linalg.norm(root @ matrix @ inverse, 2))
    sizes, turned = np.linalg.eigh(inverse @ scaling.g @ inverse)
    if float(np.abs(sizes).max(initial=0.0)) <= most:
        return scaling
    g = root @ (turned * np.clip(sizes, -most, most)) @ turned.conj().T @ root
    return Scaling(bound_of(matrix, scaling.d, g), scaling.d, g)


def bound_of(matrix: Complex, d: Complex, g: Complex) -> float:
    """Return the least β that scalings prove; infinite: they prove nothing.

    Args:
        matrix: M, shape (n, n).
        d: D of `Scaling`.
        g: G of `Scaling`.
    """
    left = matrix.conj().T @ d @ matrix + 1j * (g @ matrix - matrix.conj().T @ g)
    if not (np.isfinite(left).all() and np.isfinite(d).all()):
        return np.inf
    try:
        largest = float(eigh(left, d, eigvals_only=True)[-1])
    except LinAlgError:
        return np.inf
    return float(np.sqrt(max(largest, 0.0)))


def _diagonal(matrix: Complex, blocks: Sequence[MuBlock], size: float) -> Scaling:
    """Return the scalings of AB13MD, for a matrix divided by its size."""
    from slycot import ab13md  # noqa: PLC0415 - slow to import
    from slycot.exceptions import SlycotError  # noqa: PLC0415

    n = len(matrix)
    if n == 1 and blocks[0].real:  # AB13MD says 0, also where M is real
        turned = float(matrix[0, 0].imag)
        g = np.array([[abs(matrix[0, 0]) ** 2 / (2.0 * turned) if abs(turned) > 1e-9 else 0.0]], dtype=np.complex128)
        d = np.ones((1, 1), dtype=np.complex128)
        return Scaling(size * bound_of(matrix, d, g), d, size * g)
    sizes = [1 if b.real else b.size for b in blocks for _ in range(b.size if b.real else 1)]
    types = [1 if b.real else 2 for b in blocks for _ in range(b.size if b.real else 1)]
    try:
        _, d, g, _ = ab13md(matrix, np.array(sizes), np.array(types))
    except SlycotError:
        return Scaling(np.inf, np.eye(n, dtype=np.complex128), np.zeros((n, n), dtype=np.complex128))
    squared = np.diag(d.astype(np.complex128) ** 2)
    squared /= np.abs(squared).max()
    turn = np.diag(g.astype(np.complex128)) / np.abs(d).max() ** 2
    return Scaling(size * bound_of(matrix, squared, turn), squared, size * turn)
