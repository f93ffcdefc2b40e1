"""Pictures of a feed-forward filter: how it came about, how far it holds, and what it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator

from workbench.core.values.decibels import decibels, degrees, unwrapped
from workbench.errors import InputError, suggest
from workbench.show.bode import Degrees, plain_decades
from workbench.show.figure import ABOVE, COLOURS, LEGEND, SHADE, panels
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.core.values.arrays import Complex, Floats
    from workbench.limit_cycles.feed_forward.result import FeedForwardResult
    from workbench.limit_cycles.feed_forward.trial import Trial

__all__ = ["FIGURES", "plot_feed_forward"]

_FLOOR_DB = 120.0  # below the highest value a curve is cut off: the dip at an exact zero has no bottom
_AFTER = 45.0  # seconds after closing that are drawn

Curve = tuple[str, "Complex", str]


def plot_feed_forward(result: FeedForwardResult, *, figure: str = "overview") -> Figure:
    """Draw one of the pictures in `FIGURES`.

    Args:
        result: of the design.
        figure: its name.

    Raises:
        InputError: unknown figure, or nothing was simulated.
    """
    if figure not in FIGURES:
        raise InputError(f"figure: '{figure}' is unknown; {suggest(figure, FIGURES)}")
    return FIGURES[figure](result)


def _overview(result: FeedForwardResult) -> Figure:
    """Gain and phase of H/G and the filter, poles and zeros, and the simulation."""
    rows = 2 if result.trials else 1
    figure, grid = panels(
        rows, 2, title=f"{_title(result)}: filter of order {result.steps[-1].order}", width=11.0, height=3.4
    )
    curves = [
        ("H/G", result.exact, "-"),
        *[(_name(s.name), s.response, "--") for s in result.steps if s.name in _SHOWN],
    ]
    _gain(grid[0][0], result, curves)
    _frequency(grid[0][0], result)
    _plane(grid[0][1], result)
    if result.trials:
        _histories(grid[1][0], result, [t for t in result.trials if not t.divergence], zoom=True)
        _target(grid[1][1], result)
    return figure


_SHOWN = ("cancelled", "low-pass")


def _reduced(result: FeedForwardResult) -> Figure:
    chosen = [s for s in result.steps if s.name in {"joined", "cancelled"}]
    curves = [("H/G", result.exact, "-"), *[(f"{s.name}, order {s.order}", s.response, "--") for s in chosen]]
    return _bode(result, curves, "filter before and after the reduction")


def _compensation(result: FeedForwardResult) -> Figure:
    step = next(s for s in reversed(result.steps) if s.name in {"cancelled", "joined", "reduced"})
    curves = [("H", result.h, "-"), (f"G·F, order {step.order}", result.g * step.response, "--")]
    what = "what the filter brings to the block's input, before the poles are mirrored"
    return _bode(result, curves, what, name="gain [dB]")


def _mirrored(result: FeedForwardResult) -> Figure:
    chosen = [s for s in result.steps if s.name in {"cancelled", "mirrored", "low-pass"}]
    styles = ("-", "--", "-")
    curves = [(_name(s.name), s.response, d) for s, d in zip(chosen, styles, strict=False)]
    return _bode(result, curves, "filter before and after its unstable poles are mirrored")


def _error(result: FeedForwardResult) -> Figure:
    chosen = [s for s in result.steps if s.name in {"cancelled", "mirrored", "low-pass"}]
    with np.errstate(all="ignore"):
        curves = [(_name(s.name), result.g * s.response / result.h - 1.0, "-") for s in chosen]
    figure, axes = _bode_axes(result, "error G·F/H − 1; above 0 dB the block acts more than without filter")
    _gain(axes[0], result, curves, name="gain of the error [dB]")
    axes[0].axhline(0.0, color="#666666", linewidth=0.9)
    for number, (_, value, dash) in enumerate(curves):
        if number:  # that of the smallest error is noise in its turns
            axes[1].plot(result.frequency_hz, _wrapped(value), dash, **_line(number, dash))
    _shade(axes[1], result)
    axes[1].set(ylabel="phase of the error [deg]", ylim=(-190.0, 190.0))
    axes[1].yaxis.set_major_locator(Degrees())
    _frequency(axes[1], result)
    return figure


def _simulated(result: FeedForwardResult) -> Figure:
    if not result.trials:
        raise InputError("figure: nothing was simulated; give the inputs that start the motion")
    trials = result.trials
    figure, grid = panels(len(trials), 2, title=f"{_title(result)}: simulated", width=11.0, height=2.2)
    for number, (row, trial) in enumerate(zip(grid, trials, strict=True)):
        colour = COLOURS[number % len(COLOURS)]
        _history(row[0], result, trial, colour, whole=True)
        _history(row[1], result, trial, colour, whole=False)
        row[0].set_title(trial.name + (", within the limits" if trial.limited else ""), loc="left")
    for ax in grid[-1]:
        ax.set_xlabel("time [s]")
    return figure


def _poles(result: FeedForwardResult) -> Figure:
    figure, grid = panels(1, 1, title=f"{_title(result)}: poles and zeros of the filter", width=8.0, height=4.2)
    _plane(grid[0][0], result)
    return figure


# -- parts ----------------------------------------------------------------------------------------


def _title(result: FeedForwardResult) -> str:
    return f"{result.model}, {result.output} → {result.target}"


def _name(step: str) -> str:
    return {
        "cancelled": "reduced and cancelled", "mirrored": "poles mirrored", "low-pass": "mirrored, sign, low-pass",
    }.get(step, step)  # fmt: skip


def _bode(result: FeedForwardResult, curves: list[Curve], what: str, *, name: str = "") -> Figure:
    figure, axes = _bode_axes(result, what)
    _gain(axes[0], result, curves, name=name)
    _phase(axes[1], result, curves)
    _frequency(axes[1], result)
    return figure


def _bode_axes(result: FeedForwardResult, what: str) -> tuple[Figure, list[Axes]]:
    figure, grid = panels(2, 1, title=f"{_title(result)}\n{what}", height=2.9, width=8.0, sharex="all")
    return figure, [grid[0][0], grid[1][0]]


def _gain(ax: Axes, result: FeedForwardResult, curves: list[Curve], *, name: str = "") -> None:
    into, out = result.filter_units
    name = name or (f"gain [dB of {out}/({into})]" if into and out else "gain [dB]")
    top = -np.inf
    for number, (text, value, dash) in enumerate(curves):
        db = decibels(value)
        top = max(top, float(np.max(db[np.isfinite(db)], initial=-np.inf)))
        ax.plot(result.frequency_hz, np.maximum(db, top - _FLOOR_DB), dash, label=text, **_line(number, dash))
    _shade(ax, result)
    ax.set_ylabel(name)
    ax.legend(**{**LEGEND, "loc": "best"})


def _phase(ax: Axes, result: FeedForwardResult, curves: list[Curve]) -> None:
    """Draw phases without jumps, the others as near to the first as whole turns allow, in the band."""
    inside = (result.frequency_hz >= result.band[0]) & (result.frequency_hz <= result.band[1])
    first: Floats | None = None
    for number, (_, value, dash) in enumerate(curves):
        angle = unwrapped(value)
        first = angle - 360.0 * np.round(angle[0] / 360.0) if first is None else first
        angle -= 360.0 * np.round(np.median((angle - first)[inside]) / 360.0)
        ax.plot(result.frequency_hz, angle, dash, **_line(number, dash))
    _shade(ax, result)
    ax.set(ylabel="phase [deg]")
    ax.yaxis.set_major_locator(Degrees())


def _wrapped(value: Complex) -> Floats:
    """Return the phase between −180° and 180°, broken where it jumps from one to the other."""
    angle = degrees(value)
    angle[1:][np.abs(np.diff(angle)) > 270.0] = np.nan
    return angle


def _line(number: int, dash: str) -> dict[str, Any]:
    return {"color": COLOURS[number % len(COLOURS)], "linewidth": 2.2 if number == 0 else 1.4 if dash == "-" else 1.5}


def _shade(ax: Axes, result: FeedForwardResult) -> None:
    """Grey out what lies outside the band."""
    ax.axvspan(result.band[1], float(result.frequency_hz[-1]) * 1.1, color=SHADE, zorder=0)


def _frequency(ax: Axes, result: FeedForwardResult) -> None:
    plain_decades(ax)
    ax.set_xlim(float(result.frequency_hz[0]), float(result.frequency_hz[-1]))
    ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    ax.xaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.set_xlabel("frequency [Hz]; grey: outside the band of the filter")


def _plane(ax: Axes, result: FeedForwardResult) -> None:
    """Draw poles and zeros above the real axis; arrows show what was mirrored."""
    made, high = result.design, 2.0 * result.band[1]
    scale = 1.0 / (2.0 * np.pi)
    for roots, marker, text in ((made.factored.zeros, "o", "zero"), (made.factored.poles, "x", "pole")):
        shown = roots[(roots.imag >= 0.0) & (np.abs(roots) * scale <= high)]
        ax.plot(shown.real * scale, shown.imag * scale, marker, color=COLOURS[0 if marker == "o" else 1],
                markerfacecolor="none", markersize=6.5, label=text)  # fmt: skip
    for p in made.mirrored[made.mirrored.imag >= 0.0].tolist():
        if abs(p) * scale > high:
            continue
        ax.plot(p.real * scale, p.imag * scale, "+", color=COLOURS[3], markersize=9.0, markeredgewidth=1.6)
        ax.annotate("", (-p.real * scale, p.imag * scale), (p.real * scale, p.imag * scale),
                    arrowprops={"arrowstyle": "->", "color": COLOURS[3], "linewidth": 1.0})  # fmt: skip
    if any(abs(p) * scale <= high for p in made.mirrored.tolist()):
        ax.plot([], [], "+", color=COLOURS[3], markersize=9.0, markeredgewidth=1.6, label="pole before it was mirrored")
    ax.axvline(0.0, color="#666666", linewidth=0.9)
    ax.axhspan(result.band[1], high, color=SHADE, zorder=0)
    ax.set_ylim(-0.02 * high, high)
    ax.set_xscale("symlog", linthresh=0.1)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.set(xlabel="real part / 2π [1/s]; grey: above the band", ylabel="imaginary part / 2π [Hz]")
    ax.legend(**ABOVE, ncols=3)


def _histories(ax: Axes, result: FeedForwardResult, trials: list[Trial], *, zoom: bool) -> None:
    """Draw the envelopes of the block's input in one panel."""
    for number, trial in enumerate(trials):
        values = np.abs(trial.signals[result.input])
        time, top = _envelope(trial.time - trial.closes_at, values)
        keep = (time >= -5.0) & (time <= _AFTER) if zoom else time >= -np.inf
        ax.semilogy(time[keep], np.maximum(top[keep], 1e-300), color=COLOURS[number % len(COLOURS)], linewidth=1.4,
                    label=trial.name)  # fmt: skip
    ax.axvline(0.0, color="#666666", linewidth=0.9)
    first = max((t.before for t in trials), default=1.0)
    if first > 0.0:  # nothing moves before a filter that closes at once
        ax.set_ylim(1e-4 * first, 5.0 * first)
    unit = trials[0].units.get(result.input) if trials else None
    ax.set(xlabel="time after closing [s]", ylabel=bracketed(f"envelope of {result.input}", unit))
    ax.legend(**ABOVE, ncols=3)


