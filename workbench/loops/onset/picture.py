"""Picture of the onset of rate limiting: the Nichols chart, and the rate that a sine asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from workbench.loops.onset.boundary import BOUNDARY
from workbench.show.bode import log_axis
from workbench.show.figure import COLOURS, LEGEND, panels
from workbench.show.labels import name_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from workbench.loops.onset.result import OnsetResult

__all__ = ["plot_onset"]


def plot_onset(result: OnsetResult) -> Figure:
    """Draw the open loop in the Nichols chart with onset points and boundary, and the rate over frequency.

    Args:
        result: of `onset`.
    """
    title = f"{result.model}: rate limit of {result.limiter}"
    figure, ((chart, rates),) = panels(1, 2, title=title, width=9.6, height=4.4)
    _chart(chart, result)
    _rates(rates, result)
    return figure


def _chart(ax: Axes, result: OnsetResult) -> None:
    ax.plot(result.open_phase_deg, result.open_gain_db, color=COLOURS[6], linewidth=1.3, label="open loop L")
    phases, gains = zip(*BOUNDARY, strict=True)
    top = max(gains) + 6.0
    ax.plot(phases, gains, color="#b3261e", linewidth=1.6, label="boundary (Duda)")
    ax.fill_between(phases, gains, top, color="#b3261e14", linewidth=0.0, label="expect a jump")
    ax.plot([-180.0], [0.0], "+", color="#444444", markersize=10, label="-180°, 0 dB")
    places, names = [], []
    for k, p in enumerate(result.points):
        if p.phase_deg is None or p.gain_db is None or p.frequency_hz is None:
            continue
        ax.plot([p.phase_deg], [p.gain_db], "o", color=_colour(k), markersize=6, zorder=4)
        places.append((p.phase_deg, p.gain_db))
        names.append(f"{p.amplitude:g}{_unit(result)}: {p.frequency_hz:.3g} Hz")
    name_points(ax, places, names)
    ax.set_xlim(-270.0, -45.0)
    ax.set_ylim(-20.0, top)
    ax.set_xticks(np.arange(-270.0, -44.0, 45.0))
    ax.set_xlabel("phase of L [deg]")
    ax.set_ylabel("gain of L [dB]")
    ax.legend(**{**LEGEND, "loc": "lower right"})


def _rates(ax: Axes, result: OnsetResult) -> None:
    f = np.asarray(result.frequency_hz)
    rate = 2.0 * np.pi * f * 10.0 ** (np.asarray(result.closed_gain_db) / 20.0) / result.rate
    for k, p in enumerate(result.points):
        colour = _colour(k)
        name = f"amplitude {p.amplitude:g}{_unit(result)}"
        ax.loglog(f, p.amplitude * rate, color=colour, linewidth=1.3, label=name)
        if p.frequency_hz is not None:
            ax.plot([p.frequency_hz], [1.0], "o", color=colour, markersize=6, zorder=4)
    ax.axhline(1.0, color="#b3261e", linewidth=1.4, label="the limit")
    ax.set_ylim(1e-2, None)
    log_axis(ax, float(f[0]), float(f[-1]))
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("highest rate of the linear loop / limit")
    ax.legend(**{**LEGEND, "loc": "best"})


def _colour(k: int) -> str:
    """Return the colour of an amplitude, in both pictures; grey is the loop's."""
    return COLOURS[k % 6]


def _unit(result: OnsetResult) -> str:
    return "" if result.input_unit in {None, "1"} else f" {result.input_unit}"
