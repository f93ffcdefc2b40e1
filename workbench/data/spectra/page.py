"""The pages of spectral densities and coherences."""

from __future__ import annotations

from workbench.data.spectra.coherence import Coherence
from workbench.data.spectra.density import SpectralDensity
from workbench.data.spectra.window import WindowSettings
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import bracketed, counted

__all__ = ["coherence_page", "density_page"]


def density_page(result: SpectralDensity) -> Page:
    """Return the page of spectral densities."""
    rows = [
        (bracketed(name, unit), f"{result.band_hz(name):.4g}")
        for name, unit in zip(result.columns, result.units, strict=True)
    ]
    return Page(
        title=f"Spectral densities of {result.name}",
        lead=f"{counted(len(result.columns), 'column')} up to {result.settings.nyquist_hz:g} Hz.",
        facts=_settings(result.settings),
        sections=[
            Section("Densities", figures=[(result.plot, "Density over frequency with its 95 % band.")]),
            Section("Bands", tables=[PageTable(("column", "within 3 dB of its peak up to [Hz]"), rows)]),
        ],
        kind="sdf",
    )


def coherence_page(result: Coherence) -> Page:
    """Return the page of coherences."""
    chance = f"Unrelated data exceed {result.significance_95:.3f} in 5 % of cases."
    return Page(
        title=f"Coherence of {result.name}",
        lead=f"1 where an output follows the inputs linearly and without noise. {chance}",
        facts={
            "inputs → outputs": f"{', '.join(result.input_names)} → {', '.join(result.output_names)}",
            **_settings(result.settings),
        },
        sections=[Section("Coherence", figures=[(result.plot, "Multiple coherence of each output with all inputs.")])],
        kind="coherence",
    )


def _settings(settings: WindowSettings) -> dict[str, str]:
    return {
        "window": f"{settings.window}, {counted(settings.segments, 'segment')} of {settings.length} samples",
        "resolution": f"{settings.resolution_hz:.4g} Hz",
        "random error": f"{100.0 * settings.random_error:.3g} %",
    }
