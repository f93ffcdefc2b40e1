"""The page of an identification."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from workbench.data.advice.page import advice_table, data_facts
from workbench.data.spectra.coherence import coherence
from workbench.data.spectra.density import sdf
from workbench.identification.identify.result import IdentifyResult
from workbench.identification.subspace.page import estimate_facts, matrices_section, order_table, pole_tables
from workbench.identification.validate.page import overlay_section, validation_section
from workbench.show.page import Page, PageTable, Section
from workbench.show.verdicts import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["identify_page", "order_section"]


def identify_page(result: IdentifyResult) -> Page:
    """Return the page of an identification: data, advice, order, model, validation, comparison."""
    sections = [
        _of_data(result),
        order_section(result),
        *_of_refinement(result),
        _of_model(result),
        validation_section("Data of the fit", result.own),
    ]
    if result.other is not None:
        sections.append(validation_section(f"Validation on {result.other.data.name}", result.other))
    if result.overlay is not None:
        sections.append(overlay_section(result.overlay))
    cut = f", {result.settle:g} s cut off" if result.settle else ""
    return Page(
        title=f"Linear model of {result.data.name}",
        lead=_lead(result),
        facts={
            **data_facts(result.data),
            "removed before": f"{result.detrend}{cut}",
            **estimate_facts(result.estimate),
        },
        sections=sections,
        summary=[
            *(Verdict("failed", text) for text in result.warnings),
            *(Verdict(f.verdict, f"data, {f.topic}: {f.evidence}") for f in result.advice.concerns),
        ],
        # What the refinement has a section for stands there.
        notes=[text for text in result.notes if not (result.refinement.tried and text == result.refinement.words)],
        kind="identify",
        shown_by="--report",
    )


def _lead(result: IdentifyResult) -> str:
    where = "other data" if result.other is not None else "the data of the fit"
    if result.failed:
        return f"A model of order {result.order} that has no simulation on its data. {' '.join(result.warnings)}."
    biased = result.closed_loop and result.closed_loop_method is None
    return (
        f"{'This is not a model of the plant: the data come from a closed loop. ' if biased else ''}"
        f"A model of order {result.order} follows {where} with a fit of {result.fit_percent:.2f} % "
        f"(error {result.error_percent:.2f} %). The data are judged: {result.advice.worst}."
    )


def _of_data(result: IdentifyResult) -> Section:
    linear = coherence(result.data, segments=20)
    figures: list[tuple[Callable[[], Figure], str]] = [
        (result.advice.plot, "The data; marked: what was found in them."),
        (sdf(result.data).plot, "Spectral density of inputs and outputs."),
        (linear.plot, "Coherence: 1 where the output follows the input linearly; 20 segments."),
    ]
    return Section("Are the data good enough?", tables=[advice_table(result.advice)], figures=figures)


def order_section(result: IdentifyResult) -> Section:
    """Return singular values and principal angles, with the order and its reason."""
    return Section(
        "Order",
        paragraphs=[f"Order {result.order}: {result.estimate.order_reason}."],
        tables=[order_table(result.estimate)],
        figures=[(result.plot_order, "A state matters where its bar stands out: large value, angle far from 90°.")],
    )


def _of_model(result: IdentifyResult) -> Section:
    poles = (result.validation.plot_poles, "Poles (crosses) and zeros (circles).")
    return Section(
        "Model", tables=pole_tables(result.estimate), figures=[poles], parts=[matrices_section(result.estimate)]
    )


def _of_refinement(result: IdentifyResult) -> list[Section]:
    """Return what the refinement tried, and how well the model is known; nothing where it was not asked for."""
    refinement = result.refinement
    if not refinement.tried:
        return []
    head = ("order", "disturbance", "numbers fitted", "criterion above the best")
    tables = [PageTable(head, [tuple(row) for row in refinement.table()], right=(0, 2, 3))]
    known = result.uncertainty if refinement.taken else None
    figures = [] if known is None else [(known.plot, "Frequency response with its 95 % regions.")]
    items = () if known is None else known.words
    words = [f"{refinement.words}."]
    if known is not None and result.advice.finding("linearity").verdict != "good":
        words.append(
            "The regions are those of the best linear model for these data, which no linear system has made: the "
            "response to other signals, sines among them, may lie outside."
        )
    return [Section("Refinement", paragraphs=words, tables=tables, items=items, figures=figures)]


# -- parts of an identification, each as a page of its own ------------------------------------------
