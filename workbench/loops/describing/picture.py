"""Pictures of describing functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import degrees
from workbench.show.bode import Degrees
from workbench.show.figure import ABOVE, COLOURS, panels

if TYPE_CHECKING:
    from workbench.loops.describing.describe import DescribingFunction

__all__ = ["plot_describing"]

_MOST = 7  # curves


def plot_describing(result: DescribingFunction) -> Figure:
    """Draw |N| and arg N over the amplitude, the harmonics of the output, and −1/N in the plane.

    Args:
        result: the describing function.
    """
    figure, grid = panels(2, 2, title=f"{result.block}: describing function ({result.method})", width=8.4, height=2.8)
    (size, phase), (harmonics, plane) = grid
    inverse = np.where(np.isfinite(result.minus_inverse), result.minus_inverse, np.nan)
    for j in np.unique(np.linspace(0, len(result.frequency_hz) - 1, _MOST).astype(int)).tolist():
        label = f"{result.frequency_hz[j]:.4g} Hz" if result.frequency_dependent else None
        style: dict[str, Any] = {"color": COLOURS[j % len(COLOURS)], "linewidth": 1.4}
        n = result.gain[:, j]
        size.semilogx(result.amplitude, np.abs(n), label=label, **style)
        phase.semilogx(result.amplitude, np.where(n == 0.0, np.nan, degrees(n)), **style)
        plane.plot(inverse[:, j].real, inverse[:, j].imag, **style)
        _ends(plane, result.amplitude, inverse[:, j])
    _harmonics(harmonics, result)
    size.set_ylabel("|N|")
    size.set_ylim(bottom=0.0)
    phase.set_ylabel("phase of N [deg]")
    phase.yaxis.set_major_locator(Degrees())
    plane.set(xlabel="real part of −1/N", ylabel="imaginary part")
    for ax in (size, phase, harmonics):
        ax.set_xlabel("amplitude")
    if result.frequency_dependent:
        size.legend(fontsize=8.0, framealpha=0.9, edgecolor="#cccccc")
    return figure


def _ends(plane: Axes, amplitude: Floats, inverse: Complex) -> None:
    """Mark where the amplitude begins and ends."""
    known = np.flatnonzero(np.isfinite(inverse))
    for i in known[[0, -1]].tolist() if len(known) else []:
        plane.plot(inverse[i].real, inverse[i].imag, "o", color="#444444", markersize=3.5)
        plane.annotate(
            f"A = {amplitude[i]:.3g}", (inverse[i].real, inverse[i].imag), fontsize=8.0, xytext=(4, 5),
            textcoords="offset points",
        )  # fmt: skip


def _harmonics(ax: Axes, result: DescribingFunction) -> None:
    where = f" at {result.frequency_hz[-1]:.4g} Hz" if result.frequency_dependent else ""
    ax.set_ylabel(f"harmonics / fundamental{where}")
    ratio = result.harmonics[:, -1, :]
    if not np.isfinite(ratio).any():
        ax.text(0.5, 0.5, "not measured", transform=ax.transAxes, ha="center", color="#666666")
        return
    colour = 0
    for k in range(ratio.shape[1]):
        if k == 1 or not np.nanmax(ratio[:, k], initial=0.0) > 1e-6:
            continue
        ax.semilogx(result.amplitude, ratio[:, k], color=COLOURS[colour % 7], linewidth=1.3, label=f"{k or 'mean'}")
        colour += 1
    if colour:
        ax.legend(**{**ABOVE, "ncols": 5})
