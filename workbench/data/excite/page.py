"""The page of an identification experiment."""

from __future__ import annotations

from workbench.data.excite.result import ExciteResult
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted

__all__ = ["excite_page"]


def excite_page(result: ExciteResult) -> Page:
    """Return the page of a recorded experiment: the signal's facts, pictures, ranges of what was recorded."""
    data, other = result.identification, result.validation
    second = "" if other is None else f" and {other.n_samples} for validation"
    return Page(
        title=f"Identification experiment on {result.model}",
        lead=f"{data.n_samples} samples every {result.design.dt:.6g} s{second}.",
        facts={
            "inputs → outputs": f"{', '.join(data.input_names)} → {', '.join(data.output_names)}",
            "signal": _signal(result),
            "spectrum": f"holds −3 dB from {result.design.band[0]:.4g} to {result.design.band[1]:.4g} Hz",
            "crest factor": ", ".join(f"{c:.3f}" for c in result.design.crest_factor),
            **_correlation(result),
        },
        sections=[
            Section("Data", figures=[(result.plot, "Inputs, their spectra, and outputs.")]),
            Section("Ranges", tables=[_ranges(result)]),
        ],
        notes=result.notes,
        kind="excite",
    )


def _signal(result: ExciteResult) -> str:
    design = result.design
    if design.kind == "prbs":
        return f"PRBS of order {design.order} at {design.clock:.6g} Hz, repeats after {design.period:.6g} s"
    return f"multisine of {counted(design.lines or 0, 'line')} an input, period {design.period:.6g} s"


def _correlation(result: ExciteResult) -> dict[str, str]:
    correlation = result.design.cross_correlation
    return {} if correlation is None else {"cross-correlation of the inputs": f"at most {correlation:.3f}"}


def _ranges(result: ExciteResult) -> PageTable:
    data, before = result.identification, {**result.u0, **result.y0}
    columns = [*zip(data.input_names, data.u.T, strict=True), *zip(data.output_names, data.y.T, strict=True)]
    rows = []
    for name, values in columns:
        numbers = (before[name], values.min(), values.max(), values.mean(), values.std())
        rows.append((name, data.units[name] or "", *(f"{x:.6g}" for x in numbers)))
    return PageTable(("variable", "unit", "before", "smallest", "largest", "mean", "std"), rows, right=range(2, 7))
