"""Values of the points of a picture, which a page shows beside the pointer."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["points_of"]

_MOST = 150  # points of a curve
_CURVES = 24  # of a picture


def points_of(figure: Figure) -> str:
    """Return the points of all curves as JSON: for each its name, axes, and [place in the picture, x, y].

    Args:
        figure: that has been drawn, so that everything has its place; places are those of an SVG [points].
    """
    result = [curve for ax in figure.axes for curve in _of_axes(ax, figure)]
    return json.dumps(result[:_CURVES], separators=(",", ":"), ensure_ascii=False) if result else ""


def _of_axes(ax: Axes, figure: Figure) -> list[dict[str, Any]]:
    return [curve for line in ax.lines if (curve := _curve(ax, figure, line))]


def _curve(ax: Axes, figure: Figure, line: Any) -> dict[str, Any] | None:  # noqa: ANN401 - a line of matplotlib
    """Return one curve; lines across the axes have nothing to tell."""
    if line.get_transform() != ax.transData or not line.get_visible():
        return None
    values = np.asarray(line.get_xydata(), dtype=np.float64)
    low, high = ax.transAxes.transform([(0.0, 0.0), (1.0, 1.0)])
    with np.errstate(all="ignore"):
        at = ax.transData.transform(values)
        seen = np.isfinite(at).all(axis=1) & (at >= low - 1.0).all(axis=1) & (at <= high + 1.0).all(axis=1)
    if not seen.any():
        return None
    shown = np.flatnonzero(seen)
    shown = shown[np.unique(np.linspace(0, len(shown) - 1, _MOST).round().astype(int))]
    unit = 72.0 / figure.dpi
    top = figure.bbox.height * unit
    places = np.column_stack([at[shown, 0] * unit, top - at[shown, 1] * unit])
    name = str(line.get_label())
    return {
        "name": "" if name.startswith("_") else name,
        "x": _axis(ax.get_xlabel(), ax),
        "y": ax.get_ylabel(),
        "points": [
            [round(px, 1), round(py, 1), float(f"{x:.5g}"), float(f"{y:.5g}")]
            for (px, py), (x, y) in zip(places.tolist(), values[shown].tolist(), strict=True)
        ],
    }


def _axis(own: str, ax: Axes) -> str:
    """Return the label of the horizontal axis, which the lowest of several panels alone may have."""
    shared = [other.get_xlabel() for other in ax.get_shared_x_axes().get_siblings(ax)]
    return own or next(filter(None, shared), "x")
