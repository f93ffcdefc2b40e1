"""The picture of a fit to a frequency response."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from workbench.show.bode import Degrees, log_axis
from workbench.show.figure import COLOURS, LEGEND, rows

if TYPE_CHECKING:
    from workbench.identification.fit.result import FitResult

__all__ = ["plot_fit_response"]

_FINE = 400


def plot_fit_response(result: FitResult) -> Figure:
    """Draw gain [dB] and phase [deg] of the measured response and of the model, and the misfit.

    Args:
        result: what to draw.
    """
    title = f"{result.model}: model of order {result.order}"
    figure, (gain, phase, misfit) = rows(3, title=title)
    f = result.frequency_hz
    fine = np.geomspace(f.min(), f.max(), _FINE)
    model = result.response(fine) * np.exp(-2j * np.pi * fine * result.delay)[:, None, None]
    several = len(result.channels) > 1
    for number, ((i, j), at) in enumerate(result.channels.items()):
        measured, curve = result.measured[at], model[:, i, j]
        name = f" {result.channel_name(i, j)}" if several else ""
        points, line = (COLOURS[number % len(COLOURS)],) * 2 if several else (COLOURS[1], COLOURS[0])
        angles = np.degrees(np.unwrap(np.angle(measured))), np.degrees(np.unwrap(np.angle(curve)))
        # Both along the same turn.
        shift = 360.0 * np.round((angles[0][0] - angles[1][np.searchsorted(fine, f[at][0]) % _FINE]) / 360.0)
        gain.semilogx(f[at], 20.0 * np.log10(np.abs(measured)), ".", color=points, label=f"measured{name}")
        gain.semilogx(
            fine, 20.0 * np.log10(np.maximum(np.abs(curve), 1e-300)), color=line, label="" if several else "model"
        )
        phase.semilogx(f[at], angles[0], ".", color=points)
        phase.semilogx(fine, angles[1] + shift, color=line)
        misfit.loglog(f[at], np.maximum(result.misfit[at], 1e-12), ".", color=line, label=f"misfit{name}")
        misfit.loglog(
            f[at], (result.sigma / np.abs(result.measured))[at], "-", color=line if several else COLOURS[5],
            label="" if several else "error it was weighted with",
        )  # fmt: skip
    gain.legend(loc="lower left", **LEGEND)
    misfit.legend(loc="lower left", **LEGEND)
    gain.set_ylabel("gain [dB]")
    phase.set_ylabel("phase [deg]")
    misfit.set_ylabel("misfit / gain [1]")
    misfit.set_xlabel("frequency [Hz]")
    phase.yaxis.set_major_locator(Degrees())
    log_axis(misfit, float(f.min()), float(f.max()))
    return figure
