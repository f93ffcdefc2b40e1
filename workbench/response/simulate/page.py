"""The page of a time history."""

from __future__ import annotations

import math

import numpy as np

from workbench.response.simulate.result import SimulationResult
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted

__all__ = ["simulate_page"]

_ROUNDING = 1e-14  # of a signal's largest value: a sine that ends after whole periods ends at 0


def simulate_page(result: SimulationResult) -> Page:
    """Return the page of a time history: pictures, and where each signal begins, ends and reaches."""
    begin, end = result.time[0], result.time[-1]
    return Page(
        title=f"Time history of {result.model}",
        lead=(
            f"{counted(len(result.signals), 'signal')} from {begin:.12g} to {end:.12g} s, {len(result.time)} instants."
        ),
        facts={},
        sections=[
            Section("Time history", figures=[(result.plot, f"Signals of {result.model} over time.")]),
            Section("Values", tables=[_values(result)]),
        ],
        notes=result.notes,
        kind="simulate",
    )


def _values(result: SimulationResult) -> PageTable:
    rows = []
    for name, values in result.signals.items():
        known = values[np.isfinite(values)] if np.isfinite(values).any() else values[:1]
        figures = (values[0], values[-1], known.min(), known.max())
        nothing = _ROUNDING * max(abs(known.min()), abs(known.max()))
        rows.append((name, result.units[name] or "", *(_figure(x, nothing) for x in figures)))
    return PageTable(("variable", "unit", "first", "last", "smallest", "largest"), rows, right=(2, 3, 4, 5))


def _figure(x: float, nothing: float) -> str:
    if not math.isfinite(x):
        return "–"
    return f"{0.0 if abs(x) <= nothing else x:.6g}"
