"""What the health card of an FMU says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import RecordPart
from workbench.errors import InputError, suggest
from workbench.show.cases import ERROR, FAILURE, PASSED, SKIPPED, Case, Judged
from workbench.show.result import Result

__all__ = ["AND", "UNLOADABLE", "VERDICTS", "Answer", "HealthCard", "HealthLine"]

# From harmless to serious.
VERDICTS = ("not applicable", "good", "watch", "broken")
UNLOADABLE = "unloadable"  # among the numbers of an answer: this machine cannot load the binary
AND = ", "  # between several sources
_ADVICE = ("largest-step", "real-time")


@dataclass(frozen=True)
class Answer:
    """The answer of one check.

    Attributes:
        verdict: "good", "watch" (no promise is broken, but an analysis must know it), "broken" (a promise of the FMU
            or of the standard is not kept) or "not applicable" (`evidence` says why).
        evidence: what was found, with numbers, in one line.
        consequence: what it means for the analyses here, in one line; empty: nothing.
        numbers: what was measured, by name, for programs.
        finished: whether the check came to its end; not where a crash or the time limit cut it off.
    """

    verdict: str
    evidence: str
    consequence: str = ""
    numbers: dict[str, Any] = field(default_factory=dict)
    finished: bool = True


@dataclass(frozen=True, kw_only=True)
class HealthLine(RecordPart):
    """One check of one interface of one FMU.

    Attributes:
        component: name in the system; of several models the model as it was named, a blank and this name; empty where
            the card is of one FMU.
        interface: "me" or "cs"; "file": the description, without running it.
        name: name of the check, a key of `CHECKS`.
        verdict, evidence, consequence, numbers, finished: see `Answer`.
        seconds: how long it took.
    """

    component: str = ""
    interface: str
    name: str
    verdict: str
    evidence: str
    consequence: str = ""
    numbers: dict[str, Any] = field(default_factory=dict)
    finished: bool = True
    seconds: float = 0.0

    @property
    def outcome(self) -> str:
        """How a CI counts it: what is broken is a failure, not applicable skipped, a check cut off is an error."""
        if self.interface == "file" and not self.finished:  # it cannot be read
            return ERROR
        if self.verdict == "broken":
            return FAILURE
        if self.verdict == "not applicable":  # where an unloaded binary or a crash is why, another line tells
            return SKIPPED
        return PASSED if self.finished else ERROR

    def __str__(self) -> str:
        where = ", ".join(filter(None, (self.component, self.interface)))
        tail = f" → {self.consequence}" if self.consequence else ""
        return f"{self.name} ({where}): {self.verdict}: {self.evidence}{tail}"


@dataclass(frozen=True, kw_only=True)
class HealthCard(Result, Judged):
    """Whether an FMU, each FMU of a system, or each of several keeps its promises.

    Attributes:
        model: name of the model or of the system's file; of several models the names of the files, joined by commas.
        source: what was checked, likewise.
        sha256: of the FMU's file or folder; of several FMUs joined by commas, as the next two are.
        fmi_version, generation_tool: as the FMU tells them.
        interfaces: those checked.
        checks: every line, component by component, the file first, then "me", then "cs".
        notes: remarks for the user.
    """

    _page = "workbench.health.check.page:check_page"
    _picture = "workbench.health.check.picture:plot_check"

    model: str
    source: str
    sha256: str
    fmi_version: str
    generation_tool: str
    interfaces: tuple[str, ...]
    checks: tuple[HealthLine, ...]
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a health card", "check"

    @property
    def worst(self) -> str:
        """The most serious verdict."""
        return max((c.verdict for c in self.checks), key=VERDICTS.index, default=VERDICTS[0])

    @property
    def passed(self) -> bool:
        """Whether no promise is broken and every check came to its end: what was not seen is not kept."""
        return self.worst != "broken" and self.finished

    @property
    def finished(self) -> bool:
        """Whether every check came to its end."""
        return all(c.finished for c in self.checks)

    @property
    def concerns(self) -> tuple[HealthLine, ...]:
        """What is "broken" or "watch", the serious ones first."""
        chosen = [c for c in self.checks if c.verdict in VERDICTS[2:]]
        return tuple(sorted(chosen, key=lambda c: -VERDICTS.index(c.verdict)))

    def line(self, name: str, interface: str, *, component: str = "") -> HealthLine:
        """Return one line.

        Args:
            name: name of the check.
            interface: "me", "cs" or "file".
            component: component of a system.

        Raises:
            InputError: there is no such line.
        """
        for check in self.checks:
            if (check.component, check.interface, check.name) == (component, interface, name):
                return check
        known = [c.name for c in self.checks if c.interface == interface]
        raise InputError(f"the card has no check '{name}' of {interface}; {suggest(name, known)}")

    @property
    def suite(self) -> str:
        return self.model

    def cases(self) -> list[Case]:
        return [self._case(line) for line in self.checks]

    def _case(self, line: HealthLine) -> Case:
        sources = self.source.split(AND)
        file = next((s for s in sources if f"{line.component} ".startswith(f"{s} ")), self.source)
        several = len(sources) > 1
        component = line.component.removeprefix(file).lstrip() if several else line.component
        return Case(
            group=" ".join(filter(None, (component, line.interface))),
            name=line.name,
            outcome=line.outcome,
            message="; ".join(filter(None, (line.evidence, line.consequence))),
            kind=line.verdict,
            seconds=line.seconds,
            file=file,
            suite=file if several else "",
        )

    def derived(self) -> dict[str, Any]:
        """Return the verdict.

        Keys:
            verdict, passed: worst verdict; whether no promise is broken and every check came to its
                end.
            reference_results: results that the FMU carries (FMI-LS-REF), run again: component, then name, interface,
                step [s], worst (largest difference over the range of the variable), variable, time [s], explained
                (part of worst that the reference's own integration may be), passed (null: it cannot be told), problem
                (why not, or what is wrong with the reference).
            step_advice: of each co-simulation component, what the checks largest-step and real-time have measured:
                one_percent (longest step with an error of 1 %), stable and unstable (longest step with which the motion
                dies away, shortest with which not), tried (longest step tried) [s], order that is seen; step that is
                timed, steps of them, mean, median, p999 (99.9 %) and worst time of one [s], real_time_factor, late
                (part of the steps that took longer than they cover). null: not known.
        """
        replayed = [
            {"component": c.component, **one} for c in self.checks for one in c.numbers.get("reference_results", ())
        ]
        advice: dict[str, dict[str, Any]] = {}
        for c in self.checks:
            if c.name in _ADVICE and c.numbers:
                advice.setdefault(c.component, {"component": c.component}).update(c.numbers)
        return {
            "verdict": self.worst,
            "passed": self.passed,
            "reference_results": replayed,
            "step_advice": list(advice.values()),
        }

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each check."""
        names = ("component", "interface", "name", "verdict", "evidence", "consequence")
        yield names
        yield from ([getattr(c, n) for n in names] for c in self.checks)
