"""Where the poles of a model may be, by the covariance of its parameters: where its polynomial may vanish."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex, Floats

__all__ = ["Parameters", "PoleRegion", "compatible_regions"]

_Inside = Callable[[Complex], NDArray[np.bool_]]

_SCATTER = 0.15  # a pole that scatters more (root mean square) over the unit disc is not determined
_WIDER = 2.0  # how much wider the other regions become where one is not
ON_AXIS = 1e-12  # imaginary parts below are none
_TINY = 1e-12  # least variance: of poles that never move, as those of noise-free data
_RAYS = 32
_RADII = np.geomspace(1e-9, 2.5, 31)  # beyond the unit disc from anywhere in it
_GROWN = 1.05  # times the last reach, at which a set is seen to its ends
_HALVINGS = 14  # of the last interval of the logarithm of the radius
_LEVEL = 1e-7  # imaginary part that is as good as none
_SEARCHED = 201  # points of the real axis at which two real poles may be one pair
_COVERED = 100  # steps towards the smallest ellipse
_ON_CIRCLE = 256
_APART = 1.1  # times farther away than the last one inside a circle is the first one outside
_LEFT_OUT = 1e-3  # probability below which the part of a pole in the response is not chance


@dataclass(frozen=True, eq=False, kw_only=True)
class PoleRegion(RecordPart):
    """Where a pole may be.

    Attributes:
        pole: the estimate.
        spread: root mean square distance of a normal scatter with this region.
        shape: (2, 2), the region is all z with dᵀ shape⁻¹ d ≤ 1, d = (real, imaginary part of z − pole).
        on_axis: the region is an interval of the real axis.
        determined: False: the pole may be almost anywhere; the region then is the unit disc besides.
    """

    pole: complex
    spread: float
    shape: Floats = field(metadata=entry(dims=(2, 2)))
    on_axis: bool
    determined: bool

    def contains(self, z: complex) -> bool:
        """Return whether a number lies in the region.

        Args:
            z: on the plane of discrete poles.
        """
        if not self.determined and abs(z) <= 1.0:
            return True
        d = np.array([z.real - self.pole.real, z.imag - self.pole.imag])
        return bool(d @ np.linalg.solve(self.shape, d) <= 1.0)

    @property
    def half_axes(self) -> tuple[float, float]:
        """Lengths of the ellipse's half axes, the longer one first; without the disc of an undetermined pole."""
        sizes = np.sqrt(np.linalg.eigvalsh(self.shape))
        return float(sizes[1]), 0.0 if self.on_axis else float(sizes[0])

    def outline(self) -> Complex:
        """Return the edge of the ellipse as a closed curve, shape (181,)."""
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        edge = np.linalg.cholesky(self.shape) @ np.vstack([np.cos(angle), np.sin(angle)])
        return np.asarray(self.pole + edge[0] + 1j * edge[1], dtype=np.complex128)

    def derived(self) -> dict[str, Any]:
        """Return the size of the region."""
        return {"half_axes": self.half_axes}


