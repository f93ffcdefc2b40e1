"""The noise of each output: its size, its colour, and residuals that are freed of both."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_discrete_lyapunov, solve_triangular
from scipy.signal import lfilter

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.identification.calibrate.responses import ResponseData

__all__ = ["LOSSES", "ColouredNoise", "Loss", "Segments", "estimated"]

_MOST_ORDER = 10  # of the colour
_PER_ORDER = 20  # samples that each coefficient of the colour needs
_SETTLING = 100  # samples of drawn noise that are left out, and as many again as are wanted
_MAD = 1.482602218505602  # σ of normal noise over its median absolute value: 1/Φ⁻¹(3/4)


@dataclass(frozen=True)
class Loss:
    """How residuals count, as a function of z = (e/σ)².

    Attributes:
        name: of it.
        rho: z → ρ, ρ', ρ'', shape (3, k), as `scipy.optimize.least_squares` takes it; None: ρ = z.
        psi: e/σ → ψ = dρ/de/2 and its derivative.
    """

    name: str
    rho: Callable[[Floats], Floats] | None
    psi: Callable[[Floats], tuple[Floats, Floats]]

    def cost(self, e: Floats) -> float:
        """Return Σ ρ."""
        return float(np.sum(e**2 if self.rho is None else self.rho(e**2)[0]))

    def widening(self, e: Floats) -> float:
        """Return by how much the covariance (JᵀJ)⁻¹ is multiplied, mean ψ² / (mean ψ')² (Huber 1981, section 7.6)."""
        if self.rho is None:
            return 1.0
        psi, slope = self.psi(e)
        return float(np.mean(psi**2) / np.mean(slope) ** 2)


_HUBER = 1.345  # the usual corner: 95 % efficient under normal noise
_STUDENT = 4.0  # degrees of freedom: heavy tails with a variance


def _huber(z: Floats) -> Floats:
    far = z > _HUBER**2
    root = np.sqrt(np.where(far, z, 1.0))
    rho = np.where(far, 2.0 * _HUBER * root - _HUBER**2, z)
    return np.array([rho, np.where(far, _HUBER / root, 1.0), np.where(far, -0.5 * _HUBER / root**3, 0.0)])


def _student(z: Floats) -> Floats:
    a = 1.0 / (_STUDENT + z)
    weight = _STUDENT + 1.0
    return np.array([weight * np.log1p(z / _STUDENT), weight * a, -weight * a**2])


def _huber_psi(e: Floats) -> tuple[Floats, Floats]:
    return np.clip(e, -_HUBER, _HUBER), np.asarray(np.abs(e) < _HUBER, dtype=np.float64)


def _student_psi(e: Floats) -> tuple[Floats, Floats]:
    below = _STUDENT + e**2
    return (_STUDENT + 1.0) * e / below, (_STUDENT + 1.0) * (_STUDENT - e**2) / below**2


LOSSES = {
    loss.name: loss
    for loss in (
        Loss("gauss", None, lambda e: (e, np.ones_like(e))),
        Loss("huber", _huber, _huber_psi),
        Loss("student", _student, _student_psi),
    )
}


class Segments:
    """Where samples stand without a gap between them.

    Args:
        data: with NaN where an output is missing.

    Attributes:
        of: [data][output] → slices.
        counts: samples of each output, shape (p,) of each data set.
    """

    def __init__(self, data: Sequence[Experiment]) -> None:
        self.of = [[tuple(_pieces(one, np.isfinite(column))) for column in one.y.T] for one in data]
        self.names = [one.output_names for one in data]

    def each(self) -> Iterator[tuple[int, int, str, slice]]:
        """Yield number of the data, number and name of the output, and slice."""
        for i, outputs in enumerate(self.of):
            for j, pieces in enumerate(outputs):
                for piece in pieces:
                    yield i, j, self.names[i][j], piece

    def of_output(self, name: str, arrays: Sequence[Floats]) -> list[Floats]:
        """Return the pieces of an output.

        Args:
            name: of the output.
            arrays: shape (n, p) of each data set.
        """
        return [arrays[i][piece, j] for i, j, n, piece in self.each() if n == name]


def _pieces(one: Experiment, there: NDArray[np.bool_]) -> Iterator[slice]:
    if isinstance(one, ResponseData):  # its errors have no colour
        yield from (slice(int(k), int(k) + 1) for k in np.flatnonzero(there))
        return
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(int), [0]])))
    yield from (slice(int(a), int(b)) for a, b in edges.reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class ColouredNoise:
    """Noise v of each output: v(k) = Σ aᵢ v(k − i) + e(k), e white with standard deviation σ.

    Attributes:
        sigma: output → σ [its unit].
        colour: output → a, shape (order,); empty: white.
        given: whether σ was given.
    """

    sigma: dict[str, float]
    colour: dict[str, Floats]
    given: bool = False

    def whitened(self, arrays: Sequence[Floats], segments: Segments) -> Floats:
        """Return e/σ of all samples, one after the other, shape (N, …).

        The first samples of a piece are freed of their colour by the Cholesky factor of their covariance: nothing is
        left out.

        Args:
            arrays: shape (n, p, …) of each data set.
            segments: where there are samples.
        """
        return np.concatenate(
            [_white(arrays[i][piece, j], self.colour[n]) / self.sigma[n] for i, j, n, piece in segments.each()]
        )

    def drawn(self, e: Floats, segments: Segments, like: Sequence[Floats], rng: np.random.Generator) -> list[Floats]:
        """Return noise as large and coloured as this, shape (n, p) of each data set; NaN where there is no sample.

        Args:
            e: what its white part is drawn from, of variance 1.
            segments: where there are samples.
            like: arrays of those shapes.
            rng: draws.
        """
        result = [np.full_like(one, np.nan) for one in like]
        for i, j, n, piece in segments.each():
            count = piece.stop - piece.start
            white = rng.choice(e, 2 * count + _SETTLING)
            coloured = lfilter([1.0], np.concatenate([[1.0], -self.colour[n]]), white)
            result[i][piece, j] = self.sigma[n] * coloured[-count:]
        return result


def _white(x: Floats, a: Floats) -> Floats:
    order = min(len(a), len(x))
    if not order:
        return x
    companion = np.vstack([a, np.eye(len(a) - 1, len(a))])
    drive = np.zeros((len(a), len(a)))
    drive[0, 0] = 1.0
    covariance = solve_discrete_lyapunov(companion, drive)[:order, :order]
    root = cholesky(covariance, lower=True)  # Toeplitz: the same in the order of time
    head = solve_triangular(root, x[:order].reshape(order, -1), lower=True).reshape(x[:order].shape)
    tail = lfilter(np.concatenate([[1.0], -a]), [1.0], x, axis=0)[order:]
    return np.concatenate([head, tail])


def estimated(
    residuals: Sequence[Floats], segments: Segments, *, fitted: int, colour: bool, given: dict[str, float], robust: bool
) -> ColouredNoise:  # fmt: skip
    """Return the noise that leaves these residuals.

    Args:
        residuals: measured less computed, shape (n, p) of each data set.
        segments: where there are samples.
        fitted: numbers that were estimated from them.
        colour: whether it is estimated.
        given: output → σ that is known.
        robust: whether σ is that of most residuals, the median.
    """
    names = list(dict.fromkeys(n for one in segments.names for n in one))
    total = sum(piece.stop - piece.start for *_, piece in segments.each())
    free = max(1.0 - fitted / total, 1.0 / total)
    sigma, colours = {}, {}
    for name in names:
        pieces = segments.of_output(name, residuals)
        colours[name] = _burg(pieces) if colour and name not in given else np.zeros(0)
        e = np.concatenate([_white(piece, colours[name]) for piece in pieces])
        size = _MAD * float(np.median(np.abs(e))) if robust else math.sqrt(float(np.mean(e**2)) / free)
        measured = given.get(name)
        sigma[name] = measured if measured is not None else size or np.finfo(float).tiny ** 0.5
    return ColouredNoise(sigma, colours, given=all(name in given for name in names))


# What leaves less than this part of its power is no noise, and its covariance has no inverse in numbers.
_FORESEEN = 1e-6


def _burg(pieces: Sequence[Floats]) -> Floats:
    """Return the coefficients a by Burg's method over all pieces, stable; the order has the least BIC, 0 if white.

    Source: J. P. Burg, Maximum Entropy Spectral Analysis, Stanford (1975); Kay, Modern Spectral Estimation (1988),
    section 7.3.
    """
    forward = backward = [piece for piece in pieces if len(piece)]
    count = sum(map(len, forward))
    power = sum(float(f @ f) for f in forward) / count
    a = best = np.zeros(0)
    whole, least = power, count * math.log(power or 1.0)
    for order in range(1, min(_MOST_ORDER, count // _PER_ORDER) + 1):
        both = [(f[1:], b[:-1]) for f, b in zip(forward, backward, strict=True) if len(f) > 1]
        below = sum(float(f @ f + b @ b) for f, b in both)
        if not below > 0.0:
            break
        k = 2.0 * sum(float(f @ b) for f, b in both) / below
        if power * (1.0 - k**2) < _FORESEEN * whole:
            break
        a = np.append(a - k * a[::-1], k)
        power *= 1.0 - k**2
        forward, backward = [f - k * b for f, b in both], [b - k * f for f, b in both]
        if power > 0.0 and (criterion := count * math.log(power) + math.log(count) * order) < least:
            least, best = criterion, a
    return best
