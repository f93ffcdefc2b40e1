"""Slopes of the map over a period, at widths that the model itself shows where it declares none."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.model import Model
from workbench.point.lin.columns import AGREE, ROUNDING
from workbench.point.lin.period_map import SampledPeriodMap
from workbench.point.lin.result import Doubt
from workbench.point.scales import INTEGRATION
from workbench.session.me import SMALLEST_SCALE

__all__ = ["PeriodSlopes", "slopes_of"]

_SECOND = 2.0  # the second width, over the first
_TIGHT = 1e-13  # relative tolerance for small moves: the least that the solvers take
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
    columns are moved together by as little as rounding lets be seen. Where the map is another one there, it is taken
    again within that range, if all numbers in the model are known; in an FMU, what moves may have been lost in the sum
    with a large number that it does not show, which looks like a dead band: that is a doubt.

    Args:
        setting: the map; `widths` and `tolerance` are changed.

    Raises:
        SimulationError: a run fails.
    """
    wide = _taken(setting)
    if not setting.unscaled.any():
        return wide
    setting.tolerance = _TIGHT
    small = _SmallMoves(setting, wide.jacobian)
    if not small.bad.any():
        setting.tolerance = INTEGRATION
        return wide
    before, reach = setting.widths, small.reach()
    setting.widths = np.where(setting.unscaled, reach * before, before)
    narrow = _taken(setting)
    old, new = wide.jacobian, narrow.jacobian
    size = np.maximum(np.abs(old), np.abs(new)) @ np.abs(small.direction)
    changed = np.abs(new - old) * np.abs(small.direction) > 2.0 * AGREE * size[:, None]
    if small.sure and not small.wrong(new).any():
        short = [f"{n} ({w:.1g})" for n, w in zip(setting.names, setting.widths, strict=True)]
        names = ", ".join(s for s, u in zip(short, setting.unscaled, strict=True) if u)
        note = f"no nominal value is declared and the model is linear only over a short range: moved by {names}"
        return PeriodSlopes(narrow.dx, narrow.dy, notes=(note,))
    doubts = _doubts(setting, small, old, new, changed)
    setting.widths, setting.tolerance = before, INTEGRATION
    return PeriodSlopes(wide.dx, wide.dy, doubts=doubts)


def _doubts(
    setting: SampledPeriodMap, small: _SmallMoves, old: Floats, new: Floats, changed: NDArray[np.bool_]
) -> tuple[Doubt, ...]:
    """Return the entries that depend on the width, and rows that small moves contradict in no one entry."""
    over = float(setting.widths[setting.unscaled].max())
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

    A row is seen at a width where its slope over a second one, twice as wide, is the same.

    Args:
        setting: the map.
        jacobian: its slopes at its widths.

    Attributes:
        sure: all numbers in the model are known.
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
        numbers = _numbers_of(setting.task.model)
        self.sure = numbers is not None
        # Numbers of size one may stand in any model, beside those it shows.
        shown = np.concatenate([setting.here, setting.point_values, numbers if numbers is not None else []])
        largest = float(np.abs(shown).max(initial=1.0))
        lost = ROUNDING * largest
        if setting.continuous:  # integrated with this error beside the largest value and the least scale of a state
            moving = float(np.abs(setting.here).max(initial=0.0))
            lost = max(lost, _TIGHT * (moving + SMALLEST_SCALE) / AGREE)
        self.least = lost / float(np.abs(self.direction[setting.unscaled]).min())
        part = self.least
        while _SECOND * part < 1.0 and np.isnan(self.slope).any():
            one, other = self._over(part), self._over(_SECOND * part)
            size = np.maximum(np.abs(jacobian) @ np.abs(self.direction), np.abs(one))
            seen = np.isnan(self.slope) & (np.abs(one - other) <= 2.0 * AGREE * size)
            self.slope[seen] = one[seen]
            part *= _STEP
        self.bad = self.wrong(jacobian)

    def _over(self, part: float) -> Floats:
        above, below = (self.setting.values(s * part * self.direction) for s in (1.0, -1.0))
        return np.asarray((above - below) / (2.0 * part), dtype=np.float64)

    def wrong(self, jacobian: Floats) -> NDArray[np.bool_]:
        """Return the rows whose slope, where it is seen, is not that of a matrix."""
        size = np.maximum(np.abs(jacobian) @ np.abs(self.direction), np.abs(self.slope))
        return np.asarray(np.abs(self.slope - jacobian @ self.direction) > 4.0 * AGREE * size)

    def reach(self) -> float:
        """Return the part of the widths within which the rows go as they do for the smallest moves."""
        part = self.least
        while 10.0 * part < 1.0:
            one = self._over(10.0 * part)[self.bad]
            if (np.abs(one - self.slope[self.bad]) > 4.0 * AGREE * np.abs(self.slope[self.bad])).any():
                break
            part *= 10.0
        return max(0.1 * part, self.least)  # one column alone may go further than all together


def _numbers_of(model: Model) -> Floats | None:
    """Return all numbers that a system consists of; None: it is an FMU, or has one, or a function."""
    system = getattr(model, "system", None)
    if system is None:
        return None
    # What systems consist of is imported for them alone.
    from workbench.system.description import (  # noqa: PLC0415
        BlockComponent,
        GainComponent,
        LinearComponent,
        SumComponent,
        SystemDescription,
    )

    if not isinstance(system, SystemDescription):
        return None
    result: list[float] = [n for c in system.connections for n in (c.gain, c.offset)]
    for part in system.components:
        if isinstance(part, LinearComponent):
            result += [n for m in (part.A, part.B, part.C, part.D) for n in m.ravel().tolist()]
        elif isinstance(part, BlockComponent):
            result += _flat(part.parameters.values())
        elif isinstance(part, GainComponent):
            result.append(part.gain)
        elif not isinstance(part, SumComponent):
            return None
    return np.array([n for n in result if np.isfinite(n)])


def _flat(values: Iterable[Any]) -> list[float]:
    """Return the numbers among parameters, tables included."""
    result: list[float] = []
    for value in values:
        if isinstance(value, int | float):
            result.append(float(value))
        elif isinstance(value, Iterable) and not isinstance(value, str):
            result += _flat(value)
    return result
