"""Names beside marked points, where they cover neither curves nor each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import Bbox, IdentityTransform
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.show.figure import QUIET, SMALL

__all__ = ["Names", "name_lines", "name_points"]

# Distances between a mark and its name [points], and how many directions are tried at each.
_DISTANCES, _DIRECTIONS = (5.0, 12.0, 22.0, 34.0, 48.0, 64.0, 84.0, 108.0), 16
_COLOUR = "#333333"  # of names beside points
_LEADER = 11.0  # from this distance on a line leads from the mark to its name [points]
_ROOM = 2.0  # around a name [points]
_STEP, _MOST = 3.0, 20_000  # distance of the points of a curve that are looked at [points], and their number
# What it costs to cover a name or legend, to leave the axes, to cover a mark, to be beside another, to cover a point of
# a curve.
_OVER_NAME, _OUTSIDE, _OVER_MARK, _BESIDE_MARK, _OVER_CURVE = 1e6, 1e5, 2e3, 100.0, 20.0


def name_points(ax: Axes, points: Sequence[tuple[float, float]], texts: Sequence[str]) -> None:
    """Write names beside points of axes; those outside what is shown are left out.

    Args:
        ax: where.
        points: x and y of each, in the coordinates of the data.
        texts: a name for each; the first ones are placed first.
    """
    if points:
        ax.add_artist(Names(points, texts, _COLOUR))


@dataclass(eq=False)
class _LabelBox:
    """What a name must not cover, on the picture [pixels].

    Attributes:
        unit: pixels of a point.
        curves: points along all curves, shape (k, 2).
        marks: marked points, shape (n, 2).
        taken: other words.
        frame: of the axes.
    """

    unit: float
    curves: Floats
    marks: Floats
    taken: list[Bbox]
    frame: Bbox


def name_lines(ax: Axes, begin: tuple[float, float], ends: Sequence[tuple[float, float]], texts: Sequence[str]) -> None:
    """Write names on straight lines that begin at one point.

    Args:
        ax: where.
        begin: x and y where they begin, in the coordinates of the data.
        ends: x and y where each ends.
        texts: a name for each.
    """
    ax.add_artist(Names(ends, texts, QUIET, begin))


class Names(Artist):
    """Names that find their places whenever the picture is drawn: only then is it known where everything lies.

    Args:
        points: x and y of each.
        texts: a name for each.
        colour: of the names.
        begin: x and y where the straight lines begin that end at the points, and on which the names stand; None: the
            names stand around the points.
    """

    def __init__(
        self, points: Sequence[tuple[float, float]], texts: Sequence[str], colour: str,
        begin: tuple[float, float] | None = None,
    ) -> None:  # fmt: skip
        super().__init__()
        self._points = np.asarray(points, dtype=np.float64)
        self._begin = begin
        self.texts = [
            Text(0.0, 0.0, text, fontsize=SMALL, ha="center", va="center", color=colour,
                 bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.4})
            for text in texts
        ]  # fmt: skip
        self._leaders = [Line2D([], [], color="#888888", linewidth=0.6) for _ in texts]
        self.set_zorder(6)
        self.set_in_layout(False)

    def get_children(self) -> list[Artist]:
        children: list[Artist] = [*self._leaders, *self.texts]
        return children

    def draw(self, renderer: RendererBase) -> None:
        ax = self.axes
        if not isinstance(ax, Axes) or not self.get_visible():
            return
        figure = ax.get_figure(root=True)
        if figure is None:
            return
        unit = figure.dpi / 72.0
        at = ax.transData.transform(self._points)
        frame = ax.get_window_extent(renderer)
        shown = np.isfinite(at).all(axis=1)
        if self._begin is None:
            shown &= np.array([frame.contains(x, y) for x, y in at], dtype=bool)
        around = _LabelBox(unit, _curves(ax, unit), at[shown], list(_taken(ax, self, renderer)), frame)
        for number, (text, leader) in enumerate(zip(self.texts, self._leaders, strict=True)):
            text.set_visible(bool(shown[number]))
            leader.set_visible(False)
            if not shown[number]:
                continue
            text.set_figure(figure)
            text.set_transform(IdentityTransform())
            size = _size(text, renderer) + 2.0 * _ROOM * unit
            begin = None if self._begin is None else ax.transData.transform(self._begin)
            middle = _place(at[number], size, around, begin)
            text.set_position((float(middle[0]), float(middle[1])))
            box = _box(middle, size)
            around.taken.append(box)
            if begin is None:
                self._lead(leader, at[number], box, around)
            leader.set_figure(figure)
            leader.set_transform(IdentityTransform())
        for line in self._leaders:
            line.draw(renderer)
        for text in self.texts:
            text.draw(renderer)

    def _lead(self, leader: Line2D, at: Floats, box: Bbox, around: _LabelBox) -> None:
        """Draw a line from a mark to the nearest edge of its name, where that is not beside it."""
        end = np.clip(at, box.min, box.max)
        if np.hypot(*(end - at)) > _LEADER * around.unit:
            leader.set_data([at[0], end[0]], [at[1], end[1]])
            leader.set_visible(True)
            around.curves = np.concatenate([around.curves, np.repeat(_between(at, end[None])[0], 3, axis=0)])


def _size(text: Text, renderer: RendererBase) -> Floats:
    extent = text.get_window_extent(renderer)
    return np.array([extent.width, extent.height])


def _box(middle: Floats, size: Floats) -> Bbox:
    return Bbox([middle - 0.5 * size, middle + 0.5 * size])


def _place(at: Floats, size: Floats, around: _LabelBox, begin: Floats | None) -> Floats:
    """Return the middle of a name: the place around its mark, or on the line that ends there, that costs least."""
    turns = 2.0 * np.pi * (0.25 + np.arange(_DIRECTIONS) / _DIRECTIONS)
    way = np.column_stack([np.cos(turns), np.sin(turns)])
    reach = np.repeat(np.array(_DISTANCES), _DIRECTIONS)
    tried = at + np.tile(way, (len(_DISTANCES), 1)) * (0.5 * size + (around.unit * reach)[:, None])
    if begin is not None:
        share = np.linspace(0.97, 0.3, 40)
        tried, reach = begin + share[:, None] * (at - begin), 60.0 * (1.0 - share)
    cost = reach + _OVER_CURVE * _inside(around.curves, tried, size) + _OVER_MARK * _inside(around.marks, tried, size)
    others = around.marks[(around.marks != at).any(axis=1)]  # beside another it would be taken for its name
    cost += _BESIDE_MARK * _inside(others, tried, size + 2.0 * _LEADER * around.unit)
    low, high = tried - 0.5 * size, tried + 0.5 * size
    cost += _OUTSIDE * ((low < around.frame.min).any(axis=1) | (high > around.frame.max).any(axis=1))
    ways = _between(at, np.clip(at, low, high) if begin is None else tried)
    for box in around.taken:
        cost += _OVER_NAME * np.any(np.all((ways > box.min) & (ways < box.max), axis=2), axis=1)
        cost += _OVER_NAME * ((low < box.max).all(axis=1) & (high > box.min).all(axis=1))
    best: Floats = tried[int(np.argmin(cost))]
    return best


def _between(at: Floats, ends: Floats) -> Floats:
    """Return points on the ways from a mark to some ends, shape (ends, points, 2)."""
    part = np.linspace(0.0, 1.0, 12)[None, :, None]
    ways: Floats = at + part * (ends[:, None, :] - at)
    return ways


def _inside(points: Floats, middles: Floats, size: Floats) -> Floats:
    """Return for each place how many points a name would cover there."""
    (x, y), (at_x, at_y), (wide, high) = points.T, middles.T[:, :, None], 0.5 * size
    result: Floats = np.count_nonzero((np.abs(x - at_x) < wide) & (np.abs(y - at_y) < high), axis=1)
    return result


def _curves(ax: Axes, unit: float) -> Floats:
    """Return points along all curves of the axes, on the picture [pixels]."""
    low, high = ax.transAxes.transform([(0.0, 0.0), (1.0, 1.0)])
    every = list(_lines(ax))
    if not every:
        return np.zeros((0, 2))
    begins, ends = (np.concatenate(side) for side in zip(*every, strict=True))
    inside = (np.maximum(ends, begins) >= low).all(axis=1) & (np.minimum(ends, begins) <= high).all(axis=1)
    begins, ends = np.clip([begins[inside], ends[inside]], low - (high - low), high + (high - low))
    points = _along(begins, ends, _STEP * unit)
    return points[:: len(points) // _MOST + 1]


def _along(begins: Floats, ends: Floats, step: float) -> Floats:
    """Return points on straight lines, (k, 2) their begins and ends, which are among them; at most `step` apart."""
    count = (np.hypot(*(ends - begins).T) / step).astype(int) + 2
    last = np.cumsum(count)
    number = np.arange(count.sum()) - np.repeat(last - count, count)
    points: Floats = np.repeat(begins, count, axis=0)
    points += number[:, None] * np.repeat((ends - begins) / (count - 1)[:, None], count, axis=0)
    points[last - 1] = ends
    return points


def _lines(ax: Axes) -> Iterator[tuple[Floats, Floats]]:
    """Yield begins and ends, (k, 2) each, of the straight lines between the corners of what is drawn [pixels]."""
    for line in ax.lines:
        if line.get_visible() and line.get_linestyle() not in {"None", "", " "}:
            corners = line.get_transform().transform(line.get_xydata())
            yield _between_corners(corners, np.zeros(len(corners), dtype=int))
    for group in ax.collections:
        if isinstance(group, LineCollection) and (paths := [np.asarray(p.vertices) for p in group.get_paths()]):
            corners = group.get_transform().transform(np.concatenate(paths))
            yield _between_corners(corners, np.repeat(np.arange(len(paths)), [len(p) for p in paths]))


def _between_corners(corners: Floats, curve: NDArray[np.int_]) -> tuple[Floats, Floats]:
    """Return begins and ends of the lines from corner to corner of the same curve; a gap is where one is unknown."""
    known = np.asarray(np.isfinite(corners).all(axis=1))
    joined = known[1:] & known[:-1] & (curve[1:] == curve[:-1])
    return corners[:-1][joined], corners[1:][joined]


def _taken(ax: Axes, own: Names, renderer: RendererBase) -> Iterator[Bbox]:
    """Yield what other words of the axes cover [pixels]: the legend, texts, names that were placed before."""
    legend = ax.get_legend()
    if legend is not None:
        yield legend.get_window_extent(renderer)
    for text in ax.texts:
        if text.get_visible() and text.get_text():
            yield text.get_window_extent(renderer)
    for other in ax.artists:
        if other is own:
            return
        if isinstance(other, Names):
            yield from (t.get_window_extent(renderer) for t in other.texts if t.get_visible())
