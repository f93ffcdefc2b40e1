"""The page of a health card."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from workbench.health.check.registry import CHECKS
from workbench.health.check.result import AND, UNLOADABLE, HealthCard, HealthLine
from workbench.show.page import Page, PageTable, Section
from workbench.show.verdicts import Verdict

__all__ = ["check_page"]

_INTERFACES = {"file": "The file", "me": "Model exchange", "cs": "Co-simulation"}


def check_page(card: HealthCard) -> Page:
    """Return the page of a health card: what is broken first, then every line, interface by interface."""
    keep, no, their = ("keep", "do", "their") if AND in card.source else ("keeps", "does", "its")
    kept = f"{keep} {their} promises"
    broken = [c for c in card.checks if c.verdict == "broken"]
    if broken and all(c.numbers.get(UNLOADABLE) for c in broken):
        kept = "cannot be loaded on this machine"
    elif not card.passed:
        kept = f"{no} not keep {their} promises" if card.worst == "broken" else f"{kept}, as far as they were checked"
    concerns = [Verdict(c.verdict, _line(c)) for c in card.concerns]
    return Page(
        title=f"Health card of {card.model}",
        lead=f"{card.model} {kept}: {_counted(card)}.",
        facts={
            "checked": card.source,
            "FMI": card.fmi_version,
            "made by": card.generation_tool,
            "SHA-256": card.sha256,
        },
        sections=[*_tables(card), *_pictures(card), _questions()],
        data=card.to_dict(),
        summary=concerns or [Verdict("good", "nothing to watch")],
        notes=card.notes,
        kind="check",
    )


def _counted(card: HealthCard) -> str:
    names = ("broken", "watch", "good", "not applicable")
    numbers = [(n, sum(c.verdict == n for c in card.checks)) for n in names]
    return ", ".join(f"{count} {name}" for name, count in numbers if count)


def _line(line: HealthLine) -> str:
    where = " ".join(filter(None, (line.component, line.interface)))
    tail = f"; {line.consequence}" if line.consequence else ""
    return f"{where} {line.name}: {line.evidence}{tail}"


def _tables(card: HealthCard) -> Iterator[Section]:
    headings = ("check", "verdict", "evidence", "consequence")
    for component, interface in dict.fromkeys((c.component, c.interface) for c in card.checks):
        lines = [c for c in card.checks if (c.component, c.interface) == (component, interface)]
        rows = [(c.name, c.verdict, c.evidence, c.consequence) for c in lines]
        title = ": ".join(filter(None, (component, _INTERFACES[interface])))
        yield Section(title, tables=[PageTable(headings, rows, verdict=1, right=())])


def _pictures(card: HealthCard) -> Sequence[Section]:
    if not any(c.name in ("step", "memory") and c.numbers for c in card.checks):
        return ()
    words = "Change of the answer from each communication step to half of it, and resident memory over sessions."
    return (Section("Convergence and memory", figures=[(card.plot, words)]),)


def _questions() -> Section:
    rows = [(name, check.question) for name, check in CHECKS.items()]
    return Section("What the checks test", tables=[PageTable(("check", "question"), rows)], folded=True, explains=True)
