"""Bode pictures: every response is drawn by the same lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, Locator, LogLocator, MaxNLocator, NullFormatter, NullLocator

from workbench.core.values.response import Response

__all__ = ["Degrees", "bode_axes", "draw_response", "gain_label", "log_axis", "plain_decades"]

# A narrow band has no or one power of ten in it: plain numbers at equal distances, so many at most.
_NARROW, _MOST_TICKS = 4.0, 7

# Distance of labels from the ends of their ticks, and by how much matplotlib's minor ticks are shorter [points].
_PAD, _SHORTER = 3.5, 1.5

# Distances of ticks [deg]: multiples of 45 where the axis is long enough for two of them, else parts of 45.
_DEGREES = (0.1, 0.5, 1.0, 5.0, 15.0, 45.0, 90.0, 180.0, 360.0)
_LONG = 90.0


class Degrees(Locator):
    """Ticks of a phase: at multiples of 45° where there is room for two of them, seven at most, wherever it ends."""

    def __call__(self) -> Sequence[float]:
        low, high = self.axis.get_view_interval()  # type: ignore[union-attr]
        return self.tick_values(low, high)

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        low, high = sorted((vmin, vmax))
        if high - low < _DEGREES[0]:
            return [float(tick) for tick in MaxNLocator(_MOST_TICKS).tick_values(low, high)]
        turns = 360.0 * np.ceil((high - low) / (360.0 * _MOST_TICKS))
        least = 45.0 if high - low >= _LONG else 0.0
        step = next((s for s in _DEGREES if s >= least and (high - low) / s <= _MOST_TICKS), turns)
        ticks: list[float] = (step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0)).tolist()
        return ticks


def gain_label(input_unit: str | None, output_unit: str | None) -> str:
    """Return the label of a gain in decibels, with what 0 dB is where that is not a pure number.

    Args:
        input_unit: None: not known.
        output_unit: likewise.
    """
    below, above = input_unit or "1", output_unit or "1"
    if above == below:
        return "gain [dB]"
    if below == "1":
        return f"gain [dB re 1 {above}]"
    return f"gain [dB re {'1' if above == '1' else f'1 {above}'}/{below}]"


def draw_response(gain: Axes, phase: Axes, response: Response, **style: object) -> None:
    """Draw gain [dB] and followed phase [deg] over frequency [Hz]; nothing where the gain is 0.

    Args:
        gain: axes of the gain, where the label is, too.
        phase: axes of the phase.
        response: what to draw.
        style: of matplotlib's lines.
    """
    if not np.any(np.abs(response.value) > 0.0):
        return
    gain.plot(response.frequency_hz, np.where(response.value == 0.0, np.nan, response.gain_db), **style)  # type: ignore[arg-type]
    phase.plot(response.frequency_hz, response.phase_deg, **style)  # type: ignore[arg-type]


def bode_axes(axes: Sequence[Axes]) -> None:
    """Label two axes as gain and phase over a logarithmic frequency.

    Args:
        axes: of gain and phase.
    """
    axes[0].set_ylabel("gain [dB]")
    axes[1].set_ylabel("phase [deg]")
    axes[1].set_xlabel("frequency [Hz]")
    axes[1].yaxis.set_major_locator(Degrees())
    for ax in axes[:2]:
        plain_decades(ax)
        ax.xaxis.set_minor_formatter(NullFormatter())


def log_axis(ax: Axes, low: float, high: float) -> None:
    """Make the horizontal axis logarithmic over a span, with plain numbers between the decades where there is room.

    Args:
        ax: the axes.
        low: lowest value.
        high: highest value.
    """
    plain_decades(ax)
    margin = (high / low) ** 0.03 if high > low else 1.5
    ax.set_xlim(low / margin, high * margin)
    if high / low < _NARROW:
        ax.xaxis.set_major_locator(MaxNLocator(_MOST_TICKS, steps=[1, 2, 2.5, 5, 10]))
        ax.xaxis.set_minor_locator(NullLocator())
    elif high / low < 120.0:
        ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 3.0, 5.0)))
        ax.xaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        # Labels of shorter ticks stand as far from the axis as the others.
        ax.tick_params(axis="x", which="both", pad=_PAD)
        ax.tick_params(axis="x", which="minor", pad=_PAD + _SHORTER)
    else:
        ax.xaxis.set_minor_formatter(NullFormatter())


def plain_decades(ax: Axes) -> None:
    """Make the horizontal axis logarithmic, its labels plain numbers.

    Args:
        ax: the axes.
    """
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