@dataclass(frozen=True, eq=False)
class Parameters:
    """A model's matrices, and the factor S of their covariance S Sᵀ cut into theirs: the last axis are its f columns.

    Attributes:
        A, B, C, D: shapes (n, n), (n, m), (p, n), (p, m).
        SA, SB, SC, SD: the same with a last axis f.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    SA: Floats
    SB: Floats
    SC: Floats
    SD: Floats

    def response(self, z: Complex) -> tuple[Complex, Complex]:
        """Return G(z), shape (k, p, m), and how it moves by each column of S, shape (k, p, m, f).

        It moves by C (zI − A)⁻¹ (dA (zI − A)⁻¹ B + dB) + dC (zI − A)⁻¹ B + dD.

        Args:
            z: shape (k,).
        """
        inverse = np.linalg.inv(z[:, None, None] * np.eye(len(self.A)) - self.A)
        X, Y = inverse @ self.B, self.C @ inverse
        dX = np.einsum("ijf,kjm->kimf", self.SA, X) + self.SB
        moves = np.einsum("kpi,kimf->kpmf", Y, dX) + np.einsum("pif,kim->kpmf", self.SC, X) + self.SD
        return np.asarray(self.C @ X + self.D), np.asarray(moves)


def compatible_regions(model: Parameters, poles: Complex, *, confidence: float) -> tuple[PoleRegion, ...]:
    """Return around each pole the smallest ellipse that holds all numbers which the data allow to be that pole.

    The characteristic polynomial π(z) moves by −π(z) g(z), g(z) = tr((zI − A)⁻¹ dA), to first order in the parameters.
    It vanishes at z where g(z) = 1; so a number may be a pole where that is no surprise: (1, 0) Σ(z)⁻¹ (1, 0)ᵀ ≤ χ²₂
    with Σ(z) the covariance of real and imaginary part of g(z), on the real axis 1/var g(z) ≤ χ²₁ (Fieller, J. R. Stat.
    Soc. B 16, 1954, does so for a quotient). Poles need neither be linear in the parameters nor apart from each other,
    and the state basis does not matter: a change of it moves A by TA − AT, for which g is zero. Two real poles may be a
    pair, and a pair two real ones, where the polynomial may have a double root between them.

    What the data do not determine is found anywhere, and its covariance is of no use (Andrews & Cheng, Econometrica 80,
    2012): a pole whose region is wider than that of a scatter of 0.15, or whose part in the response may be zero. Its
    region is the unit disc besides, and the others are twice as wide.

    Not for: a fit that ended in a wrong minimum, which no covariance knows of.

    Args:
        model: with the covariance of its parameters.
        poles: shape (n,), its poles, in the order wanted.
        confidence: of each region for itself.
    """
    if not poles.size:
        return ()
    allowed = _Allowed(model.A, model.SA, confidence)
    known = [_region(allowed, complex(pole)) for pole in poles]
    known = [replace(r, determined=r.determined and _is_seen(model, poles, r)) for r in known]
    if all(r.determined for r in known):
        return tuple(known)
    return tuple(replace(r, shape=r.shape * _WIDER**2) for r in known)


class _Allowed:
    """Which numbers the data allow to be poles."""

    def __init__(self, A: Floats, SA: Floats, confidence: float) -> None:
        self._A, self._eye = A, np.eye(len(A))
        self._moves = np.swapaxes(SA, 0, 1).reshape(A.size, -1)
        self._real, self._pair = (float(special.chdtri(k, 1.0 - confidence)) for k in (1, 2))

    def spread(self, region: PoleRegion) -> float:
        """Return the root mean square distance whose region is so large."""
        quantile = self._real if region.on_axis else self._pair
        return float(np.sqrt(np.trace(region.shape) / quantile))

    def real(self, x: Complex) -> NDArray[np.bool_]:
        """Return which numbers of the real axis may be real poles."""
        g = self._g(x).real
        return np.asarray(self._real * np.sum(g * g, axis=1) >= 1.0)

    def pair(self, z: Complex) -> NDArray[np.bool_]:
        """Return which numbers may be poles with their conjugate, on the real axis twice."""
        return np.asarray(self.surprise(z) <= self._pair)

    def surprise(self, z: Complex) -> Floats:
        """Return (1, 0) Σ(z)⁻¹ (1, 0)ᵀ, on the real axis its limit."""
        g = self._g(np.where(np.abs(z.imag) < _LEVEL, z.real + 1j * _LEVEL, z))
        across, along, both = np.sum(g.imag**2, axis=1), np.sum(g.real**2, axis=1), np.sum(g.real * g.imag, axis=1)
        determinant = along * across - both * both
        least = 1.0 / np.maximum(along, 1e-300)  # also where nothing moves
        return np.asarray(np.maximum(least, across / np.maximum(determinant, 1e-300 * (1.0 + across))))

    def _g(self, z: Complex) -> Complex:
        """Return how −log π(z) moves by each column of S, shape (k, f)."""
        R = np.linalg.inv(z[:, None, None] * self._eye - self._A).reshape(len(z), -1)
        return np.asarray(R.real @ self._moves + 1j * (R.imag @ self._moves))


# -- the region of one pole ------------------------------------------------------------------------


def _region(allowed: _Allowed, pole: complex) -> PoleRegion:
    if pole.imag < -ON_AXIS:
        above = _region(allowed, pole.conjugate())
        return replace(above, pole=pole, shape=above.shape * np.array([[1.0, -1.0], [-1.0, 1.0]]))
    if pole.imag <= ON_AXIS:
        edge, on_axis = _of_real(allowed, pole)
    else:
        edge, on_axis = _of_pair(allowed, pole), False
    away = np.column_stack([(edge - pole).real, (edge - pole).imag])
    shape = np.diag([float(np.max(away**2)), 0.0]) if on_axis else _covering(away)
    shape = shape + (1e-9 * float(np.trace(shape)) + _TINY) * np.eye(2)
    region = PoleRegion(pole=pole, spread=0.0, shape=shape, on_axis=on_axis, determined=True)
    spread = allowed.spread(region)
    return replace(region, spread=spread, determined=spread <= _SCATTER)


def _of_real(allowed: _Allowed, pole: complex) -> tuple[Complex, bool]:
    """Return the edge of what a real pole may be, and whether that is on the real axis alone."""
    ends = _exits(allowed.real, pole, np.array([-1.0 + 0j, 1.0]))
    double = _double(allowed, ends.real.min(), ends.real.max())
    if double is None:
        return ends, True
    around = _star(allowed, double)
    return np.concatenate([ends, around, around.conj()]), False


def _of_pair(allowed: _Allowed, pole: complex) -> Complex:
    """Return the edge of what a pole with a conjugate may be."""
    edge = _star(allowed, pole)
    half = float(np.max(np.abs(edge - pole)))
    double = _double(allowed, pole.real - half, pole.real + half)
    if double is None:
        return edge
    return np.concatenate([edge, _exits(allowed.real, double, np.array([-1.0 + 0j, 1.0]))])


def _double(allowed: _Allowed, low: float, high: float) -> complex | None:
    """Return where between two numbers a double pole is least surprising; None: nowhere allowed."""
    x = np.linspace(low, high, _SEARCHED).astype(np.complex128)
    surprise = allowed.surprise(x)
    least = int(np.argmin(surprise))
    return complex(x[least]) if allowed.pair(x[least : least + 1])[0] else None


def _star(allowed: _Allowed, centre: complex) -> Complex:
    """Return the edge of what may be a pole with a conjugate, as seen from a number.

    The rays are even as if the set were round, so that a thin one is seen to its ends.
    """
    angle = 2.0 * np.pi * (np.arange(_RAYS) + 0.5) / _RAYS
    circle, L, reach = np.vstack([np.cos(angle), np.sin(angle)]), np.eye(2), 0.0
    while True:
        steps = L @ circle
        edge = _exits(allowed.pair, centre, steps[0] + 1j * steps[1])
        away = np.column_stack([(edge - centre).real, (edge - centre).imag])
        farthest = float(np.max(np.abs(away)))
        if farthest <= _GROWN * reach or farthest <= _RADII[0]:
            return edge
        reach, shape = farthest, _covering(away)
        L = np.linalg.cholesky(shape / np.trace(shape) + 1e-12 * np.eye(2))


def _exits(inside: _Inside, start: complex, steps: Complex) -> Complex:
    """Return where rays first leave a set, shape as steps; the last radius where they do not."""
    held = inside((start + steps[:, None] * _RADII).ravel()).reshape(len(steps), -1)
    out = np.where(held.all(axis=1), len(_RADII) - 1, np.argmin(held, axis=1))
    low, high = np.log(_RADII[np.maximum(out - 1, 0)]), np.log(_RADII[out])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        within = inside(start + steps * np.exp(middle))
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    return np.asarray(start + steps * np.exp(high))


def _covering(away: Floats) -> Floats:
    """Return the smallest ellipse about 0 that holds points: all with dᵀ M⁻¹ d ≤ 1.

    By multiplicative steps towards the design of largest determinant, which is the same (Silvey, Titterington &
    Torsney, Commun. Stat. A 7, 1978).

    Args:
        away: shape (k, 2).
    """
    least = 1e-12 * float(np.max(away**2)) + _TINY**2
    L = np.linalg.cholesky(away.T @ away / len(away) + least * np.eye(2))
    x, y = np.linalg.solve(L, away.T)  # about as wide as long, so that the determinant below is exact
    products, weights = np.stack([x * x, x * y, y * y]), np.full(len(away), 1.0 / len(away))

    def ellipse() -> tuple[Floats, Floats]:
        xx, xy, yy = products @ weights + np.array([1e-12, 0.0, 1e-12])
        return np.array([[xx, xy], [xy, yy]]), np.array([yy, -2.0 * xy, xx]) / (xx * yy - xy * xy) @ products

    for _ in range(_COVERED):
        weights *= ellipse()[1]
        weights /= weights.sum()
    M, squares = ellipse()
    return np.asarray(L @ M @ L.T * float(np.max(squares)))


# -- whether it is seen at all ---------------------------------------------------------------------


def _is_seen(model: Parameters, poles: Complex, region: PoleRegion) -> bool:
    """Return whether a pole's part in the response is more than chance.

    Of poles that are not apart from each other it is what they have in common: of their part of C (A − cI)ᵏ B as many
    terms as they are, each a mean of (z − c)ᵏ⁺¹ G(z) on a circle about c with these poles inside.
    """
    pole, half = region.pole, region.half_axes[0]
    centre = complex(pole.real) if 2.0 * abs(pole.imag) <= half else pole
    away = np.sort(np.abs(poles - centre))
    reach = max(half, abs(pole - centre))
    inside = int(np.sum(away <= reach))
    while inside < len(away) and away[inside] < _APART * reach:
        reach, inside = float(away[inside]), inside + 1
    radius = np.sqrt(reach * away[inside]) if inside < len(away) else 2.0 * reach
    turns = np.asarray(np.exp(2j * np.pi * np.arange(_ON_CIRCLE) / _ON_CIRCLE), dtype=np.complex128)
    G, moves = model.response(np.asarray(centre + radius * turns, dtype=np.complex128))
    weights = turns ** np.arange(1, inside + 1)[:, None] / _ON_CIRCLE
    x, S = weights @ G.reshape(_ON_CIRCLE, -1), weights @ moves.reshape(_ON_CIRCLE, -1)
    parts = (np.real, np.imag) if abs(centre.imag) > ON_AXIS else (np.real,)
    x, S = (np.concatenate([part(a.reshape(x.size, -1)) for part in parts]) for a in (x, S))
    x = x[:, 0]
    size = np.linalg.norm(S, axis=1) + 1e-9 * float(np.max(np.abs(x))) + 1e-300
    x, S = x / size, S / size[:, None]
    wald = x @ np.linalg.solve(S @ S.T + 1e-9 * np.eye(len(x)), x)
    return bool(special.chdtrc(len(x), wald) < _LEFT_OUT)
