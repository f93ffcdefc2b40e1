"""Bode pictures: every response is drawn by the same lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from workbench.core.response import Response

__all__ = ["bode_axes", "draw_response", "plain_decades"]


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


def plain_decades(ax: Axes) -> None:
    """Make the horizontal axis logarithmic, its labels plain numbers.

    Args:
        ax: the axes.
    """
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
