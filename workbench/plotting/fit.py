"""The picture of a fit to a frequency response."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from workbench.plotting.figure import COLOURS, LEGEND, rows
from workbench.plotting.response import Degrees, log_axis

if TYPE_CHECKING:
    from workbench.analysis.fit.result import FitResult

__all__ = ["plot_fit_response"]

_FINE = 400


def plot_fit_response(result: FitResult) -> Figure:
    """Draw gain [dB] and phase [deg] of the measured response and of the model, and the misfit.

    Args:
        result: what to draw.
    """
    title = f"{result.model}: model of order {result.order}"
    figure, (gain, phase, misfit) = rows(3, title=title)
    f, fine = result.frequency_hz, np.geomspace(result.frequency_hz[0], result.frequency_hz[-1], _FINE)
    curve = result.response(fine)[:, 0, 0] * np.exp(-2j * np.pi * fine * result.delay)
    angles = np.degrees(np.unwrap(np.angle(result.measured))), np.degrees(np.unwrap(np.angle(curve)))
    # Both along the same turn.
    shift = 360.0 * np.round((angles[0][0] - angles[1][0]) / 360.0)
    gain.semilogx(f, 20.0 * np.log10(np.abs(result.measured)), ".", color=COLOURS[1], label="measured")
    gain.semilogx(fine, 20.0 * np.log10(np.maximum(np.abs(curve), 1e-300)), color=COLOURS[0], label="model")
    phase.semilogx(f, angles[0], ".", color=COLOURS[1])
    phase.semilogx(fine, angles[1] + shift, color=COLOURS[0])
    misfit.loglog(f, np.maximum(result.misfit, 1e-12), ".", color=COLOURS[0], label="misfit")
    misfit.loglog(f, result.sigma / np.abs(result.measured), "-", color=COLOURS[5], label="error it was weighted with")
    gain.legend(loc="lower left", **LEGEND)
    misfit.legend(loc="lower left", **LEGEND)
    gain.set_ylabel("gain [dB]")
    phase.set_ylabel("phase [deg]")
    misfit.set_ylabel("misfit / gain [1]")
    misfit.set_xlabel("frequency [Hz]")
    phase.yaxis.set_major_locator(Degrees())
    log_axis(misfit, float(f[0]), float(f[-1]))
    return figure