def _target(ax: Axes, result: FeedForwardResult) -> None:
    """Draw the control input just after closing."""
    for number, trial in enumerate(t for t in result.trials if not t.divergence):
        time = trial.time - trial.closes_at
        keep = (time >= -0.5) & (time <= 4.0)
        ax.plot(time[keep], trial.signals[result.target][keep], color=COLOURS[number % len(COLOURS)], linewidth=1.1,
                label=trial.name)  # fmt: skip
    unit = result.trials[0].units.get(result.target)
    ax.set(xlabel="time after closing [s]", ylabel=bracketed(result.target, unit))


def _envelope(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return the peaks of a magnitude."""
    inner = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:])) + 1
    if len(inner) < 3:
        return time, values
    return time[inner], values[inner]


def _history(ax: Axes, result: FeedForwardResult, trial: Trial, colour: str, *, whole: bool) -> None:
    """Draw the block's input: the whole run, or what follows the closing, or the last moments before an escape."""
    time, values = trial.time, trial.signals[result.input]
    end = float(time[-1])
    if not whole:
        span = min(20.0, max(1.2 * (end - trial.closes_at), 0.01)) if trial.divergence else 20.0
        keep = (time >= trial.closes_at - (0.5 if trial.divergence else 0.1) * span) & (time <= trial.closes_at + span)
        time, values = time[keep], values[keep]
    else:
        ax.set_xlim(0.0, max(float(t.time[-1]) for t in result.trials))
    ax.plot(time, values, color=colour, linewidth=0.7 if whole else 0.9)
    ax.axvline(trial.closes_at, color="#666666", linewidth=0.9)
    ax.set_ylabel(bracketed(result.input, trial.units.get(result.input)))
    limit = _height(result)
    if trial.divergence is not None:
        ax.set_ylim(-2.0 * limit, 2.0 * limit)
        if trial.divergence.escape_time is not None and not whole:
            ax.axvline(trial.divergence.escape_time, color="#B00020", linewidth=1.2, linestyle="--")
            ax.annotate(f"escapes to infinity\nat {trial.divergence.escape_time:.7g} s", (0.02, 0.05),
                        xycoords="axes fraction", fontsize=8.5, color="#B00020")  # fmt: skip
            ax.set_xlim(time[0], trial.divergence.escape_time + 0.15 * (trial.divergence.escape_time - time[0]))
            ax.ticklabel_format(useOffset=False)


def _height(result: FeedForwardResult) -> float:
    return max((float(np.max(np.abs(t.signals[result.input]))) for t in result.trials if not t.divergence), default=1.0)


FIGURES: Mapping[str, Callable[[FeedForwardResult], Figure]] = {
    "overview": _overview,
    "reduced": _reduced,
    "compensation": _compensation,
    "mirrored": _mirrored,
    "simulated": _simulated,
    "error": _error,
    "poles": _poles,
}
