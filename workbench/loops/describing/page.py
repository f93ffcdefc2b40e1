"""The page of a describing function."""

from __future__ import annotations

import numpy as np

from workbench.core.values.decibels import degrees
from workbench.loops.describing.describe import DescribingFunction
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted, number, sampled_rows

__all__ = ["describing_page"]

_MOST_ROWS = 60  # of the values; the others are in the data of the page


def describing_page(result: DescribingFunction) -> Page:
    """Return the page of a describing function: picture and values."""
    sizes = f"{counted(len(result.amplitude), 'amplitude')} from {result.amplitude[0]:g} to {result.amplitude[-1]:g}"
    return Page(
        title=f"Describing function of {result.block}",
        lead=f"By {result.method}, at {sizes}{_frequencies(result)}.",
        facts={"depends on frequency": "yes" if result.frequency_dependent else "no"},
        sections=[
            Section("N(A)", figures=[(result.plot, "Gain and phase over the amplitude, −1/N in the plane.")]),
            _describing_values(result),
        ],
        kind="describing function",
    )


def _frequencies(result: DescribingFunction) -> str:
    return f" and {counted(len(result.frequency_hz), 'frequency', 'frequencies')}" if result.frequency_dependent else ""


def _describing_values(result: DescribingFunction) -> Section:
    rows = [
        (f"{a:.5g}", f"{f:.5g}", f"{abs(n):.6g}", f"{float(degrees(n)):.2f}", number(float(h), ".3g"))
        for a, row, harmonics in zip(result.amplitude, result.gain, result.harmonics, strict=True)
        for f, n, h in zip(result.frequency_hz, row, 100.0 * np.max(harmonics[:, 2:], axis=-1), strict=True)
    ]
    headings = ("amplitude", "frequency [Hz]", "gain", "phase [deg]", "largest harmonic [%]")
    wanted = [i for i in range(len(headings)) if i != 1 or result.frequency_dependent]
    shown = [[row[i] for i in wanted] for row in sampled_rows(rows, _MOST_ROWS)]
    return Section(
        "Values", tables=[PageTable([headings[i] for i in wanted], shown, right=range(len(wanted)))], folded=True
    )
