"""The page of motions of several models under the same signals."""

from __future__ import annotations

from workbench.response.compare.result import MotionComparison
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, counted, number
from workbench.show.verdicts import Verdict

__all__ = ["motions_page"]


def motions_page(result: MotionComparison) -> Page:
    """Return the page of a comparison of motions: the picture, and one table for each signal."""
    words = "Peak (bar) and rms (line) in each window, and the records; windows are shaded."
    return Page(
        title=f"Motions of {counted(len(result.systems), 'model')} under the same signals",
        lead=_lead(result),
        facts={
            "models": ", ".join(f"{s} ({m})" for s, m in zip(result.systems, result.models, strict=True)),
            "inputs": ", ".join(f"{n}: {s}" for n, s in result.inputs.items()) or "none forced",
            "runs": f"0 to {result.stop:g} s",
        },
        sections=[
            Section("Peaks and records", figures=[(result.plot, words)]),
            *(_signal(result, s) for s in result.signals),
        ],
        summary=[Verdict("failed", f"{f.system}: {f.reason}") for f in result.failed],
        notes=result.notes,
        kind="simulate",
    )


def _lead(result: MotionComparison) -> str:
    signal, last = result.signals[0], len(result.windows) - 1
    begin, end = result.windows[last]
    sizes = [(s, result.measure(s, signal, last)) for s in result.systems]
    shown = result.shown[signal]
    listed = [f"{s} {shown.factor * m.peak:.3g}{behind(shown.unit)}" for s, m in sizes if m is not None]
    return f"Peak of {signal} from {begin:g} to {end:g} s: {', '.join(listed) or 'not reached'}."


def _signal(result: MotionComparison, signal: str) -> Section:
    own, shown = result.units[signal], result.shown[signal]
    units = list(dict.fromkeys((shown.unit, own)))
    sizes = [bracketed(what, unit) for unit in units for what in ("peak", "rms")]
    headings = ("window [s]", "model", *sizes, "at [s]", "peak over that of the first")
    rows = []
    for m in (m for m in result.motions if m.signal == signal):
        begin, end = result.windows[m.window]
        x = m.measure
        values = (shown.factor * x.peak, shown.factor * x.rms, x.peak, x.rms)[-2 * len(units) :]
        ratio = result.ratio(m.system, signal, m.window)
        rows.append(
            (
                f"{begin:g} … {end:g}",
                m.system,
                *(number(v, ".4g") for v in (*values, x.peak_time)),
                number(ratio, ".4g"),
            )
        )
    return Section(
        signal, tables=[PageTable(headings, sorted(rows, key=lambda r: r[0]), right=range(2, len(headings)))]
    )
