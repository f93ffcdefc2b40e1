"""The page of a best linear approximation."""

from __future__ import annotations

from workbench.data.bla.result import BlaResult
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import bracketed, counted, number
from workbench.show.verdicts import Verdict

__all__ = ["bla_page"]


def bla_page(result: BlaResult) -> Page:
    """Return the page of a best linear approximation: levels at each power, response with errors."""
    of_output = ("output", "linear part", "distortion at excited lines", "odd", "even", "noise")
    heads = (
        bracketed("rms of the input", result.input_unit),
        *(bracketed(name, result.output_unit) for name in of_output),
        "left [%]",
    )
    rows = [
        (*(number(float(v), ".4g") for v in values), f"{100.0 * left:.3g}")
        for *values, left in zip(
            result.rms, result.output_rms, result.linear_rms, result.distortion_rms, result.odd_rms, result.even_rms,
            result.noise_rms, result.left, strict=True,
        )
    ]  # fmt: skip
    levels = PageTable(heads, rows, right=tuple(range(8)))
    figures = [
        (result.plot, "Gain and phase with 95 % errors; below, what noise and distortion make of one realisation.")
    ]
    return Page(
        title=f"Best linear approximation of {result.model}: {result.input} → {result.output}",
        lead=f"{result.verdict[0].upper()}{result.verdict[1:]}.",
        facts={
            "multisine": f"{result.lines} lines, {len(result.frequency_hz)} excited, "
            f"{result.frequency_hz[0]:.4g} to {result.frequency_hz[-1]:.4g} Hz",
            "records": f"{counted(result.realisations, 'realisation')} of {result.periods} periods of "
            f"{result.samples} samples every {result.dt:.4g} s, {result.transient} before",
        },
        sections=[Section("Levels (root mean squares)", items=result.words[:-1], tables=[levels], figures=figures)],
        summary=[Verdict("good" if all(result.worth) else "watch", result.verdict)],
        notes=result.notes,
        kind="bla",
    )
