"""What tuning found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.show.result import Result

__all__ = ["Conflict", "TradeOff", "TuneResult", "TuneStart", "TunedParameter", "TunedRequirement"]


@dataclass(frozen=True, kw_only=True)
class TunedParameter(RecordPart):
    """One parameter.

    Attributes:
        name: full name in the system.
        unit: of all values; None: it has none.
        start: value at which the search began.
        value: that was found.
        low, high: its limits; None: it has none.
        at_bound: whether a limit holds it.
    """

    name: str
    unit: str | None
    start: float
    value: float
    low: float | None
    high: float | None
    at_bound: bool


@dataclass(frozen=True, kw_only=True)
class TunedRequirement(RecordPart):
    """One requirement at one point, as the study measures it.

    Attributes:
        name: in the study.
        at: the point, for people; empty: the study has one.
        kind: of the requirement.
        hard: whether it must be met.
        linear: whether it was searched for by a linear model with its derivatives; else it was measured.
        unit: of values, limit and margin; None: they have none.
        before: with the start values; None: it was not measured there.
        after: with the values found; None: likewise.
        limit: "min", "max", "equal", "tolerance" → number.
        margin: how far `after` is inside the limit; None: not known.
        excess_before: how far `before` is beyond the limit, over the scale: at most 0 where it is met; None: not known.
        excess: the same of `after`; what the search makes small.
        passed: whether it is met.
        active: whether it holds the result: without it others could be met better.
        where: at which frequency, time.
        reason: why it was not measured.
        per_percent: parameter → change of the margin when it grows by 1 %, of linear ones that hold the result.
    """

    name: str
    at: str
    kind: str
    hard: bool
    linear: bool
    unit: str | None
    before: float | bool | str | None
    after: float | bool | str | None
    limit: Mapping[str, float | bool | str]
    margin: float | None
    excess_before: float | None
    excess: float | None
    passed: bool
    active: bool
    where: str
    reason: str
    per_percent: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class TuneStart(RecordPart):
    """One search.

    Attributes:
        values: parameter → value at which it began.
        objective: at which it ended; None: nothing could be evaluated, see `reason`.
        steps: evaluations.
        reason: how it ended.
    """

    values: Mapping[str, float]
    objective: float | None
    steps: int
    reason: str


@dataclass(frozen=True, eq=False, kw_only=True)
class TradeOff(RecordPart):
    """What one requirement costs the other.

    Attributes:
        first: its worst value, as a multiple of its scale beyond the limit (at most 0: met), rising, shape (k,).
        second: least value of the other one there, shape (k,).
    """

    first: Floats
    second: Floats = field(metadata=entry(dims=("first",)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Conflict(RecordPart):
    """Requirements that cannot be met together, as far as was found.

    Attributes:
        requirements: their names: one that cannot be met alone, two that exclude each other, or more.
        excess: least value of the worst of them, as a multiple of its scale beyond the limit.
        trade_off: of two; None: there are not two.
    """

    requirements: tuple[str, ...]
    excess: float
    trade_off: TradeOff | None = None

    @property
    def words(self) -> str:
        """The conflict in a sentence."""
        if len(self.requirements) == 1:
            return f"{self.requirements[0]} cannot be met by itself, as far as was found"
        return f"{' and '.join(self.requirements)} exclude each other, as far as was found"


@dataclass(frozen=True, eq=False, kw_only=True)
class TuneResult(Result):
    """Parameters that meet the requirements of a study, or come as near as was found.

    Attributes:
        system: its name.
        study: with the requirements.
        parameters: that were found.
        requirements: at every point, as the study measures them.
        objective: largest soft requirement, the distance beyond its limit over its scale: at most 0 where all are met;
            None: nothing could be evaluated.
        history: objective at the steps of the search that led to the result.
        starts: the searches.
        worst: point of the envelope with the smallest margin of its requirement; empty: the study has no envelope.
        added: points that were added because they were worse.
        conflict: None: there is none, or all is met.
        measured, reused: how many analyses were run, and how many were in the store.
        evaluations: of linear models.
        reason: why the search ended.
        files: the study and every file that the models consist of → SHA-256.
        notes: what should be known, one line each.
    """

    _page = "workbench.study.tune.page:tune_page"
    _picture = "workbench.study.tune.picture:plot_tuning"

    system: str
    study: str
    parameters: tuple[TunedParameter, ...]
    requirements: tuple[TunedRequirement, ...]
    objective: float | None
    history: tuple[float, ...]
    starts: tuple[TuneStart, ...]
    worst: Mapping[str, float | bool | str]
    added: tuple[str, ...]
    conflict: Conflict | None
    measured: int
    reused: int
    evaluations: int
    reason: str
    files: Mapping[str, str]
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a tuning", "tune"

    @property
    def passed(self) -> bool:
        """Whether every requirement is met at every point."""
        return all(r.passed for r in self.requirements)

    @property
    def values(self) -> dict[str, float]:
        """Parameter → value, as `start_values` takes them."""
        return {p.name: p.value for p in self.parameters}

    def derived(self) -> dict[str, Any]:
        """Return whether all is met, and the values.

        Keys:
            passed: whether every requirement is met at every point.
            set: parameter → value, as `--set` takes them.
        """
        return {"passed": self.passed, "set": self.values}

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns: those of each row stand in it."""
        return {}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each requirement at each point."""
        yield ("requirement", "at", "hard", "before", "after", "unit", "margin", "passed", "active", "where")
        for r in self.requirements:
            yield (r.name, r.at, r.hard, r.before, r.after, r.unit or "", r.margin, r.passed, r.active, r.where)
