"""The pages of an identification and of its parts."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from workbench.data.advice.page import advice_picture, advice_table, data_facts
from workbench.data.spectra.coherence import coherence
from workbench.data.spectra.density import sdf
from workbench.identification.identify.result import IdentifyResult
from workbench.identification.subspace.result import SubspaceEstimate
from workbench.identification.validate.bootstrap import PoleBootstrap
from workbench.identification.validate.overlay import Overlay
from workbench.identification.validate.result import Validation
from workbench.identification.validate.spread import ModelSpread
from workbench.show.page import Page, Section, Table
from workbench.show.tables import counted, matrices, number, pole_table
from workbench.show.verdicts import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "bootstrap_page",
    "estimate_page",
    "identify_page",
    "order_section",
    "overlay_page",
    "spread_page",
    "validation_page",
]


_BAR = 40  # length of the longest bar [characters]


def identify_page(result: IdentifyResult) -> Page:
    """Return the page of an identification: data, advice, order, model, validation, comparison."""
    sections = [
        _of_data(result),
        order_section(result),
        *_of_refinement(result),
        _of_model(result),
        _of_validation("Data of the fit", result.own),
    ]
    if result.other is not None:
        sections.append(_of_validation(f"Validation on {result.other.data.name}", result.other))
    if result.overlay is not None:
        sections.append(_of_overlay(result.overlay))
    cut = f", {result.settle:g} s cut off" if result.settle else ""
    return Page(
        title=f"Linear model of {result.data.name}",
        lead=_lead(result),
        facts={**data_facts(result.data), "removed before": f"{result.detrend}{cut}", **_estimated(result.estimate)},
        sections=sections,
        summary=[
            *(Verdict("failed", text) for text in result.warnings),
            *(Verdict(f.verdict, f"data, {f.topic}: {f.evidence}") for f in result.advice.concerns),
        ],
        # What the refinement has a section for stands there.
        notes=[text for text in result.notes if not (result.refinement.tried and text == result.refinement.words)],
        kind="identify",
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


def _estimated(found: SubspaceEstimate) -> dict[str, str]:
    return {
        "method": f"{found.method}, basis {found.basis}, horizon {found.horizon}{', biased' if found.biased else ''}",
        "order": str(found.order),
    }


def _of_data(result: IdentifyResult) -> Section:
    linear = coherence(result.data, segments=20)
    figures: list[tuple[Callable[[], Figure], str]] = [
        (partial(advice_picture, result.advice), "The data; marked: what was found in them."),
        (sdf(result.data).plot, "Spectral density of inputs and outputs."),
        (linear.plot, "Coherence: 1 where the output follows the input linearly; 20 segments."),
    ]
    return Section("Are the data good enough?", tables=[advice_table(result.advice)], figures=figures)


def order_section(result: IdentifyResult) -> Section:
    """Return singular values and principal angles, with the order and its reason."""
    return Section(
        "Order",
        paragraphs=[f"Order {result.order}: {result.estimate.order_reason}."],
        tables=[_order_table(result.estimate)],
        figures=[(result.plot_order, "A state matters where its bar stands out: large value, angle far from 90°.")],
    )


def _order_table(found: SubspaceEstimate) -> Table:
    """Return the first singular values with bars, which are full up to the order that was chosen."""
    values = found.singular_values[: max(2 * found.order, found.order + 4)].tolist()
    largest = values[0] or 1.0
    angles = found.principal_angles_deg.tolist()
    rows = [(str(k), f"{v:.4g}", f"{a:.2f}") for k, (v, a) in enumerate(zip(values, angles, strict=False), start=1)]
    bars = [
        ("█" if k < found.order else "░") * max(1, round(_BAR * value / largest))
        for k, value in enumerate(values[: len(rows)])
    ]
    return Table(("state", "singular value", "principal angle [deg]"), rows, bars=bars)


def _of_model(result: IdentifyResult) -> Section:
    poles = (result.validation.plot_poles, "Poles (crosses) and zeros (circles).")
    return Section("Model", tables=_poles(result.estimate), figures=[poles], parts=[_matrices(result.estimate)])


def _of_refinement(result: IdentifyResult) -> list[Section]:
    """Return what the refinement tried, and how well the model is known; nothing where it was not asked for."""
    told = result.refinement
    if not told.tried:
        return []
    head = ("order", "disturbance", "numbers fitted", "criterion above the best")
    tables = [Table(head, [tuple(row) for row in told.table()], right=(0, 2, 3))]
    known = result.uncertainty if told.taken else None
    figures = [] if known is None else [(known.plot, "Frequency response with its 95 % regions.")]
    items = () if known is None else known.words
    words = [f"{told.words}."]
    if known is not None and result.advice.finding("linearity").verdict != "good":
        words.append(
            "The regions are those of the best linear model for these data, which no linear system has made: the "
            "response to other signals, sines among them, may lie outside."
        )
    return [Section("Refinement", paragraphs=words, tables=tables, items=items, figures=figures)]


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


def _poles(estimate: SubspaceEstimate) -> list[Table]:
    model = estimate.model
    return [pole_table(model.poles.tolist(), model.dt, "Poles")] if model.order else []


def _matrices(estimate: SubspaceEstimate) -> Section:
    model = estimate.model
    states = [f"x{k + 1}" for k in range(model.order)]
    names, known = (*model.input_names, *model.output_names), (*model.input_units, *model.output_units)
    units = dict(zip(names, known, strict=True))
    values = (model.A, model.B, model.C, model.D)
    return matrices(values, states, model.input_names, model.output_names, units=units, dt=model.dt)


def _of_validation(title: str, validation: Validation) -> Section:
    figures = [
        (validation.plot, "Measured, simulated (from the input alone) and predicted (one step ahead) output."),
        *_residuals(validation, "prediction", "Errors of the one-step prediction with 95 % bands."),
        *_residuals(validation, "simulation", "Errors of the simulation with 95 % bands."),
    ]
    return Section(title, items=validation.words, figures=figures)


def _residuals(validation: Validation, kind: str, words: str) -> list[tuple[Callable[[], Figure], str]]:
    """Return the picture of residuals, none where they are rounding: the verdicts say so."""
    found = validation.residuals(kind)
    if found.autocorrelation is None or found.cross is None:
        return []
    return [(partial(validation.plot_residuals, kind=kind), words)]


def _of_overlay(overlay: Overlay) -> Section:
    words = "Frequency responses as sines would show them."
    return Section("Frequency response", items=overlay.words, figures=[(overlay.plot, words)])


# -- parts of an identification, each as a page of its own ------------------------------------------


def estimate_page(result: SubspaceEstimate) -> Page:
    """Return the page of a subspace estimate: order, poles, matrices."""
    model = result.model
    return Page(
        title=f"Linear model from {', '.join(model.input_names)} to {', '.join(model.output_names)}",
        lead=f"Order {result.order}: {result.order_reason}.",
        facts={**_estimated(result), "sampling interval": f"{model.dt:g} s"},
        sections=[
            Section("Model", tables=_poles(result)),
            _matrices(result),
            Section("Order", tables=[_order_table(result)], folded=True),
        ],
        notes=(*model.notes, *result.notes),
        kind="estimate",
    )


def validation_page(result: Validation) -> Page:
    """Return the page of a model compared with data."""
    fits = "; ".join(f.words for f in result.simulation.fits)
    poles = (result.plot_poles, "Poles (crosses) and zeros (circles).")
    return Page(
        title=f"Model compared with {result.data.name}",
        lead=f"{fits}.",
        facts=data_facts(result.data),
        sections=[_of_validation("Outputs and residuals", result), Section("Poles and zeros", figures=[poles])],
        notes=result.notes,
        kind="validate",
    )


def bootstrap_page(result: PoleBootstrap) -> Page:
    """Return the page of the poles' confidence regions."""
    of = "all regions together" if result.joint else "each region separately"
    return Page(
        title="Confidence of identified poles",
        lead=f"The data determine {result.determined} of {counted(len(result.regions), 'pole')}.",
        facts={
            "replicates": f"{len(result.replicates)}, {result.failed} more gave no model",
            "confidence": f"{100.0 * result.confidence:g} %, {of}",
            "blocks": f"{result.block} samples, seed {result.seed}",
        },
        sections=[
            Section("Regions", items=result.words, figures=[(result.plot, "Poles of all replicates, and the regions.")])
        ],
        kind="bootstrap",
    )


def overlay_page(result: Overlay) -> Page:
    """Return the page of frequency responses laid over each other."""
    rows = [(d.curve, *(number(x, ".3g") for x in d.worst())) for d in result.differences]
    table = Table(("curve", "largest difference of gain [dB]", "of phase [deg]"), rows)
    return Page(
        title=f"Frequency responses of {result.name}: {result.input} → {result.output}",
        lead=f"Compared with {result.reference}.",
        facts={"half the sampling rate": f"{result.nyquist_hz:g} Hz"},
        sections=[_of_overlay(result), Section("Differences", tables=[table])],
        notes=result.notes,
        kind="overlay",
    )
