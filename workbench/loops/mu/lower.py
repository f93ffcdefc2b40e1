"""Lower bound of the structured singular value of a matrix, with the perturbation that attains it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Complex
from workbench.loops.mu.blocks import Block, places

__all__ = ["Attained", "attained_by", "lower_bound"]

_TURNS = 60  # of the power iteration
_REAL = 1e-7  # relative: an eigenvalue so near to the real axis is real


@dataclass(frozen=True, eq=False)
class Attained:
    """A lower bound of µ(M), and what attains it.

    Attributes:
        bound: β; 0: no perturbation was found.
        delta: Δ of norm 1/β with det(I - M Δ) = 0, shape (n, n).
    """

    bound: float
    delta: Complex


def lower_bound(matrix: Complex, blocks: Sequence[Block], *, starts: int = 4, seed: int = 0) -> Attained:
    """Return a lower bound of µ(M): by power iteration, and by the eigenvalues of M Δ for what it comes to.

    Where all blocks are real the iteration often comes to no end, and what it tells is little or nothing: 0.

    Args:
        matrix: M, shape (n, n).
        blocks: the structure.
        starts: number of starts, the first at the largest singular value.
        seed: of the random ones.

    Source: P. M. Young, J. C. Doyle, A lower bound for the mixed µ problem, IEEE Trans. Automatic Control 42 (1997).
    """
    best = Attained(0.0, np.zeros_like(matrix, dtype=np.complex128))
    for shape in _tried(matrix, blocks, starts, seed):
        found = attained_by(matrix, shape, blocks)
        best = max(best, found, key=lambda a: a.bound)
    return best


def attained_by(matrix: Complex, shape: Complex, blocks: Sequence[Block]) -> Attained:
    """Return the bound that a perturbation of norm 1 proves, made larger or smaller as a whole.

    Args:
        matrix: M, shape (n, n).
        shape: the perturbation; where all blocks are complex its phase may turn, too.
        blocks: the structure.
    """
    values = np.linalg.eigvals(shape @ matrix)
    turn: complex = 1.0
    if any(b.real for b in blocks):
        values = values[np.abs(values.imag) <= _REAL * np.abs(values)].real
        largest = float(np.abs(values).max(initial=0.0))
        if largest > 0.0:
            turn = float(np.sign(values[np.argmax(np.abs(values))]))
    else:
        largest = float(np.abs(values).max(initial=0.0))
        if largest > 0.0:
            turn = largest / complex(values[np.argmax(np.abs(values))])
    if largest == 0.0:
        return Attained(0.0, np.zeros_like(shape))
    return Attained(largest, shape * turn / largest)


def _tried(matrix: Complex, blocks: Sequence[Block], starts: int, seed: int) -> Iterator[Complex]:
    """Yield perturbations of norm 1: those the iteration comes to, and plain ones."""
    n = len(matrix)
    yield np.eye(n, dtype=np.complex128)
    random = np.random.default_rng(seed)
    right = np.linalg.svd(matrix)[2].conj()
    for number in range(starts):
        first = right[0] if number == 0 else random.standard_normal(n) + 1j * random.standard_normal(n)
        yield from _iterated(matrix, blocks, first / np.linalg.norm(first))


def _iterated(matrix: Complex, blocks: Sequence[Block], b: Complex) -> Iterator[Complex]:
    """Yield the perturbation at the end of the iteration, and one on the way."""
    w, back = b, matrix.conj().T
    q = np.ones(len(blocks))
    for turn in range(_TURNS):
        a = matrix @ b
        size = float(np.linalg.norm(a))
        if not size > 0.0:
            return
        a, z = a / size, np.zeros_like(b)
        for k, (block, at) in enumerate(places(blocks)):
            z[at] = w[at] * q[k] if block.real else a[at] * _ratio(w[at], a[at])
        w = back @ z
        if not float(np.linalg.norm(w)) > 0.0:
            return
        w, before, b = w / np.linalg.norm(w), b, np.zeros_like(b)
        for k, (block, at) in enumerate(places(blocks)):
            if block.real:
                grown = np.sign(q[k] or 1.0) * _ratio(before[at], a[at]) + float(np.vdot(a[at], w[at]).real)
                q[k] = min(max(grown, -1.0), 1.0)
                b[at] = a[at] * q[k]
            else:
                b[at] = w[at] * _ratio(a[at], w[at])
        if float(np.linalg.norm(b)) == 0.0:
            return
        if turn in (_TURNS // 3, _TURNS - 1):
            yield _perturbation(blocks, q, a, w)


def _ratio(first: Complex, second: Complex) -> float:
    size = float(np.linalg.norm(second))
    return float(np.linalg.norm(first)) / size if size > 0.0 else 0.0


def _perturbation(blocks: Sequence[Block], q: np.ndarray, a: Complex, w: Complex) -> Complex:
    """Return Δ of norm 1 with b ∝ Δ a: the real numbers q, and in each complex block a dyad."""
    result = np.zeros((len(a), len(a)), dtype=np.complex128)
    for k, (block, at) in enumerate(places(blocks)):
        if block.real:
            result[at, at] = q[k] * np.eye(block.size)
            continue
        size = float(np.linalg.norm(a[at]) * np.linalg.norm(w[at]))
        if size > 0.0:
            result[at, at] = np.outer(w[at], a[at].conj()) / size
    largest = float(np.linalg.norm(result, 2))
    return result / largest if largest > 0.0 else result
