"""The matrix of auto- and cross-spectra of several channels."""

from __future__ import annotations

import numpy as np
from scipy import signal

from workbench.core.values.arrays import Complex, Floats
from workbench.data.spectra.window import WindowSettings

__all__ = ["Complex", "cross_spectra"]


def cross_spectra(channels: Floats, settings: WindowSettings) -> tuple[Floats, Complex]:
    """Return frequencies [Hz], shape (n_f,), and one-sided densities S, shape (n_f, c, c).

    S[k, i, j] is the mean of conj(X_i)·X_j over the segments, scaled so that the integral of S[:, i, i]
    over 0 … Nyquist is the variance of channel i. Each segment's mean is taken out first.

    Args:
        channels: shape (n, c).
        settings: segments and window.
    """
    every = channels.T
    frequency, density = signal.csd(
        every[:, None, :],
        every[None, :, :],
        fs=1.0 / settings.dt,
        window=settings.window,
        nperseg=settings.length,
        noverlap=settings.overlapping,
        detrend="constant",
        scaling="density",
    )
    return np.asarray(frequency, dtype=np.float64), np.moveaxis(np.asarray(density, dtype=np.complex128), -1, 0)
