"""The picture of a best linear approximation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from workbench.show.bode import Degrees, gain_label, log_axis
from workbench.show.figure import COLOURS, LEGEND, SMALL, rows
from workbench.show.tables import behind

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from workbench.data.bla.result import BlaResult

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
    top = float(_db(np.maximum(result.distortion, result.noise)).max())
    unit = behind(result.input_unit)
    for a, rms in enumerate(result.rms):
        colour = COLOURS[a % len(COLOURS)]
        size = np.maximum(np.abs(result.response[a]), 1e-300)
        part = np.minimum(result.error[a] / size, 1.0)
        angle, turn = np.degrees(np.unwrap(np.angle(result.response[a]))), np.degrees(np.arcsin(part))
        band: dict[str, Any] = {"color": colour, "alpha": 0.25, "linewidth": 0.0}
        gain.fill_between(f, _db(size * np.maximum(1.0 - part, 1e-3)), _db(size * (1.0 + part)), **band)
        gain.semilogx(f, _db(size), ".-", color=colour, linewidth=1.0, markersize=3.0, label=f"{rms:.4g}{unit} rms")
        phase.fill_between(f, angle - turn, angle + turn, **band)
        phase.semilogx(f, angle, ".-", color=colour, linewidth=1.0, markersize=3.0)
        levels.semilogx(f, _db(result.distortion[a]), "x", color=colour, markersize=4.0)
        noise = _db(result.noise[a])
        levels.semilogx(f, np.where(noise > top - _RANGE, noise, np.nan), ".", color=colour, markersize=3.0)
    gain.legend(loc="lower left", **LEGEND)
    gain.set_ylabel(gain_label(result.input_unit, result.output_unit))
    phase.set_ylabel("phase [deg]")
    phase.yaxis.set_major_locator(Degrees())
    levels.set_ylabel(gain_label(result.input_unit, result.output_unit).replace("gain", "level"))
    levels.set_xlabel("frequency [Hz]")
    log_axis(levels, float(f[0]), float(f[-1]))
    _name_levels(levels, shown=bool((_db(result.noise) > top - _RANGE).any()))
    figure.align_ylabels([gain, phase, levels])
    return figure


def _name_levels(ax: Axes, *, shown: bool) -> None:
    """Say what the marks mean; the noise of a model is rounding, far below what is shown."""
    marks = {"distortion": "x"} | ({"noise": "."} if shown else {})
    handles = [
        Line2D([], [], marker=m, linestyle="", color="#444444", markersize=4.0, label=k) for k, m in marks.items()
    ]
    ax.legend(handles=handles, loc="lower left", **LEGEND)
    if not shown:
        words = f"noise: more than {_RANGE:g} dB below the distortion"
        ax.set_title(words, loc="right", fontsize=SMALL + 0.5, color="#444444")


def _db(values: np.typing.ArrayLike) -> np.typing.NDArray[np.float64]:
    return np.asarray(20.0 * np.log10(np.maximum(values, 1e-12)))
