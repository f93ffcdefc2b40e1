"""Pictures of modes over a parameter: the flutter diagram."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from workbench.core.values.arrays import Floats
from workbench.show.figure import COLOURS, UNSTABLE, outside, panels
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.point.modes.mode import Critical, Mode
    from workbench.point.modes.result import ModeSet, ModesResult

__all__ = ["plot_modes"]

_Style = Literal["-", "--", ":", "-."]

_MOST = 6  # labelled modes of one configuration
_STYLES: tuple[_Style, ...] = ("-", "--", ":", "-.")
_HIGHEST = 0.25  # damping ratio shown, unless all labelled modes have more
_GREY = "#b8b8b8"
_FILLS = {"unstable": "#444444", "stable": "white"}


def plot_modes(result: ModesResult) -> Figure:
    """Draw damping and natural frequency over the parameter; modes that are or become nearly unstable are named.

    Args:
        result: of the analysis.
    """
    title = f"{result.model}: modes over {result.parameter}"
    figure, grid = panels(2, 1, title=title, width=9.6, height=3.0, sharex="all")
    damping, frequency = grid[0][0], grid[1][0]
    chosen = [s.relevant(_MOST) for s in result.sets]
    handles: list[Line2D] = []
    for number, (modes, numbers) in enumerate(zip(result.sets, chosen, strict=True)):
        style = _STYLES[number % len(_STYLES)]
        if len(result.sets) > 1 or modes.label:  # else there is nothing to tell apart
            handles.append(_heading(modes, style))
        first = sum(map(len, chosen[:number]))
        colours = {n: COLOURS[(first + k) % len(COLOURS)] for k, n in enumerate(numbers)}
        handles += _one_set((damping, frequency), modes, colours, style, result.unit)
    if any(len(numbers) < len(modes.modes) for modes, numbers in zip(result.sets, chosen, strict=True)):
        handles.append(Line2D([], [], color=_GREY, linewidth=0.7, label="other modes"))
    became = {c.becomes for s in result.sets for c in s.critical}
    handles += [_mark(fill, f"becomes {word}") for word, fill in _FILLS.items() if word in became]
    _limits(damping, frequency, result, chosen)
    damping.set_ylabel("damping ratio [%]")
    frequency.set(ylabel="natural frequency [Hz]", xlabel=bracketed(result.parameter, result.unit))
    outside(figure, handles, "right upper", fontsize=8.0, frameon=False, handlelength=2.4)
    return figure


def _heading(modes: ModeSet, style: _Style) -> Line2D:
    return Line2D([], [], color="#444444", linestyle=style, linewidth=1.4, label=modes.label or "as it is")


def _mark(fill: str, text: str) -> Line2D:
    return Line2D([], [], marker="o", linestyle="", color="#444444", markerfacecolor=fill, markersize=6.0, label=text)


def _one_set(
    axes: tuple[Axes, Axes], modes: ModeSet, colours: Mapping[int, str], style: _Style, unit: str | None
) -> list[Line2D]:
    damping, frequency = axes
    for mode in modes.modes:
        if mode.number not in colours:
            _line(axes, modes, mode, {"color": _GREY, "linewidth": 0.7, "linestyle": style, "zorder": 1})
    for number, colour in colours.items():
        _line(axes, modes, modes.mode(number), {"color": colour, "linewidth": 1.7, "linestyle": style, "zorder": 3})
    for c in modes.critical:
        if c.mode in colours:
            fill = colours[c.mode] if c.becomes == "unstable" else "white"
            mark: dict[str, Any] = {"color": colours[c.mode], "markerfacecolor": fill, "markersize": 6.0, "zorder": 5}
            damping.plot(c.value, 0.0, "o", **mark)
            frequency.plot(c.value, c.frequency_hz, "o", **mark)
    if modes.first_unstable is not None and not modes.unstable_count[0]:
        _border(axes, modes.first_unstable, style, unit)
    return [
        Line2D([], [], color=colour, linestyle=style, linewidth=1.7, label=_named(modes, modes.mode(number), unit))
        for number, colour in colours.items()
    ]


def _border(axes: tuple[Axes, Axes], first: Critical, style: _Style, unit: str | None) -> None:
    """Draw the border of stability through both panels, and write its value."""
    for ax in axes:
        ax.axvline(first.value, color="#444444", linewidth=0.9, linestyle=style, zorder=2)
    text = f"{first.kind} at {first.value:.5g}{f' {unit}' if unit else ''}"
    axes[0].annotate(
        text, (first.value, 0.0), xycoords=("data", "axes fraction"), xytext=(5, 8), textcoords="offset points",
        fontsize=8.0, va="bottom", color="#444444", zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8},
    )  # fmt: skip


def _line(axes: tuple[Axes, Axes], modes: ModeSet, mode: Mode, style: dict[str, Any]) -> None:
    axes[0].plot(modes.value, 100.0 * mode.damping, **style)
    axes[1].plot(modes.value, _swinging(mode), **style)


def _swinging(mode: Mode) -> Floats:
    """Return the natural frequency where the mode swings, NaN where its pole is real [Hz]."""
    return np.asarray(np.where(mode.damped_frequency_hz > 0.0, mode.natural_frequency_hz, np.nan), dtype=np.float64)


def _named(modes: ModeSet, mode: Mode, unit: str | None) -> str:
    """Return "mode 12, 2.4 → 2.7 Hz", and where it is unstable."""
    known = mode.natural_frequency_hz[~np.isnan(mode.pole)]
    text = f"mode {mode.number}, {known[0]:.3g} → {known[-1]:.3g} Hz"
    where = _unstable_ranges(modes, mode)
    return f"{text}\nunstable {where}{f' {unit}' if unit else ''}" if where else text


def _unstable_ranges(modes: ModeSet, mode: Mode) -> str:
    """Return "156.6 … 248.9, from 323.2"; "" where the mode never is."""
    own = [c for c in modes.critical if c.mode == mode.number]
    exists = np.flatnonzero(~np.isnan(mode.pole))
    starts = bool(mode.pole.real[exists[0]] > mode.uncertain[exists[0]])
    if not own:
        return "at all values shown," if starts else ""
    parts, begin = [], None
    if own[0].becomes == "stable":
        parts.append(f"up to {own[0].value:.5g}")
        own = own[1:]
    for c in own:
        if c.becomes == "unstable":
            begin = c.value
        elif begin is not None:
            parts.append(f"{begin:.5g} … {c.value:.5g}")
            begin = None
    if begin is not None:
        parts.append(f"from {begin:.5g}")
    return ", ".join(parts)


def _limits(damping: Axes, frequency: Axes, result: ModesResult, chosen: Sequence[Sequence[int]]) -> None:
    """Show the labelled modes; what is far above them leaves the picture."""
    lines = [s.mode(n) for s, numbers in zip(result.sets, chosen, strict=True) for n in numbers]
    ratio = np.concatenate([m.damping[~np.isnan(m.damping)] for m in lines]) if lines else np.array([0.0])
    top = max(float(np.quantile(ratio, 0.9)) * 1.3, 0.01)
    top = min(top, max(_HIGHEST, 1.3 * float(ratio.min())))
    low = min(1.15 * float(ratio.min()), -0.15 * top)
    top = max(top, -0.4 * low)
    damping.set_ylim(100.0 * low, 100.0 * top)
    damping.axhspan(100.0 * low, 0.0, **UNSTABLE)
    damping.axhline(0.0, color="#444444", linewidth=0.9, zorder=2)
    damping.text(0.008, 0.03, "unstable", transform=damping.transAxes, fontsize=8.0, color="#9a4a12")
    # Every mode that the legend names is in the picture.
    highest = max((float(np.nanmax(m.natural_frequency_hz)) for m in lines), default=1.0)
    lowest = min((float(np.nanmin(m.natural_frequency_hz)) for m in lines), default=0.0)
    margin = 0.15 * max(highest - lowest, 0.2 * highest, 1e-9)
    frequency.set_ylim(max(0.0, lowest - margin), highest + margin)
    values = result.sets[0].value
    frequency.set_xlim(float(values[0]), float(values[-1]))
