"""Linear models by several methods and a measured response in one Bode picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from workbench.core.values.response import Response
from workbench.point.lin.picture import frequency_band
from workbench.show.bode import bode_axes, draw_response
from workbench.show.figure import COLOURS, LEGEND, rows
from workbench.show.tables import behind

if TYPE_CHECKING:
    from workbench.response.compare_linear.result import LinComparison

__all__ = ["plot_comparison"]

_DASHES = ("-", "--", "-.", ":")


def plot_comparison(comparison: LinComparison) -> Figure:
    """Draw every model as a curve and the measurement as circles (triangles: not settled).

    Args:
        comparison: what to draw.
    """
    figure, axes = rows(2, title=_title(comparison))
    measured = comparison.measured
    frequency = frequency_band(list(comparison.results.values()))
    if measured is not None:
        low, high = 0.5 * float(measured.frequency_hz[0]), 2.0 * float(measured.frequency_hz[-1])
        frequency = np.geomspace(low, high, len(frequency))
    for number, (name, result) in enumerate(comparison.results.items()):
        shown = frequency[frequency < 0.5 / result.dt] if result.dt > 0.0 else frequency
        response = result.fundamental(shown)[:, 0, 0]
        style: dict[str, Any] = {
            "color": COLOURS[number % len(COLOURS)],
            "linestyle": _DASHES[number % 4],
            "linewidth": 1.5,
        }
        draw_response(axes[0], axes[1], Response(shown, response), label=name, **style)
    if measured is not None:
        settled = f"measured, amplitude {measured.amplitude[0]:g}{behind(measured.input_unit)}"
        for marker, chosen in (("o", ~measured.averaged[0]), ("^", measured.averaged[0])):
            style = {"color": "#222222", "markerfacecolor": "white"}
            at = measured.frequency_hz[chosen]
            text = settled if marker == "o" else "not settled"
            if chosen.any():
                axes[0].plot(at, measured.gain_db[0][chosen], marker, label=text, **style)
                axes[1].plot(at, measured.phase_deg[0][chosen], marker, **style)
    bode_axes(axes)
    axes[0].legend(**LEGEND)
    return figure


def _title(comparison: LinComparison) -> str:
    models = {result.model for result in comparison.results.values()}
    count = len(comparison.results)
    of = f"{models.pop()}: " if len(models) == 1 else ""
    return f"{of}{comparison.input} → {comparison.output} by {count} method{'' if count == 1 else 's'}"
