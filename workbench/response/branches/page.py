"""The page of the periodic responses of a forced model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from workbench.core.values.decibels import decibels
from workbench.response.branches.result import BranchesResult, Fold, ResponseBranch
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, counted, sampled_rows
from workbench.show.verdicts import Verdict

__all__ = ["branches_page", "branches_table", "folds_table", "jumping"]

_MOST_ROWS = 16
_NOTHING = 1e-4


def branches_page(result: BranchesResult) -> Page:
    """Return the page of branches: how many responses there are where, folds, every branch."""
    return Page(
        title=f"Periodic responses of {result.model}: {result.input} → {result.output}",
        lead=_lead(result),
        facts={
            "input": bracketed(result.input, result.input_unit),
            "output": bracketed(result.output, result.output_unit),
            "varied": bracketed(result.vary, result.vary_unit),
            "periods run": f"{result.periods}",
        },
        sections=[
            Section(
                "Gain and phase",
                figures=[(result.plot, "Full: stable; dashed: unstable. Dots: folds; squares: period doublings.")],
            ),
            Section("Branches", tables=[branches_table(result.branches, result.vary, result.vary_unit)]),
            *([Section("Responses at the frequencies asked for", tables=[_listed(result)])] if result.asked_hz else []),
            *([Section("Folds and bifurcations", tables=[folds_table(result.folds)])] if result.folds else []),
            *_onset(result),
            Section("Values", tables=[_values(result, i) for i in range(len(result.branches))], folded=True),
        ],
        summary=_verdicts(result),
        notes=result.warnings,
        kind="branches",
    )


def _lead(result: BranchesResult) -> str:
    kinds = Counter(fold.kind for fold in result.folds)
    names = ", ".join(counted(n, kind, f"{kind}s" if kind != "Neimark-Sacker" else "") for kind, n in kinds.items())
    return f"{counted(len(result.branches), 'branch', 'branches')}; {names or 'no folds'}."


def _verdicts(result: BranchesResult) -> list[Verdict]:
    if result.onset is not None:
        words = f"the response jumps from amplitude {result.onset.amplitude:.4g}{behind(result.input_unit)} on"
        return [Verdict("watch", f"{words}, near {result.onset.frequency_hz:.4g} Hz")]
    folds = [f for f in result.folds if f.kind == "fold"]
    if not folds:
        largest = max((b.amplitude for b in result.branches if b.amplitude is not None), default=None)
        to = "" if largest is None else f" up to amplitude {largest:g}{behind(result.input_unit)}"
        return [Verdict("good", f"no fold was found: the response does not jump{to}")]
    return [jumping([f.varied for f in folds], result.vary_unit)]


def jumping(values: Sequence[float], unit: str | None) -> Verdict:
    """Return the verdict on folds.

    Args:
        values: where they are.
        unit: of that.
    """
    low, high = min(values), max(values)
    where = f"a fold at {low:.6g}" if low == high else f"folds from {low:.6g} to {high:.6g}"
    return Verdict("watch", f"the response jumps: {where}{behind(unit)}")


def _listed(result: BranchesResult) -> PageTable:
    rows = [
        (
            f"{r.frequency_hz:g}", f"{r.amplitude:g}", f"{r.gain:.5g}", f"{decibels(np.array([r.gain + 0j]))[0]:.3f}",
            f"{r.phase_deg:.2f}", "stable" if r.stable else "unstable", f"{r.order}", f"{r.branch + 1}",
        )
        for f in result.asked_hz
        for r in result.at(f)
    ]  # fmt: skip
    headings = (
        "frequency [Hz]", bracketed("amplitude", result.input_unit), "gain", "gain [dB]", "phase [deg]", "stability",
        "repeats after [periods]", "branch",
    )  # fmt: skip
    return PageTable(headings, rows, right=(0, 1, 2, 3, 4, 6, 7))


def branches_table(branches: Sequence[ResponseBranch], vary: str, unit: str | None) -> PageTable:
    """Return a table with a row for each branch.

    Args:
        branches: the responses.
        vary: what is varied.
        unit: of that.
    """
    rows = []
    for number, b in enumerate(branches, 1):
        rows.append(
            (
                f"{number}",
                "varied" if b.amplitude is None else f"{b.amplitude:g}",
                f"{b.order}",
                f"{b.varied.min():.6g} … {b.varied.max():.6g}",
                f"{b.gain.min():.4g} … {b.gain.max():.4g}",
                _stability(b),
                "closed" if b.closed else "; ".join(dict.fromkeys(filter(None, b.ends))),
            )
        )
    headings = ("branch", "amplitude", "repeats after [periods]", bracketed(vary, unit), "gain", "stability", "ends")
    return PageTable(headings, rows, right=(0, 1, 2))


def _stability(branch: ResponseBranch) -> str:
    if branch.stable.all():
        return "stable"
    return "partly" if branch.stable.any() else "unstable"


def folds_table(folds: Sequence[Fold]) -> PageTable:
    """Return a table of folds and bifurcations."""
    rows = [
        (f.kind, f"{f.frequency_hz:.7g}", f"{f.amplitude:.7g}", f"{f.varied:.7g}", f"{f.gain:.5g}", f"{f.branch + 1}")
        for f in folds
    ]
    return PageTable(("kind", "frequency [Hz]", "amplitude", "varied", "gain", "branch"), rows, right=(1, 2, 3, 4, 5))


def _onset(result: BranchesResult) -> list[Section]:
    if result.onset is None:
        return []
    rows = [
        (f"{a:.5g}", f"{low:.6g}", f"{high:.6g}")
        for a, (low, high) in zip(result.onset.curve_amplitude, result.onset.curve_hz, strict=True)
    ]
    headings = (bracketed("amplitude", result.input_unit), "lower fold [Hz]", "upper fold [Hz]")
    return [Section("Where it begins to jump", tables=[PageTable(headings, rows)])]


def _values(result: BranchesResult, number: int) -> PageTable:
    b = result.branches[number]
    db = decibels(b.gain.astype(np.complex128))
    amplitude = b.varied if b.amplitude is None else np.full(len(b.varied), b.amplitude)
    # A mean that is nothing beside the fundamental is shown as such.
    offset = np.where(np.abs(b.offset) < _NOTHING * b.gain * amplitude, 0.0, b.offset)
    rows = [
        (f"{x:.6g}", f"{d:.3f}", f"{phase:.2f}", f"{mean:.4g}", "stable" if s else "unstable", f"{abs(mu[0]):.4g}")
        for x, d, phase, mean, s, mu in zip(b.varied, db, b.phase_deg, offset, b.stable, b.multipliers, strict=True)
    ]
    headings = (
        bracketed(result.vary, result.vary_unit), "gain [dB]", "phase [deg]", "offset", "stability",
        "largest multiplier",
    )  # fmt: skip
    return PageTable(headings, sampled_rows(rows, _MOST_ROWS), verdict=4, title=f"Branch {number + 1}")
