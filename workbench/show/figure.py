"""What all pictures share: size, style, panels, writing a file."""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.category import StrCategoryFormatter
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, Formatter, FuncFormatter

from workbench.core.machine.files import file_path, replacing
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, shortened, suggest, visible

__all__ = [
    "ABOVE",
    "AXIS",
    "COLOURS",
    "LEGEND",
    "LINE",
    "QUIET",
    "SHADE",
    "SMALL",
    "UNSTABLE",
    "caption",
    "literal",
    "on_axes",
    "outside",
    "panels",
    "rows",
    "save",
    "svg_text",
    "with_point",
    "written",
]  # fmt: skip

# Okabe and Ito's palette: told apart by every eye, and in grey by their order of brightness.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#444444")

SMALL = 8.0  # size of the letters beside marks and in captions [points]
AXIS: dict[str, Any] = {"color": "#666666", "linewidth": 0.8}  # lines at 0, −180° and the like
QUIET = "#666666"  # words and lines that only explain
SHADE = "#f1f1f1"  # what is outside of what counts
# Where something is unstable or forbidden.
UNSTABLE: dict[str, Any] = {"facecolor": COLOURS[1], "alpha": 0.10, "linewidth": 0.0, "zorder": 0}

LEGEND: dict[str, Any] = {"fontsize": 8.5, "framealpha": 0.9, "edgecolor": "#cccccc"}
LINE = 105  # characters of small print that fit below a picture
# A legend over the panel, where it covers no curve.
ABOVE: dict[str, Any] = {
    "loc": "lower left", "bbox_to_anchor": (-0.01, 0.98), "fontsize": 8.5, "frameon": False, "borderaxespad": 0.2,
}  # fmt: skip

_POWER = r"$\mathdefault{"
_WORD, _LINE = 90, 240  # longest word and line of a text in a picture [characters]
_WIDTH = 7.2  # of a figure [inch]
_NAMED = 3  # so many inputs and states of an operating point stand below a picture
_SUFFIXES = (".png", ".svg", ".pdf")

_STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 11.0,
    "axes.edgecolor": "#666666",
    "axes.linewidth": 0.8,
    "axes.unicode_minus": True,
    "svg.hashsalt": "workbench",  # the same result gives the same file
    "svg.fonttype": "none",  # text stays text: it is found, and read aloud
    "pdf.fonttype": 42,
}


_given: ContextVar[list[Axes] | None] = ContextVar("axes of the caller", default=None)


@contextmanager
def on_axes(axes: Axes | Sequence[Axes]) -> Iterator[Figure]:
    """Let the one picture that is drawn meanwhile have the caller's axes, and yield their figure.

    Args:
        axes: as many as the picture has panels, row by row; arrays of them, too.

    Raises:
        InputError: another number, or the picture lays out its panels by itself.
    """
    given = [axes] if isinstance(axes, Axes) else list(np.ravel(np.asarray(axes, dtype=object)))
    if not given or not all(isinstance(ax, Axes) for ax in given):
        raise InputError("axes: give the axes of matplotlib that the picture has panels for, as a list")
    token = _given.set(given)
    try:
        yield given[0].get_figure(root=True)  # type: ignore[misc]
    finally:
        _given.reset(token)


def _taken(count: int) -> list[Axes]:
    """Return the caller's axes, where there are some; none: the picture makes its own."""
    given = _given.get() or []
    if given and len(given) != count:
        raise InputError(f"axes: {count} are needed, one for each panel; given: {len(given)}")
    return given


def outside(figure: Figure, handles: Sequence[Any], loc: str, **settings: Any) -> None:  # noqa: ANN401 - matplotlib's
    """Put a legend beside the panels, or into the first of the caller's axes.

    Args:
        figure: of the panels.
        handles: what it names.
        loc: where, such as "right upper" or "lower center".
        settings: of the legend.
    """
    given = _given.get()
    if given:
        given[0].legend(handles=handles, **settings)
    else:
        placed: dict[str, Any] = {**settings, "loc": f"outside {loc}"}
        figure.legend(handles=handles, **placed)


def rows(count: int, *, title: str, height: float = 2.4, shared: int | None = None) -> tuple[Figure, list[Axes]]:
    """Return a figure with `count` pictures over a common horizontal axis.

    The figure belongs to no window system; it works without a display.

    Args:
        count: number of pictures.
        title: above the first one.
        height: of each [inch].
        shared: so many have the common axis, those below one of their own; None: all.
    """
    if given := _taken(count):
        _share(given[:shared])
        return given[0].get_figure(root=True), given  # type: ignore[return-value]
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(_WIDTH, 1.0 + height * count), layout="constrained")
        FigureCanvasAgg(figure)
        axes = list(figure.subplots(count, 1, squeeze=False)[:, 0])
        axes[0].set_title(title, loc="left", fontweight="bold")
    _share(axes[:shared])
    for ax in axes[: -1 if shared is None else shared - 1]:
        ax.tick_params(which="both", labelbottom=False)
    for ax in axes:
        _open_frame(ax, color="#cccccc", linewidth=0.7)
        ax.grid(visible=True, which="minor", color="#ececec", linewidth=0.5)
    return figure, axes


def _share(axes: Sequence[Axes]) -> None:
    """Let axes have the first one's horizontal axis; the caller's may have it already."""
    for ax in axes[1:]:
        if not ax.get_shared_x_axes().joined(ax, axes[0]):
            ax.sharex(axes[0])


