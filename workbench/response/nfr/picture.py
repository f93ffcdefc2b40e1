"""Bode picture of a nonlinear frequency response."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import decibels
from workbench.response.branches.picture import branch_handles, draw_branches
from workbench.show.bode import Degrees, gain_label, log_axis
from workbench.show.figure import COLOURS, LEGEND, outside, rows
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.response.nfr.result import NfrResult

__all__ = ["plot_nfr"]

# Above so many amplitudes a legend would cover the curves: it moves to the side.
_LEGEND_INSIDE = 6

# A response that may be anything is not drawn as infinite: the bar ends 20 dB above it.
_FLOOR = 0.1

# Error bars of the phase larger than this are cut off [deg]: they would fill the picture.
_WIDE = 30.0

# Curves nearer to each other than this part of the picture everywhere hide each other, unless the lower ones are wider.
_ALIKE, _WIDER = 0.005, 1.6

# Room under the curves for the marks on the lower edge, part of the picture.
_ROOM = 0.12


def plot_nfr(result: NfrResult, *, offset: bool = False) -> Figure:
    """Draw gain [dB], phase [deg] and, if wanted, offset over frequency [Hz], one curve per amplitude.

    Circles: settled; triangles: averaged; on the lower edge crosses: failed, triangles downwards: no effect, the
    gain is 0; bars: the error.

    Args:
        result: what to draw.
        offset: draw the mean of the output too.
    """
    title = f"{result.model}: {result.input} → {result.output}{_of_one(result)}"
    figure, axes = rows(3 if offset else 2, title=title)
    pictures = [(result.gain_db, gain_label(result.input_unit, result.output_unit)), (result.phase_deg, "phase [deg]")]
    if offset:
        pictures.append((result.offset, bracketed(f"offset of {result.output}", result.output_unit)))
    for ax, (values, name) in zip(axes, pictures, strict=False):
        _curves(ax, result, values)
        ax.set_ylabel(name)
    _error_bars(axes[0], axes[1], result)
    if result.branches:
        colours = {a: COLOURS[i % len(COLOURS)] for i, a in enumerate(result.amplitude.tolist())}
        draw_branches(axes[0], axes[1], result.branches, result.folds, colours)
    _open_up(axes[0], result.gain_db, 1.0)
    _open_up(axes[1], result.phase_deg, 5.0)
    axes[1].yaxis.set_major_locator(Degrees())
    _failures(axes[0], result)
    log_axis(axes[-1], float(result.frequency_hz[0]), float(result.frequency_hz[-1]))
    axes[-1].set_xlabel("frequency [Hz]")
    _legend(figure, axes[0], result)
    figure.align_ylabels(axes)
    return figure


def _curves(ax: Axes, result: NfrResult, values: Floats) -> None:
    widths = _widths(values)
    for i, row in enumerate(values):
        finite = np.where(np.isfinite(row), row, np.nan)
        colour = COLOURS[i % len(COLOURS)]
        if not result.branches:  # they are the curves then
            label = f"{result.amplitude[i]:g}{_unit(result)}"  # for a legend of the caller's
            ax.plot(result.frequency_hz, finite, "-", color=colour, linewidth=1.3 + widths[i], label=label)
        for marker, chosen in (("o", ~result.averaged[i]), ("^", result.averaged[i])):
            style: dict[str, Any] = {"color": colour, "markerfacecolor": "white", "markeredgewidth": 1.1}
            ax.plot(
                result.frequency_hz[chosen],
                finite[chosen],
                marker,
                markersize=(4.0 if marker == "o" else 6.0) + widths[i],
                **style,
            )


def _widths(values: Floats) -> list[float]:
    """Return by how much wider each curve is drawn: by so much for each later one that lies on it [points]."""
    finite = np.where(np.isfinite(values), values, np.nan)
    near = _ALIKE * (np.nanmax(finite) - np.nanmin(finite)) if np.any(np.isfinite(values)) else 0.0
    return [_WIDER * sum(bool(np.all(~(np.abs(a - b) > near))) for b in finite[i + 1 :]) for i, a in enumerate(finite)]


def _error_bars(gain: Axes, phase: Axes, result: NfrResult) -> None:
    """Draw what the errors leave open, where the eye can see it: the sector of a circle around each response."""
    for i, error in enumerate(result.error):
        known = np.isfinite(error) & np.isfinite(result.gain_db[i])
        f, e = result.frequency_hz[known], error[known]
        style: dict[str, Any] = {"ecolor": COLOURS[i % len(COLOURS)], "fmt": "none", "elinewidth": 1.0, "capsize": 2.0}
        # The true response is the measured one over 1 + e·exp(jφ), with any φ.
        below = decibels(1.0 + e)
        above = -decibels(np.maximum(1.0 - e, _FLOOR))
        gain.errorbar(f, result.gain_db[i][known], yerr=np.array([below, above]), **style)
        turned = np.degrees(np.arcsin(np.minimum(e, 1.0)))
        high = np.where(e < 1.0, turned, 180.0)
        phase.errorbar(f, result.phase_deg[i][known], yerr=high, **style)
    _keep_to_curves(phase, result)


def _keep_to_curves(phase: Axes, result: NfrResult) -> None:
    """Bound the picture by the curves, and by bars only up to a size."""
    if not np.any(np.isfinite(result.phase_deg)):
        return
    turned = np.degrees(np.arcsin(np.clip(np.nan_to_num(result.error), 0.0, 1.0)))
    room = np.minimum(turned, _WIDE)
    low, high = float(np.nanmin(result.phase_deg - room)), float(np.nanmax(result.phase_deg + room))
    margin = 0.05 * (high - low)
    if np.any(turned > _WIDE):
        phase.set_ylim(low - margin, high + margin)


def _failures(ax: Axes, result: NfrResult) -> None:
    """Mark on the lower edge, one line per amplitude: failed points by crosses, a gain of 0 by triangles downwards."""
    marked = False
    low, high = ax.get_ylim()
    for i, amplitude in enumerate(result.amplitude):
        failed = [f.frequency_hz for f in result.failed if f.amplitude == amplitude]
        style: dict[str, Any] = {"color": COLOURS[i % len(COLOURS)], "transform": ax.get_xaxis_transform()}
        for at, marker in ((failed, "x"), (result.frequency_hz[result.gain[i] == 0.0], "v")):
            if len(at):
                marked = True
                ax.plot(at, np.full(len(at), 0.04 + 0.05 * i), marker, markersize=5.0, clip_on=False, **style)
    if marked:
        ax.set_ylim(low - _ROOM * (high - low), high)


def _open_up(ax: Axes, values: Floats, least: float) -> None:
    """Show at least so much of the axis, lest rounding fill the picture."""
    finite = values[np.isfinite(values)]
    if finite.size and float(np.ptp(finite)) < least:
        middle = 0.5 * float(finite.min() + finite.max())
        ax.set_ylim(middle - 0.6 * least, middle + 0.6 * least)


def _unit(result: NfrResult) -> str:
    return f" {result.input_unit}" if result.input_unit and result.input_unit != "1" else ""


def _of_one(result: NfrResult) -> str:
    """Return the amplitude where there is only one."""
    return f", amplitude {result.amplitude[0]:g}{_unit(result)}" if len(result.amplitude) == 1 else ""


def _legend(figure: Figure, ax: Axes, result: NfrResult) -> None:
    unit = _unit(result)
    style: dict[str, Any] = {"linewidth": 1.3, "markersize": 4.0, "markerfacecolor": "white"}
    handles = [
        Line2D([], [], color=COLOURS[i % len(COLOURS)], marker="o", label=f"{a:g}{unit}", **style)
        for i, a in enumerate(result.amplitude)
    ]
    style = {"color": "#666666", "linestyle": "none", "markerfacecolor": "white"}
    if np.any(result.averaged & (result.gain != 0.0)):
        handles.append(Line2D([], [], marker="^", markersize=6.0, label="averaged", **style))
    if np.any(result.gain == 0.0):
        handles.append(Line2D([], [], marker="v", markersize=5.0, label="gain 0 (−∞ dB)", **style))
    if result.failed:
        handles.append(Line2D([], [], marker="x", markersize=5.0, label="failed", **style))
    handles += branch_handles(result.branches, result.folds)
    settings: dict[str, Any] = {**LEGEND, "title": "amplitude", "title_fontsize": 8.5}
    if len(handles) > _LEGEND_INSIDE:
        outside(figure, handles, "right upper", **settings)
    else:
        ax.legend(handles=handles, loc="best", **settings)
