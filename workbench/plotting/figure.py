"""What all pictures share: size, style, writing a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from workbench.errors import InputError, suggest

__all__ = ["COLOURS", "label", "rows", "save"]

# Okabe and Ito's palette: told apart by every eye, and in grey by their order of brightness.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#444444")

_SUFFIXES = (".png", ".svg", ".pdf")

_STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 11.0,
    "axes.edgecolor": "#666666",
    "axes.linewidth": 0.8,
    "svg.hashsalt": "workbench",  # the same result gives the same file
}


def rows(count: int, *, title: str) -> tuple[Figure, list[Axes]]:
    """Return a figure with `count` pictures over a common horizontal axis.

    The figure belongs to no window system; it works without a display.
    """
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(7.2, 1.0 + 2.4 * count), layout="constrained")
        FigureCanvasAgg(figure)
        axes = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
        axes[0].set_title(title, loc="left", fontweight="bold")
    for ax in axes:
        ax.grid(visible=True, which="major", color="#cccccc", linewidth=0.7)
        ax.grid(visible=True, which="minor", color="#ececec", linewidth=0.5)
        ax.set_axisbelow(True)
        for side in ("top", "right"):
            ax.spines[side].set_visible(False)
    return figure, axes


def label(name: str, unit: str | None) -> str:
    """Return "name [unit]", or the name alone where there is no unit."""
    return f"{name} [{unit}]" if unit and unit != "1" else name


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as png, svg or pdf by the file's suffix.

    Raises:
        InputError: another suffix, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path}: '{path.suffix}' is not a picture format; {suggest(path.suffix, _SUFFIXES)}")
    try:
        with mpl.rc_context(_STYLE):
            figure.savefig(path, dpi=160, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
