"""Pictures of a validation: outputs over time, residuals and their correlations."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.show.figure import ABOVE, COLOURS, LEGEND, LINE, label, panels

if TYPE_CHECKING:
    from workbench.identification.validate.residuals import Residuals
    from workbench.identification.validate.result import Validation

__all__ = ["plot_fit", "plot_residuals"]

_SHOWN = 300  # samples that can still be told apart over the width of a page
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
    span = _SHOWN if seconds is None else max(2, round(seconds / data.dt))
    shown = slice(0, min(span, data.n_samples))
    title = f"{data.name}: output of the model of order {result.model.order} and measured output"
    down = 2 * data.n_outputs
    figure, grid = panels(down, 1, title=title, sharex="all", height=1.6, ratios=[2.0, 1.0] * data.n_outputs)
    for k, name in enumerate(data.output_names):
        unit = data.output_units[k]
        _outputs(grid[2 * k][0], result, k, shown)
        _errors(grid[2 * k + 1][0], result, k, shown)
        grid[2 * k][0].set_ylabel(label(name, unit))
        grid[2 * k + 1][0].set_ylabel(label("error", unit))
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
    ax.set_ylabel(label(f"residual of {data.output_names[k]}", data.output_units[k]))
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
