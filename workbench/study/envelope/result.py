"""What an envelope found."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.core.records.record import RecordPart
from workbench.show.cases import ERROR, FAILURE, PASSED, Case, Judged
from workbench.show.result import Result
from workbench.study.envelope.probability import Probability
from workbench.study.requirements.base import Compliance, Scalar

__all__ = ["Border", "EnvelopeParameter", "EnvelopePoint", "EnvelopeResult", "WorstCase", "margin_of"]


@dataclass(frozen=True, kw_only=True)
class EnvelopeParameter(RecordPart):
    """One parameter of an envelope.

    Attributes:
        name: "model.parameter".
        spread: its distribution in words.
        low, high: ends of what grid, map and search cover; None: it has values, not a range.
        values: of a discrete one.
        unit: None: it has none, or its model could not be opened.
    """

    name: str
    spread: str
    low: float | None
    high: float | None
    values: tuple[Scalar, ...] = ()
    unit: str | None = None


@dataclass(frozen=True, kw_only=True)
class EnvelopePoint(RecordPart):
    """One point of an envelope.

    Attributes:
        failure: name of the configuration; None: the study has none.
        values: "model.parameter" → value.
        value: what the requirement is about; None: nothing was measured.
        margin: how far the value is inside the limits, negative outside; None: it has no distance.
        passed: whether the requirement is met; None: nothing was measured.
        where: at which frequency, amplitude, time.
        reason: why nothing was measured.
    """

    failure: str | None
    values: Mapping[str, Scalar]
    value: float | bool | str | None
    margin: float | None
    passed: bool | None
    where: str = ""
    reason: str = ""


def margin_of(point: EnvelopePoint) -> float:
    """Return the margin of a point, by which points are put in order; infinite where it has none."""
    return math.inf if point.margin is None else point.margin


@dataclass(frozen=True, kw_only=True)
class WorstCase(RecordPart):
    """The point with the smallest margin.

    Attributes:
        failure, values, value, margin, where: as of a point.
        found: "plan" or "search": which of them met it.
        evaluations: of the search, beside the plan's points.
        failed: of these, at how many nothing was measured: what is there is not known, and may be worse.
        commands: command lines that measure it again, in the folder of the study.
        systems: model → a system file that is the model of this point, as text; empty: it cannot be written as one.
    """

    failure: str | None
    values: Mapping[str, Scalar]
    value: float
    margin: float
    where: str
    found: str
    evaluations: int
    failed: int
    commands: tuple[str, ...]
    systems: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Border(RecordPart):
    """Where stability changes along a line of the map.

    Attributes:
        analysis: that found it.
        failure: under which.
        kind: "Hopf" (an equilibrium begins or ceases to oscillate), "real pole", "fold" (two cycles meet), "cycle born"
            (a cycle shrinks to a point), "period doubling", "Neimark-Sacker", "branch point".
        at: value of the map's first axis.
        line: value of the map's second axis; None: it has none.
        words: what else is known, such as the frequency.
    """

    analysis: str
    failure: str | None
    kind: str
    at: float
    line: float | None
    words: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class EnvelopeResult(Result, Judged):
    """An envelope: points with values, the worst case, the probability of the requirement, borders.

    Attributes:
        study: its name.
        requirement: whose value it is.
        limit: its limits: "min", "max", "equal", "tolerance".
        unit: of value, limit and margin; None: they have none.
        plan: "grid", "random", "latin" or "sobol".
        seed: of its random numbers.
        parameters: that are varied.
        failures: names of the configurations; empty: the study has none.
        axes: parameters of the map: two, or one.
        points: all of them; those that an interrupt left undone are missing.
        probabilities: of each failure, and of all together where they have probabilities; none with a grid.
        interval: what the intervals are worth with points of this plan.
        worst: the smallest margin; None: there is none.
        borders: where stability changes.
        planned: how many points there were to be.
        measured, reused: how many analyses were run, and how many were in the store.
        files: the study and every file that the models consist of → SHA-256.
        notes: one line each.
    """

    _page = "workbench.study.envelope.page:envelope_page"
    _picture = "workbench.study.envelope.page:plot_envelope"

    study: str
    requirement: str
    limit: Mapping[str, float | bool | str]
    unit: str | None
    plan: str
    seed: int
    parameters: tuple[EnvelopeParameter, ...]
    failures: tuple[str, ...]
    axes: tuple[str, ...]
    points: tuple[EnvelopePoint, ...]
    probabilities: tuple[Probability, ...]
    interval: str
    worst: WorstCase | None
    borders: tuple[Border, ...]
    planned: int
    measured: int
    reused: int
    files: Mapping[str, str]
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "an envelope", "run"

    @property
    def failed(self) -> tuple[EnvelopePoint, ...]:
        """Points at which nothing was measured."""
        return tuple(p for p in self.points if p.passed is None)

    @property
    def violated(self) -> tuple[EnvelopePoint, ...]:
        """Points at which the requirement is not met."""
        return tuple(p for p in self.points if p.passed is False)

    @property
    def found_violated(self) -> WorstCase | None:
        """The worst case where the search found it, and the requirement is not met there; None: there is none."""
        worst = self.worst
        return worst if worst is not None and worst.found == "search" and worst.margin < 0.0 else None

    @property
    def passed(self) -> bool:
        """Whether every point was measured and meets the requirement, and so does the worst case."""
        return not self.violated and not self.failed and self.found_violated is None

    @property
    def suite(self) -> str:
        return self.study

    def cases(self) -> list[Case]:
        searched = [] if self.found_violated is None else [self._case(self.found_violated, passed=False)]
        return [*(self._case(point, passed=point.passed) for point in self.points), *searched]

    def _case(self, point: EnvelopePoint | WorstCase, *, passed: bool | None) -> Case:
        values = [f"{name} = {value}" for name, value in point.values.items()]
        came_out = Compliance(value=point.value, limit=self.limit, unit=self.unit, where=point.where)
        return Case(
            group=self.requirement,
            name=", ".join(filter(None, (point.failure, *values))),
            outcome=ERROR if passed is None else PASSED if passed else FAILURE,
            message=getattr(point, "reason", "") or came_out.words,
            kind="envelope",
        )

    def of(self, failure: str | None) -> tuple[EnvelopePoint, ...]:
        """Return the points of one failure.

        Args:
            failure: its name; None: the study has none.
        """
        return tuple(p for p in self.points if p.failure == failure)

    def parameter(self, name: str) -> EnvelopeParameter:
        """Return a parameter.

        Args:
            name: "model.parameter".
        """
        return next(p for p in self.parameters if p.name == name)

    def derived(self) -> dict[str, Any]:
        """Return how many points meet the requirement, do not, or failed, and whether all is met.

        Keys:
            met, violated, failed: how many points.
            passed: whether every point meets the requirement, and the worst case of the search, too.
        """
        met = sum(p.passed is True for p in self.points)
        return {"met": met, "violated": len(self.violated), "failed": len(self.failed), "passed": self.passed}

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return {**{p.name: p.unit for p in self.parameters}, **dict.fromkeys(("value", "margin"), self.unit)}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each point."""
        names = [p.name for p in self.parameters]
        yield ("failure", *names, "value", "margin", "passed", "where", "reason")
        for p in self.points:
            own = (p.failure or "", *(p.values.get(n, "") for n in names))
            yield (*own, *("" if v is None else v for v in (p.value, p.margin, p.passed)), p.where, p.reason)
