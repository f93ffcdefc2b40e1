"""Pseudo-arclength continuation of the equations of harmonic balance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from workbench.analysis.describing.base import Block, Floats
from workbench.analysis.limit_cycle.branch import Branch, BranchPoint
from workbench.analysis.limit_cycle.floquet import multipliers, others
from workbench.analysis.limit_cycle.harmonic_balance import Cycle, HarmonicBalance
from workbench.analysis.periodic.stability import is_stable
from workbench.core.linear import LinearPart

__all__ = ["Family", "follow"]

Family = Callable[[float], tuple[LinearPart, Block]]

_MOST = 400  # points in each direction
_CLOSE = 1e-8
_NEWTON = 8
_FIRST, _SHORTEST, _LONGEST = 0.02, 1e-5, 0.08  # steps along the branch; the range of the parameter is 1
_CRAWL, _PATIENCE = 1e-3, 12  # so short a step, so many in a row: the end
_SHRINKS = 0.5  # a step may reduce the fundamental to this part at most
_TURNS = 0.94  # least cosine between the directions of neighbouring points
_STRAIGHT = 0.01  # steps that are shorter may turn more
_NUDGE = 1e-6
_NUDGE_PARAMETER = 1e-4
_VANISHED = 1e-3  # of the first fundamental


@dataclass(frozen=True, eq=False)
class _Iterate:
    """A point of the branch: unknowns with the scaled parameter last, and the direction of the branch there."""

    y: Floats
    direction: Floats


def follow(
    family: Family,
    *,
    parameter: str,
    start: float,
    limits: tuple[float, float],
    cycle: Cycle,
) -> Branch:
    """Return the branch of limit cycles through a known one, followed in both directions.

    Args:
        family: value of the parameter → linear part and block.
        parameter: its name.
        start: its value at the known cycle.
        limits: lowest and highest value.
        cycle: the known cycle, by harmonic balance.

    Source: Seydel, Practical Bifurcation and Stability Analysis, chapter 4.
    """
    track = _Track(family, start, limits, cycle)
    first = track.begin(cycle)
    if first is None:
        why = "harmonic balance has no solution at the start"
        return Branch(parameter=parameter, points=(), folds=(), ends=(why, why))
    backward, folds_back, why_back = track.walk(_Iterate(first.y, -first.direction), _MOST)
    forward, folds, why = track.walk(first, _MOST)
    places = [*reversed(backward), first.y, *forward]
    blocks = not _has_memory(family(start)[1])
    return Branch(
        parameter=parameter,
        points=tuple(track.point(y, stability=blocks) for y in places),
        folds=tuple(track.point(y, stability=False) for y in (*reversed(folds_back), *folds)),
        ends=(why_back, why),
    )


def _stable(part: LinearPart, block: Block, cycle: Cycle) -> bool | None:
    across, doubt = others(multipliers(part, block, cycle))
    return is_stable(across, doubt=doubt)


def _has_memory(block: Block) -> bool:
    try:
        block.static(np.zeros(1))
    except NotImplementedError:
        return True
    return False


class _Track:
    def __init__(self, family: Family, start: float, limits: tuple[float, float], cycle: Cycle) -> None:
        self._family, self._limits = family, limits
        self._span = limits[1] - limits[0]
        self._scale, self._count = cycle.fundamental, len(cycle.v) - 1
        self._start = start

    def value(self, y: Floats) -> float:
        """Return the parameter."""
        return self._limits[0] + self._span * float(y[-1])

    def _balance(self, value: float) -> HarmonicBalance:
        part, block = self._family(value)
        return HarmonicBalance(part, block, count=self._count, scale=self._scale)

    def begin(self, cycle: Cycle) -> _Iterate | None:
        z = self._balance(self._start).pack(cycle.v, cycle.frequency)
        y = np.append(z, (self._start - self._limits[0]) / self._span)
        straight = np.zeros(len(y))
        straight[-1] = 1.0
        found = self._correct(y, straight, 0.0)
        return None if found is None else _Iterate(found, self._tangent(found, straight))

    def residual(self, y: Floats) -> Floats:
        return self._balance(self.value(y))(y[:-1])

    def _jacobian(self, y: Floats, here: Floats) -> Floats:
        equations = self._balance(self.value(y))
        columns = []
        for i in range(len(y) - 1):
            z = y[:-1].copy()
            z[i] += _NUDGE
            columns.append((equations(z) - here) / _NUDGE)
        nudge = -_NUDGE_PARAMETER if y[-1] > 0.5 else _NUDGE_PARAMETER
        aside = y.copy()
        aside[-1] += nudge
        columns.append((self.residual(aside) - here) / nudge)
        return np.array(columns, dtype=np.float64).T

    def _tangent(self, y: Floats, like: Floats) -> Floats:
        """Return the unit direction of the branch, on the side of `like`."""
        jacobian = self._jacobian(y, self.residual(y))
        bordered = np.vstack([jacobian, like])
        found = np.linalg.lstsq(bordered, np.append(np.zeros(len(y) - 1), 1.0), rcond=None)[0]
        return np.asarray(found / np.linalg.norm(found), dtype=np.float64)

    def _correct(self, y: Floats, direction: Floats, length: float) -> Floats | None:
        """Return the point of the branch in the plane `length` ahead of `y` along `direction`."""
        x = y + length * direction
        target = float(direction @ x)
        for _ in range(_NEWTON):
            here = self.residual(x)
            if not np.isfinite(here).all():
                return None
            if float(np.abs(here).max()) < _CLOSE:
                return x
            system = np.vstack([self._jacobian(x, here), direction])
            step = np.linalg.lstsq(system, -np.append(here, float(direction @ x) - target), rcond=None)[0]
            if float(np.abs(step).max()) > 0.5:
                return None
            x = x + step
        return None

    def walk(self, place: _Iterate, most: int) -> tuple[list[Floats], list[Floats], str]:
        """Return the points after `place`, the folds between them, and why the walk ended."""
        points: list[Floats] = []
        folds: list[Floats] = []
        length, crawled = _FIRST, 0
        while len(points) < most:
            y = self._correct(place.y, place.direction, length)
            # A step must not jump to the equilibrium, where the equations hold at every value of the parameter.
            if y is None or y[1] < _SHRINKS * place.y[1]:
                length *= 0.5
                if length < _SHORTEST:
                    return points, folds, "the equations of harmonic balance could not be solved beyond this point"
                continue
            following = _Iterate(y, self._tangent(y, place.direction))
            if length > _STRAIGHT and float(following.direction @ place.direction) < _TURNS:
                length *= 0.5
                continue
            if following.direction[-1] * place.direction[-1] < 0.0:
                folds.append(self._fold(place, length))
                points.append(folds[-1])
            if not 0.0 <= y[-1] <= 1.0:
                return [*points, self._at_limit(place, y)], folds, "limit of the parameter"
            points.append(y)
            if y[1] < _VANISHED:
                return points, folds, "the cycle shrinks to a point"
            crawled = crawled + 1 if length < _CRAWL else 0
            if crawled > _PATIENCE:
                return points, folds, "the equations of harmonic balance can hardly be solved beyond this point"
            place, length = following, min(1.3 * length, _LONGEST)
        return points, folds, f"{most} points"

    def _fold(self, place: _Iterate, length: float) -> Floats:
        """Return where the parameter turns back within a step."""
        best = place.y

        def slope(part: float) -> float:
            nonlocal best
            y = self._correct(place.y, place.direction, part)
            if y is None:
                return 0.0
            best = y
            return float(self._tangent(y, place.direction)[-1])

        brentq(slope, 0.0, length, xtol=1e-6, maxiter=30, disp=False)
        return best

    def _at_limit(self, place: _Iterate, y: Floats) -> Floats:
        """Return the point of the branch at the limit of the parameter that a step passed."""
        edge = float(np.clip(y[-1], 0.0, 1.0))
        part = (edge - place.y[-1]) / (y[-1] - place.y[-1])
        guess = place.y + part * (y - place.y)
        straight = np.zeros(len(y))
        straight[-1] = 1.0
        guess[-1] = edge
        found = self._correct(guess, straight, 0.0)
        return guess if found is None else found

    def point(self, y: Floats, *, stability: bool) -> BranchPoint:
        value = self.value(y)
        part, block = self._family(value)
        cycle = HarmonicBalance(part, block, count=self._count, scale=self._scale).cycle(y[:-1])
        return BranchPoint(
            value=value,
            frequency_hz=cycle.frequency,
            amplitude=cycle.amplitude,
            fundamental=cycle.fundamental,
            mean=block.centre + float(cycle.v[0].real),
            stable=_stable(part, block, cycle) if stability else None,
        )
