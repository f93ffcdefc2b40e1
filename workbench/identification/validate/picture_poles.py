"""Poles and zeros of an identified model with their confidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from workbench.core.values.arrays import Complex
from workbench.core.values.poles import pole_rows
from workbench.identification.validate.pole_zero import in_words
from workbench.show.bode import Degrees, log_axis
from workbench.show.figure import ABOVE, COLOURS, panels

if TYPE_CHECKING:
    from workbench.identification.identified.model import IdentifiedModel
    from workbench.identification.validate.pole_zero import NearCancellation
    from workbench.identification.validate.regions import PoleRegion
    from workbench.identification.validate.spread import ModelSpread

__all__ = ["plot_poles", "plot_spread"]


_SMALL = 0.15  # half axes of regions that deserve a magnified picture
_PAIRS = 4  # inputs and outputs that fit beside each other
_FAR = 1.6  # zeros further out are named instead of drawn


def plot_poles(
    model: IdentifiedModel,
    *,
    cancellations: Sequence[NearCancellation] = (),
    spread: ModelSpread | None = None,
) -> Figure:
    """Draw poles and zeros of a discrete model with the unit circle, near-cancellations marked, and 95 % regions.

    A table beside names natural frequency and damping ratio of each pole.

    Args:
        model: discrete.
        cancellations: pairs to be marked.
        spread: regions of the poles.
    """
    poles, zeros = model.undelayed().poles, model.undelayed().zeros
    title = f"{model.name}: poles and zeros of the model of order {len(poles)}"
    figure, ax, side, cells = _plane(title)
    if spread is not None:
        _regions(ax, spread)
    near = zeros[np.abs(zeros) <= _FAR]
    ax.plot(near.real, near.imag, "o", color=COLOURS[1], markerfacecolor="none", markersize=7.5, label="zero")
    ax.plot(poles.real, poles.imag, "x", color=COLOURS[0], markersize=7.5, markeredgewidth=1.8, label="pole")
    _mark(ax, cancellations)
    _legend(ax, spread, cancellations)
    _table(side, poles, model.dt, spread)
    _zooms(figure, cells, spread)
    far = [z for z in zeros[np.abs(zeros) > _FAR].tolist() if z.imag >= 0.0]
    if far:
        outside = f"zeros outside the picture: {', '.join(in_words(z) for z in far)}"
        figure.supxlabel(outside, x=0.01, ha="left", fontsize=8.5)
    return figure


def plot_spread(result: ModelSpread) -> Figure:
    """Draw gain [dB] and phase [deg] over frequency [Hz], from each input to each output, with their regions.

    Args:
        result: what to draw.
    """
    _, p, m = result.response.shape
    pairs = [(i, j) for i in range(p) for j in range(m)][:_PAIRS]
    title = f"{result.name}: frequency response with {100.0 * result.confidence:g} % regions"
    figure, grid = panels(2, len(pairs), title=title, height=2.3)
    for column, (i, j) in enumerate(pairs):
        value, error = result.response[:, i, j], result.gain_error[:, i, j]
        gain, phase = np.abs(value), np.unwrap(np.angle(value))
        turn = np.degrees(np.arcsin(np.minimum(error, 1.0)))
        curves = (
            tuple(20.0 * np.log10(gain * part) for part in (np.maximum(1.0 - error, 1e-3), 1.0, 1.0 + error)),
            (np.degrees(phase) - turn, np.degrees(phase), np.degrees(phase) + turn),
        )  # fmt: skip
        for ax, (low, middle, high), text in zip(
            (grid[0][column], grid[1][column]), curves, ("gain [dB]", "phase [deg]"), strict=True
        ):
            ax.fill_between(result.frequency_hz, low, high, color=COLOURS[2], alpha=0.3, linewidth=0.0)
            ax.semilogx(result.frequency_hz, middle, color=COLOURS[0], linewidth=1.2)
            if column == 0:
                ax.set_ylabel(text)
        grid[0][column].set_title(f"{result.input_names[j]} → {result.output_names[i]}", fontsize=9.0, loc="left")
        grid[1][column].set_xlabel("frequency [Hz]")
        grid[1][column].yaxis.set_major_locator(Degrees())
        for ax in (grid[0][column], grid[1][column]):
            log_axis(ax, float(result.frequency_hz[0]), float(result.frequency_hz[-1]))
    return figure


def _plane(title: str) -> tuple[Figure, Axes, Axes, GridSpec]:
    """Return a figure with the plane of discrete poles, room for a table, and the grid they lie in."""
    figure, grid = panels(1, 1, title=title, width=9.6, height=5.0)
    ax = grid[0][0]
    cells = figure.add_gridspec(2, 4)
    ax.set_subplotspec(cells[:, :2])
    side = figure.add_subplot(cells[0, 2:])
    ax.add_patch(Circle((0.0, 0.0), 1.0, fill=False, edgecolor="#444444", linewidth=1.0))
    ax.axhline(0.0, color="#888888", linewidth=0.7)
    ax.axvline(0.0, color="#888888", linewidth=0.7)
    ax.set_aspect("equal")
    ax.set_xlim(-1.2, 1.2)
    ax.set_ylim(-1.2, 1.2)
    ax.set_xlabel("real part [1]")
    ax.set_ylabel("imaginary part [1]")
    side.set_axis_off()
    return figure, ax, side, cells


def _regions(ax: Axes, spread: ModelSpread) -> None:
    if spread.determined < len(spread.regions):
        ax.add_patch(Circle((0.0, 0.0), 1.0, color=COLOURS[5], alpha=0.15, zorder=1.0, linewidth=0.0))
    for region in spread.regions:
        if region.determined:
            _region(ax, region)


def _region(ax: Axes, region: PoleRegion) -> None:
    if region.on_axis:
        half = region.half_axes[0]
        ends = [region.pole.real - half, region.pole.real + half]
        ax.plot(ends, [0.0, 0.0], "-|", color=COLOURS[2], linewidth=3.0, alpha=0.7, markersize=9.0, zorder=1.8)
        return
    edge = region.outline()
    corners = np.column_stack([edge.real, edge.imag])
    ax.add_patch(Polygon(corners, facecolor=COLOURS[2], edgecolor="none", alpha=0.25, zorder=1.7))
    ax.plot(edge.real, edge.imag, color=COLOURS[2], linewidth=1.0, zorder=1.8)


def _zooms(figure: Figure, cells: GridSpec, spread: ModelSpread | None) -> None:
    """Magnify two regions that are too small to be seen, those nearest to the unit circle."""
    if spread is None:
        return
    upper = [r for r in spread.regions if r.determined and r.pole.imag >= 0.0 and r.half_axes[0] < _SMALL]
    for k, region in enumerate(sorted(upper, key=lambda r: abs(abs(r.pole) - 1.0))[:2]):
        ax = figure.add_subplot(cells[1, 2 + k])
        ax.grid(visible=True, color="#dddddd", linewidth=0.6)
        _region(ax, region)
        ax.plot(region.pole.real, region.pole.imag, "x", color=COLOURS[0], markersize=7.5, markeredgewidth=1.8)
        half = 1.35 * region.half_axes[0]
        ax.set_xlim(region.pole.real - half, region.pole.real + half)
        ax.set_ylim(region.pole.imag - half, region.pole.imag + half)
        ax.set_aspect("equal")
        ax.tick_params(labelsize=7.5)
        ax.set_xlabel("real part [1]", fontsize=8.0)
        ax.locator_params(nbins=4)
        ax.set_title(f"magnified: {in_words(region.pole)}", fontsize=8.5, loc="left")


def _mark(ax: Axes, cancellations: Sequence[NearCancellation]) -> None:
    for pair in cancellations:
        middle = 0.5 * (pair.pole + pair.zero)
        radius = 0.5 * pair.distance + 0.07
        for sign in (1.0, -1.0) if middle.imag > 1e-9 else (1.0,):
            at = (middle.real, sign * middle.imag)
            ax.add_patch(Circle(at, radius, fill=False, edgecolor=COLOURS[3], linewidth=1.4, linestyle="--"))


def _legend(ax: Axes, spread: ModelSpread | None, cancellations: Sequence[NearCancellation]) -> None:
    handles, labels = ax.get_legend_handles_labels()
    extra: list[tuple[dict[str, Any], str]] = []
    if spread is not None:
        if spread.determined:
            wide = {"color": COLOURS[2], "linewidth": 4.0, "alpha": 0.5}
            extra.append((wide, f"{100.0 * spread.confidence:g} % region"))
        if spread.determined < len(spread.regions):
            extra.append(({"color": COLOURS[5], "linewidth": 6.0, "alpha": 0.25}, "region of undetermined poles"))
    if cancellations:
        extra.append(({"color": COLOURS[3], "linestyle": "--"}, "nearly cancel"))
    handles = [*handles, *(Line2D([], [], **style) for style, _ in extra)]
    ax.legend(handles, [*labels, *(text for _, text in extra)], ncols=3, **ABOVE)


def _table(ax: Axes, poles: Complex, dt: float, spread: ModelSpread | None) -> None:
    """List poles, one line for a pair, with natural frequency, damping ratio and size of the region."""
    head = ["pole", "natural\n[Hz]", "damping\nratio"]
    head += [] if spread is None else [f"{100.0 * spread.confidence:g} % region,\nhalf axes"]
    upper = sorted((p for p in poles.tolist() if p.imag >= 0.0), key=lambda p: -abs(p))
    rows = [[in_words(p), *_motion(p, dt), *_size(p, spread)] for p in upper]
    if not rows:
        ax.text(0.0, 0.9, "no poles: a gain alone")
        return
    widths = [0.36, 0.2, 0.16] + ([] if spread is None else [0.34])
    table = ax.table(cellText=rows, colLabels=head, loc="upper left", cellLoc="left", colWidths=widths)
    table.auto_set_font_size(False)
    table.set_fontsize(8.0)
    for (row, _), cell in table.get_celld().items():
        cell.set_edgecolor("#cccccc")
        cell.set_height(0.11 if row == 0 else 0.06)
        if row == 0:
            cell.set_facecolor("#eef2f5")


def _motion(pole: complex, dt: float) -> list[str]:
    """Return natural frequency [Hz] and damping ratio of the continuous pole behind a discrete one."""
    (row,) = pole_rows([pole], dt)
    return [row.natural, row.damping]


def _size(pole: complex, spread: ModelSpread | None) -> list[str]:
    if spread is None:
        return []
    region = min(spread.regions, key=lambda r: abs(r.pole - pole))
    if not region.determined:
        return ["not determined"]
    long, short = region.half_axes
    return [f"± {long:.2g}" if region.on_axis else f"{long:.2g}, {short:.2g}"]
