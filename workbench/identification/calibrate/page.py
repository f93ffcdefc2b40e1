"""The page of a calibration."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.identification.calibrate.result import CalibratedParameter, CalibrateResult, DataFit, OutputNoise
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, counted, number
from workbench.show.verdicts import Verdict

__all__ = ["calibrate_page"]


def calibrate_page(result: CalibrateResult) -> Page:
    """Return the page of a calibration: parameters and regions, what the data do not tell, fits, residuals."""
    fits = ", ".join(f"{name} {fit:.4g} %" for name, fit in result.fit_percent.items())
    known = sum(p.identifiable for p in result.parameters)
    count = len(result.parameters)
    how_many = (
        f"{known} of {counted(count, 'value')}" if count > 1 else "the value" if known else "nothing of the value"
    )
    doubt = ", but they hang on what inputs do between samples" if result.doubt else ""
    doubt += ", but the model misses something, and regions may not hold them" if result.misfit else ""
    words = "Measured, computed with the start values, computed with the estimate; the band is what the regions leave."
    return Page(
        title=f"Parameters of {result.model}",
        lead=f"The data tell {how_many}{doubt}. Fit: {fits}.",
        facts={
            "data": "; ".join(f"{one.name}: {len(one.time)} samples" for one in result.data),
            "noise": "; ".join(_noise(one, result) for one in result.noise),
            "search": f"{result.runs} runs of the model; it ended because {result.reason}",
        },
        sections=[
            Section("Parameters", items=result.not_identifiable, tables=[_parameters(result), *_correlation(result)]),
            Section("Data and model", items=_lines(result.data, named=len(result.data) > 1),
                    figures=[(result.plot, words)]),
            *_validation(result),
            *_next(result),
        ],
        summary=_verdicts(result),
        notes=result.notes,
        kind="calibrate",
    )  # fmt: skip


def _verdicts(result: CalibrateResult) -> list[Verdict]:
    sure = result.converged and not result.misfit
    found = [Verdict("good" if p.identifiable and sure else "watch", _told(p)) for p in result.parameters]
    if result.doubt:
        found.insert(0, Verdict("watch", result.doubt))
    if not result.converged:
        found.append(Verdict("watch", f"the search is not at its end: {result.reason}"))
    chi = result.chi_squared
    if chi is not None:
        explains = chi.p_value >= 0.05
        can = "the model explains the data" if explains else "the model does not explain the data with this noise"
        words = f"{can}: χ² = {chi.value:.4g} with {chi.degrees} degrees of freedom, p = {chi.p_value:.2g}"
        found.append(Verdict("good" if explains else "poor", words))
    for one in result.data:
        if one.cross is not None and one.cross.undermodelled:
            words = (
                "the input is still visible in the residuals: the model misses something, and regions do not hold it"
            )
            found.append(Verdict("poor", f"{one.name}: {words}"))
        if one.autocorrelation is not None and not one.autocorrelation.white:
            far = "; regions hold what noise does to values, not what the model misses" if result.misfit else ""
            found.append(Verdict("watch", f"{one.name}: {one.autocorrelation.words}{far}"))
    return found


def _told(p: CalibratedParameter) -> str:
    if p.at_bound:
        return f"{p.name} = {p.value:.4g}{behind(p.unit)}, held by its limit"
    if p.low is None or p.high is None:
        return f"{p.name}: not in the data"
    words = f"{p.name} = {_digits(p.value, p)}{behind(p.unit)}, 95 %: {_digits(p.low, p)} to {_digits(p.high, p)}"
    return words if p.identifiable else f"{words}, wider than the value itself"


def _digits(value: float, p: CalibratedParameter) -> str:
    """Return a value with the digits that its error supports: two of the error's."""
    if not p.std_error or not value or not math.isfinite(value):
        return number(value, ".4g")
    digits = 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(p.std_error))
    return f"{value:.{min(max(digits, 2), 9)}g}"


def _parameters(result: CalibrateResult) -> PageTable:
    rows = [
        (
            bracketed(p.name, p.unit), f"{p.start:.5g}", _digits(p.value, p), number(p.std_error, ".2g"),
            *(("–", "–") if p.low is None or p.high is None else (_digits(p.low, p), _digits(p.high, p))),
            "held by its limit" if p.at_bound else "yes" if p.identifiable else "no",
        )
        for p in result.parameters
    ]  # fmt: skip
    headings = ("parameter", "start", "value", "standard error", "low (95 %)", "high (95 %)", "in the data")
    return PageTable(headings, rows, verdict=6, right=(1, 2, 3, 4, 5))


def _correlation(result: CalibrateResult) -> list[PageTable]:
    names = [p.name for p in result.parameters]
    if len(names) < 2:
        return []
    rows = [(name, *(number(x, ".2f") for x in row)) for name, row in zip(names, result.correlation, strict=True)]
    return [PageTable(("correlation", *names), rows)]


def _noise(one: OutputNoise, result: CalibrateResult) -> str:
    unit = next(
        (u for d in result.data for n, u in zip(d.output_names, d.output_units, strict=True) if n == one.output), None
    )
    if any(d.of_response for d in result.data if one.output in d.output_names):
        return f"{one.output}: {one.sigma:.3g} of the stated errors"
    how = "given" if one.given else "estimated"
    colour = f", coloured (order {len(one.colour)})" if one.colour else ", white"
    return f"{one.output}: σ = {one.sigma:.3g}{behind(unit)}{colour}, {how}"


def _lines(data: Sequence[DataFit], *, named: bool) -> list[str]:
    return [f"{one.name}: {line}" if named else line for one in data for line in one.words]


def _validation(result: CalibrateResult) -> list[Section]:
    lines = _lines(result.validation, named=True)
    return [Section("Other data", items=lines)] if lines else []


def _next(result: CalibrateResult) -> list[Section]:
    asked = result.next_experiment
    return [] if asked is None else [Section("Next experiment", items=asked.words)]
