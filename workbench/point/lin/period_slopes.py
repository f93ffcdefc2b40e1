"""Slopes of the map over a period, at widths that the model itself shows where it declares none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.point.lin.columns import AGREE, ROUNDING, SECOND
from workbench.point.lin.period_map import SampledPeriodMap
from workbench.point.lin.result import Doubt
from workbench.point.scales import INTEGRATION

__all__ = ["PeriodSlopes", "slopes_of"]

_STEP = 100.0  # from one width at which rounding is looked behind to the next


@dataclass(frozen=True, eq=False)
class PeriodSlopes:
    """Slopes of the map.

    Attributes:
        dx: of the states, shape (n, n + m).
        dy: of the outputs within the period, shape (k, 2, q, n + m).
        doubts: entries that moves orders of magnitude smaller do not confirm.
        notes: in one line each.
    """

    dx: Floats
    dy: Floats
    doubts: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def jacobian(self) -> Floats:
        """Of the map's rows, shape (n + q, n + m)."""
        return np.vstack([self.dx, self.dy[0, 0]])


def slopes_of(setting: SampledPeriodMap) -> PeriodSlopes:
    """Return the slopes of a map; its widths become those at which they were taken.

    A width that nothing in the model tells may be beyond all that is linear in it: a limiter of 1 nm, of a model in m,
    is then saturated on both sides, its slope all but 0, and that at a second width as wide is 0, too. So all such
    columns are moved together by as little as rounding lets be seen. Where the map is steeper there, it is taken again
    within that range. Where it is flatter, a dead band has no slope, or what moves was lost in the sum with a large
    number that the model does not show: that is a doubt.

    Args:
        setting: the map; `widths` are changed.

    Raises:
        SimulationError: a run fails.
    """
    wide = _taken(setting)
    if not setting.unscaled.any():
        return wide
    small = _SmallMoves(setting, wide.jacobian)
    if not small.bad.any():
        return wide
    before, reach = setting.widths, small.reach()
    setting.widths = np.where(setting.unscaled, reach * before, before)
    narrow = _taken(setting)
    old, new = wide.jacobian, narrow.jacobian
    size = np.maximum(np.abs(old), np.abs(new)) @ np.abs(small.direction)
    changed = np.abs(new - old) * np.abs(small.direction) > 2.0 * AGREE * size[:, None]
    steeper = bool((np.abs(new) >= np.abs(old))[changed].all())
    if steeper and not small.wrong(new).any():
        short = [f"{n} ({w:.1g})" for n, w in zip(setting.names, setting.widths, strict=True)]
        names = ", ".join(s for s, u in zip(short, setting.unscaled, strict=True) if u)
        note = f"no nominal value is declared and the model is linear only over a short range: moved by {names}"
        return PeriodSlopes(narrow.dx, narrow.dy, notes=(note,))
    over = float(setting.widths[setting.unscaled].max())
    setting.widths = before
    return PeriodSlopes(wide.dx, wide.dy, doubts=_doubts(setting, small, old, new, changed, over))


def _doubts(
    setting: SampledPeriodMap, small: _SmallMoves, old: Floats, new: Floats, changed: NDArray[np.bool_], over: float
) -> tuple[Doubt, ...]:
    """Return the entries that depend on the width, and rows that small moves contradict in no one entry."""
    result = [
        Doubt(
            setting.rows[i],
            setting.names[j],
            float(old[i, j]),
            float(new[i, j]),
            f"it depends on the width: {new[i, j]:.6g} over {over:.3g}; declare nominal values, or give widths",
        )
        for i, j in np.argwhere(changed)
    ]
    why = "with everything moved at once by as little as can be seen the result differs"
    for i in np.flatnonzero(small.bad & ~changed.any(axis=1)):
        value, other = float(old[i] @ small.direction), float(small.slope[i])
        result.append(Doubt(setting.rows[i], "all", value, other, why))
    return tuple(result)


def _taken(setting: SampledPeriodMap) -> PeriodSlopes:
    """Return central differences at the widths of the map."""
    slopes_x, slopes_y = [], []
    for unit, width in zip(np.eye(len(setting.names)), setting.widths.tolist(), strict=True):
        (x1, y1), (x0, y0) = (setting.run(s * 0.5 * width * unit) for s in (1.0, -1.0))
        slopes_x.append((x1 - x0) / width)
        slopes_y.append((y1 - y0) / width)
    dx = np.array(slopes_x).T.reshape(len(setting.states), len(setting.names))
    return PeriodSlopes(dx, np.moveaxis(np.array(slopes_y), 0, -1))


class _SmallMoves:
    """What the map does when all columns without a scale move together, as little as rounding lets be seen.

    A row is seen at a width where its slope over a second one, 8 times as wide, is the same.

    Args:
        setting: the map.
        jacobian: its slopes at its widths.

    Attributes:
        direction: the columns' moves, of which parts are made, shape (n + m,).
        slope: of the rows along it, per part, shape (n + q,); NaN where nothing is seen.
        bad: rows whose slope is not that of the matrix.
    """

    def __init__(self, setting: SampledPeriodMap, jacobian: Floats) -> None:
        random = np.random.default_rng(5)
        count = len(setting.names)
        signs = random.choice([-1.0, 1.0], count) * random.uniform(0.5, 1.0, count)
        self.setting = setting
        self.direction = np.where(setting.unscaled, 0.5 * setting.widths * signs, 0.0)
        self.slope = np.full(len(setting.rows), np.nan)
        largest = max(np.abs(setting.here).max(initial=0.0), np.abs(setting.point_values).max(initial=0.0))
        # Numbers of size one may stand in any model, beside those it shows.
        lost = max(ROUNDING, (ROUNDING + INTEGRATION * (setting.continuous > 0)) * largest)
        self.least = float(lost / np.abs(self.direction[setting.unscaled]).min())
        part = self.least
        while SECOND * part < 1.0 and np.isnan(self.slope).any():
            one, other = self._over(part), self._over(SECOND * part)
            size = np.maximum(np.abs(jacobian) @ np.abs(self.direction), np.abs(one))
            seen = np.isnan(self.slope) & (np.abs(one - other) <= AGREE * size)
            self.slope[seen] = one[seen]
            part *= _STEP
        self.bad = self.wrong(jacobian)

    def _over(self, part: float) -> Floats:
        above, below = (self.setting.values(s * part * self.direction) for s in (1.0, -1.0))
        return np.asarray((above - below) / (2.0 * part), dtype=np.float64)

    def wrong(self, jacobian: Floats) -> NDArray[np.bool_]:
        """Return the rows whose slope, where it is seen, is not that of a matrix."""
        size = np.maximum(np.abs(jacobian) @ np.abs(self.direction), np.abs(self.slope))
        return np.asarray(np.abs(self.slope - jacobian @ self.direction) > 2.0 * AGREE * size)

    def reach(self) -> float:
        """Return the part of the widths within which the rows go as they do for the smallest moves."""
        part = self.least
        while 10.0 * part < 1.0:
            one = self._over(10.0 * part)[self.bad]
            if (np.abs(one - self.slope[self.bad]) > AGREE * np.abs(self.slope[self.bad])).any():
                break
            part *= 10.0
        return max(0.1 * part, self.least)  # one column alone may go further than all together
