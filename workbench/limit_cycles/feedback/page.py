"""The page of a scalar feedback over its gain."""

from __future__ import annotations

import math
from itertools import groupby

from workbench.limit_cycles.feedback.closing_run import HANDED, FeedbackRun
from workbench.limit_cycles.feedback.result import CONVENTION, FeedbackResult, interval_words
from workbench.limit_cycles.feedback.settling import GainRun, SettlingStudy
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import bracketed, counted, number
from workbench.show.verdicts import Verdict

__all__ = ["feedback_page", "run_page", "settling_page"]

_MANY = 30


def feedback_page(result: FeedbackResult) -> Page:
    """Return the page of a feedback: stable gains, crossings, limit cycles left, settling times, one simulation."""
    return Page(
        title=f"Feedback of {result.source} to {result.target}",
        lead=f"{result.model}: {result.words}.",
        facts={
            "convention": CONVENTION,
            "from": bracketed(result.source, result.source_unit),
            "to": bracketed(result.target, result.target_unit),
            "gains considered": interval_words(result.gains),
            "open": f"{result.unstable_open} unstable poles, linearised by {result.lin_method}",
            **({"nonlinear block": result.block} if result.block else {}),
        },
        sections=[
            Section("Overview", figures=[(result.plot, "Poles over the gain, Nyquist curve, and remaining cycles.")]),
            _stability(result),
            Section("Root locus", figures=[(result.plot_root_locus, "Poles over the gain.")]),
            Section("Nyquist curve", figures=[(result.plot_nyquist, "G(jω), and around its crossings.")]),
            *_cycles(result),
            *([] if result.settling is None else [_settling(result.settling)]),
            *([] if result.run is None else [_run(result.run)]),
        ],
        summary=_verdicts(result),
        notes=result.notes,
        kind="feedback",
    )


def _verdicts(result: FeedbackResult) -> list[Verdict]:
    if not result.stable_gains:
        return [Verdict("unstable", result.words)]
    verdicts = [Verdict("stable", f"gain {interval_words(pair)}") for pair in result.stable_gains]
    if result.settling is not None and result.settling.optimum is not None:
        verdicts.append(Verdict("best", f"{_best(result.settling)} by the polynomial"))
    return verdicts


def _stability(result: FeedbackResult) -> Section:
    rows = [
        (
            f"{c.gain:.6g}",
            "∞" if math.isinf(c.frequency_hz) else f"{c.frequency_hz:.6g}",
            number(c.real, ".6g"),
            str(c.unstable_below),
            str(c.unstable_above),
        )
        for c in result.crossings
    ]
    headings = ("gain", "frequency [Hz]", "G there", "unstable poles below", "above")
    fastest = [
        f"gain {f.gain:.5g}: the slowest oscillation decays with {f.growth:.4g} 1/s at {f.frequency_hz:.4g} Hz "
        f"damped, the slowest pole of all with {f.slowest:.4g} 1/s"
        for f in result.fastest
        if f is not None
    ]
    return Section(
        "Gains at the border of stability",
        items=fastest,
        tables=[PageTable(headings, rows, right=range(5))],
        folded=len(rows) > _MANY,
    )


def _cycles(result: FeedbackResult) -> list[Section]:
    if not result.cycles:
        return []
    rows = []
    for (small, large, words), same in groupby(result.cycles, lambda c: (c.unstable_small, c.unstable_large, c.words)):
        gains = [c.gain for c in same]
        span = f"{gains[0]:.5g}" if len(gains) == 1 else f"{len(gains)}: {gains[0]:.5g} … {gains[-1]:.5g}"
        rows.append((span, str(small), str(large), words))
    drawable = any(c.curve is not None for c in result.cycles)
    headings = ("gains", "unstable poles, small amplitude", "large amplitude", "remaining cycles")
    return [
        Section(
            f"Limit cycles that {result.block} leaves",
            figures=[(result.plot_cycles, "Nyquist curves seen by the nonlinear block.")] if drawable else [],
            tables=[PageTable(headings, rows, right=(0, 1, 2))],
        )
    ]


def _settling(study: SettlingStudy) -> Section:
    unit, below = study.target_unit or "-", f"{100.0 * study.threshold:g} %"
    headings = ("gain", f"settled to {below} [s]", "left [%]", f"peak [{unit}]", f"[{unit}/s]", "at a limit")
    rows = [
        (
            f"{r.gain:.5g}",
            number(r.settling_seconds, ".4g"),
            f"{100.0 * r.left:.3g}",
            f"{r.peak_deflection:.4g}",
            f"{r.peak_rate:.4g}",
            _limited(r),
        )
        for r in study.runs
    ]
    return Section(
        "Settling",
        paragraphs=[
            f"Magnitude of {study.variable} after closing, compared with that before: {study.motion.how}.",
            f"By a polynomial of order {study.polynomial_order} through the measured times: {_best(study)}.",
        ],
        figures=[(study.plot, "Settling times over the gain.")],
        tables=[PageTable(headings, rows, right=range(len(headings)))],
    )


def _best(study: SettlingStudy) -> str:
    """Return the best gain in words."""
    if study.optimum is None:
        return f"none, as {counted(len(study.settled), 'gain')} settled"
    end = ", the end of the measured gains," if study.optimum_at_end else ""
    return f"gain {study.optimum:.5g}{end} settles in {study.optimum_seconds:.4g} s"


def _limited(run: GainRun) -> str:
    """Return how long the actuator was at which limit."""
    if run.deflection_limited is None and run.rate_limited is None:
        return "–"
    times = (("deflection", run.deflection_limited), ("rate", run.rate_limited))
    return ", ".join(f"{name} {seconds:.3g} s" for name, seconds in times if seconds) or "no"


def _run(run: FeedbackRun) -> Section:
    result = run.to_dict()
    unit = run.units[HANDED] or "-"
    words = (
        f"Gain {run.gain:g} closes at {run.closes_at:.6g} s; {100.0 * result['left_at_end']:.3g} % of the motion of "
        f"{run.watch} is left at {result['stop']:.6g} s. Peak deflection {result['peak_deflection']:.4g} {unit}, "
        f"peak rate {result['peak_rate']:.4g} {unit}/s."
    )
    return Section("Simulation", paragraphs=[words], figures=[(run.plot, "The motion before and after closing.")])


# -- parts of it, each as a page of its own --------------------------------------------------------


def settling_page(study: SettlingStudy) -> Page:
    """Return the page of settling times over the gain."""
    return Page(
        title=f"Settling of {study.variable}",
        lead=f"{counted(len(study.runs), 'gain')}, settled below {100.0 * study.threshold:g} % of the motion.",
        facts={"to": bracketed(study.target, study.target_unit)},
        sections=[_settling(study)],
        kind="feedback",
    )


def run_page(run: FeedbackRun) -> Page:
    """Return the page of a simulation in which the feedback closes."""
    return Page(
        title=f"Feedback of {run.source} to {run.target}",
        lead=f"{run.model}: a motion of {run.watch} at {run.frequency_hz:.4g} Hz, and what becomes of it.",
        facts={"gain": f"{run.gain:g}", "closes": f"at {run.closes_at:.6g} s"},
        sections=[_run(run)],
        kind="feedback",
    )
