"""Spectral density and coherence of recorded data, each with the window that made it."""
