"""Pictures of a feedback over its gain: poles, growth, and the overview."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from workbench.core.values.poles import continuous, damped_frequency_hz
from workbench.limit_cycles.feedback.picture_nyquist import draw_curve
from workbench.limit_cycles.feedback.picture_runs import draw_settling
from workbench.show.figure import ABOVE, COLOURS, UNSTABLE, panels, written
from workbench.show.labels import name_lines, name_points

if TYPE_CHECKING:
    from workbench.limit_cycles.feedback.result import FeedbackResult

__all__ = ["draw_growth", "draw_locus", "gain_label", "plot_feedback", "plot_root_locus"]

_STABLE = "#009E73"
_COLOURMAP = "viridis"
_DAMPINGS = (0.01, 0.02, 0.05, 0.1, 0.2)
_ROWS = 12


def plot_feedback(result: FeedbackResult) -> Figure:
    """Draw the root locus, the growth of the slowest pole, the Nyquist curve, and settling times or the crossings.

    Args:
        result: of the analysis.
    """
    title = f"{result.model}: feedback of {result.source} to {result.target}"
    figure, ((poles, growth), (plane, last)) = panels(2, 2, title=title, width=11.0, height=3.5)
    draw_locus(poles, result, near=True)
    draw_growth(growth, result)
    draw_curve(plane, result, band=None, marks="shown")
    if result.settling is not None:
        draw_settling(last, result.settling)
    else:
        _table(last, result)
    figure.supxlabel(result.words, x=0.01, ha="left", fontsize=8.5)
    return figure


def plot_root_locus(result: FeedbackResult) -> Figure:
    """Draw the poles over the gain, all of them and those around the border of stability.

    Args:
        result: of the analysis.
    """
    title = f"{result.model}: poles with feedback of {result.source} to {result.target}"
    figure, ((whole, near),) = panels(1, 2, title=title, width=11.0, height=5.0)
    draw_locus(whole, result, near=False)
    draw_locus(near, result, near=True)
    return figure


# -- poles -------------------------------------------------------------------------------------


def draw_locus(ax: Axes, result: FeedbackResult, *, near: bool) -> None:
    """Draw each pole's way over the gain in the s-plane, upper half.

    Args:
        ax: where.
        result: of the analysis.
        near: around the crossings of the border only.
    """
    locus = result.locus
    left, right, top = _view(result, near=near)
    _damping_lines(ax, left, top)
    ax.axvspan(0.0, right, label="unstable", **UNSTABLE)
    ax.axvline(0.0, color="#444444", linewidth=0.9, zorder=2)
    limits = Normalize(float(locus.gains[0]), float(locus.gains[-1]))
    for column in locus.poles.T:
        x, y = column.real, damped_frequency_hz(column)
        if np.all((x < left) | (x > right) | (y > top)):
            continue
        points = np.column_stack([x, y]).reshape(-1, 1, 2)
        # Where a pole leaves or enters the real axis its mirror image takes over.
        pieces = np.concatenate([points[:-1], points[1:]], axis=1)
        lines = LineCollection(list(pieces), cmap=_COLOURMAP, norm=limits, linewidths=1.9, zorder=3)
        lines.set_array(0.5 * (locus.gains[:-1] + locus.gains[1:]))
        ax.add_collection(lines)
    _ends(ax, result, top, named=near)
    ax.set_xlim(left, right)
    ax.set_ylim(-0.01 * top, top)
    ax.set(xlabel="real part of the pole [1/s]", ylabel="damped frequency [Hz]")
    shade = ax.figure.colorbar(LineCollection([], cmap=_COLOURMAP, norm=limits), ax=ax, pad=0.02, aspect=30)
    shade.set_label(gain_label(result))


def _view(result: FeedbackResult, *, near: bool) -> tuple[float, float, float]:
    """Return left and right end [1/s] and top [Hz] of the picture."""
    poles = result.locus.poles
    f = damped_frequency_hz(poles)
    if not near:
        left, right = float(np.quantile(poles.real, 0.02)), max(0.0, float(poles.real.max()))
        width = max(right - left, 1e-9)
        return left - 0.05 * width, right + 0.1 * width, max(1.08 * float(f.max()), 0.05 * width)
    shown = [c.frequency_hz for c in _marked(result) if np.isfinite(c.frequency_hz)]
    top = 1.35 * max([*shown, 0.0])
    top = top if top > 0.0 else max(1.2 * float(f.max()), 0.1 * float(np.abs(poles.real).max(initial=1.0)))
    inside = poles.real[f <= top]
    right = max(float(inside.max(initial=0.0)), 1e-9)
    left = -max(2.0 * right, 0.08 * top * 2.0 * np.pi)
    slow = inside[inside > left]
    return left, 1.15 * max(right, -0.12 * float(slow.min(initial=left))), top


def _damping_lines(ax: Axes, left: float, top: float) -> None:
    """Draw lines of constant damping ratio, each named on itself where there is room."""
    ends = []
    for ratio in _DAMPINGS:
        slope = 2.0 * np.pi * ratio / np.sqrt(1.0 - ratio**2)  # −real part over frequency
        end = min(top, -left / slope)
        ax.plot([0.0, -slope * end], [0.0, end], color="#999999", linewidth=0.7, linestyle=(0, (4, 3)), zorder=1)
        ends.append((-slope * end, end))
    name_lines(ax, (0.0, 0.0), ends, [f"ζ = {ratio:g}" for ratio in _DAMPINGS])


def _ends(ax: Axes, result: FeedbackResult, top: float, *, named: bool) -> None:
    """Mark the open-loop poles, and where poles stand on the border with the gain that puts them there."""
    if result.locus.gains[0] <= 0.0 <= result.locus.gains[-1]:
        poles = _open_poles(result)
        f = damped_frequency_hz(poles)
        ax.plot(poles.real, f, "x", color="#222222", markersize=6.0, zorder=5, label="g = 0")
    ends = [c for c in _marked(result) if np.isfinite(c.frequency_hz) and c.frequency_hz <= top]
    words = {True: "on the border", False: "there, others beyond"}
    for c in ends:
        stable = 0 in (c.unstable_below, c.unstable_above)
        style: dict[str, Any] = {"color": COLOURS[1], "markerfacecolor": COLOURS[1] if stable else "white"}
        ax.plot(0.0, c.frequency_hz, "o", markersize=6.0, zorder=5, label=words.pop(stable, None), **style)
    if named:
        name_points(ax, [(0.0, c.frequency_hz) for c in ends], [f"g = {c.gain:.4g}" for c in ends])
    if named:
        ax.legend(**{**ABOVE, "fontsize": 8.0}, ncols=4, columnspacing=1.0, handletextpad=0.3)


def _open_poles(result: FeedbackResult) -> Any:  # noqa: ANN401 - an array of complex numbers
    return continuous(result.plant.poles, result.plant.dt)


def _marked(result: FeedbackResult) -> list[Any]:
    """Return the crossings with gains inside the picture's range."""
    low, high = result.locus.gains[0], result.locus.gains[-1]
    return [c for c in result.crossings if low <= c.gain <= high]


