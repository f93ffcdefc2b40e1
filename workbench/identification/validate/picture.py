"""Pictures of a validation: outputs and residuals, poles and zeros, frequency responses."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.poles import pole_rows
from workbench.core.values.response import Response
from workbench.errors import InputError
from workbench.identification.validate.pole_zero import in_words
from workbench.show.bode import Degrees, bode_axes, draw_response, log_axis
from workbench.show.figure import ABOVE, COLOURS, LEGEND, LINE, panels
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.identification.identified.model import IdentifiedModel
    from workbench.identification.validate.overlay import Overlay
    from workbench.identification.validate.pole_zero import NearCancellation
    from workbench.identification.validate.regions import PoleRegion
    from workbench.identification.validate.residuals import Residuals
    from workbench.identification.validate.result import Validation
    from workbench.identification.validate.spread import ModelSpread
    from workbench.response.nfr.result import NfrResult

__all__ = ["SHOWN", "plot_fit", "plot_overlay", "plot_poles", "plot_residuals", "plot_spread"]

SHOWN = 300  # samples that can still be told apart over the width of a page
_DARK = "#333333"
_BAND: dict[str, Any] = {"color": COLOURS[4], "alpha": 0.25, "linewidth": 0.0}
_EDGE: dict[str, Any] = {"color": "#666666", "linewidth": 0.9, "linestyle": "--"}


def plot_fit(result: Validation, *, seconds: float | None = None) -> Figure:
    """Draw measured, simulated and predicted outputs over time [s], the errors below each.

    Args:
        result: what to draw.
        seconds: how much to show [s]; None: the first 300 samples.

    Raises:
        InputError: nothing to show.
    """
    data = result.data
    if seconds is not None and not seconds > 0.0:
        raise InputError(f"seconds must be positive, not {seconds:g}")
    span = SHOWN if seconds is None else max(2, round(seconds / data.dt))
    shown = slice(0, min(span, data.n_samples))
    title = f"{data.name}: output of the model of order {result.model.order} and measured output"
    down = 2 * data.n_outputs
    figure, grid = panels(down, 1, title=title, sharex="all", height=1.6, ratios=[2.0, 1.0] * data.n_outputs)
    for k, name in enumerate(data.output_names):
        unit = data.output_units[k]
        _outputs(grid[2 * k][0], result, k, shown)
        _errors(grid[2 * k + 1][0], result, k, shown)
        grid[2 * k][0].set_ylabel(bracketed(name, unit))
        grid[2 * k + 1][0].set_ylabel(bracketed("error", unit))
    part = "" if shown.stop >= data.n_samples else f", {shown.stop} of {data.n_samples} samples"
    grid[-1][0].set_xlabel(f"time [s]{part}")
    figure.align_ylabels([row[0] for row in grid])
    return figure


def _outputs(ax: Axes, result: Validation, k: int, shown: slice) -> None:
    time, y = result.data.time[shown], result.data.y[shown, k]
    ax.plot(time, y, color=_DARK, linewidth=1.8, label="measured")
    simulated, predicted = result.simulation, result.prediction
    for kind, colour, dash in ((simulated, COLOURS[1], "-"), (predicted, COLOURS[0], "--")):
        fit = kind.fits[k]
        good = np.all(np.isfinite(kind.computed[shown, k]))
        text = f"{kind.kind}, fit {fit.fit_percent:.1f} %" if np.isfinite(fit.fit_percent) else f"{kind.kind}: unstable"
        values = kind.computed[shown, k] if good else np.full(len(time), np.nan)
        ax.plot(time, values, dash, color=colour, linewidth=1.2, label=text)
    room = (float(np.ptp(y)) or 1.0) * 0.15  # what leaves it is wrong anyhow: an unstable model must not hide the rest
    ax.set_ylim(float(np.min(y)) - room, float(np.max(y)) + room)
    ax.legend(ncols=3, **ABOVE)


def _errors(ax: Axes, result: Validation, k: int, shown: slice) -> None:
    time = result.data.time[shown]
    for kind, colour, dash in ((result.simulation, COLOURS[1], "-"), (result.prediction, COLOURS[0], "--")):
        if np.all(np.isfinite(kind.residual[shown, k])):
            ax.plot(time, kind.residual[shown, k], dash, color=colour, linewidth=1.0)
    ax.axhline(0.0, color="#888888", linewidth=0.7)


def plot_residuals(result: Validation, residuals: Residuals) -> Figure:
    """Draw residuals over time, their autocorrelation and their cross-correlation with each input.

    One column for each output. Shaded: 95 % of the lags of a good model lie within. Dashed: with 97.5 % all of
    them do. The verdicts stand below.

    Args:
        result: of the validation.
        residuals: one of its two.

    Raises:
        InputError: there are no residual tests to draw.
    """
    if residuals.autocorrelation is None or residuals.cross is None:
        raise InputError(f"{result.data.name}: {residuals.remark}; there is no residual picture")
    data, p, m = result.data, result.data.n_outputs, result.data.n_inputs
    title = f"{data.name}: residuals of the {residuals.kind}"
    figure, grid = panels(2 + m, p, title=title, width=max(7.2, 4.2 * p), height=2.2)
    for k in range(p):
        _residual(grid[0][k], result, residuals, k)
        _autocorrelation(grid[1][k], residuals, k, data.dt)
        for j, source in enumerate(data.input_names):
            _cross(grid[2 + j][k], residuals, k, j)
            grid[2 + j][k].set_ylabel(f"correlation of\n{source} and residual")
            grid[2 + j][k].set_xlabel(f"lag [samples of {data.dt:g} s]")
    _verdicts(figure, residuals)
    _explain(grid[1][0])
    return figure


def _residual(ax: Axes, result: Validation, residuals: Residuals, k: int) -> None:
    data = result.data
    ax.plot(data.time, residuals.residual[:, k], color=COLOURS[0], linewidth=0.6)
    ax.set_ylabel(bracketed(f"residual of {data.output_names[k]}", data.output_units[k]))
    ax.set_xlabel("time [s]")
    ax.margins(x=0.01)


def _autocorrelation(ax: Axes, residuals: Residuals, k: int, dt: float) -> None:
    test = residuals.autocorrelation
    if test is None:
        return
    ax.axhspan(-test.band, test.band, **_BAND)
    _stems(ax, test.lags, test.values[:, k], (np.abs(test.values[:, k]) > test.band) & (test.lags > 0.0))
    ax.set_ylabel("autocorrelation")
    ax.set_xlabel(f"lag [samples of {dt:g} s]")
    ax.set_ylim(min(-0.15, 1.15 * float(np.min(test.values[:, k]))), 1.05)


def _cross(ax: Axes, residuals: Residuals, k: int, j: int) -> None:
    test = residuals.cross
    if test is None:
        return
    values, band, wide = test.values[:, k, j], float(test.band[k, j]), float(test.band_all[k, j])
    ax.axhspan(-band, band, **_BAND)
    ax.axhline(wide, **_EDGE)
    ax.axhline(-wide, **_EDGE)
    ax.axvline(-0.5, color="#888888", linewidth=0.7)
    _stems(ax, test.lags, values, np.abs(values) > wide)
    top = 1.5 * max(float(np.max(np.abs(values))), wide)
    ax.set_ylim(-top, top)
    for at, side in ((0.01, "left"), (0.99, "right")):
        text = "feedback" if side == "left" else "dynamics missed"
        ax.text(at, 0.03, text, transform=ax.transAxes, ha=side, fontsize=8.0, color="#555555")


def _stems(ax: Axes, lags: Floats, values: Floats, outside: np.ndarray[Any, Any]) -> None:
    for chosen, colour in ((~outside, COLOURS[0]), (outside, COLOURS[1])):
        ax.vlines(lags[chosen], 0.0, values[chosen], color=colour, linewidth=1.2)
        ax.plot(lags[chosen], values[chosen], "o", color=colour, markersize=3.0)
    ax.axhline(0.0, color="#888888", linewidth=0.7)


def _explain(ax: Axes) -> None:
    outside = Line2D([], [], color=COLOURS[1], marker="o", markersize=3.0, linewidth=1.2)
    words = ["95 % band, each lag", "97.5 % band, all lags", "outside"]
    ax.legend([Patch(**_BAND), Line2D([], [], **_EDGE), outside], words, loc="upper right", **LEGEND)


def _verdicts(figure: Figure, residuals: Residuals) -> None:
    if residuals.autocorrelation is None or residuals.cross is None:
        return
    words = (residuals.autocorrelation.words, *residuals.cross.words)
    lines = [line for text in words for line in wrap(text, LINE, subsequent_indent="    ")]
    figure.supxlabel("\n".join(lines), x=0.01, ha="left", fontsize=8.5)


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
