"""The page of a tuning."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import behind, bracketed, counted, sentence
from workbench.show.verdicts import Verdict
from workbench.study.requirements.base import Compliance, number

if TYPE_CHECKING:
    from workbench.study.tune.result import TunedRequirement, TuneResult

__all__ = ["tune_page"]

_DIGITS = ".5g"
_CAPTION = (
    "How far each requirement is beyond its limit, before and after, and the worst of them over the search; left of 0, "
    "or below, it is met. The scale is 6 dB or 45° for what is in dB or degrees, else the size of the limit."
)


def tune_page(result: TuneResult) -> Page:
    """Return the page.

    Args:
        result: what to report.
    """
    met = sum(r.passed for r in result.requirements)
    lead = f"{met} of {counted(len(result.requirements), 'requirement')} met"
    if result.conflict is not None:
        lead += f"; {result.conflict.words}"
    return Page(
        title=f"{result.system} tuned for {result.study}",
        lead=sentence(lead),
        facts={
            "search": f"{result.reason}; {counted(len(result.starts), 'search', 'searches')}",
            "linear models": f"{result.evaluations} evaluations",
            "analyses": f"{result.measured} measured, {result.reused} taken from the store",
        },
        summary=[*map(_verdict, result.requirements), *_bounds(result)],
        sections=[
            Section("Parameters", tables=[_parameters(result)]),
            Section("Requirements", tables=[_requirements(result)], figures=[(result.plot, _CAPTION)]),
            *_holding(result),
            *_conflict(result),
            *_envelope(result),
            Section("Searches", tables=[_starts(result)], explains=True),
            Section("Files", tables=[PageTable(("file", "SHA-256"), list(result.files.items()))], explains=True),
        ],
        notes=result.notes,
        kind="tune",
    )


def _verdict(r: TunedRequirement) -> Verdict:
    found = Compliance(value=r.after, unit=r.unit, limit=r.limit, passed=r.passed, where=r.where, reason=r.reason)
    return Verdict(found.verdict, f"{_label(r)}: {found.words}")


def _bounds(result: TuneResult) -> list[Verdict]:
    """Return what is to be watched: a parameter at its limit might do better beyond, or the limit is the real one."""
    return [
        Verdict("watch", f"{p.name} = {p.value:{_DIGITS}}{behind(p.unit)} is held by its limit")
        for p in result.parameters
        if p.at_bound
    ]


def _label(r: TunedRequirement) -> str:
    return f"{r.name} ({r.at})" if r.at else r.name


def _parameters(result: TuneResult) -> PageTable:
    rows = [
        (
            bracketed(p.name, p.unit), format(p.start, _DIGITS), format(p.value, _DIGITS),
            "–" if p.low is None else format(p.low, _DIGITS), "–" if p.high is None else format(p.high, _DIGITS),
            "held by its limit" if p.at_bound else "",
        )
        for p in result.parameters
    ]  # fmt: skip
    return PageTable(("parameter", "start", "found", "low", "high", "remark"), rows)


def _requirements(result: TuneResult) -> PageTable:
    rows = []
    for r in result.requirements:
        found = Compliance(value=r.after, unit=r.unit, limit=r.limit, margin=r.margin, passed=r.passed)
        kinds = [*(["hard"] if r.hard else []), "linear" if r.linear else "measured"]
        before = replace(found, value=r.before).value_words
        rows.append((
            _label(r), before, found.value_words, found.limit_words, found.margin_words, found.verdict,
            "holds the result" if r.active else "", ", ".join(kinds),
        ))  # fmt: skip
    headings = ("requirement", "before", "after", "limit", "margin", "verdict", "remark", "kind")
    return PageTable(headings, rows, verdict=5, right=(1, 2, 4))


def _holding(result: TuneResult) -> Iterator[Section]:
    """Yield what the requirements that hold the result depend on."""
    active = [r for r in result.requirements if r.per_percent]
    if active:
        names = [p.name for p in result.parameters]
        rows = [(_label(r), r.unit or "1", *(format(r.per_percent[n], "+.2g") for n in names)) for r in active]
        table = PageTable(("requirement", "unit", *names), rows)
        words = "Change of the margin when a parameter grows by 1 %; these requirements hold the result."
        yield Section("What holds the result", paragraphs=[words], tables=[table])


def _conflict(result: TuneResult) -> Iterator[Section]:
    found = result.conflict
    if found is None:
        return
    words = f"{found.words}: the worst of them stays {found.excess:.3g} of its scale beyond the limit"
    tables = []
    if found.trade_off is not None:
        pairs = zip(found.trade_off.first.tolist(), found.trade_off.second.tolist(), strict=True)
        rows = [(format(x, "+.3g"), format(y, "+.3g")) for x, y in pairs]
        tables = [PageTable(found.requirements, rows, title="beyond the limit, of the scale; at most 0: met")]
    yield Section("Conflict", paragraphs=[sentence(words)], tables=tables)


def _envelope(result: TuneResult) -> Iterator[Section]:
    if result.worst:
        where = ", ".join(f"{n} = {number(v)}" for n, v in result.worst.items() if n != "margin")
        lines = [f"worst case found: {where}, margin {number(result.worst['margin'])}"]
        lines += [f"added to the points: {point}" for point in result.added]
        yield Section("Envelope", items=lines)


def _starts(result: TuneResult) -> PageTable:
    rows = [
        (
            ", ".join(f"{n} = {v:.4g}" for n, v in s.values.items()),
            "–" if s.objective is None else format(s.objective, ".4g"), str(s.steps), s.reason,
        )
        for s in result.starts
    ]  # fmt: skip
    return PageTable(("start", "objective", "steps", "end"), rows, right=(1, 2))