# -- growth ------------------------------------------------------------------------------------


def gain_label(result: FeedbackResult) -> str:
    """Return "gain g" with its unit.

    Args:
        result: of the analysis.
    """
    top, below = result.target_unit, result.source_unit
    if not (top and below) or top == below:
        return f"gain g of {result.source.rpartition('.')[2]}"
    return f"gain g [{top} per {below}]"


def draw_growth(ax: Axes, result: FeedbackResult) -> None:
    """Draw the growth rate of the slowest pole over the gain, stable intervals shaded.

    Args:
        ax: where.
        result: of the analysis.
    """
    locus = result.locus
    ax.plot(locus.gains, locus.growth, color=COLOURS[0], linewidth=1.6, label="slowest pole")
    swinging = np.where(np.abs(locus.poles.imag) > np.abs(locus.poles.real), locus.poles.real, -np.inf).max(axis=1)
    if np.any(np.isfinite(swinging)) and not np.allclose(swinging, locus.growth):
        shown = np.where(np.isfinite(swinging), swinging, np.nan)
        ax.plot(locus.gains, shown, color=COLOURS[4], linewidth=1.3, linestyle="--", label="slowest oscillation")
    ax.axhline(0.0, color="#444444", linewidth=0.9)
    low, high = float(locus.gains[0]), float(locus.gains[-1])
    for number, (a, b) in enumerate(result.stable_gains):
        ax.axvspan(
            max(a, low), min(b, high), color=_STABLE, alpha=0.15, linewidth=0.0, label=None if number else "stable"
        )
    marked = [(end, 0.0, f"{end:.5g}") for pair in result.stable_gains for end in pair if low < end < high]
    for end, zero, _ in marked:
        ax.plot(end, zero, "o", color=COLOURS[1], markersize=5.0, zorder=5)
    best = [f for f in result.fastest if f is not None and low <= f.gain <= high]
    for f in best:
        ax.plot(f.gain, f.growth, "D", color=COLOURS[5], markersize=5.5, zorder=5)
    marked += [(f.gain, f.growth, f"decays fastest: {f.gain:.4g}") for f in best]
    name_points(ax, [(x, y) for x, y, _ in marked], [text for *_, text in marked])
    finite = locus.growth[np.isfinite(locus.growth)]
    bottom = min(float(np.min(np.where(np.isfinite(swinging), swinging, 0.0))), float(finite.min(initial=0.0)))
    top = float(finite.max(initial=0.0))
    # Away from the stable gains poles may grow fast; the picture is about where they do not.
    top = min(top, 4.0 * abs(bottom)) if result.stable_gains and bottom < 0.0 else top
    width = max(top - bottom, 1e-12)
    ax.set_ylim(bottom - 0.15 * width, top + 0.1 * width)
    ax.set_xlim(low, high)
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.set(xlabel=gain_label(result), ylabel="growth rate [1/s]")
    ax.legend(**ABOVE, ncols=3)


def _table(ax: Axes, result: FeedbackResult) -> None:
    """Write the crossings."""
    ax.axis("off")
    rows = [
        [f"{c.gain:.5g}", _hertz(c.frequency_hz), f"{c.real:.5g}", f"{c.unstable_below} / {c.unstable_above}"]
        for c in sorted(sorted(result.crossings, key=lambda c: abs(c.gain))[:_ROWS], key=lambda c: c.gain)
    ]
    if not rows:
        ax.text(0.0, 0.9, "no pole reaches the border of stability", fontsize=9.0)
        return
    written(ax, ["gain", "f [Hz]", "G = 1/gain", "unstable below / above"], rows)
    if len(result.crossings) > _ROWS:
        ax.text(0.0, 0.0, f"… and {len(result.crossings) - _ROWS} with larger gains", fontsize=8.5)


def _hertz(frequency: float) -> str:
    return f"{frequency:.4g}" if np.isfinite(frequency) else "∞"
