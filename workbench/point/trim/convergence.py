"""Whether the end of a search is an equilibrium: what is left of the equations against what they do around it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.point.trim.null_space import RANK, Factors, Solver, least_norm, readable, regular
from workbench.point.trim.scaled import ScaledEquations

__all__ = ["EquilibriumTest", "SearchResult"]

# Over the differences' own width curvature is as small as rounding; ten times as far it shows, 100 times as large.
_WIDER = 10.0  # than the differences of the Jacobian: how far around a point the equations are looked at
_SCATTER = (2.0, 5.0, 11.0)  # ulps of the unknowns by which a point is moved to see the noise; no two round alike
# Three samples of an even error are all below an eighth of its bound once in 8³ = 512 cases.
_NOISE = 8.0  # times the scatter seen: what cannot be told from zero
_ROUNDING = 16.0 * np.finfo(np.float64).eps  # of an equation's terms where no unknown changes it: 32 roundings
# An edge gives 2, that of a square root 1.41; what fades by rounding (1 − tanh x, e^-x²) 1.01 at most over _EDGE.
_SHARP = 1.3  # at twice the distance from where it vanishes, an equation is larger by this factor at least
_HARDLY = 100.0  # times the noise: what can hardly be told from zero; decides on words only ("there may be one")
_EDGE = 1e-4  # that distance, in reaches; e^-x² at x = 6, where it has faded, changes by 0.7 % over it
_BISECTIONS = 60  # more than the 53 bits of a double
_ALONG = 0.03  # nominal values by which one moves along a direction to see whether it is a family; x³ is 3e-5 there
_RETURNS = 12  # corrections on the way back to the family; each leaves a tenth, or less, where curvature is about 1
_ON_FAMILY = 1e-12  # scaled residual: thousands of rounding errors, far below x³ at _ALONG
_FURTHER = 3  # steps of Newton's method from a root without slope
_CLOSER = 0.8  # the last of these over the first; 0.9³ = 0.73 towards a tenfold root, 0.96 for e^-x² from 6, 1 for e^-x
_REGULAR = 0.1  # largest singular value, at least, where slopes do not vanish; 1 for a straight line
_STRAIGHT = 0.5  # part by which differences may differ from slopes where those speak for all combinations
_TOGETHER = 1e-3  # part by which equations may change otherwise when all unknowns are moved together: they bend
_SURELY = 2.0  # times a bound with a singular value that inverse iteration finds to a part of it
_LARGE = 1e300  # stands for what cannot be evaluated
_VERY_FAR = 1e6  # reaches: rounding is 1e-10 of a reach there, and may hide what was seen at the start


@dataclass(frozen=True, eq=False, kw_only=True)
class SearchResult:
    """What is to be said of the end of a search.

    Attributes:
        at_rest: whether the equations hold.
        bad: shape (h,), required equations that do not hold.
        scales: shape (e,), change of every equation when each unknown changes by its nominal value, or by
            itself where that is more; the nominal value where no unknown changes it.
        ran_away: whether residuals fell only because the unknowns went ever further away.
        faded: whether an equation faded into rounding, so that a root and a run-away look alike.
    """

    at_rest: bool
    bad: NDArray[np.bool_]
    scales: Floats
    ran_away: bool = False
    faded: bool = False


@dataclass(frozen=True, eq=False)
class _Combinations:
    """Sums of equations: r of them, or each of the first r by itself.

    Attributes:
        count: r.
        weights: shape (r, e); None: single equations.
    """

    count: int
    weights: Floats | None = None

    def of(self, values: Floats) -> Floats:
        """Return the sums of values, shape (…, e) → (…, r)."""
        return values[..., : self.count] if self.weights is None else values @ self.weights.T

    def of_sizes(self, values: Floats) -> Floats:
        """Return the sums by the sizes of the weights, shape (…, e) → (…, r)."""
        return values[..., : self.count] if self.weights is None else values @ np.abs(self.weights).T

    def one(self, i: int, equations: int) -> _Combinations:
        """Return one of them."""
        return _Combinations(1, np.eye(1, equations, i) if self.weights is None else self.weights[[i]])


@dataclass(frozen=True, eq=False)
class _Neighbourhood:
    """The equations at a point and around it.

    Attributes:
        at: shape (k,), the point.
        here: shape (e,).
        moved: shape (m, e), how they change when one unknown is moved.
        part: shape (m,), by how much of its reach; a reach is the nominal value, or the unknown where that is more.
        column: shape (m,), which unknown.
        scatter: shape (s, e), how they change when all unknowns are moved by rounding errors.
        rounding: shape (e,), rounding errors of the equations themselves.
        mixing: relative error of combinations of equations.
    """

    at: Floats
    here: Floats
    moved: Floats
    part: Floats
    column: NDArray[np.intp]
    scatter: Floats
    rounding: Floats
    mixing: float

    def change(self, sums: _Combinations) -> Floats:
        """Return the change of combinations of equations when each unknown moves by its reach, shape (r,)."""
        return self._change[: sums.count] if sums.weights is None else self._change_of(sums.of(self.moved))

    @cached_property
    def _change(self) -> Floats:
        """Of the equations, shape (e,)."""
        return self._change_of(self.moved)

    def _change_of(self, moved: Floats) -> Floats:
        first = np.flatnonzero(np.diff(self.column, prepend=-1))
        last = np.flatnonzero(np.diff(self.column, append=-1))  # both sides of an unknown, or the only one
        sizes, others = (np.abs(moved[at]) / self.part[at, None] for at in (first, last))
        return np.asarray(np.maximum(sizes, others, out=sizes).sum(axis=0))

    @cached_property
    def _largest(self) -> Floats:
        """Largest change of each equation, shape (e,)."""
        return np.asarray(np.abs(self.moved).max(axis=0, initial=0.0))

    def noise(self, sums: _Combinations) -> Floats:
        """Return what cannot be told from zero in combinations of equations, shape (r,)."""
        seen = np.abs(sums.of(self.scatter)).max(axis=0, initial=0.0)
        return np.asarray(_NOISE * np.maximum(seen, sums.of_sizes(self.rounding)))

    def flat(self, sums: _Combinations) -> NDArray[np.bool_]:
        """Return which combinations do not change around the point, shape (r,)."""
        single = sums.weights is None
        largest = self._largest[: sums.count] if single else np.abs(sums.of(self.moved)).max(axis=0, initial=0.0)
        return np.asarray(largest <= self.noise(sums) + self.mixing * sums.of_sizes(self._largest))


def _off(factors: Factors, differences: Floats) -> float:
    """Return ‖M‖∞ of differences of one side, shape (n, n), an unknown a row; see `EquilibriumTest._certain`."""
    off = factors.solve(differences.T)
    off *= np.sign(np.diag(off))
    off[np.diag_indices_from(off)] -= 1.0
    return float(np.abs(off, out=off).sum(axis=1).max())


@dataclass(frozen=True, eq=False)
class _Look:
    """Of combinations of equations, shape (r,) each: which vanish, which fell by running away, which faded."""

    holds: NDArray[np.bool_]
    away: NDArray[np.bool_]
    faded: NDArray[np.bool_]


class EquilibriumTest:
    """Tells an equilibrium from a point where the equations are merely small.

    A residual is small against the change that the equation makes around the point, over a finite distance: 1e-4 of
    each unknown or its nominal value (more where the model is less precise). So x' = e^-x never holds: it is small
    far away, but so are its changes, and the root it points to stays as far as before. x' = −x³ holds near 0,
    where its slope vanishes as well, since around it it is larger by orders. Besides single equations,
    combinations of them are looked at, those of the singular values: a slow drift may hide under stiff terms.

    Where an equation does not change around the point at all, it must be zero to rounding; if the search came from
    where it was not, it must have become zero at an edge (a dead zone), not by fading into rounding (1 − tanh x).

    Args:
        scaled: the equations.
        home: shape (k,), where the search began.
        tolerance: of a residual over the change around the point.
    """

    def __init__(self, scaled: ScaledEquations, home: Floats, tolerance: float) -> None:
        self._scaled, self._home, self._tolerance = scaled, home, tolerance
        self._width = _WIDER * scaled.problem.balance.precision ** (1.0 / 3.0)
        self._hard = scaled.hard
        self._kept: dict[bytes, SearchResult] = {}
        self._seen: dict[bytes, _Neighbourhood] = {}

    def __call__(self, w: Floats) -> SearchResult:
        """Return what is to be said of a point, shape (k,)."""
        key = w.tobytes()
        if key not in self._kept:
            self._kept[key] = self._judge(w)
        return self._kept[key]

    def _judge(self, w: Floats) -> SearchResult:
        here = self._scaled.residuals(w)
        if not np.isfinite(here[: self._hard]).all():
            bad = ~np.isfinite(here[: self._hard])
            return SearchResult(at_rest=False, bad=bad, scales=self._scaled.nominals)
        around = self._around(w)
        every = _Combinations(len(here))
        change = around.change(every)
        scales = np.where(around.flat(every) | (change == 0.0), self._scaled.nominals, change)
        looks = [self._look(w, around, _Combinations(self._hard), self._begin)]
        bad = ~looks[0].holds
        if not bad.any() and not self._contracts(w, scales[: self._hard], around):
            bad[:] = True
        if not bad.any() and not self._certain(w, scales[: self._hard], around):
            for combined, come_from in self._combined(w, scales):
                looks.append(self._look(w, around, _Combinations(len(combined), combined), come_from))
                share = np.abs(combined[:, : self._hard]) * scales[: self._hard]
                most = share.max(axis=1, initial=0.0, keepdims=True)
                bad |= (share >= 0.5 * most)[~looks[-1].holds].any(axis=0)
        return SearchResult(
            at_rest=not bad.any(),
            bad=bad,
            scales=scales,
            ran_away=any(x.away.any() for x in looks),
            faded=any(x.faded.any() for x in looks),
        )

    def _look(
        self, w: Floats, around: _Neighbourhood, sums: _Combinations, come_from: Callable[[], _Neighbourhood]
    ) -> _Look:
        """Return what is to be said of combinations of equations; `come_from`: where they are looked at from."""
        left = np.abs(sums.of(around.here))
        noise, flat, change = around.noise(sums), around.flat(sums), around.change(sums)
        clearly = left <= self._tolerance * change
        if (clearly & ~flat).all() and self._way(w, self._home) < _VERY_FAR:
            none = np.zeros(sums.count, dtype=bool)
            return _Look(~none, none, none)
        begin = come_from()
        holds = clearly | (left <= noise)
        before, clear = np.abs(sums.of(begin.here)), begin.noise(sums)
        for i in np.flatnonzero(flat).tolist():
            one = sums.one(i, len(around.here))
            idle = bool(begin.flat(one)[0]) and abs(before[i] - left[i]) <= max(noise[i], clear[i])
            if idle:
                holds[i] = left[i] <= noise[i] or self._idle(one, float(left[i]))
            else:
                holds[i] = left[i] <= noise[i] and (
                    before[i] <= noise[i] or self._edge(begin.at, w, one, float(noise[i]))
                )
        # What was seen clearly at the start cannot be seen here: large numbers, not an equilibrium.
        lost = (before > clear) & (before <= noise)
        holds &= ~lost
        far = self._way(w, begin.at) > 1.0
        stuck = left > self._width * np.where(flat, 0.0, change)
        away = ~holds & far & stuck & ((left < before) | lost)
        return _Look(holds, away, ~holds & flat & (before > clear) & (left <= _HARDLY * noise))

    @staticmethod
    def _way(w: Floats, begin: Floats) -> float:
        """Return how far a point is from where one came from, in reaches."""
        return float((np.abs(w - begin) / np.maximum(1.0, np.abs(begin))).max(initial=0.0))

    def _contracts(self, w: Floats, scales: Floats, around: _Neighbourhood) -> bool:
        """Whether Newton's method goes on to come nearer where its step is not small yet: to a root without slope.

        It does not where there is none, but almost (x² + 1e-9), nor where the root is as far as before (e^-x).
        """
        reach = np.maximum(1.0, np.abs(w))
        noise = around.noise(_Combinations(self._hard))
        at, left = w, around.here[: self._hard]
        steps: list[float] = []
        for _ in range(_FURTHER + 1):
            if not w.size or (np.abs(left) <= noise).all():
                return True
            jacobian = self._scaled.jacobian(at)[: self._hard] * reach / scales[:, None]
            step = least_norm(jacobian)[0](-left / scales)
            steps.append(float(np.abs(step).max()))
            if steps[0] <= self._tolerance:
                return True
            at = self._scaled.inside(at + step * reach)
            left = self._scaled.residuals(at)[: self._hard]
            if not np.isfinite(left).all():
                return False
        return steps[-1] <= _CLOSER * steps[0]

    def _certain(self, w: Floats, scales: Floats, around: _Neighbourhood) -> bool:
        """Whether the combinations of all singular values hold, so that none has to be looked at by itself.

        With a regular J, the differences D around the point and M = J⁻¹D − I, the combination of a singular value,
        y·J = σv, is y·r = σv·s, s = J⁻¹r, and changes by ‖yD‖₁ ≥ σ‖v‖₁ (1 − ‖M‖∞): it is small against that where s
        is small. It is no rounding error e of the equations where ‖e‖₂ is small against that, ‖v‖₁ ≥ 1, as far as
        the unknowns also change it when they are moved together.

        Source: Deuflhard, Newton Methods for Nonlinear Problems, 2004, section 2.1 (affine covariant conditions).
        """
        reach, n, own = np.maximum(1.0, np.abs(w)), len(w), slice(0, self._hard)
        factors = regular(self._scaled.jacobian(w)[own] * reach / scales[:, None])
        sides = (np.diff(around.column, prepend=-1) > 0, np.diff(around.column, append=n) > 0)
        if factors is None or self._way(w, self._home) >= _VERY_FAR or len(np.unique(around.column)) < n:
            return False
        above, below = (around.moved[side, own] / around.part[side, None] / scales for side in sides)
        bent = _off(factors, above)
        if bent > _STRAIGHT:
            return False
        # Of a straight line both sides are opposite: ‖J⁻¹E‖∞ ≤ √n ‖E‖₂/σ of what they are not is small.
        other = _SURELY * math.sqrt(n) * float(np.linalg.norm(above + below)) / factors.least
        if bent + other > _STRAIGHT and _off(factors, below) > _STRAIGHT:
            return False
        width = float(around.part.min())
        moved = self._scaled.inside(w + width * reach * np.random.default_rng(4).choice([-1.0, 1.0], size=n))
        together = factors.solve((self._scaled.residuals(moved)[own] - around.here[own]) / scales)
        if not np.abs(together - (moved - w) / reach).max() <= _STRAIGHT * width:
            return False
        largest = np.abs(around.moved[:, own]).max(axis=0)
        noise = (around.noise(_Combinations(self._hard)) + around.mixing * largest) / scales
        step = np.abs(factors.solve(around.here[own] / scales)).max()
        changes = 1.0 - _STRAIGHT
        return bool(step <= changes * self._tolerance and np.linalg.norm(noise) <= changes * factors.least * width)

    # -- where nothing changes an equation ------------------------------------------------------

    def _idle(self, one: _Combinations, left: float) -> bool:
        """Whether a combination is zero to rounding that no unknown changes, neither here nor at the start.

        Its terms are as large as what is held makes them, and of the nominal value.
        """
        terms = np.abs(self._scaled.held_change()).sum(axis=1) + self._scaled.nominals
        return bool(left <= _ROUNDING * float(one.of_sizes(terms)[0]))

    def _edge(self, begin: Floats, w: Floats, one: _Combinations, level: float) -> bool:
        """Whether a combination becomes zero at an edge on the way from `begin`; False: it fades away."""
        way = w - begin

        def size(part: float) -> float:
            result = float(np.abs(one.of(self._scaled.residuals(begin + part * way)))[0])
            return result if np.isfinite(result) else np.inf

        low, high = 0.0, 1.0
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if size(middle) <= level else (middle, high)
        reach = np.maximum(1.0, np.abs(begin + high * way))
        step = min(_EDGE / float((np.abs(way) / reach).max()), 0.25 * high)
        near, far = size(high - step), size(high - 2.0 * step)
        return near > level and far >= _SHARP * near

    # -- around a point -------------------------------------------------------------------------

    def _begin(self) -> _Neighbourhood:
        return self._around(self._home)

    def _around(self, w: Floats) -> _Neighbourhood:
        key = w.tobytes()
        if key not in self._seen:
            self._seen[key] = self._look_around(w)
        return self._seen[key]

    def _look_around(self, w: Floats) -> _Neighbourhood:
        here = np.nan_to_num(self._scaled.residuals(w), nan=_LARGE, posinf=_LARGE, neginf=-_LARGE)
        moved, part, column = self._at_once(w, here) or self._one_by_one(w, here)
        signs = np.random.default_rng(2).choice([-1.0, 1.0], size=(len(_SCATTER), len(w)))
        ulps = np.array(_SCATTER)[:, None] * np.spacing(np.abs(w)) * signs
        scatter = [self._scaled.residuals(self._scaled.inside(w + u)) - here for u in ulps] if len(w) else []
        return _Neighbourhood(
            w,
            here,
            moved,
            part,
            column,
            np.nan_to_num(np.array(scatter).reshape(len(scatter), len(here)), nan=0.0, posinf=0.0, neginf=0.0),
            self._scaled.rounding(w),
            self._scaled.problem.balance.precision ** (2.0 / 3.0),
        )

    def _one_by_one(self, w: Floats, here: Floats) -> tuple[Floats, Floats, NDArray[np.intp]]:
        """Return how the equations change when one unknown is moved: `moved`, `part` and `column`."""
        reach = np.maximum(1.0, np.abs(w))
        sides = [(j, r) for j in range(len(w)) for s in (1.0, -1.0) if (r := self._beside(w, j, s * reach[j]))]
        column = np.array([j for j, _ in sides], dtype=np.intp)
        moved = np.array([r[1] - here for _, r in sides]).reshape(len(sides), len(here))
        return moved, np.array([r[0] for _, r in sides]) / reach[column], column

    def _at_once(self, w: Floats, here: Floats) -> tuple[Floats, Floats, NDArray[np.intp]] | None:
        """Return the same with unknowns moved at once that change no equation in common, as declared.

        None: that is not declared, an unknown is at its bound, or the equations change in another way when all unknowns
        are moved together.
        """
        k, scaled, reach = len(w), self._scaled, np.maximum(1.0, np.abs(w))
        moved, step = np.zeros((k, 2, len(here))), np.zeros((k, 2))
        for members, rows, by in scaled.groups:
            for side, sign in enumerate((1.0, -1.0)):
                at = w.copy()
                at[members] += sign * self._width * reach[members]
                at = scaled.inside(at)
                moved[by, side, rows] = (scaled.residuals(at) - here)[rows]
                step[members, side] = np.abs(at - w)[members]
        if not scaled.groups or not (step > 0.0).all() or not np.isfinite(moved).all():
            return None
        if not all(self._together(w, here, moved, random) for random in map(np.random.default_rng, (5, 6))):
            return None
        return moved.reshape(2 * k, -1), (step / reach[:, None]).ravel(), np.repeat(np.arange(k), 2)

    def _together(self, w: Floats, here: Floats, moved: Floats, random: np.random.Generator) -> bool:
        """Whether all unknowns moved together, each to one side and by a part of its own, change equations as alone.

        Args:
            w: shape (k,).
            here: the equations there, shape (e,).
            moved: their changes, shape (k, 2, e).
            random: what chooses.
        """
        side, part = random.integers(0, 2, size=len(w)), random.uniform(0.5, 1.0, len(w))
        expected = moved[np.arange(len(w)), side] * part[:, None]
        step = np.where(side, -1.0, 1.0) * part * self._width * np.maximum(1.0, np.abs(w))
        apart = np.abs(self._scaled.residuals(self._scaled.inside(w + step)) - here - expected.sum(axis=0))
        return bool((apart <= _TOGETHER * np.abs(expected).sum(axis=0) + _ROUNDING * np.abs(here)).all())

    def _beside(self, w: Floats, j: int, reach: float) -> tuple[float, Floats] | None:
        """Return how far unknown `j` could be moved and the equations there; None: not at all."""
        moved = w.copy()
        moved[j] += self._width * reach
        moved = self._scaled.inside(moved)
        result = self._scaled.residuals(moved)
        return (abs(float(moved[j] - w[j])), result) if moved[j] != w[j] and np.isfinite(result).all() else None

    def _combined(self, w: Floats, scales: Floats) -> list[tuple[Floats, Callable[[], _Neighbourhood]]]:
        """Return combinations of required equations, (r, e), and where to come from to see them change.

        They are those of the singular values: first those that change, seen from the start, then those that do not.
        These are seen from the point to which the start belongs if all others hold.
        """
        hard, reach = scales[: self._hard], np.maximum(1.0, np.abs(w))
        jacobian = self._scaled.jacobian(w)[: self._hard] * reach / hard[:, None]
        if not jacobian.size:
            return []
        left, sigma, right = np.linalg.svd(jacobian)
        rank = int((sigma > RANK * max(float(sigma[0]), _REGULAR)).sum())
        rows = np.hstack([left.T / hard, np.zeros((len(hard), len(scales) - len(hard)))])
        back = right[rank:].T @ (right[rank:] @ ((self._home - w) / reach)) * reach
        anchor = self._scaled.inside(w + back)
        return [(rows[:rank], self._begin), (rows[rank:], lambda: self._around(anchor))]

    # -- families -------------------------------------------------------------------------------

    def directions(self, w: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
        """Return the directions in which the slopes vanish, shape (k, d): families of equilibria, and the others.

        One moves along each a little and returns to the equations across it: on a family they hold again, else the
        equilibrium is degenerate (x' = −x³ at 0).

        Args:
            w: an equilibrium, shape (k,).
            jacobian: of all residuals there, shape (e, k).
        """
        scales, reach = self(w).scales[: self._hard], np.maximum(1.0, np.abs(w))
        solve, closed = least_norm(jacobian[: self._hard] * reach / scales[:, None], size=_REGULAR)
        if not closed.shape[1]:
            return closed, closed
        basis = readable(closed) * reach[:, None]
        around = self._around(w)
        level = np.maximum(around.noise(_Combinations(self._hard)) / scales, _ON_FAMILY)
        open_ = np.array([self._open(w, v, lambda r: reach * solve(r), scales, level) for v in basis.T], dtype=bool)
        basis = basis / np.abs(basis).max(axis=0, initial=1e-300)
        return basis[:, open_], basis[:, ~open_]

    def _open(self, w: Floats, v: Floats, back: Solver, scales: Floats, level: Floats) -> bool:
        for side in (1.0, -1.0):
            at = self._scaled.inside(w + side * _ALONG * v)
            if (at == w).all():
                continue
            for _ in range(_RETURNS):
                with np.errstate(over="ignore"):
                    left = self._scaled.residuals(at)[: self._hard] / scales
                if not np.isfinite(left).all():
                    break
                if (np.abs(left) <= level).all():
                    return True
                at = self._scaled.inside(at - back(left))
        return False
