"""Pictures as data: what a figure of Matplotlib shows, which the browser draws in its own colours and sizes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.records.record import plain

# Matplotlib takes a second to import; the page is there before.
if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import Collection
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

__all__ = ["panels_of"]

# Matplotlib's markers → the browser's; all others are dots.
_MARKS = {"s": "square", "^": "triangle", "v": "triangle", "x": "cross", "+": "cross"}
_MOST = 20_000  # points of a panel; of a picture with more an image is sent


def panels_of(figure: Figure) -> list[dict[str, Any]] | None:
    """Return what a figure shows, ready for JSON: one panel each pair of axes, in rows and columns.

    A panel has `row`, `column`, `title`, `x` and `y` (`label`, `log`, `range`), `equal`, `curves` (`label`, `colour`:
    number of a colour, None: that of the text, `x`, `y`, `width`, `dash`, `mark`, `line`), `areas` (`colour`, `x`,
    `y`), `lines` (`axis`, `value`) and `texts` (`x`, `y`, `text`).

    Args:
        figure: drawn.

    Returns:
        None where it holds what none of these says: the figure has to be shown as an image.
    """
    panels = []
    for ax in figure.axes:
        place = ax.get_subplotspec()
        if place is None or not ax.get_visible() or not _known(ax):
            return None
        panels.append({"row": place.rowspan.start, "column": place.colspan.start, **_panel(ax)})
    places = [(p["row"], p["column"]) for p in panels]
    points = sum(len(c["x"]) for p in panels for c in p["curves"])
    if not panels or len(set(places)) < len(places) or points > _MOST:
        return None
    return list(plain(panels))


def _known(ax: Axes) -> bool:
    """Whether axes hold only what a panel can say."""
    from matplotlib.collections import LineCollection, PathCollection, PolyCollection  # noqa: PLC0415 - as above

    plain_scales = {ax.get_xscale(), ax.get_yscale()} <= {"linear", "log"}
    kinds = (LineCollection, PathCollection, PolyCollection)
    return plain_scales and not ax.images and not ax.tables and all(isinstance(c, kinds) for c in ax.collections)


def _panel(ax: Axes) -> dict[str, Any]:
    legend = ax.get_legend()
    named = set() if legend is None else {t.get_text() for t in legend.get_texts()}
    title = ax.get_title() or ax.get_title(loc="left")
    result: dict[str, Any] = {"title": title, "curves": [], "areas": [], "lines": []}
    for name, axis, limits in (("x", ax.xaxis, ax.get_xlim()), ("y", ax.yaxis, ax.get_ylim())):
        words = [t.get_text() for t in axis.get_ticklabels()] if _worded(axis) else []
        result[name] = {
            "label": _label(ax, name), "log": axis.get_scale() == "log", "range": sorted(limits),
            "ticks": [[at, text] for at, text in zip(axis.get_ticklocs(), words, strict=False) if text],
        }  # fmt: skip
    for line in ax.get_lines():
        crossing = _crossing(ax, line)
        if crossing is not None:
            result["lines"].append(crossing)
        elif np.size(line.get_xdata()) and line.get_transform() == ax.transData:
            result["curves"].append(_curve(line, named))
    for collection in ax.collections:
        for curve in _collected(collection):
            result["areas" if "fill" in curve else "curves"].append(curve)
    result["areas"] += [_area(p.get_facecolor(), p.get_path().interpolated(1), p) for p in ax.patches]
    result["texts"] = [
        {"x": t.get_position()[0], "y": t.get_position()[1], "text": t.get_text()}
        for t in ax.texts
        if t.get_text() and t.get_transform() == ax.transData
    ]
    result["equal"] = ax.get_aspect() == 1.0
    return result


def _worded(axis: Any) -> bool:  # noqa: ANN401 - Matplotlib's
    """Whether names stand at the ticks of an axis, in place of numbers."""
    from matplotlib.category import StrCategoryFormatter  # noqa: PLC0415 - as above
    from matplotlib.ticker import FixedFormatter  # noqa: PLC0415

    return isinstance(axis.get_major_formatter(), FixedFormatter | StrCategoryFormatter)


def _label(ax: Axes, name: str) -> str:
    """Return what stands at an axis; where it is that of axes below with the same range, their words."""
    own = str(ax.get_xlabel() if name == "x" else ax.get_ylabel())
    if own or name == "y":
        return own
    below = [b.get_xlabel() for b in ax.get_shared_x_axes().get_siblings(ax) if b.get_xlabel()]
    return str(below[0]) if below else ""


def _crossing(ax: Axes, line: Line2D) -> dict[str, Any] | None:
    """Return the line across all of the axes that this is; None: it is a curve."""
    x, y = np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)
    if line.get_transform() == ax.get_yaxis_transform(which="grid"):
        return {"axis": "y", "value": y[0]}
    if line.get_transform() == ax.get_xaxis_transform(which="grid"):
        return {"axis": "x", "value": x[0]}
    return None


def _curve(line: Line2D, named: set[str]) -> dict[str, Any]:
    label = str(line.get_label())
    marker = line.get_marker()
    style = line.get_linestyle()
    drawn = style not in {"None", "", " "} and np.size(line.get_xdata()) > 1
    x, y = line.get_xdata(orig=False), line.get_ydata(orig=False)
    if line.get_drawstyle() == "steps-post" and drawn:
        x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
    return {
        "label": "" if label.startswith("_") else label, "named": label in named, "colour": _colour(line.get_color()),
        "x": np.asarray(x, dtype=float), "y": np.asarray(y, dtype=float), "width": line.get_linewidth(),
        "dash": {"--": [6, 4], ":": [2, 3], "-.": [6, 3, 2, 3]}.get(str(style), []) if drawn else [], "line": drawn,
        "mark": "" if marker in {None, "None", "", " "} else _MARKS.get(str(marker), "dot"),
    }  # fmt: skip


def _collected(collection: Collection) -> Iterator[dict[str, Any]]:
    """Yield the curves and areas of a collection."""
    from matplotlib.collections import LineCollection, PathCollection  # noqa: PLC0415 - as above

    label = str(collection.get_label())
    common = {"label": "" if label.startswith("_") else label, "named": False, "width": 1.2, "dash": []}
    if isinstance(collection, PathCollection):
        places = np.ma.getdata(collection.get_offsets())
        colours = collection.get_facecolor()
        own = _colour(colours[0] if len(colours) else "black")
        yield {**common, "colour": own, "x": places[:, 0], "y": places[:, 1], "line": False, "mark": "dot"}
        return
    for path in collection.get_paths():
        if isinstance(collection, LineCollection):
            colours = collection.get_colors()
            own = _colour(colours[0] if len(colours) else "black")
            x, y = np.asarray(path.vertices).T
            yield {**common, "colour": own, "x": x, "y": y, "line": True, "mark": ""}
        else:
            yield _area(collection.get_facecolor()[0], path, None)


def _area(colour: Any, path: Any, patch: Any) -> dict[str, Any]:  # noqa: ANN401 - Matplotlib's
    if patch is not None:
        path = patch.get_patch_transform().transform_path(path)
    polygons = path.to_polygons(closed_only=False)
    corners = polygons[0] if polygons else np.zeros((0, 2))
    axes = "" if patch is None else _spans(patch)
    filled = patch is None or bool(patch.get_fill())
    return {"fill": filled, "colour": _colour(colour), "x": corners[:, 0], "y": corners[:, 1], "spans": axes}


def _spans(patch: Any) -> str:  # noqa: ANN401 - Matplotlib's
    """Return along which axis a patch reaches over the whole picture, as a band does; empty: along none."""
    ax = patch.axes
    base = patch.get_data_transform()
    if base == ax.get_xaxis_transform(which="grid"):
        return "y"
    return "x" if base == ax.get_yaxis_transform(which="grid") else ""


def _colour(colour: Any) -> int | None:  # noqa: ANN401 - Matplotlib's
    """Return the number of a colour in the palette of pictures; None: black or grey."""
    from matplotlib.colors import to_rgb  # noqa: PLC0415 - as above

    from workbench.show.figure import COLOURS  # noqa: PLC0415

    own = np.array(to_rgb(colour))
    if np.ptp(own) < 0.05:
        return None
    return int(np.argmin([np.sum((own - to_rgb(c)) ** 2) for c in COLOURS[:-1]]))
