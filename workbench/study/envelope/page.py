"""The page of an envelope, and its picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from workbench.errors import InputError
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import bracketed, counted, sentence
from workbench.show.verdicts import Verdict
from workbench.study.envelope.result import margin_of
from workbench.study.envelope.surface import Surface
from workbench.study.requirements.base import Scalar, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workbench.study.envelope.picture import EnvelopePanel
    from workbench.study.envelope.probability import Probability
    from workbench.study.envelope.result import EnvelopeResult

__all__ = ["envelope_page", "plot_envelope"]

_MOST = 20  # points that are listed
_DIGITS = ".4g"


def envelope_page(result: EnvelopeResult) -> Page:
    """Return the page.

    Args:
        result: what to report.
    """
    met = sum(p.passed is True for p in result.points)
    lead = f"{result.requirement} is met at {met} of {counted(len(result.points), 'point')}"
    if result.found_violated is not None:
        lead += " of the plan, but not at one that the search found"
    if result.failed:
        lead += f"; at {len(result.failed)} nothing was measured"
    if len(result.points) < result.planned:
        lead += f"; {result.planned - len(result.points)} of the plan were not run: the same command continues"
    return Page(
        title=f"Envelope of {result.study}",
        lead=sentence(lead),
        facts={
            "requirement": f"{result.requirement}, {_limit(result)}",
            "plan": result.plan if result.plan == "grid" else f"{result.plan}, seed {result.seed}",
            "analyses": f"{result.measured} measured, {result.reused} taken from the store",
        },
        summary=list(_verdicts(result)),
        sections=[
            *_pictures(result),
            *_worst(result),
            *_probabilities(result),
            *_borders(result),
            _parameters(result),
            *_points(result),
            Section("Files", tables=[PageTable(("file", "SHA-256"), list(result.files.items()))], explains=True),
        ],
        notes=result.notes,
        kind="run",
    )


def _limit(result: EnvelopeResult) -> str:
    signs = {"min": "≥", "max": "≤", "equal": "=", "tolerance": "±"}
    limits = " ".join(f"{signs[name]} {number(value)}" for name, value in result.limit.items() if name in signs)
    return f"{limits} {result.unit}" if limits and result.unit not in (None, "1") else limits or "no limit is known"


def _verdicts(result: EnvelopeResult) -> Iterator[Verdict]:
    violated = result.found_violated
    for failure in result.failures or (None,):
        points = result.of(failure)
        bad = sum(p.passed is False for p in points)
        unknown = sum(p.passed is None for p in points)
        words = f"{failure}: " if failure is not None else ""
        if bad:
            yield Verdict("failed", f"{words}not met at {bad} of {counted(len(points), 'point')}")
        elif points and not unknown:
            word, of = ("passed", "") if violated is None or violated.failure != failure else ("watch", " of the plan")
            yield Verdict(word, f"{words}met at every one of {counted(len(points), 'point')}{of}")
        if violated is not None and violated.failure == failure:
            yield Verdict("failed", f"{words}not met at the worst case, margin {violated.margin:+.4g}")
        if unknown:
            yield Verdict("watch", f"{words}nothing was measured at {counted(unknown, 'point')}: see the reasons")
    if result.worst is not None and result.worst.failed:
        yield Verdict("watch", f"the search failed at {counted(result.worst.failed, 'point')}, which may be worse")


def _values(values: Mapping[str, Scalar]) -> str:
    return ", ".join(f"{name} = {v:.8g}" if isinstance(v, float) else f"{name} = {v}" for name, v in values.items())


def _worst(result: EnvelopeResult) -> Iterator[Section]:
    worst = result.worst
    if worst is None:
        return
    where = f" ({worst.where})" if worst.where else ""
    what = f"{result.requirement} is {worst.value:.6g}, margin {worst.margin:+.4g}{where}."
    how = (
        f"Found by the search, after {counted(worst.evaluations, 'evaluation')} beside the points of the plan."
        if worst.found == "search"
        else "It is a point of the plan"
        + (
            f"; {counted(worst.evaluations, 'evaluation')} of the search met nothing worse."
            if worst.evaluations
            else "."
        )
    )
    failure = [("failure", worst.failure)] if worst.failure is not None else []
    rows = [*failure, *((name, f"{v:.12g}" if isinstance(v, float) else str(v)) for name, v in worst.values.items())]
    words = [what, how, "A search proves nothing about what it did not look at: the true worst case may be worse."]
    files = [
        Section(f"System file of {name}", code=[text], folded=True, explains=True)
        for name, text in worst.systems.items()
    ]
    yield Section(
        "Worst case",
        paragraphs=words,
        tables=[PageTable(("parameter", "value"), rows)],
        code=list(worst.commands),
        parts=files,
    )


def _probabilities(result: EnvelopeResult) -> Iterator[Section]:
    if not result.probabilities:
        return
    confidence = f"{100.0 * result.probabilities[0].confidence:g} %"
    headings = (
        "failure",
        "points",
        "met",
        "not measured",
        "probability",
        f"{confidence} interval",
        "more points for the width",
    )
    rows = [_probability(p) for p in result.probabilities]
    more = () if any(p.more is not None for p in result.probabilities) else (6,)
    columns = [k for k in range(len(headings)) if k not in more]
    table = PageTable([headings[k] for k in columns], [[row[k] for k in columns] for row in rows])
    yield Section("Probability of the requirement", paragraphs=[sentence(result.interval)], tables=[table])


def _probability(p: Probability) -> tuple[str, ...]:
    estimate = "–" if p.estimate is None else f"{p.estimate:.4g}"
    more = "–" if p.more is None else str(p.more)
    return (p.failure or "–", str(p.samples), str(p.met), str(p.unknown), estimate, f"{p.low:.4f} … {p.high:.4f}", more)


def _borders(result: EnvelopeResult) -> Iterator[Section]:
    if not result.borders:
        return
    first, *second = (bracketed(name, result.parameter(name).unit) for name in result.axes)
    rows = [
        (b.failure or "–", "–" if b.line is None else f"{b.line:.6g}", f"{b.at:.6g}", b.kind, b.words)
        for b in result.borders
    ]
    headings = ("failure", second[0] if second else "line", first, "what happens", "details")
    yield Section("Where stability changes", tables=[PageTable(headings, rows)])


def _parameters(result: EnvelopeResult) -> Section:
    rows = [(bracketed(p.name, p.unit), p.spread) for p in result.parameters]
    if result.failures:
        rows.append(("failures", ", ".join(result.failures)))
    return Section("What is varied", tables=[PageTable(("parameter", "distribution"), rows)])


def _points(result: EnvelopeResult) -> Iterator[Section]:
    failed = result.failed[:_MOST]
    if failed:
        without = [(p.failure or "–", _values(p.values), p.reason) for p in failed]
        more = len(result.failed) - len(failed)
        words = [f"{more} more are in the JSON and the CSV."] if more else []
        table = PageTable(("failure", "point", "reason"), without)
        yield Section("Points without a value", paragraphs=words, tables=[table])
    ordered = sorted((p for p in result.points if p.margin is not None), key=margin_of)[:_MOST]
    if ordered:
        rows = [(p.failure or "–", _values(p.values), number(p.value), f"{p.margin:+.4g}", p.where) for p in ordered]
        title = f"The {len(ordered)} points with the smallest margins"
        yield Section(title, tables=[PageTable(("failure", "point", "value", "margin", "where"), rows)])


# -- the picture -------------------------------------------------------------------------------


def _pictures(result: EnvelopeResult) -> Iterator[Section]:
    if result.axes and any(p.margin is not None for p in result.points):
        words = f"Margin of {result.requirement} over {' and '.join(result.axes)}."
        yield Section("Map", figures=[(lambda: plot_envelope(result), words)])


def plot_envelope(result: EnvelopeResult) -> Figure:
    """Draw the map: the margin over two parameters, a panel for each failure, or over one.

    Where these two alone are varied, the margin is interpolated between the points; hatched is where the limit may lie
    by the interpolation's error.

    Args:
        result: what to draw.

    Raises:
        InputError: there is no axis, or no margin.
    """
    from workbench.study.envelope.picture import plot_maps  # noqa: PLC0415 - matplotlib is slow to import

    if not result.axes or all(p.margin is None for p in result.points):
        raise InputError("no picture of the envelope: it needs a parameter with a range, and margins")
    axes = []
    for name in result.axes:
        p = result.parameter(name)
        values = [float(q.values[name]) for q in result.points]
        low = min([*values, *([] if p.low is None else [p.low])])
        axes.append((bracketed(name, p.unit), low, max([*values, *([] if p.high is None else [p.high])])))
    return plot_maps(
        [_panel(result, failure, axes) for failure in result.failures or (None,)],
        title=f"{result.study}: {result.requirement}",
        axes=axes,
        quantity=result.requirement,
        unit=result.unit,
        remark=_remark(result),
    )


def _remark(result: EnvelopeResult) -> str:
    others = [p.name for p in result.parameters if p.name not in result.axes]
    notes = []
    if others:
        notes.append(f"{', '.join(others)} vary, too, so that nothing is interpolated between the points.")
    if others and result.borders:
        notes.append("Borders hold with these in their middle.")
    return " ".join(notes)


def _panel(result: EnvelopeResult, failure: str | None, axes: list[tuple[str, float, float]]) -> EnvelopePanel:
    from workbench.study.envelope.picture import EnvelopePanel  # noqa: PLC0415 - matplotlib is slow to import

    points = result.of(failure)
    placed = [np.array([float(p.values[name]) for p in points]) for name in result.axes]
    margin = np.array([np.nan if p.margin is None else p.margin for p in points])
    surface = None
    if len(axes) == 2 and len(result.parameters) == 2:
        scaled = np.column_stack(
            [(x - low) / ((high - low) or 1.0) for x, (_, low, high) in zip(placed, axes, strict=True)]
        )
        known = np.isfinite(margin)
        try:
            surface = Surface(scaled[known], margin[known])
        except ValueError:
            surface = None  # too few points: they are drawn alone
    borders = [(b.kind, b.at, np.nan if b.line is None else b.line) for b in result.borders if b.failure == failure]
    worst = None
    if result.worst is not None and result.worst.failure == failure:
        at = [float(result.worst.values[name]) for name in result.axes]
        worst = (at[0], at[1] if len(axes) > 1 else result.worst.margin)
    return EnvelopePanel(
        title=failure or "",
        x=placed[0],
        y=placed[1] if len(axes) > 1 else None,
        margin=margin,
        passed=np.array([p.passed is True for p in points], dtype=bool),
        surface=surface,
        borders=borders,
        worst=worst,
    )
