"""The picture of a best linear approximation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from workbench.plotting.figure import COLOURS, LEGEND, rows

if TYPE_CHECKING:
    from workbench.analysis.bla.result import BlaResult

__all__ = ["plot_bla"]

_RANGE = 100.0  # of levels [dB]


def plot_bla(result: BlaResult) -> Figure:
    """Draw gain [dB] and phase [deg] with 95 % errors, and levels of noise and distortion of one realisation [dB].

    Args:
        result: what to draw.
    """
    title = f"{result.model}: best linear approximation {result.input} → {result.output}"
    figure, (gain, phase, levels) = rows(3, title=title)
    f = result.frequency_hz
    for a, rms in enumerate(result.rms):
        colour = COLOURS[a % len(COLOURS)]
        size = np.maximum(np.abs(result.response[a]), 1e-300)
        part = np.minimum(result.error[a] / size, 1.0)
        angle, turn = np.degrees(np.unwrap(np.angle(result.response[a]))), np.degrees(np.arcsin(part))
        band: dict[str, Any] = {"color": colour, "alpha": 0.25, "linewidth": 0.0}
        gain.fill_between(f, _db(size * np.maximum(1.0 - part, 1e-3)), _db(size * (1.0 + part)), **band)
        gain.semilogx(f, _db(size), ".-", color=colour, linewidth=1.0, markersize=3.0, label=f"{rms:.4g} rms")
        phase.fill_between(f, angle - turn, angle + turn, **band)
        phase.semilogx(f, angle, ".-", color=colour, linewidth=1.0, markersize=3.0)
        levels.semilogx(f, _db(result.distortion[a]), "x", color=colour, markersize=4.0)
        levels.semilogx(f, _db(result.noise[a]), ".", color=colour, markersize=3.0)
    gain.legend(loc="lower left", **LEGEND)
    gain.set_ylabel("gain [dB]")
    phase.set_ylabel("phase [deg]")
    levels.set_ylabel("distortion (x),\nnoise (·) [dB]")
    levels.set_xlabel("frequency [Hz]")
    top = float(_db(np.maximum(result.distortion, result.noise)).max())
    levels.set_ylim(max(levels.get_ylim()[0], top - _RANGE), top + 5.0)  # noise of a model is rounding
    return figure


def _db(values: np.typing.ArrayLike) -> np.typing.NDArray[np.float64]:
    return np.asarray(20.0 * np.log10(np.maximum(values, 1e-12)))
