"""The report of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from workbench import __version__
from workbench.analysis.identify import IdentifyResult
from workbench.analysis.spectra import coherence, sdf
from workbench.analysis.validate import Overlay, Validation
from workbench.report.page import Page, Section, Table

__all__ = ["identify_page"]

_MOST_ENTRIES = 8  # matrices with more rows or columns go to the embedded data only


def identify_page(
    result: IdentifyResult, *, overlay: Overlay | None = None, command: str = "", data: Mapping[str, Any] | None = None
) -> Page:
    """Return the page of an identification: data, advice, order, model, validation, comparison.

    Args:
        result: what to report.
        overlay: its frequency response beside others.
        command: that made it, to run it again.
        data: what is embedded; None: the result.
    """
    sections = [_of_data(result), _of_order(result), _of_model(result), _of_validation("Data of the fit", result.own)]
    if result.other is not None:
        sections.append(_of_validation("Validation on other data", result.other))
    if overlay is not None:
        words = "Frequency responses as sines would show them."
        sections.append(Section("Frequency response", items=overlay.words, figures=[(overlay.plot(), words)]))
    return Page(
        title=f"Linear model of {result.data.name}",
        lead=_lead(result),
        facts={**_facts(result), **({"command": command} if command else {})},
        sections=sections,
        data=result.to_dict() if data is None else data,
    )


def _lead(result: IdentifyResult) -> str:
    where = "other data" if result.other is not None else "the data of the fit"
    n = result.order
    return (
        f"A model of order {n} follows {where} with a fit of {result.fit_percent:.2f} % "
        f"(error {result.error_percent:.2f} %). The data are judged: {result.advice.worst}."
    )


def _facts(result: IdentifyResult) -> dict[str, str]:
    data, found = result.data, result.estimate
    cut = f", {result.settle:g} s cut off" if result.settle else ""
    return {
        "data": f"{data.name}: {data.n_samples} samples every {data.dt:g} s",
        "inputs → outputs": f"{', '.join(data.input_names)} → {', '.join(data.output_names)}",
        "taken off before": f"{result.detrend}{cut}",
        "method": f"{found.method}, basis {found.basis}, horizon {found.horizon}{', biased' if found.biased else ''}",
        "order": f"{found.order} ({found.order_reason})",
        "FMI workbench": __version__,
    }


def _of_data(result: IdentifyResult) -> Section:
    rows = [(f.topic, f.verdict, f.evidence, f.advice) for f in result.advice.findings]
    linear = coherence(result.data, segments=20)
    figures = [
        (result.advice.plot(), "The data and what was found in them."),
        (sdf(result.data).plot(), "Spectral density of inputs and outputs."),
        (linear.plot(), "Coherence: 1 where the output follows the input linearly; 20 segments."),
    ]
    table = Table(("question", "verdict", "evidence", "advice"), rows, verdict=1)
    return Section("Are the data good enough?", tables=[table], figures=figures)


def _of_order(result: IdentifyResult) -> Section:
    return Section(
        "Order",
        paragraphs=[f"Order {result.order}: {result.estimate.order_reason}."],
        figures=[(result.plot_order(), "A state matters where its bar stands out: large value, angle far from 90°.")],
    )


def _of_model(result: IdentifyResult) -> Section:
    model = result.model
    poles = [(_complex(z), *_as_continuous(z, model.dt)) for z in sorted(model.poles.tolist(), key=abs)]
    tables = [Table(("pole", "frequency [Hz]", "damping ratio"), poles)]
    if model.order <= _MOST_ENTRIES:
        tables += [_matrix(name, getattr(model, name)) for name in "ABCD"]
    poles_and_zeros = (result.validation.plot_poles(), "Poles (crosses) and zeros (circles).")
    return Section("Model", items=result.notes, tables=tables, figures=[poles_and_zeros])


def _of_validation(title: str, validation: Validation) -> Section:
    figures = [
        (validation.plot(), "Measured, simulated (from the input alone) and predicted (one step ahead) output."),
        (validation.plot_residuals(), "Errors of the one-step prediction with 95 % bands."),
        (validation.plot_residuals(kind="simulation"), "Errors of the simulation with 95 % bands."),
    ]
    return Section(title, items=validation.words, figures=figures)


def _matrix(name: str, values: np.ndarray) -> Table:
    return Table((name, *[""] * (values.shape[1] - 1)), [[f"{x:.6g}" for x in row] for row in values.tolist()])


def _complex(z: complex) -> str:
    return f"{z.real:.6g}" if z.imag == 0.0 else f"{z.real:.6g} {'+' if z.imag > 0.0 else '−'} {abs(z.imag):.6g}j"


def _as_continuous(z: complex, dt: float) -> tuple[str, str]:
    if abs(z) < 1e-12:
        return "delay", "–"
    s = complex(np.log(z)) / dt
    size = abs(s)
    return f"{size / (2.0 * np.pi):.5g}", f"{-s.real / size:.4g}" if size > 0.0 else "–"
