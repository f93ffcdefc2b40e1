"""Spectral density and coherence of recorded data, each with the window that made it."""

from workbench.analysis.spectra.coherence import Coherence, coherence
from workbench.analysis.spectra.density import SpectralDensity, sdf
from workbench.analysis.spectra.window import WindowSettings

__all__ = ["Coherence", "SpectralDensity", "WindowSettings", "coherence", "sdf"]
