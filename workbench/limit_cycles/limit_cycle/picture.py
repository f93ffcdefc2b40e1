"""Pictures of limit cycles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from workbench.limit_cycles.limit_cycle.branch import goes_on
from workbench.limit_cycles.limit_cycle.picture_free_run import draw_amplitude, draw_frequency, draw_signal
from workbench.loops.nyquist.picture import draw_absolute, draw_plane
from workbench.show.figure import COLOURS, LEGEND, panels
from workbench.show.labels import name_points

if TYPE_CHECKING:
    from workbench.limit_cycles.limit_cycle.branch import BranchPoint
    from workbench.limit_cycles.limit_cycle.result import LimitCycleResult
from collections.abc import Callable
from typing import TYPE_CHECKING

from workbench.show.figure import rows
from workbench.show.tables import behind, bracketed

if TYPE_CHECKING:
    from workbench.limit_cycles.limit_cycle.branch import Branch, BranchPoint

__all__ = ["draw_branch", "plot_branch", "plot_limit_cycle"]

_SHOWN = 4  # periods of the simulation
_OUTPUTS = 4  # panels
_MARKS = {"describing function": "o", "harmonic balance": "s", "shooting": "D", "simulation": "X"}
_SIZES = {"describing function": 11.0, "harmonic balance": 8.5, "shooting": 6.0, "simulation": 5.0}
_BIFURCATIONS = {
    "period doubling": ("s", "period doubling"),
    "Neimark-Sacker": ("D", "Neimark–Sacker"),
    "branch point": ("P", "branch point"),
}
_CONSTANT = 1e-6  # a frequency that varies by no more, relative, is drawn as constant


def plot_limit_cycle(result: LimitCycleResult) -> Figure:
    """Draw the Nyquist curve around the crossings, frequency and amplitude by every method, and the simulated motion.

    Then, where they were asked for, the cycles over each parameter, and the run from rest.

    Args:
        result: of the analysis.
    """
    title = f"{result.model}: limit cycles of the loop through {result.block}"
    names = [] if result.simulated is None else [n for n in result.simulated.amplitude if n != result.input]
    parameters = list(dict.fromkeys(b.parameter for b in result.branches))
    motions = 0 if result.simulated is None else 1
    rows = 1 + motions + len(parameters) + (0 if result.free_run is None else 2)
    figure, grid = panels(rows, 2, title=title, width=10.0, height=3.0)
    plane, methods = grid[0]
    draw_plane(plane, result.nyquist, reach=_reach(result))
    if result.absolute is not None:
        draw_absolute(plane, result.absolute)
    plane.legend(**{**LEGEND, "loc": "best"})
    _methods(methods, result)
    if motions:
        _motion(grid[1][0], result, [result.input])
        _outputs(grid[1][1], result, names[:_OUTPUTS])
    for row, parameter in zip(grid[1 + motions :], parameters, strict=False):
        _branches(row, result, parameter)
    if result.free_run is not None:
        _free_run(grid[-2:], result)
    return figure


def _branches(row: list[Axes], result: LimitCycleResult, parameter: str) -> None:
    """Draw amplitude and frequency over a parameter."""

    def amplitude(p: BranchPoint) -> float:
        return p.amplitude

    def frequency(p: BranchPoint) -> float:
        return p.frequency_hz

    for ax, of, words in zip(
        row,
        (amplitude, frequency),
        (bracketed(f"amplitude of {result.input}", result.input_unit), "frequency [Hz]"),
        strict=True,
    ):
        for branch in result.branches:
            if branch.parameter == parameter and branch.points:
                draw_branch(ax, branch, of)
        ax.set(xlabel=bracketed(parameter, result.units.get(parameter)), ylabel=words)
        low, high = ax.get_ylim()
        if high - low < _CONSTANT * abs(high):  # rounding is not a motion to look at
            ax.set_ylim(0.99 * low, 1.01 * high)
    row[0].set_title(f"cycles over {parameter}", loc="left", fontsize=9.5)
    handles, texts = row[0].get_legend_handles_labels()
    once = dict(zip(texts, handles, strict=True))
    row[0].legend(list(once.values()), list(once), **{**LEGEND, "loc": "best"})


def _free_run(rows: list[list[Axes]], result: LimitCycleResult) -> None:
    run = result.free_run
    if run is None:
        return
    (signal, spare), (frequency, amplitude) = rows
    spec = signal.get_subplotspec()
    if spec is not None:
        signal.set_subplotspec(spec.get_gridspec()[spec.rowspan.start, :])
    spare.remove()
    draw_signal(signal, run)
    signal.set_title(f"run from rest: {run.words()}", loc="left", fontsize=9.5)
    draw_frequency(frequency, run, {c.frequency_hz: f"crossing {n}" for n, c in _met(result).items()})
    draw_amplitude(amplitude, run, {c.amplitude or 0.0: f"crossing {n}" for n, c in _met(result).items()})


def _met(result: LimitCycleResult) -> Mapping[int, Any]:
    return {n: c for n, c in enumerate(result.crossings, 1) if c.amplitude is not None}


def _reach(result: LimitCycleResult) -> float | None:
    """Return the size of the farthest crossing that a limit cycle belongs to, else of any."""
    used = [c for c in result.crossings if c.amplitude is not None] or list(result.crossings)
    sizes = [abs(complex(c.real, c.imag)) for c in used if np.isfinite(c.real)]
    return max(sizes) if sizes else None


def _methods(ax: Axes, result: LimitCycleResult) -> None:
    """Mark frequency and amplitude of each cycle by each method, nested marks; hollow ones are unstable."""
    seen: set[str] = set()
    for c in result.limit_cycles:
        colour = COLOURS[(c.crossing or 0) % len(COLOURS)]
        fill = colour if c.stable and c.method in {"describing function", "simulation"} else "white"
        style: dict[str, Any] = {"color": colour, "markerfacecolor": fill, "linestyle": "", "alpha": 0.9}
        ax.plot(c.frequency_hz, c.fundamental, _MARKS[c.method], markersize=_SIZES[c.method], **style)
        seen.add(c.method)
    predicted = [c for c in result.limit_cycles if c.method == "describing function"]
    names = [
        f"{(c.crossing or 0) + 1}: {c.frequency_hz:.4g} Hz, {'stable' if c.stable else 'unstable'}" for c in predicted
    ]
    name_points(ax, [(c.frequency_hz, c.fundamental) for c in predicted], names)
    for name in [m for m in _MARKS if m in seen]:
        ax.plot([], [], _MARKS[name], color="#444444", markerfacecolor="none", linestyle="", markersize=6.0, label=name)
    ax.set(xlabel="frequency [Hz]", ylabel=bracketed(f"fundamental of {result.input}", result.input_unit))
    ax.margins(0.3)
    low, high = ax.get_ylim()
    ax.set_ylim(max(low, -0.04 * high), high)  # no amplitude is negative
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.ticklabel_format(useOffset=False)
    if seen:
        ax.legend(**{**LEGEND, "loc": "best"})
    else:
        ax.text(0.5, 0.5, "no limit cycle found", transform=ax.transAxes, ha="center", color="#666666")


def _motion(ax: Axes, result: LimitCycleResult, names: list[str]) -> None:
    """Draw the last periods of the simulation."""
    cycle = result.simulated
    if cycle is None:
        return
    shown = cycle.time >= cycle.time[-1] - _SHOWN / cycle.frequency_hz
    for number, name in enumerate(names):
        ax.plot(cycle.time[shown], cycle.values[name][shown], color=COLOURS[number % len(COLOURS)], linewidth=1.3)
    ax.set(xlabel="time [s]", ylabel=bracketed(names[0], cycle.units.get(names[0])))
    begun = "a free run" if cycle.crossing is None else "the predicted state"
    ax.set_title(f"simulated from {begun}: {cycle.frequency_hz:.5g} Hz", loc="left", fontsize=9.5)


def _outputs(ax: Axes, result: LimitCycleResult, names: list[str]) -> None:
    """Draw other variables over one period; where their units differ, each over its own amplitude."""
    cycle = result.simulated
    if cycle is None or not names:
        ax.axis("off")
        return
    begin = cycle.time[-1] - 1.0 / cycle.frequency_hz
    shown = cycle.time >= begin
    units = {cycle.units.get(name) for name in names}
    for number, name in enumerate(names):
        size, value = cycle.amplitude[name], cycle.values[name][shown]
        if len(units) > 1:
            value = (value - cycle.mean[name]) / (size or 1.0)
        text = f"{name}, ±{size:.4g}{behind(cycle.units.get(name))}"
        style: dict[str, Any] = {"color": COLOURS[number % len(COLOURS)], "linewidth": 1.3, "label": text}
        ax.plot((cycle.time[shown] - begin) * cycle.frequency_hz, value, **style)
    if len(units) > 1:
        ax.set(ylabel="(value − mean) / amplitude", yticks=[-1.0, -0.5, 0.0, 0.5, 1.0])
    else:
        ax.set_ylabel(bracketed(names[0] if len(names) == 1 else "value", units.pop()))
    ax.set_xlabel("time [periods]")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + (0.05 + 0.14 * len(names)) * (high - low))  # for the legend
    ax.legend(**{**LEGEND, "loc": "upper left", "fontsize": 8.0})


# -- pictures of limit cycles over a parameter -----------------------------------------------------


def plot_branch(branch: Branch) -> Figure:
    """Draw amplitude and frequency over the parameter; unstable parts dashed, folds and Hopf points marked.

    Args:
        branch: what was followed.
    """
    figure, (size, frequency) = rows(2, title=f"limit cycles over {branch.parameter}")
    draw_branch(size, branch, lambda p: p.amplitude)
    draw_branch(frequency, branch, lambda p: p.frequency_hz)
    size.set_ylabel("amplitude")
    frequency.set_ylabel("frequency [Hz]")
    frequency.set_xlabel(branch.parameter)
    size.legend(**LEGEND)
    return figure


def draw_branch(ax: Axes, branch: Branch, of: Callable[[BranchPoint], float]) -> None:
    """Draw one quantity of a branch over the parameter.

    Args:
        ax: where.
        branch: what was followed.
        of: the quantity.
    """
    x = np.array([p.value for p in branch.points])
    y = np.array([of(p) for p in branch.points])
    solid = np.array([p.stable is not False for p in branch.points], dtype=bool)
    for stable, style, words in ((True, "-", "stable"), (False, "--", "unstable")):
        shown = solid == stable
        # A segment belongs to the point it begins at, so that the parts meet.
        shown = shown | np.append(False, shown[:-1])
        if np.any(solid == stable):
            ax.plot(x, np.where(shown, y, np.nan), style, color=COLOURS[0 if stable else 1], linewidth=1.4, label=words)
    if branch.folds:
        ax.plot([p.value for p in branch.folds], [of(p) for p in branch.folds], "o", color="#444444", label="fold")
    if branch.hopf:
        hopf = [p.value for p in branch.hopf], [of(p) for p in branch.hopf]
        ax.plot(*hopf, "^", color="#444444", markerfacecolor="white", label="Hopf point")
    for kind, (mark, words) in _BIFURCATIONS.items():
        there = [p for p in branch.bifurcations if p.kind == kind]
        if there:
            ax.plot([p.value for p in there], [of(p) for p in there], mark, color="#444444", label=words)
    cut = [p for p, why in zip((branch.points[0], branch.points[-1]), branch.ends, strict=True) if goes_on(why)]
    if cut:
        ax.plot([p.value for p in cut], [of(p) for p in cut], "x", color="#444444", label="not followed further")
