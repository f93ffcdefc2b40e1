"""A state space of given order fitted to the responses of several channels: poles in common, residues of least rank.

Vector fitting finds common poles; of each residue matrix the largest singular values are kept, as many as the order
has room for, which makes B and C of a modal realisation (E. G. Gilbert, SIAM J. Control 1, 1963). From there

    Σ |C (s I − A)⁻¹ B + D − G|²/σ²,

over all points of all channels, is made least. A is block diagonal, [0 1; −a0 −a1] for two states, so that a pair of
poles becomes two real ones without a jump; B, C and D are free. A basis within each block stays free, too: as many
directions as there are states change nothing. Such a block cannot have the same pole twice with residues of rank two,
as of two channels with one lag each: B and C would grow without end. Where a block comes near to that, all of its
four numbers are freed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from workbench.core.values.arrays import Complex, Floats, as_reals
from workbench.identification.fit.rational import ResponseChannel, common_poles, paired, pole_spread

__all__ = ["Points", "StateSpaceFit", "fitted_matrix"]

Numbers = NDArray[np.intp]

_STARTS = 6  # numbers of common poles to start from
_MORE = 3  # than the order: noise takes poles, too; the strongest are kept
_SHORT, _LONG = 20, 200  # evaluations of a start, and of the best ones
_FINISHED, _ALIKE = 3, 1e-3  # starts that are followed to the end; costs nearer than this are one
_LEAST = 1e-9  # of the coefficients of a stable block
_APART = 1e-2  # relative distance that two real poles of a block are given
_ROUNDS = 3  # of B and C in turn, before both at once


@dataclass(frozen=True, eq=False)
class Points:
    """Measured values of several channels.

    Attributes:
        s: shape (k,) [1/s].
        row: shape (k,), number of the output.
        column: shape (k,), number of the input.
        value: shape (k,).
        sigma: shape (k,), standard deviation of each value.
    """

    s: Complex
    row: Numbers
    column: Numbers
    value: Complex
    sigma: Floats

    @property
    def shape(self) -> tuple[int, int]:
        """Outputs and inputs."""
        return int(self.row.max()) + 1, int(self.column.max()) + 1


@dataclass(frozen=True, eq=False)
class StateSpaceFit:
    """A state space and how well it follows.

    Attributes:
        theta: the blocks' coefficients a1, a0 (a0 alone of a single state), or all of their numbers by rows where they
            are free; then B, C and D by rows.
        order: n.
        shape: outputs and inputs.
        direct: whether D is free.
        scale: s is divided by it [rad/s].
        cost: sum of the squares of the weighted misfits.
        covariance: shape (t, t), of theta.
        full: whether all numbers of the blocks are free.
    """

    theta: Floats
    order: int
    shape: tuple[int, int]
    direct: bool
    scale: float
    cost: float
    covariance: Floats
    full: bool = False

    @property
    def freedom(self) -> int:
        """How many numbers the model has, whatever its basis."""
        (p, m), n = self.shape, self.order
        return n * (p + m) + (p * m if self.direct else 0)

    @property
    def matrices(self) -> tuple[Floats, Floats, Floats, Floats]:
        """A, B, C and D."""
        A, B, C, D = _matrices(self.theta, self.order, self.shape, full=self.full)
        return self.scale * A, self.scale * B, C, D

    def pole_spread(self) -> Floats:
        """Return the standard deviation of each pole [1/s], shape (n,), in the order of the eigenvalues of A."""
        A = self.matrices[0]
        moves = np.zeros((len(self.theta), *A.shape))
        for j, (row, column, sign) in enumerate(_places(self.order, full=self.full)):
            moves[j, row, column] = self.scale * sign
        return pole_spread(A, moves, self.covariance)


def fitted_matrix(points: Points, order: int, *, direct: bool, stable: bool) -> StateSpaceFit:
    """Return the state space of an order with the least Σ |misfit|²/σ².

    Args:
        points: of all channels.
        order: n.
        direct: D is fitted.
        stable: poles stay left of the imaginary axis.
    """
    scale = float(np.sqrt(np.abs(points.s).min() * np.abs(points.s).max()))
    scaled = replace(points, s=points.s / scale)
    p, m = points.shape
    fewest = -(-order // min(p, m))
    counts = np.unique(np.linspace(fewest, order + _MORE, _STARTS).round().astype(int)) if order else np.array([0])
    wish = _Wish(order, direct, stable)
    tried = [_least(scaled, _start(scaled, int(q), wish), wish, most=_SHORT) for q in counts]
    best = [_least(scaled, theta, wish, most=_LONG) for theta in _different(tried)]
    theta, jacobian, cost = min(best, key=lambda result: result[2])
    if (start := _freed(scaled, theta, wish)) is not None:
        other, slopes, least = _least(scaled, start, replace(wish, full=True), most=_LONG)
        poles = np.linalg.eigvals(_matrices(other, order, (p, m), full=True)[0])
        if least < cost and not (stable and poles.real.max() >= 0.0):
            theta, jacobian, cost, wish = other, slopes, least, replace(wish, full=True)
    fit = StateSpaceFit(theta, order, (p, m), direct, scale, cost, np.zeros((len(theta), len(theta))), wish.full)
    return replace(fit, covariance=_covariance(jacobian, fit.freedom))


@dataclass(frozen=True)
class _Wish:
    """States, whether D is free, whether poles stay stable, and whether all numbers of the blocks are free."""

    order: int
    direct: bool
    stable: bool
    full: bool = False


def _different(tried: Sequence[tuple[Floats, Floats, float]]) -> list[Floats]:
    """Return theta of the best starts that are on their ways to different ends."""
    kept: list[tuple[Floats, float]] = []
    for theta, _, cost in sorted(tried, key=lambda result: result[2]):
        if not kept or cost > (1.0 + _ALIKE) * kept[-1][1]:
            kept.append((theta, cost))
    return [theta for theta, _ in kept[:_FINISHED]]


def _covariance(jacobian: Floats, freedom: int) -> Floats:
    """Return the covariance of theta along the directions that change the model, the others set to zero."""
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    _, values, turned = np.linalg.svd(jacobian / size, full_matrices=False)
    kept = values[:freedom] > 1e-13 * values.max(initial=0.0)
    factor = turned[:freedom][kept] / values[:freedom][kept, None] / size
    # Real and imaginary part have half of σ² each.
    return np.asarray(0.5 * factor.T @ factor)


# -- the squares -----------------------------------------------------------------------------------


def _least(points: Points, start: Floats, wish: _Wish, *, most: int) -> tuple[Floats, Floats, float]:
    """Return theta, the Jacobian there, and the sum of the squares."""
    sides = _StateSpaceSides(points, wish)
    if not len(start):
        return start, np.zeros((2 * len(points.s), 0)), float(np.sum(sides.misfit(start) ** 2))
    low = np.full(len(start), -np.inf)
    if wish.stable and not wish.full:
        low[: wish.order] = _LEAST
        start[: wish.order] = np.maximum(start[: wish.order], 2.0 * _LEAST)
    result = scipy.optimize.least_squares(
        sides.misfit, start, sides.slopes, bounds=(low, np.inf), x_scale="jac", method="trf", xtol=1e-12, ftol=1e-12,
        gtol=1e-12, max_nfev=most,
    )  # fmt: skip
    return np.asarray(result.x), np.asarray(result.jac), float(2.0 * result.cost)


class _StateSpaceSides:
    """Misfits and their exact derivatives by theta."""

    def __init__(self, points: Points, wish: _Wish) -> None:
        self.points, self.wish, self.places = points, wish, _places(wish.order, full=wish.full)
        self.s, self.at = np.unique(points.s, return_inverse=True)
        self.weight = 1.0 / points.sigma

    def misfit(self, theta: Floats) -> Floats:
        _, right, D = self._parts(theta)
        # C (s I − A)⁻¹ B at each point, by its row of C and (s I − A)⁻¹ B.
        _, _, C, _ = _matrices(theta, self.wish.order, self.points.shape, full=self.wish.full)
        model = np.einsum("ki,ki->k", C[self.points.row], right) + D[self.points.row, self.points.column]
        return as_reals((model - self.points.value) * self.weight)

    def slopes(self, theta: Floats) -> Floats:
        left, right, _ = self._parts(theta)
        (p, m), n, count = self.points.shape, self.wish.order, len(self.points.s)
        a = np.zeros((count, len(self.places)), dtype=np.complex128)
        for j, (row, column, sign) in enumerate(self.places):
            a[:, j] = sign * left[:, row] * right[:, column]
        B, C = np.zeros((count, n, m), dtype=np.complex128), np.zeros((count, p, n), dtype=np.complex128)
        every = np.arange(count)
        B[every, :, self.points.column] = left
        C[every, self.points.row] = right
        parts = [a, B.reshape(count, -1), C.reshape(count, -1)]
        if self.wish.direct:
            D = np.zeros((count, p, m), dtype=np.complex128)
            D[every, self.points.row, self.points.column] = 1.0
            parts.append(D.reshape(count, -1))
        weighted = np.hstack(parts) * self.weight[:, None]
        return np.vstack([weighted.real, weighted.imag])

    def _parts(self, theta: Floats) -> tuple[Complex, Complex, Floats]:
        """Return the row of C (s I − A)⁻¹ and the column of (s I − A)⁻¹ B of each point, shape (k, n), and D."""
        A, B, C, D = _matrices(theta, self.wish.order, self.points.shape, full=self.wish.full)
        inverse = np.linalg.inv(self.s[:, None, None] * np.eye(self.wish.order) - A)
        left, right = C @ inverse, inverse @ B
        return left[self.at, self.points.row], right[self.at, :, self.points.column], D


def _places(order: int, *, full: bool) -> list[tuple[int, int, float]]:
    """Return row, column and sign of the numbers of A that theta begins with."""
    pairs = range(0, order - 1, 2)
    if full:
        places = [(k + i, k + j, 1.0) for k in pairs for i in (0, 1) for j in (0, 1)]
    else:
        places = [(k + 1, k + j, -1.0) for k in pairs for j in (1, 0)]
    return places + ([(order - 1, order - 1, 1.0 if full else -1.0)] if order % 2 else [])


def _matrices(
    theta: Floats, order: int, shape: tuple[int, int], *, full: bool
) -> tuple[Floats, Floats, Floats, Floats]:
    (p, m), n = shape, order
    A, places = np.zeros((n, n)), _places(n, full=full)
    if not full:
        A[range(0, n - 1, 2), range(1, n, 2)] = 1.0
    for value, (row, column, sign) in zip(theta, places, strict=False):
        A[row, column] = sign * value
    B, C, D = np.split(theta[len(places) :], [n * m, n * m + p * n])
    return A, B.reshape(n, m), C.reshape(p, n), D.reshape(p, m) if len(D) else np.zeros((p, m))


def _freed(points: Points, theta: Floats, wish: _Wish) -> Floats | None:
    """Return theta with all numbers of the blocks, those of a double pole with two inputs' directions; None: no such.

    Args:
        points: of all channels.
        theta: with the blocks' coefficients.
        wish: with these.
    """
    if min(points.shape) < 2:
        return None
    A, B, *_ = _matrices(theta, wish.order, points.shape, full=False)
    near = False
    for k in range(0, wish.order - 1, 2):
        block = slice(k, k + 2)
        first, second = np.linalg.eigvals(A[block, block])
        if abs(first - second) <= _APART * abs(first):
            # Any basis will do for p·I, so that B may have orthonormal rows.
            A[block, block] = 0.5 * (first + second).real * np.eye(2)
            B[block] = np.linalg.qr(B[block].T)[0].T
            near = True
    if not near:
        return None
    C, D = _side(points, A, B, direct=wish.direct)
    a = [A[row, column] for row, column, _ in _places(wish.order, full=True)]
    return np.concatenate([a, B.ravel(), C.ravel(), D.ravel() if wish.direct else np.zeros(0)])


# -- the start -------------------------------------------------------------------------------------


def _start(points: Points, count: int, wish: _Wish) -> Floats:
    """Return theta from so many common poles, of which each gives as many states as its residues are worth."""
    p, m = points.shape
    channels = [
        ResponseChannel(points.s[at], points.value[at], 1.0 / points.sigma[at])
        for at in ((points.row == i) & (points.column == j) for i in range(p) for j in range(m))
    ]
    poles = common_poles(channels, count, direct=wish.direct, stable=wish.stable)
    modes = _modes(channels, poles, (p, m), wish.order, direct=wish.direct)
    a1a0, single = paired(np.array([mode for mode, _ in modes]))
    blocks = [np.array([[0.0, 1.0], [-a0, -a1]]) for a1, a0 in a1a0]
    A = scipy.linalg.block_diag(*blocks, *([] if single is None else [[[-single]]])) if wish.order else np.zeros((0, 0))
    B = _inputs(A, modes, m)
    D = np.zeros((p, m))
    for _ in range(_ROUNDS if wish.order else 1):
        C, D = _side(points, A, B, direct=wish.direct)
        turned = replace(points, row=points.column, column=points.row)
        left, other = _side(turned, A.T, C.T, direct=wish.direct)
        B, D = left.T, other.T
    C, D = _side(points, A, B, direct=wish.direct)
    a = [x for pair in a1a0 for x in pair] + ([] if single is None else [single])
    return np.concatenate([np.array(a), B.ravel(), C.ravel(), D.ravel() if wish.direct else np.zeros(0)])


def _modes(
    channels: list[ResponseChannel], poles: Complex, shape: tuple[int, int], order: int, *, direct: bool
) -> list[tuple[complex, Complex]]:
    """Return poles and their directions at the inputs, shape (m,), the strongest ones, `order` with conjugates.

    A pole whose residues are worth more than one state comes several times.
    """
    residues = np.array([channel.residues(poles, direct=direct) for channel in channels]).reshape(*shape, len(poles))
    result = []
    for k, pole in enumerate(poles):
        if pole.imag < 0.0:
            continue
        _, values, right = np.linalg.svd(residues[:, :, k])
        result += [
            (value / max(abs(pole.real), 1e-3 * abs(pole), 1e-9), pole, right[i]) for i, value in enumerate(values)
        ]
    result.sort(key=lambda one: -one[0])
    modes: list[tuple[complex, Complex]] = []
    for _, pole, direction in result:
        states = 1 if pole.imag == 0.0 else 2
        if len(modes) + states <= order:
            again = sum(other == pole for other, _ in modes)
            # Two real poles of one block have to differ.
            near = pole * (1.0 + _APART * again) if states == 1 else pole
            modes += [(near, direction)] if states == 1 else [(pole, direction), (pole.conjugate(), direction.conj())]
    size = float(np.sqrt(np.mean([np.mean(np.abs(c.s) ** 2) for c in channels])))
    while len(modes) < order:  # a single state is left, and there is no real pole
        modes.append((complex(-size * (1.0 + _APART * len(modes))), np.ones(shape[1], dtype=np.complex128)))
    return modes


def _inputs(A: Floats, modes: list[tuple[complex, Complex]], inputs: int) -> Floats:
    """Return B whose modes are driven along their directions.

    Args:
        A: block diagonal.
        modes: poles and directions.
        inputs: how many.
    """
    n = len(A)
    upper = [mode for mode in modes if mode[0].imag > 0.0]
    real = sorted((mode for mode in modes if mode[0].imag == 0.0), key=lambda mode: mode[0].real)
    B = np.zeros((n, inputs))
    first = 0
    for pole, direction in upper:
        V = np.array([[1.0, 1.0], [pole, pole.conjugate()]])
        B[first : first + 2] = (V @ np.array([direction, direction.conj()])).real
        first += 2
    for k in range(0, len(real) - 1, 2):
        V = np.array([[1.0, 1.0], [real[k][0].real, real[k + 1][0].real]])
        B[first : first + 2] = V @ np.array([real[k][1].real, real[k + 1][1].real])
        first += 2
    if len(real) % 2:
        B[first] = real[-1][1].real
    return B


def _side(points: Points, A: Floats, B: Floats, *, direct: bool) -> tuple[Floats, Floats]:
    """Return C and D that follow best for given A and B, output by output."""
    p, m = points.shape
    n = len(A)
    C, D = np.zeros((p, n)), np.zeros((p, m))
    right = np.linalg.solve(points.s[:, None, None] * np.eye(n) - A, np.broadcast_to(B, (len(points.s), n, m)))
    right = np.asarray(right)[np.arange(len(points.s)), :, points.column]
    for i in range(p):
        at = points.row == i
        through = (points.column[at][:, None] == np.arange(m)) if direct else np.zeros((int(at.sum()), 0))
        weighted = np.hstack([right[at], through]) / points.sigma[at, None]
        matrix = np.vstack([weighted.real, weighted.imag])
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        target = as_reals(points.value[at] / points.sigma[at])
        numbers = np.linalg.lstsq(matrix / size, target, rcond=1e-12)[0] / size
        C[i], D[i] = numbers[:n], numbers[n:] if direct else 0.0
    return C, D
