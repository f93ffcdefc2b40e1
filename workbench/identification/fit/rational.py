"""Rational functions fitted to complex values: vector fitting for a start, then weighted least squares.

In sections of two states, (b1 s + b0)/(s² + a1 s + a0), and one of one state, b0/(s + a0), where the order is odd, all
coefficients are real and a pair of poles becomes two real ones without a jump. s is scaled by the middle frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize

from workbench.core.values.arrays import Complex, Floats, as_reals

__all__ = ["Rational", "ResponseChannel", "common_poles", "fitted", "paired", "pole_spread"]


_ROUNDS = 20  # of vector fitting
_DAMPED = 0.01  # of the first poles
_LEAST = 1e-9  # of the coefficients of a stable section


@dataclass(frozen=True, eq=False)
class Rational:
    """A sum of sections and a constant.

    Attributes:
        theta: coefficients: a1, a0, b1, b0 of each section of two states, a0, b0 of the one of one, then the constant.
        order: states.
        direct: whether there is a constant.
        scale: s is divided by it [rad/s].
        cost: sum of the squares of the weighted misfits.
        covariance: shape (t, t), of the coefficients.
    """

    theta: Floats
    order: int
    direct: bool
    scale: float
    cost: float
    covariance: Floats

    def value(self, s: Complex) -> Complex:
        """Return the function's values, shape (k,).

        Args:
            s: shape (k,) [1/s].
        """
        return _value(self.theta, self.order, s / self.scale, direct=self.direct)

    @property
    def matrices(self) -> tuple[Floats, Floats, Floats, Floats]:
        """A, B, C, D with one input and one output."""
        return _matrices(self.theta, self.order, self.scale, direct=self.direct)

    def pole_spread(self) -> Floats:
        """Return the standard deviation of each pole [1/s], shape (n,), in the order of the eigenvalues of A."""
        A = self.matrices[0]
        moves = np.zeros((len(self.theta), *A.shape))
        for j in range(len(self.theta)):
            step = np.zeros(len(self.theta))
            step[j] = 1.0
            # A is linear in the coefficients.
            moves[j] = _matrices(self.theta + step, self.order, self.scale, direct=self.direct)[0] - A
        return pole_spread(A, moves, self.covariance)

    @property
    def freedom(self) -> int:
        """How many numbers were fitted."""
        return len(self.theta)


def pole_spread(A: Floats, moves: Floats, covariance: Floats) -> Floats:
    """Return the standard deviation of each eigenvalue, shape (n,).

    Args:
        A: shape (n, n).
        moves: shape (t, n, n), its derivatives by the parameters.
        covariance: shape (t, t), of these.
    """
    if not len(A):
        return np.zeros(0)
    _, left, right = scipy.linalg.eig(A, left=True, right=True)
    size = np.einsum("ik,ik->k", left.conj(), right)
    slopes = np.einsum("ik,tij,jk->kt", left.conj(), moves, right) / size[:, None]
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(np.linalg.norm(slopes @ (vectors * np.sqrt(np.maximum(values, 0.0))), axis=1))


def fitted(
    s: Complex, value: Complex, sigma: Floats, order: int, *, direct: bool, stable: bool, start: Complex | None = None
) -> Rational:
    """Return the rational function of an order with the least Σ |misfit|²/σ².

    Args:
        s: shape (k,) [1/s].
        value: shape (k,).
        sigma: shape (k,), standard deviations of the values.
        order: n.
        direct: a constant is fitted.
        stable: poles stay left of the imaginary axis.
        start: poles to start from [1/s]; None: vector fitting finds some.
    """
    scale = float(np.sqrt(np.abs(s).min() * np.abs(s).max()))
    z, weight = s / scale, 1.0 / sigma
    poles = (
        common_poles([ResponseChannel(z, value, weight)], order, direct=direct, stable=stable)
        if start is None
        else start / scale
    )
    theta = _from_poles(z, value, weight, poles, direct=direct)
    low = np.full(len(theta), -np.inf)
    if stable:
        places = [k for j in range(order // 2) for k in (4 * j, 4 * j + 1)] + [4 * (order // 2)] * (order % 2)
        low[places] = _LEAST
        theta[places] = np.maximum(theta[places], 2.0 * _LEAST)

    def misfit(theta: Floats) -> Floats:
        return as_reals((_value(theta, order, z, direct=direct) - value) * weight)

    def slopes(theta: Floats) -> Floats:
        return np.asarray(np.array([as_reals(c * weight) for c in _slopes(theta, order, z, direct=direct)]).T)

    if not len(theta):
        return Rational(theta, 0, direct, scale, float(np.sum(misfit(theta) ** 2)), np.zeros((0, 0)))
    result = scipy.optimize.least_squares(
        misfit, theta, slopes, bounds=(low, np.inf), x_scale="jac", method="trf", xtol=1e-14, ftol=1e-14, gtol=1e-14,
        max_nfev=300,
    )  # fmt: skip
    # Real and imaginary part have half of σ² each.
    information = 2.0 * result.jac.T @ result.jac
    return Rational(
        result.x, order, direct, scale, float(2.0 * result.cost), np.linalg.pinv(information, hermitian=True)
    )


def _sections(theta: Floats, order: int) -> tuple[Floats, Floats]:
    """Return the sections of two states (j, 4), and what is left of the coefficients."""
    pairs = order // 2
    return theta[: 4 * pairs].reshape(pairs, 4), theta[4 * pairs :]


def _value(theta: Floats, order: int, z: Complex, *, direct: bool) -> Complex:
    pairs, rest = _sections(theta, order)
    total = np.full(len(z), rest[-1] if direct else 0.0, dtype=np.complex128)
    for a1, a0, b1, b0 in pairs:
        total += (b1 * z + b0) / (z * z + a1 * z + a0)
    if order % 2:
        total += rest[1] / (z + rest[0])
    return total


def _slopes(theta: Floats, order: int, z: Complex, *, direct: bool) -> list[Complex]:
    pairs, rest = _sections(theta, order)
    result: list[Complex] = []
    for a1, a0, b1, b0 in pairs:
        below = z * z + a1 * z + a0
        part = -(b1 * z + b0) / below**2
        result += [part * z, part, z / below, 1.0 / below]
    if order % 2:
        result += [-rest[1] / (z + rest[0]) ** 2, 1.0 / (z + rest[0])]
    return result + ([np.ones(len(z), dtype=np.complex128)] if direct else [])


def _matrices(theta: Floats, order: int, scale: float, *, direct: bool) -> tuple[Floats, Floats, Floats, Floats]:
    pairs, rest = _sections(theta, order)
    A, B, C = np.zeros((order, order)), np.zeros((order, 1)), np.zeros((1, order))
    for j, (a1, a0, b1, b0) in enumerate(pairs):
        k = 2 * j
        A[k : k + 2, k : k + 2] = [[0.0, 1.0], [-a0, -a1]]
        B[k + 1, 0], C[0, k : k + 2] = 1.0, (b0, b1)
    if order % 2:
        A[-1, -1], B[-1, 0], C[0, -1] = -rest[0], 1.0, rest[1]
    return scale * A, scale * B, C, np.array([[rest[-1] if direct else 0.0]])


def _from_poles(z: Complex, value: Complex, weight: Floats, poles: Complex, *, direct: bool) -> Floats:
    """Return coefficients for given poles, numerators by least squares."""
    pairs, single = paired(poles)
    columns = [column for a1, a0 in pairs for column in (z / (z * z + a1 * z + a0), 1.0 / (z * z + a1 * z + a0))]
    columns += [] if single is None else [1.0 / (z + single)]
    columns += [np.ones(len(z), dtype=np.complex128)] if direct else []
    if not columns:
        return np.zeros(0)
    matrix = np.array([as_reals(c * weight) for c in columns]).T
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    numbers = np.linalg.lstsq(matrix / size, as_reals(value * weight), rcond=1e-12)[0] / size
    theta = [x for j, (a1, a0) in enumerate(pairs) for x in (a1, a0, numbers[2 * j], numbers[2 * j + 1])]
    theta += [] if single is None else [single, numbers[2 * len(pairs)]]
    return np.array([*theta, *(numbers[-1:] if direct else ())])


def paired(poles: Complex) -> tuple[list[tuple[float, float]], float | None]:
    """Return a1 and a0 of pairs of poles, and minus a single real one if their number is odd.

    Args:
        poles: complex ones in pairs; their pairs come first, then those of real ones, rising.
    """
    upper = [p for p in poles if p.imag > 1e-12 * abs(p)]
    real = sorted(p.real for p in poles if abs(p.imag) <= 1e-12 * abs(p))
    pairs = [(-2.0 * p.real, abs(p) ** 2) for p in upper]
    pairs += [(-(real[k] + real[k + 1]), real[k] * real[k + 1]) for k in range(0, len(real) - 1, 2)]
    return pairs, -real[-1] if len(real) % 2 else None


@dataclass(frozen=True, eq=False)
class ResponseChannel:
    """Values of one input and output.

    Attributes:
        s: shape (k,).
        value: shape (k,).
        weight: shape (k,), of each value.
    """

    s: Complex
    value: Complex
    weight: Floats

    def residues(self, poles: Complex, *, direct: bool) -> Complex:
        """Return the residues at given poles that follow best, shape (n,), conjugate at conjugate poles.

        Args:
            poles: in pairs.
            direct: a constant is fitted, too.
        """
        basis = _partial_fractions(self.s, poles)
        columns = [*basis, *([np.ones(len(self.s))] if direct else [])]
        if not basis:
            return np.zeros(0, dtype=np.complex128)
        matrix = np.array([as_reals(c * self.weight) for c in columns]).T
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        c = (np.linalg.lstsq(matrix / size, as_reals(self.value * self.weight), rcond=1e-12)[0] / size)[: len(poles)]
        result = np.zeros(len(poles), dtype=np.complex128)
        k = 0
        for j, pole in enumerate(poles):
            if pole.imag == 0.0:
                result[j], k = c[k], k + 1
            elif pole.imag > 0.0:  # c r + d i: (c + i d) at the upper pole
                result[j], result[j + 1], k = c[k] + 1j * c[k + 1], c[k] - 1j * c[k + 1], k + 2
        return result

    def equations(self, basis: list[Complex], *, direct: bool) -> tuple[Floats, Floats]:
        """Return the equations of the coefficients c in common, the channel's own being eliminated.

        Σ r/(z − p) + d = (1 + Σ c/(z − p)) value is linear in r, d and c.

        Args:
            basis: partial fractions of real coefficients.
            direct: a constant is fitted.
        """
        own = [*basis, *([np.ones(len(self.s))] if direct else [])]
        matrix = np.array([as_reals(c * self.weight) for c in [*own, *(-self.value * c for c in basis), self.value]]).T
        size = np.maximum(np.linalg.norm(matrix[:, : len(own)], axis=0), 1e-300)
        matrix[:, : len(own)] /= size
        R = np.asarray(np.linalg.qr(matrix, mode="r"))[len(own) :, len(own) :]
        return R[:, :-1], R[:, -1]


def common_poles(channels: Sequence[ResponseChannel], order: int, *, direct: bool, stable: bool) -> Complex:
    """Return poles near those of rational functions with one denominator through the values: vector fitting.

    The zeros of the bracket in Σ r/(z − p) + d = (1 + Σ c/(z − p)) value are better poles.

    Args:
        channels: values.
        order: how many.
        direct: constants are fitted.
        stable: poles are mirrored to the left of the imaginary axis.
    """
    w = np.abs(np.concatenate([channel.s.imag for channel in channels]))
    at = np.geomspace(max(w.min(), 1e-6), w.max(), max(order // 2, 1))
    poles = np.array([p for x in at[: order // 2] for p in (x * (-_DAMPED + 1j), x * (-_DAMPED - 1j))])
    poles = np.append(poles, [-1.0 + 0j] * (order % 2))
    for _ in range(_ROUNDS if order else 0):
        parts = [channel.equations(_partial_fractions(channel.s, poles), direct=direct) for channel in channels]
        matrix, right = np.vstack([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        numbers = np.linalg.lstsq(matrix / size, right, rcond=1e-13)[0] / size
        A, b = _states_of(poles)
        new = np.linalg.eigvals(A - np.outer(b, numbers)).astype(np.complex128)
        if stable:
            new = np.where(new.real > 0.0, -new.real, new.real) + 1j * new.imag
        new[np.abs(new.imag) <= 1e-12 * np.abs(new)] = new[np.abs(new.imag) <= 1e-12 * np.abs(new)].real
        settled = np.allclose(np.sort_complex(new), np.sort_complex(poles), rtol=1e-9)
        poles = new
        if settled:
            break
    return poles


def _partial_fractions(z: Complex, poles: Complex) -> list[Complex]:
    """Return the partial fractions with real coefficients, of each pole of a pair one after the other."""
    basis: list[Complex] = []
    for p in poles:
        if p.imag == 0.0:
            basis.append(1.0 / (z - p))
        elif p.imag > 0.0:
            one, other = 1.0 / (z - p), 1.0 / (z - p.conjugate())
            basis += [one + other, 1j * one - 1j * other]
    return basis


def _states_of(poles: Complex) -> tuple[Floats, Floats]:
    """Return the A and b whose states the partial fractions are."""
    A, b, k = np.zeros((len(poles), len(poles))), np.zeros(len(poles)), 0
    for p in poles:
        if p.imag == 0.0:
            A[k, k], b[k], k = p.real, 1.0, k + 1
        elif p.imag > 0.0:
            A[k : k + 2, k : k + 2], b[k], k = [[p.real, p.imag], [-p.imag, p.real]], 2.0, k + 2
    return A, b
