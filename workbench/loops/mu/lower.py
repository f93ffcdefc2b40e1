"""Lower bound of the structured singular value of a matrix, with the perturbation that attains it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.loops.mu.blocks import MuBlock, places

__all__ = ["Attained", "attained_by", "lower_bound"]

_TURNS = 60  # of the power iteration
_REAL = 1e-7  # relative: an eigenvalue so near to the real axis is real
_CORNERS = 5  # of so many real numbers all edges are tried, of more as many at random
_STEPS = 10  # along an edge or a turn

_Path = Callable[[float], Complex]  # number from 0 to 1 → perturbation


@dataclass(frozen=True, eq=False)
class Attained:
    """A lower bound of µ(M), and what attains it.

    Attributes:
        bound: β; 0: no perturbation was found.
        delta: Δ of norm 1/β with det(I - M Δ) = 0, shape (n, n).
    """

    bound: float
    delta: Complex


def lower_bound(matrix: Complex, blocks: Sequence[MuBlock], *, starts: int = 6, seed: int = 0) -> Attained:
    """Return a lower bound of µ(M): the largest real eigenvalue of Δ M that is found, Δ of norm 1.

    With complex blocks Δ comes from the power iteration, and they are turned until an eigenvalue is real. Without, the
    largest is attained where all numbers but one are at their ends: it is looked for along such edges.

    Args:
        matrix: M, shape (n, n).
        blocks: the structure.
        starts: number of starts of the iteration, the first at the largest singular value.
        seed: of the random ones.

    Source: P. M. Young, J. C. Doyle, A lower bound for the mixed µ problem, IEEE Trans. Automatic Control 42 (1997);
    R. R. E. de Gaston, M. G. Safonov, Exact calculation of the multiloop stability margin, ibid. 33 (1988), for edges.
    """
    best = Attained(0.0, np.zeros_like(matrix, dtype=np.complex128))
    if not len(matrix) or not matrix.any():
        return best
    for shape in _tried(matrix, blocks, starts, seed):
        best = max(best, attained_by(matrix, shape, blocks), key=lambda a: a.bound)
    return best


def _crossings(matrix: Complex, path: _Path) -> Iterator[Complex]:
    """Yield perturbations on a path at which an eigenvalue of Δ M becomes real, other than 0.

    Args:
        matrix: M.
        path: number from 0 to 1 → Δ.
    """
    steps = np.linspace(0.0, 1.0, _STEPS + 1)
    values = np.linalg.eigvals(np.array([path(t) for t in steps]) @ matrix)
    for k in range(_STEPS):
        left = values[k + 1].tolist()
        for value in sorted(values[k].tolist(), key=abs, reverse=True):
            near = left[int(np.argmin(np.abs(np.array(left) - value)))]
            left.remove(near)
            if value.imag * near.imag < 0.0 and abs(value - near) < 0.5 * (abs(value) + abs(near)):
                yield path(_bisected(matrix, path, (steps[k], steps[k + 1]), (value, near)))


def _bisected(matrix: Complex, path: _Path, ends: tuple[float, float], values: tuple[complex, complex]) -> float:
    """Return where an eigenvalue that is followed becomes real."""
    (a, b), (u, v) = ends, values
    for _ in range(60):
        t = 0.5 * (a + b)
        every = np.linalg.eigvals(path(t) @ matrix)
        w = complex(every[np.argmin(np.abs(every - 0.5 * (u + v)))])
        if w.imag * u.imag <= 0.0:
            b, v = t, w
        else:
            a, u = t, w
    return a if abs(u.imag) < abs(v.imag) else b


def _edges(blocks: Sequence[MuBlock], seed: int) -> Iterator[_Path]:
    """Yield the edges of the cube of real numbers, or some."""
    count, sizes = len(blocks), [b.size for b in blocks]
    if count <= _CORNERS:
        corners = [np.array(s) for s in itertools.product((-1.0, 1.0), repeat=count)]
    else:
        corners = list(np.random.default_rng(seed).choice([-1.0, 1.0], (2**_CORNERS // 2, count)))
    for signs in corners:
        for k in range(count):
            if signs[k] < 0.0 or count > _CORNERS:
                ends = np.where(np.arange(count) == k, -1.0, signs), np.where(np.arange(count) == k, 1.0, signs)
                first, last = (np.diag(np.repeat(end, sizes)).astype(np.complex128) for end in ends)
                yield _between(first, last)


def _between(first: Complex, last: Complex) -> _Path:
    return lambda t: (1.0 - t) * first + t * last


def _turned(blocks: Sequence[MuBlock], shape: Complex) -> _Path:
    """Return the path on which the complex blocks turn once."""
    real = np.concatenate([np.full(b.size, b.real) for b in blocks])
    return lambda t: shape * np.where(real, 1.0, np.exp(2j * np.pi * t))[:, None]


def attained_by(matrix: Complex, shape: Complex, blocks: Sequence[MuBlock]) -> Attained:
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


def _tried(matrix: Complex, blocks: Sequence[MuBlock], starts: int, seed: int) -> Iterator[Complex]:
    """Yield perturbations of norm 1."""
    n = len(matrix)
    if all(b.real for b in blocks):
        for path in _edges(blocks, seed):
            yield path(1.0)
            yield from _crossings(matrix, path)
        yield np.diag(np.repeat(-np.ones(len(blocks)), [b.size for b in blocks])).astype(np.complex128)
        return
    random = np.random.default_rng(seed)
    right = np.linalg.svd(matrix)[2].conj()
    for number in range(starts):
        first = right[0] if number == 0 else random.standard_normal(n) + 1j * random.standard_normal(n)
        signs = random.choice([-1.0, 1.0], len(blocks))
        for shape in _iterated(matrix, blocks, first / np.linalg.norm(first), signs):
            yield shape
            if any(b.real for b in blocks):
                yield from _crossings(matrix, _turned(blocks, shape))


def _iterated(matrix: Complex, blocks: Sequence[MuBlock], b: Complex, q: Floats) -> Iterator[Complex]:
    """Yield the perturbation at the end of the iteration, and one on the way."""
    w, back = b, matrix.conj().T
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


def _perturbation(blocks: Sequence[MuBlock], q: Floats, a: Complex, w: Complex) -> Complex:
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
