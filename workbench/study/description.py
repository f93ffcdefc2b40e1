"""A study as it is written down."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.study.commands import Command, Reference, references
from workbench.study.requirements.base import Requirement, Scalar

if TYPE_CHECKING:
    from workbench.study.spread import Spread

__all__ = ["Approval", "Change", "Envelope", "GridPoint", "Study", "StudyAnalysis"]


@dataclass(frozen=True, kw_only=True)
class Change:
    """A model and how it is opened, or what a configuration changes of that.

    Attributes:
        model: file, `fmu:NAME`, or None where a configuration leaves it.
        options: option of the commands → value; `set` and `bias` are mappings.
    """

    model: str | None
    options: Mapping[str, Any] = field(default_factory=dict)

    def changed(self, change: Change) -> Change:
        """Return this with a change applied; `set` and `bias` are joined, the rest is replaced."""
        options = dict(self.options)
        for name, value in change.options.items():
            joined = isinstance(value, Mapping) and isinstance(options.get(name), Mapping)
            options[name] = {**options[name], **value} if joined else value
        return Change(model=change.model or self.model, options=options)


@dataclass(frozen=True, kw_only=True)
class StudyAnalysis:
    """One analysis.

    Attributes:
        name: in the study.
        command: that does it.
        models: in `Study.models`; none where the command takes none, several where it compares them.
        options: as given, by the keys of the command, references in them.
    """

    name: str
    command: Command
    models: tuple[str, ...]
    options: Mapping[str, Any]

    @property
    def references(self) -> list[Reference]:
        """What it takes from other analyses."""
        return list(references(self.options))


@dataclass(frozen=True, kw_only=True)
class GridPoint:
    """One point of the grid.

    Attributes:
        configuration: its name, or None where the study has none.
        values: "model.parameter" → value.
    """

    configuration: str | None = None
    values: Mapping[str, Scalar] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """For people: "worn, rudder.ps = 2e+07"; empty where there is nothing to tell apart."""
        values = [f"{name} = {_text(value)}" for name, value in self.values.items()]
        return ", ".join([*([self.configuration] if self.configuration else []), *values])


def _text(value: Scalar) -> str:
    return format(value, "g") if isinstance(value, float) else str(value).lower()


@dataclass(frozen=True, kw_only=True)
class Approval:
    """Who has to agree with a study, and whether they have.

    Attributes:
        role: e.g. "checked" or "chief engineer".
        name: of the person; empty: to be written by hand.
        date: as written; empty: not yet.
    """

    role: str
    name: str = ""
    date: str = ""


@dataclass(frozen=True, kw_only=True)
class Envelope:
    """What an envelope asks for.

    Attributes:
        spreads: of the parameters, in the order of the file.
        requirement: whose value is mapped, searched and counted.
        plan: one of `PLANS`.
        points: number of them for each failure, where the plan is not a grid.
        seed: of random numbers.
        confidence: of intervals.
        width: wanted of the interval of the probability; None: none.
        weights: failure → its probability, of sum 1; empty: not given.
        axes: the parameters of the map: two, or the only one.
        borders: analyses that find where stability changes along the map's first axis.
        lines: at so many values of the second axis.
        search: evaluations of the search for the worst case, for each failure; 0: no search.
    """

    spreads: tuple[Spread, ...]
    requirement: Requirement
    plan: str
    points: int
    seed: int
    confidence: float
    width: float | None
    weights: Mapping[str, float]
    axes: tuple[str, ...]
    borders: tuple[str, ...]
    lines: int
    search: int

    def spread(self, name: str) -> Spread:
        """Return how a parameter spreads."""
        return next(s for s in self.spreads if s.name == name)


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study as it is written down; nothing was opened or measured yet.

    Attributes:
        name: for people.
        description: for people.
        path: of the file; paths in it are relative to its folder.
        models: by name.
        configurations: name → model → change.
        grid: "model.parameter" → values.
        analyses: in the order of the file.
        requirements: likewise.
        id: of the document; empty: none.
        author: who wrote it; empty: not told.
        revision: as written; empty: not told.
        approvals: who has to agree.
        sha256: of the file.
        envelope: parameters that spread, in place of a grid; None: it has none.
        between: names of analyses whose rows a requirement reads between → whether nothing else reads them.
    """

    name: str
    description: str
    path: Path
    models: Mapping[str, Change]
    configurations: Mapping[str, Mapping[str, Change]]
    grid: Mapping[str, tuple[Scalar, ...]]
    analyses: Mapping[str, StudyAnalysis]
    requirements: tuple[Requirement, ...]
    id: str = ""
    author: str = ""
    revision: str = ""
    approvals: tuple[Approval, ...] = ()
    sha256: str = ""
    envelope: Envelope | None = None
    between: Mapping[str, bool] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        """Where relative paths begin."""
        return self.path.resolve().parent

    @property
    def points(self) -> list[GridPoint]:
        """Every combination of configuration and parameter values, in the order of the file."""
        configurations: list[str | None] = [*self.configurations] or [None]
        return [
            GridPoint(configuration=configuration, values=dict(zip(self.grid, values, strict=True)))
            for configuration in configurations
            for values in product(*self.grid.values())
        ]

    def alone(self, names: Iterable[str]) -> Study:
        """Return the study with some of its analyses and those that they refer to, without requirements."""
        wanted: dict[str, StudyAnalysis] = {}
        waiting = list(names)
        while waiting:
            name = waiting.pop()
            wanted[name] = self.analyses[name]
            waiting += [r.analysis for r in wanted[name].references if r.analysis not in wanted]
        kept = {name: analysis for name, analysis in self.analyses.items() if name in wanted}
        return replace(self, analyses=kept, requirements=())

    def model_at(self, model: str, point: GridPoint) -> Change:
        """Return a model as a point has it."""
        result = self.models[model]
        if point.configuration is not None:
            result = result.changed(self.configurations[point.configuration].get(model, Change(model=None)))
        split = [(name.partition("."), value) for name, value in point.values.items()]
        values = {parameter: value for (owner, _, parameter), value in split if owner == model}
        return result.changed(Change(model=None, options={"set": values})) if values else result

    def part_of(self, point: GridPoint, models: set[str]) -> GridPoint:
        """Return what of a point concerns some models: results differ only by that."""
        values = {name: value for name, value in point.values.items() if name.partition(".")[0] in models}
        configured = {model for changes in self.configurations.values() for model in changes}
        return GridPoint(configuration=point.configuration if configured & models else None, values=values)
