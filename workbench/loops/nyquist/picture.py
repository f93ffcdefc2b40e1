"""Pictures of Nyquist curves with their crossings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.interpolate import Akima1DInterpolator

from workbench.core.values.arrays import Complex
from workbench.show.figure import COLOURS, LEGEND, panels, written
from workbench.show.labels import name_points

if TYPE_CHECKING:
    from workbench.loops.nyquist.absolute import AbsoluteStability
    from workbench.loops.nyquist.result import Crossing, NyquistResult

__all__ = ["draw_absolute", "draw_plane", "plot_nyquist"]

_ROWS = 10  # of the table
_COLUMNS = ("", "f [Hz]", "real part", "gain", "amplitude", "poles at less / more gain", "stable")
_APART = 6.0  # a crossing so much nearer to the origin than the farthest gets a picture of its own
_BETWEEN = 6  # points drawn between two of the curve
_FARTHER = 3.0  # times: so far the plane grows to show a bound
_ARROWS = 2  # along the curve


def plot_nyquist(result: NyquistResult) -> Figure:
    """Draw L(jω) with −1/N(A): whole, around the crossings and around the nearest; and the table of crossings.

    Args:
        result: curve and crossings.
    """
    reaches = _reaches(result)
    rows = min(max(len(result.crossings), 1), _ROWS)
    ratios = (1.5, 0.24 + 0.085 * rows)
    title = f"{result.name}: Nyquist curve"
    figure, grid = panels(2, len(reaches), title=title, width=4.6 * len(reaches), height=2.5, ratios=ratios)
    for ax, reach in zip(grid[0], reaches, strict=True):
        draw_plane(ax, result, reach=reach)
    words = ("whole curve", "around the crossings", "around the nearest crossing")
    for ax, text in zip(grid[0], words, strict=False):
        ax.set_title(text, loc="left", fontsize=9.0, color="#555555")
    grid[0][0].legend(**{**LEGEND, "loc": "best"})
    _table(_below(grid[1]), result.crossings)
    return figure


def _below(axes: list[Axes]) -> Axes:
    """Return one panel in place of a row of them."""
    first, *others = axes
    for ax in others:
        ax.remove()
    spec = first.get_subplotspec()
    if spec is not None:
        first.set_subplotspec(spec.get_gridspec()[1, :])
    first.axis("off")
    return first


def _reaches(result: NyquistResult) -> list[float | None]:
    """Return how far each picture goes: the whole curve, all crossings, the nearest one where it is much nearer."""
    sizes = sorted(abs(complex(c.real, c.imag)) for c in result.crossings if np.isfinite(c.real))
    if not sizes:
        return [None, 1.0]
    near = [sizes[0]] if sizes[-1] > _APART * sizes[0] > 0.0 else []
    return [None, sizes[-1], *near]


def draw_plane(ax: Axes, result: NyquistResult, *, reach: float | None) -> None:
    """Draw the curve in the complex plane; arrows show where frequency and amplitude rise.

    Args:
        ax: where.
        result: curve and crossings.
        reach: largest size shown; None: the whole curve, as far as 98 % of it go.
    """
    value = np.asarray(result.response, dtype=np.complex128)
    value = np.where(np.isfinite(value), value, np.nan)
    curve = _smooth(value)
    ax.axhline(0.0, color="#888888", linewidth=0.7)
    ax.axvline(0.0, color="#888888", linewidth=0.7)
    ax.plot(curve.real, curve.imag, color=COLOURS[0], linewidth=1.2, label="L(jω)")
    if result.block:
        inverse = np.asarray(result.minus_inverse, dtype=np.complex128)
        ax.plot(inverse.real, inverse.imag, color=COLOURS[1], linewidth=1.6, label="−1/N(A)", zorder=3)
    size = reach if reach is not None else float(np.nanquantile(np.abs(value), 0.98)) / 1.2
    if size > 0.0:
        ax.set_xlim(-1.25 * size, (0.35 if reach is not None else 1.25) * size)
        ax.set_ylim(-0.8 * size, 0.8 * size)
    _directions(ax, curve, COLOURS[0], _ARROWS)
    if result.block:
        _directions(ax, np.asarray(result.minus_inverse, dtype=np.complex128), COLOURS[1], 1)
    shown = [(n, c) for n, c in enumerate(result.crossings, 1) if np.isfinite(c.real)]
    for _, c in shown:
        _mark(ax, c)
    if reach is not None:
        _names(ax, shown, result.crossings)
    ax.set(xlabel="real part", ylabel="imaginary part")
    ax.xaxis.set_major_locator(MaxNLocator(6))


def draw_absolute(ax: Axes, result: AbsoluteStability) -> None:
    """Draw what the circle criterion keeps L(jω) away from, and where on the real axis Popov's ends.

    Args:
        ax: the complex plane; it grows a little where that shows a bound.
        result: the sectors that are proven stable.
    """
    if result.refused:
        return
    (left_end, right_end), height = ax.get_xlim(), ax.get_ylim()
    bounds = [-1.0 / k for k in (result.circle, result.popov) if k]
    near = [bound for bound in bounds if bound > _FARTHER * left_end]
    left_end = min([left_end, *(1.1 * bound for bound in near)])
    style: dict[str, Any] = {"color": COLOURS[2], "linestyle": "--", "linewidth": 1.1, "zorder": 2}
    if result.circle is not None:
        name = f"circle criterion, slopes {result.low:.4g} … {result.circle:.4g}"
        right = -1.0 / result.circle if result.circle else -math.inf
        if result.low == 0.0 and right > left_end:
            ax.axvline(right, label=name, **style)
        elif result.low != 0.0 and math.isfinite(right):
            left, turn = -1.0 / result.low, np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 361))
            disc = 0.5 * (left + right) + 0.5 * (right - left) * turn
            ax.plot(disc.real, disc.imag, label=name, **style)
    if result.popov and -1.0 / result.popov > left_end:
        name = f"Popov, slopes {result.low:.4g} … {result.popov:.4g}"
        ax.plot(-1.0 / result.popov, 0.0, "|", color=COLOURS[3], markersize=22.0, markeredgewidth=2.0, label=name)
    ax.set(xlim=(left_end, right_end), ylim=height)


def _smooth(value: Complex) -> Complex:
    """Return a curve through all its points without corners; it is computed finely enough to have none."""
    known = value[np.isfinite(value)]
    apart = np.append(True, np.abs(np.diff(known)) > 0.0)
    known = known[apart]
    if len(known) < 5 or len(known) < int(np.isfinite(value).sum() // 2):
        return value
    # The square root of the chord keeps the interpolation from overshooting where points lie unevenly.
    along = np.append(0.0, np.cumsum(np.sqrt(np.abs(np.diff(known)))))
    fine = np.interp(np.arange((len(known) - 1) * _BETWEEN + 1) / _BETWEEN, np.arange(len(known)), along)
    parts = (Akima1DInterpolator(along, x)(fine) for x in (known.real, known.imag))
    real, imag = parts
    return np.asarray(real + 1j * imag, dtype=np.complex128)


def _directions(ax: Axes, curve: Complex, colour: str, count: int) -> None:
    """Draw arrows in the direction in which a curve runs, spread over the part that is shown."""
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    x, y = (curve.real - left) / (right - left), (curve.imag - low) / (high - low)
    inside = (x > 0.04) & (x < 0.96) & (y > 0.04) & (y < 0.96)
    step = np.where(inside[1:] & inside[:-1], np.hypot(np.diff(x), np.diff(y)), 0.0)
    travelled = np.cumsum(step)
    if not len(travelled) or travelled[-1] < 0.2:
        return
    for share in (np.arange(count) + 0.5) / count:
        k = int(np.searchsorted(travelled, share * travelled[-1]))
        begin, end = curve[k], curve[min(k + 1, len(curve) - 1)]
        if begin != end:
            arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.0, "mutation_scale": 11.0}
            ax.annotate("", (end.real, end.imag), (begin.real, begin.imag), arrowprops=arrow, zorder=4)


def _mark(ax: Axes, c: Crossing) -> None:
    filled = "#444444" if c.stable else "white"
    ax.plot(c.real, c.imag, "o", markersize=5.5, zorder=5, color="#444444", markerfacecolor=filled)


def _names(ax: Axes, shown: Sequence[tuple[int, Crossing]], every: Sequence[Crossing]) -> None:
    """Write number and frequency beside each crossing, the stable ones first."""
    ordered = sorted(shown, key=lambda one: (not one[1].stable, -abs(complex(one[1].real, one[1].imag))))
    names = [f"{number}: {c.frequency_hz:.4g} Hz" for number, c in ordered]
    if any(c.stable is not None for c in every):
        names = [f"{name}, stable" if c.stable else name for name, (_, c) in zip(names, ordered, strict=True)]
    name_points(ax, [(c.real, c.imag) for _, c in ordered], names)


def _table(ax: Axes, crossings: tuple[Crossing, ...]) -> None:
    """Write the crossings; filled circles in the plane are the stable ones."""
    rows = [_row(number, c) for number, c in enumerate(crossings[:_ROWS], 1)]
    if not rows:
        ax.text(0.0, 0.9, "no crossing of the negative real axis", fontsize=9.0)
        return
    written(ax, _COLUMNS, rows)
    if len(crossings) > _ROWS:
        ax.text(1.0, 0.0, f"… and {len(crossings) - _ROWS} more", fontsize=8.5, ha="right")


def _row(number: int, c: Crossing) -> list[str]:
    stable = "" if c.stable is None else "yes" if c.stable else "no"
    amplitude = "" if c.amplitude is None else f"{c.amplitude:.4g}"
    place = f"{c.real:.4g}" if not c.imag else f"{c.real:.4g} {c.imag:+.4g}j"
    return [
        str(number), f"{c.frequency_hz:.5g}", place, f"{c.gain:.4g}", amplitude,
        f"{c.unstable_below} / {c.unstable_above}", stable,
    ]  # fmt: skip
