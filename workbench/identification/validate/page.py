"""The pages of a model compared with data: validation, regions, frequency responses."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from workbench.data.advice.page import data_facts
from workbench.identification.validate.overlay import Overlay
from workbench.identification.validate.result import Validation
from workbench.identification.validate.spread import ModelSpread
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["overlay_page", "overlay_section", "spread_page", "validation_page", "validation_section"]


def spread_page(result: ModelSpread) -> Page:
    """Return the page of the regions of poles and frequency response."""
    words = "Frequency response with its regions."
    return Page(
        title=f"How well {result.name} is known",
        lead=f"The data determine {result.determined} of {counted(len(result.regions), 'pole')}.",
        facts={"confidence": f"{100.0 * result.confidence:g} %, each region for itself"},
        sections=[Section("Regions", items=result.words, figures=[(result.plot, words)])],
        kind="spread",
    )


def validation_section(title: str, validation: Validation) -> Section:
    """Return the fits and residuals of a model on data."""
    figures = [
        (validation.plot, "Measured, simulated (from the input alone) and predicted (one step ahead) output."),
        *_residuals(validation, "prediction", "Errors of the one-step prediction with 95 % bands."),
        *_residuals(validation, "simulation", "Errors of the simulation with 95 % bands."),
    ]
    return Section(title, items=validation.words, figures=figures)


def _residuals(validation: Validation, kind: str, words: str) -> list[tuple[Callable[[], Figure], str]]:
    """Return the picture of residuals, none where they are rounding: the verdicts say so."""
    result = validation.residuals(kind)
    if result.autocorrelation is None or result.cross is None:
        return []
    return [(partial(validation.plot_residuals, kind=kind), words)]


def overlay_section(overlay: Overlay) -> Section:
    """Return the picture of frequency responses laid over each other."""
    words = "Frequency responses as sines would show them."
    return Section("Frequency response", items=overlay.words, figures=[(overlay.plot, words)])


def validation_page(result: Validation) -> Page:
    """Return the page of a model compared with data."""
    fits = "; ".join(f.words for f in result.simulation.fits)
    poles = (result.plot_poles, "Poles (crosses) and zeros (circles).")
    return Page(
        title=f"Model compared with {result.data.name}",
        lead=f"{fits}.",
        facts=data_facts(result.data),
        sections=[validation_section("Outputs and residuals", result), Section("Poles and zeros", figures=[poles])],
        notes=result.notes,
        kind="validate",
    )


def overlay_page(result: Overlay) -> Page:
    """Return the page of frequency responses laid over each other."""
    rows = [(d.curve, *(number(x, ".3g") for x in d.worst())) for d in result.differences]
    table = PageTable(("curve", "largest difference of gain [dB]", "of phase [deg]"), rows)
    return Page(
        title=f"Frequency responses of {result.name}: {result.input} → {result.output}",
        lead=f"Compared with {result.reference}.",
        facts={"half the sampling rate": f"{result.nyquist_hz:g} Hz"},
        sections=[overlay_section(result), Section("Differences", tables=[table])],
        notes=result.notes,
        kind="overlay",
    )