def caption(figure: Figure, text: str) -> None:
    """Write a line of small print below a figure, under what stands there already.

    Args:
        figure: where.
        text: broken into lines that fit.
    """
    width = int(LINE * figure.get_figwidth() / _WIDTH)
    before = figure.get_supxlabel()
    text = text.replace(" = ", "\u00a0=\u00a0")  # a value stays beside its name
    lines = [*filter(None, [before]), *textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)]
    figure.supxlabel("\n".join(lines), x=0.01, ha="left", fontsize=SMALL + 0.5)


def with_point(figure: Any, result: object) -> Any:  # noqa: ANN401 - whatever draws may draw without matplotlib
    """Return a picture that says at which operating point its result was measured.

    Args:
        figure: the picture.
        result: what it shows; one without an operating point leaves the picture as it is.
    """
    point = getattr(result, "operating_point", None)
    if isinstance(figure, Figure) and isinstance(point, OperatingPoint):
        caption(figure, f"operating point: {point.words(_NAMED)}")
    return figure


def _open_frame(ax: Axes, **grid: Any) -> None:  # noqa: ANN401 - style of matplotlib's lines
    ax.grid(visible=True, which="major", **grid)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def panels(
    down: int,
    across: int,
    *,
    title: str,
    width: float = _WIDTH,
    height: float = 2.3,
    sharex: str = "none",
    ratios: Sequence[float] | None = None,
) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure with a grid of panels under one title; it works without a display.

    Args:
        down: rows.
        across: columns.
        title: of the whole.
        width: of the figure [inch].
        height: of a row [inch].
        sharex: "none", "col" or "all".
        ratios: heights of the rows against each other.
    """
    if given := _taken(down * across):
        grid = [given[across * i : across * (i + 1)] for i in range(down)]
        for together in {"none": [], "col": [given[k::across] for k in range(across)], "all": [given]}[sharex]:
            _share(together)
        return given[0].get_figure(root=True), grid  # type: ignore[return-value]
    sizes = None if ratios is None else {"height_ratios": list(ratios)}
    with mpl.rc_context({**_STYLE, "axes.titlesize": 10.0}):
        figure = Figure(figsize=(width, 0.7 + height * (down if ratios is None else sum(ratios))), layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(title, x=0.01, ha="left", fontsize=11.0, fontweight="bold")
        grid = figure.subplots(down, across, squeeze=False, sharex=sharex, gridspec_kw=sizes).tolist()  # type: ignore[call-overload]
    for ax in (a for row in grid for a in row):
        _open_frame(ax, color="#dddddd", linewidth=0.6)
    return figure, grid


def written(ax: Axes, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write a table into axes, with lines between its rows only.

    Args:
        ax: where.
        heads: headings.
        rows: cells.
    """
    table = ax.table(cellText=rows, colLabels=heads, loc="upper left", cellLoc="right", edges="horizontal")
    table.auto_set_font_size(value=False)
    table.set_fontsize(8.5)
    table.auto_set_column_width(list(range(len(heads))))
    table.scale(1.0, 1.15)
    for cell in table.get_celld().values():
        cell.set_edgecolor("#bbbbbb")


def literal(figure: Any) -> Any:  # noqa: ANN401 - a figure, or what was drawn as text already
    """Return a figure whose texts say what they say: names of variables may have dollar signs, which begin formulas.

    Only what begins as matplotlib's own powers of ten on an axis stays a formula.
    """
    if not isinstance(figure, Figure):
        return figure
    written_by_axis = {id(text) for axes in figure.axes for axis in (axes.xaxis, axes.yaxis) for text in _literal(axis)}
    for text in figure.findobj(Text):
        if id(text) not in written_by_axis and not text.get_text().startswith(_POWER):
            text.set_text("\n".join(shortened(line, _WORD, _LINE) for line in visible(text.get_text()).split("\n")))
            text.set_parse_math("$" not in text.get_text())
    return figure


class _Literal(Formatter):
    """Names beside the ticks of an axis, which are written anew whenever it is drawn."""

    def __init__(self, names: Formatter) -> None:
        self._names = names

    def __call__(self, x: float, pos: int | None = None) -> str:
        text = self._names(x, pos)
        return text if text.startswith(_POWER) else shortened(visible(text), _WORD, _LINE).replace("$", r"\$")

    def set_locs(self, locs: Any) -> None:  # noqa: ANN401 - as matplotlib has it
        self._names.set_locs(locs)


def _literal(axis: Axis) -> Iterator[Text]:
    """Let an axis write names as they are; yield the texts that it writes by itself."""
    for formatter, replaced in (
        (axis.get_major_formatter(), axis.set_major_formatter),
        (axis.get_minor_formatter(), axis.set_minor_formatter),
    ):
        if isinstance(formatter, FixedFormatter | FuncFormatter | StrCategoryFormatter):
            replaced(_Literal(formatter))
    for tick in (*axis.majorTicks, *axis.minorTicks):
        yield from (tick.label1, tick.label2)


def svg_text(figure: Figure) -> str:
    """Return a picture as SVG, its text as text.

    Args:
        figure: the picture.
    """
    buffer = io.StringIO()
    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        literal(figure).savefig(buffer, format="svg", metadata=nothing)
    return buffer.getvalue()


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as png, svg or pdf by the file's suffix.

    Raises:
        InputError: another suffix, or the file cannot be written.
    """
    path = file_path(path, otherwise="give axes of your own as `axes`")
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path}: '{path.suffix}' is not a picture format; {suggest(path.suffix, _SUFFIXES)}")
    with replacing(path) as part, mpl.rc_context(_STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")  # names in other scripts become boxes
        literal(figure).savefig(part, dpi=160, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)
