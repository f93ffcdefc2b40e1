"""The page of what a master of co-simulation parts costs."""

from __future__ import annotations

from workbench.health.delays.result import ConnectionDelay, DelayReport, NoDelays
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted, number
from workbench.show.verdicts import Verdict

__all__ = ["delays_page", "no_delays_page"]


def delays_page(result: DelayReport) -> Page:
    """Return the page of a delay report: what each connection and loop costs, and how far the answer is off."""
    order = " → ".join(" | ".join(stage) for stage in result.stages)
    return Page(
        title=f"Delays in {result.system}",
        lead=f"{result.order}, {order}: {counted(len(result.connections), 'connection')} between parts that are "
        f"stepped by themselves, every {1e3 * result.step:.6g} ms.",
        facts={
            "communication step": f"{result.step:.6g} s"
            + (f", fixed: {result.fixed}" if result.fixed else ", controlled in runs without a given step"),
            "runs": f"to {result.stop:g} s, with the step, half and a quarter of it",
            "sampled parts": ", ".join(f"{name} every {p:.6g} s" for name, p in result.periods.items()) or "none",
        },
        sections=[_connections(result), *_loops(result), *_outputs(result)],
        summary=[*(_verdict(c) for c in result.connections), *(Verdict("watch", w) for w in result.conclusions)],
        notes=result.notes,
        kind="check",
    )


def no_delays_page(result: NoDelays) -> Page:
    """Return the page of a model without a master."""
    verdict = Verdict("good", result.words)
    notes = [result.words, *result.notes]
    return Page(f"Delays in {result.model}", "", {}, [], summary=[verdict], notes=notes, kind="check")


def _verdict(c: ConnectionDelay) -> Verdict:
    if c.mean_s == 0.0:
        return Verdict("good", f"{c.connection}: no delay on average")
    side = "late" if c.mean_s > 0.0 else "early"
    return Verdict("watch", f"{c.connection}: {1e3 * abs(c.mean_s):.4g} ms {side} on average")


def _connections(result: DelayReport) -> Section:
    at = "" if result.frequency is None else f" at {result.frequency:g} Hz"
    rows = [
        (c.connection, c.how, f"{1e3 * c.mean_s:.4g}", f"{1e3 * c.longest_s:.4g}", number(c.phase_lost_deg, ".3g"))
        for c in result.connections
    ]
    headings = (
        "connection",
        "value over a step",
        "mean delay [ms]",
        "oldest [ms]",
        f"phase lost{at} [deg]",
    )
    return Section("Connections", tables=[PageTable(headings, rows, right=(2, 3, 4))])


def _loops(result: DelayReport) -> list[Section]:
    rows = [
        (
            " → ".join(p.components),
            f"{1e3 * p.mean_s:.4g}",
            number(p.crossover_hz, ".4g"),
            number(p.phase_lost_deg, ".3g"),
        )
        for p in result.loops
    ]
    headings = ("loop", "delay around the loop [ms]", "crossover [Hz]", "phase lost [deg]")
    return [Section("Loops", tables=[PageTable(headings, rows, right=(1, 2, 3))])] if rows else []


def _outputs(result: DelayReport) -> list[Section]:
    rows = [
        (
            o.name,
            f"{o.change:.3g}",
            number(o.order, ".3g"),
            f"{o.error:.3g}",
            f"{o.span:.3g}",
            f"{100.0 * o.error / o.span:.3g}" if o.span else "–",
        )
        for o in result.outputs
    ]
    headings = ("output", "change with half the step", "order", "estimated error", "range", "of the range [%]")
    words = (
        "From runs with the step, half and a quarter of it. The order says how fast the error falls with the step; "
        "without one it falls unevenly, and the error is an estimate."
    )
    return [Section("Error at this step", paragraphs=[words], tables=[PageTable(headings, rows)])] if rows else []
