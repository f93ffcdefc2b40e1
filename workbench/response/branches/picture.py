"""Picture of the periodic responses of a forced model."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from workbench.core.values.decibels import decibels
from workbench.show.bode import Degrees, gain_label, log_axis
from workbench.show.figure import COLOURS, LEGEND, outside, rows
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.response.branches.result import BranchesResult, Fold, ResponseBranch

__all__ = ["branch_handles", "draw_branches", "plot_branches"]

_ASKED: dict[str, Any] = {"color": "#888888", "linewidth": 0.8}
_MARKERS = {"fold": "o", "period doubling": "s", "Neimark-Sacker": "D", "branch point": "P"}


def plot_branches(result: BranchesResult) -> Figure:
    """Draw gain [dB] and phase [deg] of all responses over what is varied: full where stable, dashed where not."""
    amplitudes = sorted({b.amplitude for b in result.branches if b.amplitude is not None})
    figure, axes = rows(2, title=f"{result.model}: {result.input} → {result.output}{_held(result, amplitudes)}")
    colours = {a: COLOURS[i % len(COLOURS)] for i, a in enumerate(amplitudes)}
    draw_branches(axes[0], axes[1], result.branches, result.folds, colours)
    axes[0].set_ylabel(gain_label(result.input_unit, result.output_unit))
    axes[1].set_ylabel("phase [deg]")
    axes[1].yaxis.set_major_locator(Degrees())
    axes[1].set_xlabel(bracketed(result.vary, result.vary_unit))
    for f in result.asked_hz:
        axes[0].axvline(f, **_ASKED)
    if result.vary in {"frequency", "amplitude"}:
        values = np.concatenate([b.varied for b in result.branches])
        log_axis(axes[1], float(values.min()), float(values.max()))
    _legend(figure, result, colours)
    figure.align_ylabels(axes)
    return figure


def _held(result: BranchesResult, amplitudes: Sequence[float]) -> str:
    """Return what is the same in the whole picture."""
    unit = f" {result.input_unit}" if result.input_unit not in {None, "1"} else ""
    held = [f"amplitude {amplitudes[0]:g}{unit}"] if len(amplitudes) == 1 else []
    if result.vary != "frequency" and result.branches:
        held.append(f"{result.branches[0].frequency_hz[0]:g} Hz")
    if result.onset is not None:
        held.append(f"it jumps from amplitude {result.onset.amplitude:.4g}{unit} on")
    return f", {', '.join(held)}" if held else ""


def draw_branches(
    gain: Axes, phase: Axes, branches: Sequence[ResponseBranch], folds: Sequence[Fold],
    colours: dict[float, str],
) -> None:  # fmt: skip
    """Draw branches and their folds.

    Args:
        gain: where the gain is drawn.
        phase: where the phase is drawn.
        branches: the responses.
        folds: and what lies on them.
        colours: amplitude → colour; another branch has the first one.
    """
    for b in branches:
        colour = colours.get(b.amplitude if b.amplitude is not None else np.nan, COLOURS[0])
        turned = b.phase_deg - 360.0 * np.round((np.median(b.phase_deg) + 90.0) / 360.0)
        thin = 1.3 if b.order == 1 else 0.9
        for ax, values in ((gain, decibels(b.gain.astype(np.complex128))), (phase, turned)):
            for part, stable in _parts(b.stable):
                ax.plot(b.varied[part], values[part], "-" if stable else "--", color=colour, linewidth=thin)
    for kind, marker in _MARKERS.items():
        chosen = [f for f in folds if f.kind == kind and f.gain > 0.0]
        if chosen:
            at = [f.varied for f in chosen]
            gain.plot(at, decibels(np.array([f.gain + 0j for f in chosen])), marker, color="#333333", markersize=4.0)


def _parts(stable: NDArray[np.bool_]) -> list[tuple[slice, bool]]:
    """Return the stretches of a branch that are stable or not, each reaching to the next."""
    breaks = [0, *(np.flatnonzero(stable[1:] != stable[:-1]) + 1).tolist(), len(stable)]
    return [(slice(a, min(b + 1, len(stable))), bool(stable[a])) for a, b in pairwise(breaks)]


def branch_handles(branches: Sequence[ResponseBranch], folds: Sequence[Fold]) -> list[Line2D]:
    """Return what a legend says of branches: which are stable, and what lies on them.

    Args:
        branches: the responses.
        folds: and what lies on them.
    """
    handles = []
    if any(not b.stable.all() for b in branches):
        handles.append(Line2D([], [], color="#333333", linestyle="-", label="stable"))
        handles.append(Line2D([], [], color="#333333", linestyle="--", label="unstable"))
    kinds = {f.kind for f in folds}
    handles += [
        Line2D([], [], color="#333333", linestyle="", marker=m, markersize=4.0, label=kind)
        for kind, m in _MARKERS.items()
        if kind in kinds
    ]
    return handles


def _legend(figure: Figure, result: BranchesResult, colours: dict[float, str]) -> None:
    """Put the legend beside the picture, where it covers no curve."""
    handles: list[Any] = []
    if len(colours) > 1:
        unit = f" {result.input_unit}" if result.input_unit not in {None, "1"} else ""
        handles += [Line2D([], [], color=c, label=f"amplitude {a:g}{unit}") for a, c in colours.items()]
    handles += branch_handles(result.branches, result.folds)
    if result.asked_hz:
        handles.append(Line2D([], [], label=f"{', '.join(f'{f:g}' for f in result.asked_hz)} Hz", **_ASKED))
    if handles:
        outside(figure, handles, "right upper", **LEGEND)
