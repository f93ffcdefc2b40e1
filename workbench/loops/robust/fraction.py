"""What parameters do, as a linear fractional transformation that is found from values at a few points."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["Fraction", "fraction"]

_RANK = 1e-3  # relative: smaller singular values of what a parameter does are left to the rest, which is measured
_FIRST, _SECOND = (1.0, -0.5), (-1.0, 0.5)  # deviations at which it is known
_REGULAR = 1e8  # condition of a pencil: a worse one comes from rounding
_ROUNDS = 4  # in which the couplings of two parameters are improved


@dataclass(frozen=True, eq=False)
class Fraction:
    """F(δ) = L Δ (I - J Δ)⁻¹ R with Δ = diag(δᵢ I).

    Attributes:
        left, inner, right: L, J, R.
        ranks: how often each parameter stands in Δ.
    """

    left: Floats
    inner: Floats
    right: Floats
    ranks: tuple[int, ...]

    def at(self, share: Floats) -> Floats:
        """Return F.

        Args:
            share: δ, shape (p,).

        Raises:
            numpy.linalg.LinAlgError: it has no value there.
        """
        delta = np.repeat(share, self.ranks)
        return np.asarray((self.left * delta) @ np.linalg.solve(np.eye(len(delta)) - self.inner * delta, self.right))


def fraction(
    alone: Sequence[Sequence[Floats]], corners: Sequence[Floats], values: Sequence[Floats], least: float
) -> Fraction:
    """Return the fraction that comes near to what is known, of low rank.

    What each parameter does by itself is interpolated in Loewner's way: a straight line, a square, an inverse are
    exact. Of what two do together the part that leads from the channels of one into those of the other is taken, as in
    a product or a quotient.

    Args:
        alone: of each parameter F at its deviations 1, -½, -1, ½.
        corners: deviations of all parameters at once, 1 or -1.
        values: F there.
        least: what is smaller is rounding.

    Source: A. J. Mayo, A. C. Antoulas, A framework for the solution of the generalized realization problem, Linear
    Algebra and its Applications 425 (2007), section 4.
    """
    parts = [_interpolated(each, least) for each in alone]
    ranks = tuple(len(j) for _, j, _ in parts)
    ends = np.cumsum([0, *ranks])
    inner = np.zeros((ends[-1], ends[-1]))
    for begin, (_, j, _) in zip(ends, parts, strict=False):
        inner[begin : begin + len(j), begin : begin + len(j)] = j
    plain = Fraction(np.hstack([p[0] for p in parts]), inner, np.vstack([p[2] for p in parts]), ranks)
    return _coupled(plain, corners, values)


def _interpolated(known: Sequence[Floats], least: float) -> tuple[Floats, Floats, Floats]:
    """Return L, J, R of one parameter; of a straight line where a pole would be in its range."""
    g = dict(zip((*_FIRST, *_SECOND), (f / d for f, d in zip(known, (*_FIRST, *_SECOND), strict=True)), strict=True))
    differences = np.block([[(g[a] - g[b]) / (a - b) for b in _SECOND] for a in _FIRST])
    shifted = np.block([[(a * g[a] - b * g[b]) / (a - b) for b in _SECOND] for a in _FIRST])
    u, s, _ = np.linalg.svd(np.hstack([differences, shifted]), full_matrices=False)
    v = np.linalg.svd(np.vstack([differences, shifted]), full_matrices=False)[2]
    k = int(np.count_nonzero(s > max(_RANK * float(s.max(initial=0.0)), 4.0 * least)))
    y, x = u[:, :k].T, v[:k].T
    pencil = y @ shifted @ x
    if k and np.linalg.cond(pencil) < _REGULAR:
        inner = np.linalg.solve(pencil, y @ differences @ x)
        poles = np.linalg.eigvals(inner)
        if not (np.abs(poles[np.abs(poles.imag) <= 1e-3 * np.abs(poles)]) >= 1.0).any():
            right = np.linalg.solve(pencil, y @ np.vstack([g[a] for a in _FIRST]))
            return _balanced(np.hstack([g[b] for b in _SECOND]) @ x, inner, right)
    u, s, v = np.linalg.svd(0.5 * (g[1.0] + g[-1.0]), full_matrices=False)
    kept = s > max(_RANK * float(s.max(initial=0.0)), least)
    return u[:, kept] * np.sqrt(s[kept]), np.zeros((kept.sum(),) * 2), v[kept] * np.sqrt(s[kept])[:, None]


def _balanced(left: Floats, inner: Floats, right: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the same with columns of L as large as the rows of R."""
    sizes = np.linalg.norm(left, axis=0), np.linalg.norm(right, axis=1)
    floor = 1e-3 * max(float(x.max(initial=0.0)) for x in sizes)
    scale = np.sqrt(np.maximum(sizes[1], floor) / np.maximum(sizes[0], floor))
    return left * scale, inner * scale / scale[:, None], right / scale[:, None]


def _coupled(plain: Fraction, corners: Sequence[Floats], values: Sequence[Floats]) -> Fraction:
    """Return the fraction with the couplings of each two parameters that leave least at the corners.

    Jᵢⱼ adds Lᵢ δᵢ (I - Jᵢᵢ δᵢ)⁻¹ Jᵢⱼ δⱼ (I - Jⱼⱼ δⱼ)⁻¹ Rⱼ; of that the part odd in both, (I - J²)⁻¹ at the corners, is
    not in what other parameters do. One way is fitted, then what it leaves by the other: both at once would be a
    product of both.
    """
    pairs = list(itertools.combinations(range(len(plain.ranks)), 2))
    if not pairs:
        return plain
    odd = np.array([[c[i] * c[j] for i, j in pairs] for c in corners])
    ends = [0, *itertools.accumulate(plain.ranks)]
    at = [slice(a, b) for a, b in itertools.pairwise(ends)]
    own = [np.linalg.inv(np.eye(b.stop - b.start) - plain.inner[b, b] @ plain.inner[b, b]) for b in at]
    left = [plain.left[:, b] @ o for b, o in zip(at, own, strict=True)]
    right = [o @ plain.right[b] for b, o in zip(at, own, strict=True)]
    out, into = ([np.linalg.pinv(m, rcond=1e-6) for m in some] for some in (left, right))
    ways = dict[tuple[int, int], list[tuple[int, int]]]()
    best, rest, inner = plain, _rest(plain, corners, values), plain.inner.copy()
    smallest = _size(rest)
    for _ in range(_ROUNDS):
        fitted = np.linalg.lstsq(odd, rest.reshape(len(corners), -1), rcond=None)[0]
        for pair, flat in zip(pairs, fitted, strict=True):
            both = flat.reshape(rest.shape[1:])
            missing = [_size(both - left[i] @ out[i] @ both @ into[j] @ right[j]) for i, j in (pair, pair[::-1])]
            for i, j in ways.setdefault(pair, [pair, pair[::-1]] if missing[0] <= missing[1] else [pair[::-1], pair]):
                more = out[i] @ both @ into[j]
                inner[at[i], at[j]] += more
                both = both - left[i] @ more @ right[j]
        found = Fraction(plain.left, inner.copy(), plain.right, plain.ranks)
        try:
            rest = _rest(found, corners, values)
        except np.linalg.LinAlgError:
            break
        if not _size(rest) < 0.9 * smallest:
            break
        best, smallest = found, _size(rest)
    return best


def _rest(found: Fraction, corners: Sequence[Floats], values: Sequence[Floats]) -> Floats:
    return np.array([value - found.at(corner) for corner, value in zip(corners, values, strict=True)])


def _size(rest: Floats) -> float:
    return float(np.linalg.norm(rest))
