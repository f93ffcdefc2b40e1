"""Spectral density and coherence of recorded data, each with the window that made it."""

from workbench.data.spectra.coherence import Coherence, coherence
from workbench.data.spectra.density import SpectralDensity, sdf
from workbench.data.spectra.window import WindowSettings

__all__ = ["Coherence", "SpectralDensity", "WindowSettings", "coherence", "sdf"]
