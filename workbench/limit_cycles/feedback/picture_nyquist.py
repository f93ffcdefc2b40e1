"""Nyquist pictures of a feedback: G(jω) by bands, and what the nonlinear block sees for some gains."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.errors import InputError
from workbench.loops.nyquist.picture import draw_plane
from workbench.show.figure import COLOURS, LEGEND, panels
from workbench.show.labels import name_points

if TYPE_CHECKING:
    from workbench.limit_cycles.feedback.gains import CriticalGain
    from workbench.limit_cycles.feedback.result import FeedbackResult
    from workbench.loops.nyquist.result import NyquistResult

__all__ = ["draw_curve", "plot_cycles", "plot_nyquist"]

_VIEWS = 4
_GAP = 1.15  # ratio of frequencies above which two groups of crossings are looked at apart


def plot_nyquist(result: FeedbackResult) -> Figure:
    """Draw G(jω) as a whole and, in bands, around its crossings of the real axis.

    Args:
        result: of the analysis.
    """
    title = f"{result.model}: G(jω) from {result.target} to {result.source}"
    figure, grid = panels(2, 2, title=title, width=10.0, height=3.6)
    axes = [ax for row in grid for ax in row]
    bands = _bands(result)
    draw_curve(axes[0], result, band=None, marks="")
    for ax, band in zip(axes[1:], bands, strict=False):
        draw_curve(ax, result, band=band, marks="all")
    for ax in axes[1 + len(bands) :]:
        ax.axis("off")
    return figure


def plot_cycles(result: FeedbackResult) -> Figure:
    """Draw what the nonlinear block sees, from its output to its input, for four gains over the stable interval.

    Args:
        result: of the analysis.

    Raises:
        InputError: no gain was looked at with a block.
    """
    if not result.cycles:
        raise InputError(f"{result.model}: no nonlinear block was analysed, so there are no cycles to draw")
    if all(left.curve is None for left in result.cycles):
        raise InputError(f"{result.model}: the file does not hold the curves of the cycles; run feedback again")
    title = f"{result.model}: what {result.block} sees, with feedback of {result.source}"
    figure, grid = panels(2, 2, title=title, width=10.0, height=3.6)
    curves = [(left, left.curve) for left in result.cycles if left.curve is not None]
    chosen = [curves[i] for i in np.unique(np.linspace(0, len(curves) - 1, _VIEWS).astype(int)).tolist()]
    axes = [ax for row in grid for ax in row]
    for ax, (left, curve) in zip(axes, chosen, strict=False):
        draw_plane(ax, curve, reach=_reach(curve))
        ax.set_title(f"gain {left.gain:.4g}: {left.words}", loc="left", fontsize=9.0)
    axes[0].legend(**{**LEGEND, "loc": "best"})
    for ax in axes[len(chosen) :]:
        ax.axis("off")
    return figure


def _reach(curve: NyquistResult) -> float | None:
    """Return the size of the farthest crossing, or of the beginning of −1/N if that is not far beyond."""
    real = [abs(c.real) for c in curve.crossings if np.isfinite(c.real)]
    begin = np.abs(curve.minus_inverse[np.isfinite(curve.minus_inverse)]).min(initial=np.inf)
    if not real:
        return None
    return max(*real, 1.2 * float(begin)) if begin < 10.0 * max(real) else max(real)


def _bands(result: FeedbackResult) -> list[tuple[float, float]]:
    """Return up to three bands: below, around and above the crossings that bound the stable gains."""
    f = result.frequency_hz
    ends = [g for pair in result.stable_gains for g in pair]
    main = [c.frequency_hz for c in result.crossings if c.gain in ends and 0.0 < c.frequency_hz < np.inf]
    every = [c.frequency_hz for c in result.crossings if 0.0 < c.frequency_hz < np.inf]
    main = main or sorted(c.frequency_hz for c in _nearest(result) if 0.0 < c.frequency_hz < np.inf)
    if not main:
        return [(float(f[0]), float(f[-1]))]
    low, high = min(main) / _GAP, max(main) * _GAP
    bands = [(low, high)]
    if any(x < low for x in every):
        bands.insert(0, (float(f[0]), low))
    if any(x > high for x in every):
        bands.append((high, float(f[-1])))
    return bands


def _nearest(result: FeedbackResult) -> list[CriticalGain]:
    return sorted(result.crossings, key=lambda c: abs(c.gain))[:3]


def draw_curve(ax: Axes, result: FeedbackResult, *, band: tuple[float, float] | None, marks: str) -> None:
    """Draw G(jω) with its crossings of the real axis; where it crosses between them all poles are stable.

    Args:
        ax: where.
        result: of the analysis.
        band: frequencies drawn [Hz]; None: all.
        marks: "": no numbers; "shown": around the ends of the stable gains; "all".
    """
    f, value = result.frequency_hz, np.asarray(result.response)
    value = np.where(np.isfinite(value), value, np.nan)
    inside = np.ones(len(f), dtype=bool) if band is None else (f >= band[0]) & (f <= band[1])
    ax.plot(value[inside].real, value[inside].imag, color=COLOURS[0], linewidth=1.2, label="G(jω)")
    ax.axhline(0.0, color="#888888", linewidth=0.7)
    ax.axvline(0.0, color="#888888", linewidth=0.7)
    limits = (0.0, np.inf) if band is None else band
    shown = [c for c in result.crossings if limits[0] <= c.frequency_hz <= limits[1] and np.isfinite(c.real)]
    _stable_axis(ax, result)
    _frame(ax, result, shown, value[inside], marks)
    _marks(ax, result, shown, marks)
    low, high = (float(f[inside][0]), float(f[inside][-1])) if inside.any() else limits
    ax.set_title(f"{low:.3g} … {high:.3g} Hz", loc="left", fontsize=9.5)
    unit = f" [{result.source_unit} per {result.target_unit}]" if _mixed(result) else ""
    ax.set(xlabel=f"real part{unit}", ylabel=f"imaginary part{unit}")


def _mixed(result: FeedbackResult) -> bool:
    return bool(result.source_unit and result.target_unit) and result.source_unit != result.target_unit


def _bounds(result: FeedbackResult, c: CriticalGain) -> bool:
    return any(c.gain in pair for pair in result.stable_gains) or not result.stable_gains


def _stable_axis(ax: Axes, result: FeedbackResult) -> None:
    """Draw the part of the real axis where 1/g lies for stable gains."""
    for number, (low, high) in enumerate(result.stable_gains):
        if low < 0.0 < high or not (np.isfinite(low) and np.isfinite(high)) or 0.0 in (low, high):
            continue
        label = None if number else "1/g, g stable"
        ax.plot([1.0 / high, 1.0 / low], [0.0, 0.0], color=COLOURS[2], linewidth=5.0, alpha=0.45, zorder=2, label=label)
        ax.legend(**{**LEGEND, "loc": "best"})


def _marks(ax: Axes, result: FeedbackResult, shown: list[CriticalGain], marks: str) -> None:
    """Mark the crossings that are seen, and name those that are asked for, the ends of the stable gains first."""
    left, right = ax.get_xlim()
    inside = sorted((c for c in shown if left < c.real < right), key=lambda c: (not _bounds(result, c), -abs(c.real)))
    named = [c for c in inside if marks == "all" or (marks == "shown" and _bounds(result, c))]
    for c in inside:
        stable = 0 in (c.unstable_below, c.unstable_above)
        style: dict[str, Any] = {"color": COLOURS[1], "markerfacecolor": COLOURS[1] if stable else "white"}
        ax.plot(c.real, 0.0, "o", markersize=5.5 if c in named else 3.5, zorder=5, **style)
    if marks == "shown" and len(named) < len(inside):
        ax.plot([], [], "o", color=COLOURS[1], markerfacecolor="white", markersize=3.5, label="other crossings")
        ax.legend(**{**LEGEND, "loc": "best"})
    name_points(ax, [(c.real, 0.0) for c in named], [f"{c.real:.4g}\n{c.frequency_hz:.4g} Hz" for c in named])


def _frame(ax: Axes, result: FeedbackResult, shown: list[CriticalGain], value: Any, marks: str) -> None:  # noqa: ANN401
    """Choose what part of the plane is seen."""
    chosen = [abs(c.real) for c in shown if marks == "all" or _bounds(result, c)]
    if not marks or not chosen:
        return
    reach = max(chosen)
    left = 1.35 * reach if any(c.real < 0.0 for c in shown if abs(c.real) <= reach) else 0.35 * reach
    right = 1.35 * reach if any(0.0 < c.real <= reach for c in shown) else 0.45 * reach
    tall = min(float(np.nanmax(np.abs(value.imag))) * 1.1, 0.8 * reach) if len(value) else reach
    ax.set_xlim(-left, right)
    ax.set_ylim(-tall, tall)
