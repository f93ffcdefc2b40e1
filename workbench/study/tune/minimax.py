"""Least maximum of functions that are smooth in pieces: a trust region, a bundle of slopes, quadratic programmes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from workbench.core.values.arrays import Floats

__all__ = ["Evaluation", "MinimaxEnd", "SmoothPiece", "minimax"]

_CURVED = 1e-3  # curvature of t in the quadratic programme, which makes it strictly convex; its t is then off by 1e-3·t
_PENALTY = 100.0  # of a violated hard piece against a soft one
_GOOD = 0.1  # part of the predicted decrease that a step must keep
_SMALL = 1e-9  # trust region [coordinate], below which a search ends
_CUTS = 30  # slopes of refused steps that are kept
_NEAR = 0.3  # places that differ by less than this, relative, are of one piece at neighbouring points
_STILL = 12  # steps in a row that gain less than `tolerance`, after which a search ends


@dataclass(frozen=True, eq=False)
class SmoothPiece:
    """One smooth function at a point.

    Attributes:
        value: at most 0 where it is met.
        slope: by the coordinates, shape (n,).
        place: where it is, e.g. a frequency or a pole: tells it from others of the same owner.
        owner: number of what it belongs to.
    """

    value: float
    slope: Floats
    place: complex
    owner: int


# The pieces at a point; None: they are not defined there (a loop is unstable, a run failed).
Evaluation = Callable[[Floats], Sequence[SmoothPiece] | None]


@dataclass(frozen=True, eq=False)
class MinimaxEnd:
    """Where a search ended.

    Attributes:
        z: coordinates, shape (n,).
        value: the largest soft piece; of all, where none is soft.
        hard: the largest hard piece; −inf: there is none.
        weights: owner → its part of the multipliers, of sum 1 over soft ones: at a minimum Σ weight · slope = 0.
        pieces: there.
        evaluations: that it took.
        values: of the steps that were kept, in their order.
        converged: whether no step gains more.
    """

    z: Floats
    value: float
    hard: float
    weights: dict[int, float]
    pieces: Sequence[SmoothPiece]
    evaluations: int
    values: tuple[float, ...]
    converged: bool

    @property
    def merit(self) -> float:
        """What is made small."""
        return self.value + _PENALTY * max(0.0, self.hard)


def minimax(
    evaluate: Evaluation,
    z: Floats,
    limits: tuple[Floats, Floats],
    *,
    hard: frozenset[int] = frozenset(),
    enough: float = -math.inf,
    most: int = 300,
    radius: float = 0.3,
    tolerance: float = 1e-6,
) -> MinimaxEnd | None:
    """Return a local minimum of the largest soft piece at which no hard piece is above 0, or as little as can be.

    Each step solves min ½ dᵀHd + t + ρ s subject to fⱼ + gⱼd ≤ t (soft), ≤ s (hard), s ≥ 0, within the limits and a
    trust region; H is a BFGS approximation of the curvature of the pieces with their multipliers. What a refused step
    has shown is kept as further slopes. A point without pieces is refused.

    Args:
        evaluate: the pieces at a point.
        z: where it begins, shape (n,).
        limits: lowest and highest coordinates.
        hard: owners that must be met; where all are hard, their largest is made small.
        enough: value at which the search may end.
        most: evaluations.
        radius: first trust region.
        tolerance: gain, relative to 1 + |value|, that ends the search.

    Returns:
        Where it ended; None: nothing is defined at z.

    Source: P. Apkarian, D. Noll, Nonsmooth H∞ synthesis, IEEE Trans. Automatic Control 51 (2006); the quadratic
    programme is a least-distance problem: C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974), ch. 23.
    """
    first = evaluate(z)
    if first is None:
        return None
    if all(p.owner in hard for p in first):
        hard = frozenset()
    search = _MinimaxSearch(z, first, hard, limits, radius)
    count, still = 1, 0
    while count < most and search.radius > _SMALL and still < _STILL and search.value > enough:
        step, predicted, weights = search.step()
        search.weights = weights
        if predicted <= tolerance * (1.0 + abs(search.merit)):
            if not search.forget():
                return search.ended(count, converged=True)
            continue
        tried = evaluate(search.z + step)
        count += 1
        gained = search.take(step, tried, predicted)
        still = still + 1 if gained < tolerance * (1.0 + abs(search.merit)) else 0
    return search.ended(count, converged=search.radius <= _SMALL or still >= _STILL)


class _MinimaxSearch:
    """A search under way."""

    def __init__(
        self,
        z: Floats,
        pieces: Sequence[SmoothPiece],
        hard: frozenset[int],
        limits: tuple[Floats, Floats],
        radius: float,
    ) -> None:
        self.z, self.pieces, self.radius = z, pieces, radius
        self._hard, self._limits = hard, limits
        steep = max((float(np.linalg.norm(p.slope)) for p in pieces), default=1.0)
        self._curvature = np.eye(len(z)) * min(max(0.1 * steep, 1e-6), 1e6)
        self._cuts: list[tuple[float, Floats, bool]] = []  # value at z, slope, whether it is hard
        self.values = [self.merit]
        self.weights: Floats = np.zeros(len(pieces))

    @property
    def value(self) -> float:
        """The largest soft piece."""
        return _largest(self.pieces, self._hard)[0]

    @property
    def merit(self) -> float:
        """What is made small."""
        return _merit(self.pieces, self._hard)

    def ended(self, count: int, *, converged: bool) -> MinimaxEnd:
        """Return where it ended."""
        weights: dict[int, float] = {}
        for piece, weight in zip(self.pieces, self.weights, strict=False):
            weights[piece.owner] = weights.get(piece.owner, 0.0) + float(weight)
        value, above = _largest(self.pieces, self._hard)
        return MinimaxEnd(self.z, value, above, weights, self.pieces, count, tuple(self.values), converged)

    def step(self) -> tuple[Floats, float, Floats]:
        """Return a step, the decrease that it promises, and the multipliers of the pieces."""
        n = len(self.z)
        rows = [(p.value, p.slope, p.owner in self._hard) for p in self.pieces] + self._cuts
        low, high = (np.clip(end - self.z, -self.radius, self.radius) for end in self._limits)
        root = np.linalg.cholesky(self._curvature)  # H = root rootᵀ
        base = self.value
        c = math.sqrt(_CURVED)
        # x = (rootᵀ d, c τ + 1/c, c s + ρ/c) has least distance from 0, with t = base + τ.
        gradients = np.array([slope for _, slope, _ in rows])
        soft = np.array([0.0 if h else 1.0 for *_, h in rows])
        left = np.vstack([
            np.column_stack([-np.linalg.solve(root, gradients.T).T, soft / c, (1.0 - soft) / c]),
            np.column_stack([np.linalg.solve(root, np.eye(n)).T, np.zeros((n, 2))]),
            np.column_stack([-np.linalg.solve(root, np.eye(n)).T, np.zeros((n, 2))]),
            [[0.0] * n + [0.0, 1.0 / c]],
        ])  # fmt: skip
        shift = np.where(soft > 0.0, 1.0, _PENALTY) / _CURVED
        values = np.array([value for value, *_ in rows])
        right = np.concatenate([values - soft * base + shift, low, -high, [_PENALTY / _CURVED]])
        x, multipliers = _least_distance(left, right)
        d = np.clip(np.linalg.solve(root.T, x[:n]), low, high)
        model = [value + float(slope @ d) for value, slope, _ in rows]
        reached = max((m for m, s in zip(model, soft, strict=True) if s > 0.0), default=base)
        above = max((m for m, s in zip(model, soft, strict=True) if s == 0.0), default=-math.inf)
        curved = 0.5 * float(d @ self._curvature @ d)
        predicted = self.merit - (reached + _PENALTY * max(0.0, above)) - curved
        return d, predicted, multipliers[: len(self.pieces)]

    def forget(self) -> bool:
        """Leave the slopes of refused steps, which may mislead, and return whether there were any."""
        known, self._cuts = bool(self._cuts), []
        self.radius *= 0.1 if known else 1.0
        return known

    def take(self, step: Floats, tried: Sequence[SmoothPiece] | None, predicted: float) -> float:
        """Go the step if it holds what it promises, and return what was gained."""
        long = float(np.abs(step).max())
        if tried is None:
            self.radius = 0.3 * long
            return math.inf  # it does not count as standing still
        gained = self.merit - _merit(tried, self._hard)
        if gained < _GOOD * predicted:
            self._learn(step, tried)
            self.radius = 0.5 * long
            return math.inf
        if gained > 0.7 * predicted and long > 0.9 * self.radius:
            self.radius *= 2.0
        self._bend(step, tried)
        self._cuts = [(v + float(g @ step), g, h) for v, g, h in self._cuts][-_CUTS:]
        self.z, self.pieces = self.z + step, tried
        limits = {False: self.value, True: max(0.0, _largest(tried, self._hard)[1])}
        self._cuts = [(min(v, limits[h]), g, h) for v, g, h in self._cuts if v > limits[h] - 1.0 - abs(limits[h])]
        self.values.append(self.merit)
        return gained

    def _learn(self, step: Floats, tried: Sequence[SmoothPiece]) -> None:
        """Keep the slopes of a refused step, lowered where they would lie above what is known here."""
        top = {False: self.value, True: max(0.0, _largest(self.pieces, self._hard)[1])}
        for p in tried:
            is_hard = p.owner in self._hard
            here = p.value - float(p.slope @ step)
            if p.value > top[is_hard] - 0.5 * abs(top[is_hard]):
                self._cuts.append((min(here, top[is_hard]), p.slope, is_hard))
        self._cuts = self._cuts[-_CUTS:]

    def _bend(self, step: Floats, tried: Sequence[SmoothPiece]) -> None:
        """Update the curvature by how the pieces that count have turned, with Powell's damping."""
        turned = np.zeros(len(step))
        for piece, weight in zip(self.pieces, self.weights, strict=False):
            if weight > 0.0 and (same := _same(piece, tried)) is not None:
                turned = turned + weight * (same.slope - piece.slope)
        pushed = self._curvature @ step
        along, wanted = float(step @ pushed), float(step @ turned)
        if not along > 0.0 or not np.isfinite(turned).all():
            return
        part = 1.0 if wanted >= 0.2 * along else 0.8 * along / (along - wanted)
        mixed = part * turned + (1.0 - part) * pushed
        update = np.outer(mixed, mixed) / float(step @ mixed) - np.outer(pushed, pushed) / along
        result = self._curvature + update
        size = float(np.linalg.eigvalsh(result)[-1])
        if math.isfinite(size) and size < 1e12:
            self._curvature = 0.5 * (result + result.T) + np.eye(len(step)) * 1e-9 * size


