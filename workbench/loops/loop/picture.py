"""Pictures of a loop: Bode, Nyquist, sensitivities."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import NullFormatter

from workbench.core.values.decibels import decibels
from workbench.core.values.response import Response
from workbench.show.bode import Degrees, draw_response, plain_decades
from workbench.show.figure import COLOURS, LEGEND, LINE, panels

if TYPE_CHECKING:
    from workbench.core.values.arrays import Complex, Floats
    from workbench.core.values.margins import Margins
    from workbench.loops.loop.result import LoopResult

__all__ = ["plot_loop"]

_REACH = 2.6  # half the side of the Nyquist picture
_DEEPEST_DB, _HIGHEST_DB = -60.0, 60.0
_GREY = "#555555"


@dataclass(frozen=True, eq=False)
class _DrawnCurve:
    """One curve of L."""

    label: str
    frequency: Floats
    value: Complex
    margins: Margins
    style: dict[str, Any]


def plot_loop(result: LoopResult) -> Figure:
    """Draw L over frequency with its margins, |S| and |T|, and the Nyquist picture around -1 with the disk margin.

    Lines: linear loop; circles: broken loop; squares: injected; one colour per amplitude. Black dots: gain
    crossovers; black bars: gain margins; both of the linear loop, or of the first measured one where there is none.

    Args:
        result: what to draw.
    """
    shown = list(_shown(result))
    figure, grid = panels(2, 2, title=f"{result.system}: loop opened at {result.place.label}", width=11.0, height=3.3)
    for s in shown:
        _curve(grid, s)
    _bode(grid[0][0], grid[1][0], shown)
    _sensitivities(grid[1][1], shown)
    _nyquist(grid[0][1], shown)
    figure.supxlabel("\n".join(_words(shown)), x=0.01, ha="left", fontsize=8.5)
    return figure


def _shown(result: LoopResult) -> Iterator[_DrawnCurve]:
    if result.linear is not None:
        f = result.frequencies(600)
        style = {"color": COLOURS[-1], "linewidth": 1.4}
        yield _DrawnCurve("linear", f, result.linear.response(f), result.linear.margins, style)
    unit = f" {result.place.unit}" if result.place.unit and result.place.unit != "1" else ""
    amplitudes = sorted({c.amplitude for c in result.curves})
    for c in result.curves:
        style = {
            "color": COLOURS[amplitudes.index(c.amplitude) % (len(COLOURS) - 1)],
            "marker": "o" if c.how == "break" else "s",
            "linestyle": "-" if c.how == "break" else "--",
            "markersize": 3.5,
            "markerfacecolor": "white",
            "linewidth": 1.0,
        }
        yield _DrawnCurve(f"{c.how}, {c.amplitude:g}{unit}", c.frequency_hz, c.value, c.margins, style)


def _curve(grid: list[list[Axes]], s: _DrawnCurve) -> None:
    if not len(s.frequency):
        return
    gain, phase, nyquist, sensitivity = grid[0][0], grid[1][0], grid[0][1], grid[1][1]
    draw_response(gain, phase, Response(s.frequency, s.value), label=s.label, **s.style)
    nyquist.plot(s.value.real, s.value.imag, **s.style)
    plain = {**s.style, "marker": ""}
    sensitivity.plot(s.frequency, decibels(1.0 / (1.0 + s.value)), **plain)
    sensitivity.plot(s.frequency, decibels(s.value / (1.0 + s.value)), **{**plain, "linestyle": ":"})


def _bode(gain: Axes, phase: Axes, shown: list[_DrawnCurve]) -> None:
    gain.set_ylabel("|L| [dB]")
    phase.set_ylabel("arg L [deg]")
    gain.axhline(0.0, color=_GREY, linewidth=0.8)
    top, bottom = _span([decibels(s.value) for s in shown])
    gain.set_ylim(max(bottom, _DEEPEST_DB), min(top, _HIGHEST_DB))
    phase.yaxis.set_major_locator(Degrees())
    low, high = phase.get_ylim()
    for turn in range(math.floor(low / 360.0) - 1, math.ceil(high / 360.0) + 1):
        if low <= 180.0 + 360.0 * turn <= high:
            phase.axhline(180.0 + 360.0 * turn, color=_GREY, linewidth=0.8)
    for s in shown[:1]:
        for g in s.margins.gain_crossovers:
            phase.axvline(g.frequency_hz, color=_GREY, linestyle=":", linewidth=1.1)
            gain.plot(g.frequency_hz, 0.0, "o", color="black", markersize=5.0)
        for p in s.margins.phase_crossovers:
            if 0.0 < p.frequency_hz < math.inf:
                gain.plot([p.frequency_hz] * 2, [0.0, -p.db], color="black", linewidth=2.0)
                phase.axvline(p.frequency_hz, color=_GREY, linestyle="--", linewidth=1.1)
    _legend(gain, phase, shown)
    for ax in (gain, phase):
        _frequency(ax, shown)


def _legend(gain: Axes, phase: Axes, shown: list[_DrawnCurve]) -> None:
    """Name the curves in one panel, and what marks their margins in the other, as far as there are any."""
    if gain.get_legend_handles_labels()[0]:
        gain.legend(**LEGEND)
    marks: list[Line2D] = []
    for s in shown[:1]:
        if s.margins.gain_crossovers:
            marks.append(Line2D([], [], color=_GREY, linestyle=":", linewidth=1.1, label="gain crossover"))
        if any(0.0 < p.frequency_hz < math.inf for p in s.margins.phase_crossovers):
            marks.append(Line2D([], [], color=_GREY, linestyle="--", linewidth=1.1, label="phase crossover"))
            what = "gain margin (above)" if s.margins.meaningful else "gain at it (above)"
            marks.append(Line2D([], [], color="black", linewidth=2.0, label=what))
    if marks:
        phase.legend(handles=marks, **LEGEND)


def _span(curves: list[Floats]) -> tuple[float, float]:
    finite = np.concatenate([c[np.isfinite(c)] for c in curves] or [np.zeros(1)])
    if not len(finite):
        return 20.0, -20.0
    return max(float(finite.max()), 0.0) + 6.0, min(float(finite.min()), 0.0) - 6.0


def _sensitivities(ax: Axes, shown: list[_DrawnCurve]) -> None:
    ax.set_ylabel("|S|, dotted |T| [dB]")
    ax.axhline(0.0, color=_GREY, linewidth=0.8)
    curves = [decibels(1.0 / (1.0 + s.value)) for s in shown]
    top, _ = _span([*curves, *(decibels(s.value / (1.0 + s.value)) for s in shown)])
    ax.set_ylim(-40.0, min(top, _HIGHEST_DB))
    _frequency(ax, shown)


def _frequency(ax: Axes, shown: list[_DrawnCurve]) -> None:
    """Show where |L| is not far from 1: three decades around the crossovers at most."""
    plain_decades(ax)
    ax.set_xlabel("frequency [Hz]")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ends = [x for s in shown if len(s.frequency) for x in (s.frequency[0], s.frequency[-1])]
    crossed = [f for s in shown for f in s.margins.crossovers_hz]
    measured = [x for s in shown if "marker" in s.style and len(s.frequency) for x in (s.frequency[0], s.frequency[-1])]
    if not ends:
        return
    near = [*(f / 30.0 for f in crossed), *(f * 30.0 for f in crossed), *(x / 1.2 for x in measured)]
    low, high = (min(near), max(near)) if near else (min(ends), max(ends))
    ax.set_xlim(max(low, min(ends)), min(max([high, *measured]), max(ends)))


def _nyquist(ax: Axes, shown: list[_DrawnCurve]) -> None:
    unit = Circle((0.0, 0.0), 1.0, fill=False, color="#999999", linestyle="--", linewidth=0.8, label="|L| = 1")
    ax.add_patch(unit)
    disk = next((s.margins.disk for s in shown if s.margins.disk is not None), None)
    if disk is not None and disk.low > 0.0 and math.isfinite(disk.high):
        # The disk of factors on L turned around: L keeps out of the disk from -1/low to -1/high.
        left, right = -1.0 / disk.low, -1.0 / disk.high
        middle = (0.5 * (left + right), 0.0)
        ax.add_patch(
            Circle(middle, 0.5 * (right - left), color=COLOURS[5], alpha=0.25, linewidth=0.0, label="disk margin")
        )
    ax.plot(-1.0, 0.0, "+", color="#CC0000", markersize=11.0, markeredgewidth=2.0, label="−1")
    handles = {text: handle for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    ax.legend(handles.values(), handles, **LEGEND)
    ax.axhline(0.0, color=_GREY, linewidth=0.7)
    ax.axvline(0.0, color=_GREY, linewidth=0.7)
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlim(-1.0 - _REACH, -1.0 + _REACH)
    ax.set_ylim(-0.6 * _REACH, 0.6 * _REACH)
    ax.set_xlabel("Re L")
    ax.set_ylabel("Im L")


# -- words ----------------------------------------------------------------------------------------


def _words(shown: list[_DrawnCurve]) -> list[str]:
    lines = [f"{s.label}: {_short(s.margins)}" for s in shown]
    return [line if len(line) <= 1.6 * LINE else f"{line[: int(1.6 * LINE)]}…" for line in lines[:8]]


def _short(m: Margins) -> str:
    if not m.meaningful:
        return m.words
    parts = [
        f"gain margin {_with(m.gain_margin_db, 'dB')}{_at(m.phase_crossover_hz)}",
        f"phase margin {_with(m.phase_margin_deg, '°')}{_at(m.gain_crossover_hz)}",
        f"delay margin {_with(m.delay_margin_s, 's')}",
    ]
    if m.gain_reduction > 0.0:
        parts.insert(1, f"gain may fall by {_with(-m.gain_reduction_db, 'dB')}")
    if m.disk is not None:
        parts.append(f"disk margin {m.disk.alpha:.3g}")
    return ", ".join(parts)


def _with(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return "infinite" if math.isinf(value) else "not seen"
    return f"{value:.4g}{'' if unit == '°' else ' '}{unit}"


def _at(frequency: float) -> str:
    return "" if math.isnan(frequency) or math.isinf(frequency) else f" at {frequency:.4g} Hz"
