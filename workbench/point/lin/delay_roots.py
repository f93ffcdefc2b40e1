"""The poles of a linear model with transport delays as they are: counted by the argument principle, none stepped over.

With the delays taken out, w = diag(e^(−sT)) v and v = C₂x + D₂₂w, the poles are the roots of the entire function
h(s) = det M(s), M = [sI − A, −B₂E; −C₂, I − D₂₂E]. Its argument along a line Re s = σ tells how many lie right of it.
From a point s the step X = M(s)⁻¹(M(s + jt) − M(s)) is known in closed form, and

    |ln det(I + X) − tr X| ≤ ‖X‖²/(2(1 − ‖X‖))    (Frobenius),

so that over a stretch with ‖X‖ ≤ 1/2 the turn of h is known within half a radian; its values at both ends then fix it.
Stretches are halved until that holds. Beyond R, the spectral radius of |A| + |B₂|(I − |D₂₂|)⁻¹|C₂| (Perron), the series
of ln(h/sⁿ) converges in the whole half-plane, which closes the contour without a walk.

Source: L. V. Ahlfors, Complex Analysis, 3rd ed., 5.2 (argument principle); J. K. Hale, S. M. Verduyn Lunel,
Introduction to Functional Differential Equations, 1993, ch. 1 and 9 (retarded and neutral equations).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.large import is_large
from workbench.core.values.matrices import balance
from workbench.point.lin.result import DelayFreePart

__all__ = ["DelayRoots", "RootCount", "count_right_of", "delay_roots", "radius", "stretches"]

_HALF = 0.5  # ‖X‖ up to which the series above holds with half a radian
_RELATIVE = 1e-7  # of a root's size: so near the line a root is on it, as far as is known
_MOST = 200_000  # stretches: more take longer than a minute
_CHUNK = 4_000_000  # entries of matrices at a time
_OUT = 1.5  # times the radius beyond which no root lies: where the contour is closed
_NEWTON = 40
_LISTED = 3  # groups of poles of one real part that are proved to be the rightmost
_ASIDE = 0.01  # of its size: so far left of the last root that was found a line is, too
_APART = 1e-4  # of a root's size: lines nearer to a root than half of this take long to count along
_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class RootCount:
    """How many poles lie right of a line.

    Attributes:
        number: of them; infinite: a chain of them; NaN: not known.
        why: why it is not known, or infinite; empty: it is proved.
        seeds: places on the line from which roots near it are found, shape (k,) [1/s].
    """

    number: float
    why: str
    seeds: Complex


@dataclass(frozen=True)
class DelayRoots:
    """The rightmost poles of a linear model with delays.

    Attributes:
        right: number of poles right of the imaginary axis; see `RootCount`.
        roots: poles found, rightmost first, both of a pair, shape (k,) [1/s]; not all: there are infinitely many.
        complete_to: right of this no pole is missing from `roots`, proved [1/s]; infinite: nothing is proved.
        border: a pole is on the imaginary axis, as far as is known.
    """

    right: RootCount
    roots: Complex
    complete_to: float
    border: bool


class _Characteristic:
    """M(s) along the line Re s = σ, states and delays in units that make rows and columns alike."""

    def __init__(self, part: DelayFreePart, sigma: float) -> None:
        n, k = len(part.A), len(part.times)
        whole = np.block([[part.A, part.B[:, -k:]], [part.C[-k:], part.D[-k:, -k:]]])
        whole, _ = balance(whole)
        self.n, self.times, self.size = n, part.times, float(np.linalg.norm(whole[:n, :n]))
        self.A, self.C = whole[:n, :n] - sigma * np.eye(n), whole[n:, :n]
        self.into = whole[:, n:]  # B₂ and D₂₂, one column for each delay
        self.still = np.exp(-sigma * part.times)

    def matrices(self, s: Complex) -> Complex:
        """Return M, shape (k, n + d, n + d)."""
        n, size = self.n, self.n + len(self.times)
        result = np.zeros((len(s), size, size), dtype=np.complex128)
        result[:, :n, :n] = -self.A
        result[:, n:, :n] = -self.C
        result[:, :, n:] = -self.into * (self.still * np.exp(-s[:, None] * self.times))[:, None, :]
        index = np.arange(size)
        result[:, index, index] += np.where(index < n, s[:, None], 1.0)
        return result

    def inverse(self, s: Complex) -> Complex:
        """Return M⁻¹, NaN where there is none."""
        m = self.matrices(s)
        singular = (np.linalg.slogdet(m)[0] == 0.0) | ~np.isfinite(m).all(axis=(1, 2))
        m[singular] = np.eye(m.shape[1])
        result = np.linalg.inv(m)
        result[singular] = np.nan
        return np.asarray(result, dtype=np.complex128)

    def steps(self, s: Complex) -> tuple[Complex, Complex, Floats, Floats]:
        """Return tr M⁻¹ over the states, diagonal of M⁻¹[B₂; D₂₂]E, and the sizes of their columns in X."""
        n = self.n
        inverse = self.inverse(s)
        turned = (self.still * np.exp(-s[:, None] * self.times))[:, None, :]
        back = (inverse @ self.into) * turned
        d = np.arange(len(self.times))
        return (
            np.trace(inverse[:, :n, :n], axis1=1, axis2=2), back[:, n + d, d],
            np.linalg.norm(inverse[:, :, :n], axis=(1, 2)), np.linalg.norm(back, axis=1),
        )  # fmt: skip

    def norm(self, half: Floats, states: Floats, delays: Floats) -> Floats:
        """Return a bound on ‖X‖ over a stretch."""
        turn = np.minimum(half[:, None] * self.times, 2.0)
        return np.asarray(np.sqrt((half * states) ** 2 + ((turn * delays) ** 2).sum(axis=1)), dtype=np.float64)

    def trace(self, t: Floats, states: Complex, delays: Complex) -> Complex:
        """Return tr X of a step jt."""
        turned = ((np.exp(-1j * t[:, None] * self.times) - 1.0) * delays).sum(axis=1)
        return np.asarray(1j * t * states - turned, dtype=np.complex128)

    def through(self) -> float:
        """Return the spectral radius of |D₂₂E|: below 1 the chains of poles stay left of the line."""
        direct = np.abs(self.into[self.n :]) * self.still
        return float(np.abs(np.linalg.eigvals(direct)).max(initial=0.0))

    def radius(self) -> float:
        """Return the size beyond which no root lies right of the line."""
        direct = np.abs(self.into[self.n :]) * self.still
        within = np.linalg.solve(np.eye(len(direct)) - direct, np.abs(self.C))
        bound = np.abs(self.A) + (np.abs(self.into[: self.n]) * self.still) @ within
        return float(np.abs(np.linalg.eigvals(bound)).max(initial=0.0))

    def logarithm(self, s: complex) -> float:
        """Return the argument of h/sⁿ beyond the radius, by its series."""
        turned = self.still * np.exp(-s * self.times)
        direct = self.into[self.n :] * turned
        rest = self.A + self.into[: self.n] * turned @ np.linalg.solve(np.eye(len(direct)) - direct, self.C)
        values = np.concatenate([np.linalg.eigvals(direct), np.linalg.eigvals(rest) / s])
        return float(np.angle(1.0 - values).sum())


def count_right_of(part: DelayFreePart, sigma: float = 0.0) -> RootCount:
    """Return how many poles lie right of the line Re s = σ.

    Args:
        part: the model.
        sigma: σ [1/s].
    """
    nothing = np.zeros(0, dtype=np.complex128)
    if is_large(part.A, 0.0):
        return RootCount(math.nan, "the model is too large for its delays to be counted with", nothing)
    h = _Characteristic(part, sigma)
    through = h.through()
    if through >= 1.0:
        own = np.abs(np.diag(h.into[h.n :])) * h.still
        if own.max() == through and through > 1.0:  # the bound is reached: by a delay that feeds itself
            return RootCount(math.inf, "what a delay passes on returns to it at once, and greater", nothing)
        return RootCount(math.nan, "what a delay passes on returns to it at once, and not smaller", nothing)
    top = _OUT * h.radius() or 1.0
    found = _walk(h, top)
    seeds = np.asarray(sigma + 1j * found.centres, dtype=np.complex128)
    if found.why:
        return RootCount(math.nan, found.why, seeds)
    turns = 0.5 * h.n - (found.turn - h.logarithm(1j * top)) / math.pi
    if abs(turns - round(turns)) > 0.01:
        return RootCount(math.nan, "rounding hides how often the characteristic function turns", seeds)
    return RootCount(float(round(turns)), "", seeds)


@dataclass(frozen=True)
class _Walked:
    turn: float
    why: str
    centres: Floats
    ends: Floats


def _walk(h: _Characteristic, top: float, turn: float = math.inf) -> _Walked:
    """Return by how much h turns from 0 to `top`, in stretches that are proved to be short enough.

    Args:
        h: of the line.
        top: [rad/s].
        turn: a stretch is no longer than this [rad/s].
    """
    grid = np.concatenate([[0.0], np.geomspace(1e-4 * top, top, 33)])
    low, high = grid[:-1], grid[1:]
    kept: list[tuple[Floats, Floats, Floats]] = []
    least, why, count = 100.0 * _EPS * max(h.size, 1e-300), "", 0
    while len(low):
        count += len(low)
        if count > _MOST:
            why = "it takes too many frequencies to follow the delays up to where they do no more"
            break
        centre, half = 0.5 * (low + high), 0.5 * (high - low)
        states, delays, norm = _chunks(h, centre, half)
        good = (norm <= _HALF) & (2.0 * half <= turn)
        change = (h.trace(half, states, delays) - h.trace(-half, states, delays)).imag
        kept.append((low[good], high[good], change[good]))
        stuck = ~good & (half < _RELATIVE * centre + least)
        if stuck.any():
            why = (
                why or f"a pole is on the border, as near as it is known, at {centre[stuck][0] / (2 * math.pi):.4g} Hz"
            )
            kept.append((low[stuck], high[stuck], change[stuck]))
        again = ~good & ~stuck
        low, middle, high = low[again], centre[again], high[again]
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    a, b, change = (np.concatenate([k[i] for k in kept]) for i in range(3))
    order = np.argsort(a)
    a, b, change = a[order], b[order], change[order]
    ends = np.append(a, b[-1:])
    if why:
        return _Walked(math.nan, why, 0.5 * (a + b), ends)
    at = _signs(h, np.asarray(1j * ends, dtype=np.complex128))
    step = np.angle(at[1:] * at[:-1].conj())
    turned = float((step + 2.0 * math.pi * np.round((change - step) / (2.0 * math.pi))).sum())
    return _Walked(turned, "", 0.5 * (a + b), ends)


def _chunks(h: _Characteristic, centre: Floats, half: Floats) -> tuple[Complex, Complex, Floats]:
    size = max(_CHUNK // (h.n + len(h.times)) ** 2, 1)
    every = [h.steps(np.asarray(1j * centre[i : i + size], dtype=np.complex128)) for i in range(0, len(centre), size)]
    states, delays, wide, back = (np.concatenate([e[i] for e in every]) for i in range(4))
    return states, delays, np.nan_to_num(h.norm(half, wide, back), nan=np.inf)


def _signs(h: _Characteristic, s: Complex) -> Complex:
    size = max(_CHUNK // (h.n + len(h.times)) ** 2, 1)
    every = [np.linalg.slogdet(h.matrices(s[i : i + size]))[0] for i in range(0, len(s), size)]
    return np.asarray(np.concatenate(every), dtype=np.complex128)


def stretches(part: DelayFreePart, top: float, turn: float) -> Floats:
    """Return frequencies between which the model with its delays changes little, rising from 0 [rad/s].

    Args:
        part: the model.
        top: the last [rad/s].
        turn: no two neighbours are farther apart [rad/s].
    """
    return _walk(_Characteristic(part, 0.0), top, turn).ends


def radius(part: DelayFreePart) -> float:
    """Return the size beyond which no pole lies right of the imaginary axis [rad/s]; infinite: there is none.

    Args:
        part: the model.
    """
    h = _Characteristic(part, 0.0)
    return _OUT * h.radius() if h.through() < 1.0 else math.inf


def delay_roots(part: DelayFreePart, near: Complex) -> DelayRoots:
    """Return the rightmost poles, and how many are right of the imaginary axis.

    Args:
        part: the model.
        near: where some are, such as those of a Padé approximation, shape (k,) [1/s].
    """
    right = count_right_of(part)
    roots = _refined(part, np.concatenate([near, right.seeds]))
    h = _Characteristic(part, 0.0)
    known = _RELATIVE * np.abs(roots) + 100.0 * _EPS * h.size
    border = bool(np.any(np.abs(roots.real) <= known))
    complete = 0.0 if right.number == float(np.sum(roots.real > 0.0)) else math.inf
    for line in _gaps(roots):
        counted = count_right_of(part, line)
        if counted.number != float(np.sum(roots.real > line)):
            roots = _refined(part, np.concatenate([roots, counted.seeds]))
        if counted.number != float(np.sum(roots.real > line)):
            break
        complete = line
    return DelayRoots(right, roots, complete, border)


def _gaps(roots: Complex) -> list[float]:
    """Return lines left of the first roots: in the middle between two of different real parts, beside the last."""
    real = np.append(roots.real, roots.real[-1:] - 2.0 * _ASIDE * np.abs(roots[-1:]))
    apart = np.flatnonzero(real[:-1] - real[1:] > _APART * np.abs(roots))[:_LISTED]
    lines: list[float] = (0.5 * (real[apart] + real[apart + 1])).tolist()
    return lines


def _refined(part: DelayFreePart, near: Complex) -> Complex:
    """Return the poles to which Newton's method leads from these places, rightmost first, both of a pair."""
    h = _Characteristic(part, 0.0)
    s = np.unique(near[near.imag >= 0.0])
    bound = 1e3 * max(h.size, float(np.abs(s).max(initial=0.0)), 1e-300)
    step = np.full(len(s), np.inf, dtype=np.complex128)
    for _ in range(_NEWTON):
        with np.errstate(all="ignore"):
            states, delays, *_ = h.steps(s)
            # h'/h = tr M⁻¹M', M' = [I, T B₂E; 0, T D₂₂E]
            step = 1.0 / (states + (delays * h.times).sum(axis=1))
            moved = s - np.where(np.isfinite(step), step, 0.0)
        keep = np.isfinite(moved) & (np.abs(moved) < bound) & (moved.real > -bound / 1e3)
        s, step = moved[keep], step[keep]
        if not len(s) or np.all(np.abs(step) <= 1e-13 * np.abs(s) + _EPS * h.size):
            break
    s = s[~(np.abs(step) > 1e-9 * np.abs(s) + 100.0 * _EPS * h.size)]
    s = np.where(np.abs(s.imag) <= 1e-9 * np.abs(s) + 100.0 * _EPS * h.size, s.real + 0j, s.real + 1j * np.abs(s.imag))
    kept: list[complex] = []
    for root in s[np.argsort(-s.real)].tolist():
        if all(abs(root - other) > 1e-6 * abs(root) + 100.0 * _EPS * h.size for other in kept):
            kept += [root, root.conjugate()] if root.imag else [root]
    return np.array(kept, dtype=np.complex128)
