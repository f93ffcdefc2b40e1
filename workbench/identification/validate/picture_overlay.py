"""An identified model, the linearisation and the measured response on one Bode picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.core.values.response import Response
from workbench.show.bode import bode_axes, draw_response
from workbench.show.figure import COLOURS, LEGEND, panels

if TYPE_CHECKING:
    from workbench.identification.validate.overlay import Overlay
    from workbench.response.nfr.result import NfrResult

__all__ = ["plot_overlay"]

_DASHES = ("-", "--", "-.")
_MARKS = ("o", "s", "D", "v", "P")


def plot_overlay(result: Overlay) -> Figure:
    """Draw gain [dB] and phase [deg] over frequency [Hz], and how far the curves are from the reference.

    Args:
        result: what to draw.
    """
    title = f"{result.name}: {result.input} → {result.output}"
    figure, grid = panels(4, 1, title=title, sharex="all", height=1.75, ratios=[1.35, 1.35, 0.8, 0.8])
    axes = [row[0] for row in grid]
    colours = {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(result.curves)}
    for number, (name, response) in enumerate(result.curves.items()):
        style: dict[str, Any] = {"color": colours[name], "linestyle": _DASHES[number % 3], "linewidth": 1.6}
        draw_response(axes[0], axes[1], Response(result.frequency_hz, response), label=name, **style)
    if result.measured is not None:
        _measured(axes, result, result.measured)
    for number, d in enumerate(result.differences):
        style = {"color": colours[d.curve], "marker": ".", "linestyle": _DASHES[number % 3], "linewidth": 1.2}
        axes[2].plot(d.frequency_hz, d.gain_db, **style)
        axes[3].plot(d.frequency_hz, d.phase_deg, **style)
    _finish(axes, result)
    figure.align_ylabels(axes)
    return figure


def _measured(axes: list[Axes], result: Overlay, nfr: NfrResult) -> None:
    unit = f" {nfr.input_unit}" if nfr.input_unit and nfr.input_unit != "1" else ""
    for k, amplitude in enumerate(nfr.amplitude.tolist()):
        colour = "#222222" if np.isclose(amplitude, result.amplitude) else "#999999"
        style: dict[str, Any] = {"color": colour, "markerfacecolor": "white", "linestyle": "none", "markersize": 4.5}
        mark = _MARKS[k % len(_MARKS)]
        text = f"measured, {amplitude:g}{unit}"
        axes[0].plot(nfr.frequency_hz, nfr.gain_db[k], mark, label=text, **style)
        axes[1].plot(nfr.frequency_hz, nfr.phase_deg[k], mark, **style)
        if nfr.averaged[k].any():
            at = nfr.frequency_hz[nfr.averaged[k]]
            axes[0].plot(at, nfr.gain_db[k][nfr.averaged[k]], "^", label="not settled", **{**style, "markersize": 7.0})


def _finish(axes: list[Axes], result: Overlay) -> None:
    bode_axes(axes[:2])
    axes[1].set_xlabel("")
    axes[2].set_ylabel("difference [dB]")
    axes[3].set_ylabel("difference [deg]")
    axes[3].set_xlabel("frequency [Hz]")
    axes[2].set_title(f"curves less {result.reference}", loc="left", fontsize=9.5)
    if result.nyquist_hz <= 1.1 * float(result.frequency_hz[-1]):
        for ax in axes:
            ax.axvline(result.nyquist_hz, color="#888888", linestyle=":", linewidth=1.0)
        axes[0].plot([], [], color="#888888", linestyle=":", label="Nyquist frequency")
    for ax in axes[2:]:
        ax.axhline(0.0, color="#888888", linewidth=0.7)
    axes[0].legend(loc="best", **LEGEND)
    low = float(result.frequency_hz[0])
    high = float(result.frequency_hz[-1])
    axes[0].set_xlim(low / 1.1, high * 1.1)
