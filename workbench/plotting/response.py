"""Bode pictures: every response is drawn by the same lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogFormatter, LogLocator, NullFormatter

from workbench.core.response import Response

__all__ = ["bode_axes", "draw_response", "log_axis", "plain_decades"]


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
    if high / low < 4.0:
        # Less than a decade has no or one power of ten in it: let the minor ticks speak, too.
        ax.xaxis.set_minor_locator(LogLocator(subs=tuple(np.arange(1.0, 10.0, 0.5))))
        ax.xaxis.set_minor_formatter(LogFormatter(minor_thresholds=(10.0, 10.0)))
    elif high / low < 120.0:
        ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 3.0, 5.0)))
        ax.xaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    else:
        ax.xaxis.set_minor_formatter(NullFormatter())


def plain_decades(ax: Axes) -> None:
    """Make the horizontal axis logarithmic, its labels plain numbers.

    Args:
        ax: the axes.
    """
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
