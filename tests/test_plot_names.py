"""Names beside marks: each one is there, and covers neither another one nor the legend."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.transforms import Bbox

import workbench as wb
from workbench.core.values.operating_point import OperatingPoint
from workbench.show.figure import panels, with_point
from workbench.show.labels import Names, name_lines, name_points


def crowded(count: int) -> tuple[Axes, list[tuple[float, float]]]:
    """Return axes with a curve, a legend, and marks, most of them near to each other."""
    _, ((ax,),) = panels(1, 1, title="marks", height=4.0)
    angle = np.linspace(0.0, 6.0, 400)
    ax.plot(np.cos(angle), np.sin(angle), label="curve")
    ax.axhline(0.0)
    points = [(-0.9 + 1.8 * (k / count) ** 2, 0.0) for k in range(count)]
    ax.set(xlim=(-1.5, 1.5), ylim=(-1.5, 1.5))
    ax.legend(loc="upper left")
    return ax, points


def boxes(ax: Axes) -> list[Bbox]:
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()
    names = [artist for artist in ax.artists if isinstance(artist, Names)]
    return [text.get_window_extent() for one in names for text in one.texts if text.get_visible()]


@pytest.mark.parametrize("size", [(4.0, 3.0), (9.0, 5.0)])
@pytest.mark.parametrize("dpi", [72, 160])
def test_every_mark_has_a_name_that_covers_no_other(size: tuple[float, float], dpi: int) -> None:
    ax, points = crowded(7)
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.set_size_inches(*size)
    figure.set_dpi(dpi)
    name_points(ax, points, [f"{k}: {x:.3g} Hz" for k, (x, _) in enumerate(points)])
    found = boxes(ax)
    assert len(found) == len(points)
    legend = ax.get_legend()
    assert legend is not None
    for one, other in combinations([*found, legend.get_window_extent()], 2):
        assert not one.overlaps(other)
    frame = ax.get_window_extent()
    assert all(frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1 for box in found)


def test_a_name_does_not_strike_through_a_curve_where_there_is_room() -> None:
    ax, _ = crowded(1)
    name_points(ax, [(1.0, 0.0)], ["-0.31849"])
    (box,) = boxes(ax)
    angle = np.linspace(0.0, 6.0, 4000)
    curve = ax.transData.transform(np.column_stack([np.cos(angle), np.sin(angle)]))
    assert not any(box.contains(x, y) for x, y in curve)
    axis = ax.transData.transform([(x, 0.0) for x in np.linspace(-1.5, 1.5, 500)])
    assert not any(box.contains(x, y) for x, y in axis)


def test_marks_outside_the_picture_have_no_name() -> None:
    ax, _ = crowded(1)
    name_points(ax, [(0.0, 0.5), (7.0, 0.0), (np.nan, 0.0)], ["inside", "outside", "nowhere"])
    assert len(boxes(ax)) == 1


def test_lines_are_named_on_themselves() -> None:
    ax, _ = crowded(1)
    ends = [(-1.5, 0.4), (-1.5, 1.0), (-0.3, 1.5)]
    name_lines(ax, (0.0, 0.0), ends, ["a", "b", "c"])
    found = boxes(ax)
    assert len(found) == 3
    for box, end in zip(found, ends, strict=True):
        middle = ax.transData.inverted().transform((0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)))
        assert abs(middle[0] * end[1] - middle[1] * end[0]) < 0.03


def test_the_operating_point_stands_below_a_picture() -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        figure = wb.lin(model).result.plot()
    assert "operating point: u\u00a0=\u00a00" in figure.get_supxlabel()


def test_many_states_at_zero_are_told_in_one_word() -> None:
    point = OperatingPoint(x={f"q[{k}]": 0.0 for k in range(71)}, u={"u": 2.0})
    assert point.words() == "u = 2; all 71 states 0; t = 0 s"
    figure, _ = panels(1, 1, title="")
    with_point(figure, point)  # it has no operating point of its own
    assert figure.get_supxlabel() == ""


def test_a_name_is_not_beside_the_mark_of_another() -> None:
    """Two marks near to each other on a line: the name of the first does not stand above the second."""
    ax, _ = crowded(1)
    marks = [(0.0, 0.0), (-0.2, 0.0)]
    name_points(ax, marks, ["1: 2.64 Hz, stable", "2: 3.31 Hz"])
    found, pixels = boxes(ax), ax.transData.transform(marks)
    for k, box in enumerate(found):
        away = np.hypot(*(np.clip(pixels, box.min, box.max) - pixels).T)
        assert away[1 - k] > away[k]
