"""The pages of what is measured on data alone: advice, spectral densities, coherence."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from workbench.data.advice.result import Advice
from workbench.data.experiment.experiment import Experiment
from workbench.data.spectra.coherence import Coherence
from workbench.data.spectra.density import SpectralDensity
from workbench.data.spectra.window import WindowSettings
from workbench.show.page import Page, Section, Table
from workbench.show.result import drawn
from workbench.show.tables import bracketed, counted
from workbench.show.verdicts import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["advice_page", "advice_picture", "advice_table", "coherence_page", "data_facts", "density_page"]


def data_facts(data: Experiment) -> dict[str, str]:
    """Return what an experiment is, as facts of a page."""
    return {
        "data": f"{data.name}: {data.n_samples} samples every {data.dt:g} s",
        "inputs → outputs": f"{', '.join(data.input_names)} → {', '.join(data.output_names)}",
    }


def advice_picture(advice: Advice) -> Figure:
    """Return the picture of data without the findings, which a page has as a table."""
    return drawn("workbench.data.advice.picture:plot_advice", None, advice, findings=False)


def advice_table(advice: Advice) -> Table:
    """Return every finding with its evidence."""
    rows = [(f.topic, f.verdict, f.evidence, f.advice) for f in advice.findings]
    return Table(("question", "verdict", "evidence", "advice"), rows, verdict=1)


def advice_page(advice: Advice) -> Page:
    """Return the page of a judgement of data: each question with verdict, evidence and what to do."""
    orders = "as many as were tested" if advice.excited_orders is None else str(advice.excited_orders)
    return Page(
        title=f"Are the data of {advice.experiment.name} good enough?",
        lead=f"Judged: {advice.worst}.",
        facts={**data_facts(advice.experiment), "orders excited": orders},
        sections=[
            Section("Data", figures=[(partial(advice_picture, advice), "The data; marked: what was found in them.")]),
            Section("Findings", tables=[advice_table(advice)]),
        ],
        summary=[Verdict(f.verdict, f"{f.topic}: {f.evidence}") for f in advice.findings],
        kind="advise",
    )


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
            Section("Bands", tables=[Table(("column", "within 3 dB of its peak up to [Hz]"), rows)]),
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