def _same(piece: SmoothPiece, others: Sequence[SmoothPiece]) -> SmoothPiece | None:
    """Return the piece of the same owner at the nearest place; None: there is none near."""
    own = [p for p in others if p.owner == piece.owner]
    nearest = min(own, key=lambda p: abs(p.place - piece.place), default=None)
    return nearest if nearest is not None and abs(nearest.place - piece.place) <= _NEAR * abs(piece.place) else None


def _largest(pieces: Sequence[SmoothPiece], hard: frozenset[int]) -> tuple[float, float]:
    soft = max((p.value for p in pieces if p.owner not in hard), default=-math.inf)
    return soft, max((p.value for p in pieces if p.owner in hard), default=-math.inf)


def _merit(pieces: Sequence[SmoothPiece], hard: frozenset[int]) -> float:
    soft, above = _largest(pieces, hard)
    return soft + _PENALTY * max(0.0, above)


def _least_distance(left: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return the x nearest to 0 with left · x ≥ right, shape (n,), and the multipliers, shape (m,)."""
    scale = np.maximum(np.linalg.norm(left, axis=1), 1e-300)
    matrix = np.vstack([(left / scale[:, None]).T, right / scale])
    goal = np.zeros(len(matrix))
    goal[-1] = 1.0
    u, _ = nnls(matrix, goal, maxiter=50 * matrix.shape[1])
    rest = matrix @ u - goal
    return -rest[:-1] / rest[-1], u / scale / -rest[-1]
