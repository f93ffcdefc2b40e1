"""Bandwidth and phase delay of an attitude (MIL-STD-1797; Hoh et al. 1982)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from workbench.analysis.nyquist.grid import adaptive_grid
from workbench.analysis.onset.request import RateOnset
from workbench.analysis.onset.result import Attitude
from workbench.core.linear import LinearPart
from workbench.core.matrices import Floats

__all__ = ["attitude_of"]

_MARGIN_DEG, _MARGIN_DB = 45.0, 6.0


def attitude_of(part: LinearPart, asked: RateOnset) -> Attitude:
    """Return bandwidth and phase delay of the response from the command to an attitude.

    Args:
        part: the response.
        asked: names the attitude, and the band.
    """
    f, value = adaptive_grid(part, asked.band)
    sign = -1.0 if (part.at(f[0]) * 1j).imag < 0.0 and abs(np.angle(value[0])) > np.pi / 2.0 else 1.0
    phase = np.degrees(np.unwrap(np.angle(sign * value)))
    half = _crossing(f, phase, -180.0)
    by_phase = _crossing(f, phase, _MARGIN_DEG - 180.0)
    by_gain = delay = None
    if half is not None:
        gain = 20.0 * np.log10(np.abs(value))
        by_gain = _crossing(f, gain, float(np.interp(half, f, gain)) + _MARGIN_DB)
        if 2.0 * half <= f[-1]:
            beyond = float(np.interp(2.0 * half, f, phase)) + 180.0
            delay = -beyond / (360.0 * 2.0 * half)
    return Attitude(
        output=asked.attitude or "", phase_bandwidth_hz=by_phase, gain_bandwidth_hz=by_gain, phase_delay_s=delay
    )


def _crossing(f: Floats, values: Floats, level: float) -> float | None:
    """Return the lowest frequency at which values fall through a level; None: they do not."""
    falls = np.flatnonzero((values[:-1] > level) & (values[1:] <= level))
    if not len(falls):
        return None
    k = int(falls[0])
    return float(brentq(lambda x: float(np.interp(x, f, values)) - level, f[k], f[k + 1]))
