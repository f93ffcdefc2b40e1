"""The page of a fit to a frequency response."""

from __future__ import annotations

from workbench.identification.fit.result import FitResult
from workbench.show.page import Page, Section
from workbench.show.tables import matrices, pole_table

__all__ = ["fit_page"]


def fit_page(result: FitResult) -> Page:
    """Return the page of a fit: how well it follows, poles, matrices."""
    words = "Measured response (points) and the model's (line); below, the misfit and the errors it was weighted with."
    poles = [pole_table(result.poles.tolist(), result.dt, "Poles")] if result.order else []
    values = (result.A, result.B, result.C, result.D)
    return Page(
        title=f"Linear model of the response of {result.model}",
        lead=f"Order {result.order}: {result.order_reason}. {result.words[0][0].upper()}{result.words[0][1:]}.",
        facts={
            "response": f"{len(result.frequency_hz)} points, {result.frequency_hz.min():.4g} to "
            f"{result.frequency_hz.max():.4g} Hz{_channels(result)}",
            "model": "continuous" if result.dt == 0.0 else f"sampled every {result.dt:g} s",
        },
        sections=[
            Section("Model", tables=poles, figures=[(result.plot, words)], parts=[
                matrices(values, result.state_names, result.input_names, result.output_names, units=result.units,
                         dt=result.dt),
            ]),
        ],
        notes=result.notes,
        kind="identify",
        shown_by="--report",
    )  # fmt: skip


def _channels(result: FitResult) -> str:
    names = [result.channel_name(*place) for place in result.channels]
    return f", of {', '.join(names)}" if len(names) > 1 else ""
