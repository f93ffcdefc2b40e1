"""Which analyses a study runs: one for each that differs by model, options or files."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from workbench import __version__
from workbench.errors import InputError, LostError
from workbench.study.commands import Command, Reference
from workbench.study.description import Change, GridPoint, Study, StudyAnalysis
from workbench.study.fingerprint import Hashes, code_hash
from workbench.study.position_in_file import place

__all__ = ["OUTPUTS", "Plan", "PlannedRun", "RunResult", "make_plan", "with_label"]

# Options by which commands write files; their paths are kept apart for each point.
OUTPUTS = ("plot", "csv", "report", "bode", "out")
_LOST = tuple(error.kind for error in LostError.__subclasses__())


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedRun:
    """One analysis at one point.

    Attributes:
        analysis: what is run.
        point: as far as it concerns the analysis.
        models: as the point has them.
        options: of the command, by its keys: the model's and those of the analysis.
        words: the arguments of the program that do the same; results of others stand as NAME.json.
        wants: CSV files that other analyses take.
        needs: name of an analysis referred to → its run.
        subject: what the result depends on, but the options: for the store.
        key: the options, and all that those referred to depend on: for the store.
        files: that the run writes by its own options.
        rows: "more": a time history is read between its rows, and gets as many as it needs; "told": it keeps those that
            were asked for, and says what they leave out; empty: neither.
    """

    analysis: StudyAnalysis
    point: GridPoint
    models: tuple[Change, ...]
    options: Mapping[str, Any]
    words: Sequence[str]
    wants: tuple[str, ...]
    needs: Mapping[str, PlannedRun]
    subject: Mapping[str, Any]
    key: str
    files: tuple[Path, ...]
    rows: str = ""

    @property
    def label(self) -> str:
        """For people: "response (worn)"."""
        return f"{self.analysis.name} ({self.point.label})" if self.point.label else self.analysis.name

    @property
    def command_line(self) -> str:
        """What does the same by hand."""
        return shlex.join(["workbench", *self.words])


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """What one run of an analysis gave.

    Attributes:
        result: the JSON of the command; None: there is none, `reason` says why.
        code: exit code of the command; 1: points of it failed.
        reason: why there is no result.
        kind: what went wrong, see `WorkbenchError.kind`; empty: nothing did.
        notes: remarks of the command, one line each.
        seconds: that it took when it was measured.
        files: "csv" and further CSV files by what follows NAME_ → text; those that other analyses take.
        reused: whether it comes from the store.
    """

    result: Mapping[str, Any] | None = None
    code: int = 2
    reason: str = ""
    kind: str = ""
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    files: Mapping[str, str] = field(default_factory=dict)
    reused: bool = False

    @property
    def lasting(self) -> bool:
        """Whether it may be kept: what was interrupted, or lost a point by a crash or limit, is measured again."""
        if self.result is None or self.code not in (0, 1):
            return False
        return self.code == 0 or not _lost(self.result)

    def to_store(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return {k: v for k, v in asdict(self).items() if k not in ("reused", "reason", "kind")}

    @classmethod
    def from_store(cls, data: Mapping[str, Any]) -> RunResult:
        """Return what `to_store` describes."""
        result: RunResult = TypeAdapter(cls).validate_python({**data, "reused": True})
        return result


def _lost(part: object) -> bool:
    """Return whether a part of a record says that a point of it was lost with its process."""
    if isinstance(part, Mapping):
        return part.get("kind") in _LOST or any(_lost(value) for value in part.values())
    return isinstance(part, list | tuple) and any(_lost(value) for value in part)


def _words(command: Command, models: Sequence[Change], options: Mapping[str, Any]) -> list[str]:
    ordered = sorted(options, key=lambda key: key != command.subject)
    words = [word for key in ordered for word in command.words(key, options[key])]
    return [*command.head, *(str(model.model) for model in models), *words]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """All runs of a study.

    Attributes:
        points: of the grid.
        runs: each once, those referred to before those that refer to them.
        at: (analysis, number of the point) → its run.
        notes: what should be known before, one line each.
    """

    points: Sequence[GridPoint]
    runs: Sequence[PlannedRun]
    at: Mapping[tuple[str, int], PlannedRun]
    notes: Sequence[str]


def make_plan(study: Study, points: Sequence[GridPoint] | None = None) -> Plan:
    """Return what has to be run.

    Args:
        study: what was asked for.
        points: at which; None: those of its grid.

    Raises:
        InputError: a file cannot be read; a parameter of the grid for a command that has no `set`.
    """
    return _Planner(study).plan(study.points if points is None else points)


class _Planner:
    """Makes runs, each once.

    Args:
        study: what was asked for.
    """

    def __init__(self, study: Study) -> None:
        self._study = study
        self._references = {name: analysis.references for name, analysis in study.analyses.items()}
        self._runs: dict[str, PlannedRun] = {}
        self._notes: dict[str, None] = {}
        self._files = Hashes(study.folder)
        self._common = {"workbench": __version__, "code": code_hash()}

    def plan(self, every: Sequence[GridPoint]) -> Plan:
        """Return all of it at some points."""
        at: dict[tuple[str, int], PlannedRun] = {}
        for k, point in enumerate(every):
            for name in self._ordered():
                at[name, k] = self._run(name, point, {r.analysis: at[r.analysis, k] for r in self._references[name]})
        return Plan(points=every, runs=list(self._runs.values()), at=at, notes=list(self._notes))

    def _ordered(self) -> list[str]:
        """Return the analyses in the order of the file, those referred to first."""
        done: dict[str, None] = {}

        def visit(name: str) -> None:
            for reference in self._references[name]:
                visit(reference.analysis)
            done[name] = None

        for name in self._study.analyses:
            visit(name)
        return list(done)

    def _models(self, name: str) -> set[str]:
        """Return the models that an analysis depends on."""
        return set(self._study.analyses[name].models).union(*(self._models(r.analysis) for r in self._references[name]))

    def _run(self, name: str, point: GridPoint, needs: Mapping[str, PlannedRun]) -> PlannedRun:
        analysis = self._study.analyses[name]
        models = tuple(self._study.model_at(model, point) for model in analysis.models)
        part = self._study.part_of(point, self._models(name))
        options = self._options(analysis, models)
        files = {key: with_label(Path(options[key]), part.label) for key in OUTPUTS if key in options}
        options |= {key: str(path) for key, path in files.items()}
        wants = tuple(sorted({r.kind for r in self._wanted(name)} - {"json"}))
        with place(f"[analyses.{name}]"), chdir(self._study.folder):
            words = _words(analysis.command, models, options)
            asks = analysis.command.asks(options)
        hashes = self._hashes(models, [word for word in words if not _writes(word)])
        subject = {**self._common, "command": analysis.command.name, "files": hashes}
        rows = self._rows(analysis, options, wants)
        asks |= {"rows": [rows]} if rows else {}
        key = _key({"models": [str(model.model) for model in models], "options": asks}, wants, needs)
        identity = json.dumps([subject, key], sort_keys=True)
        if identity not in self._runs:
            self._runs[identity] = PlannedRun(
                analysis=analysis, point=part, models=models, options=options, words=words, wants=wants,
                needs=needs, subject=subject, key=key, files=tuple(self._study.folder / p for p in files.values()),
                rows=rows,
            )  # fmt: skip
        return self._runs[identity]

    def _rows(self, analysis: StudyAnalysis, options: Mapping[str, Any], wants: Sequence[str]) -> str:
        """Return how the rows of a time history are to be, see `PlannedRun`."""
        if analysis.name not in self._study.between:
            return ""
        others = [r.analysis for references in self._references.values() for r in references]
        free = self._study.between[analysis.name] and analysis.name not in others and not wants
        return "more" if free and not {"step", "csv", "mat"} & set(options) else "told"

    def _wanted(self, name: str) -> Iterator[Reference]:
        for references in self._references.values():
            yield from (r for r in references if r.analysis == name)

    def _options(self, analysis: StudyAnalysis, models: Sequence[Change]) -> dict[str, Any]:
        """Return how the models are opened, then the options of the analysis; `set` and `bias` are joined."""
        where, command, own = f"[analyses.{analysis.name}]", analysis.command, analysis.options
        if any(model.options != models[0].options for model in models):
            raise InputError(
                f"{where}: '{command.name}' opens all its models in the same way, but their set, bias, … differ"
            )
        result: dict[str, Any] = {}
        for name, value in models[0].options.items() if models else ():
            if name not in command.options:
                self._not_taken(where, command, name, models[0])
            elif isinstance(value, Mapping) and name in own:
                with place(where):
                    result[name] = {**value, **command.table(name, own[name])}
            else:
                result[name] = value
        return {**result, **{name: value for name, value in own.items() if not isinstance(result.get(name), Mapping)}}

    def _not_taken(self, where: str, command: Command, name: str, model: Change) -> None:
        self._notes[f"{where}: '{command.name}' has no option {name}; it uses {model.model} as it is"] = None

    def _hashes(self, models: Sequence[Change], words: Sequence[str]) -> dict[str, str]:
        """Return the hashes of all files that the arguments name, systems with their FMUs."""
        result: dict[str, str] = {}
        for model in models:
            result |= self._files.of_model(str(model.model))
        for word in words:
            result |= self._files.of_word(word)
        return result


def _writes(word: str) -> bool:
    return any(word.startswith(f"--{name}=") for name in OUTPUTS)


def with_label(path: Path, label: str) -> Path:
    """Return the path of a file of one point of the grid.

    Args:
        path: of the file, where there is only one.
        label: of the point; empty: there is only one.
    """
    plain = "".join(c if c.isalnum() or c in "._=-" else "_" for c in label.replace(" ", ""))
    return path.with_stem(f"{path.stem}_{plain}") if plain else path


def _key(options: Mapping[str, Any], wants: Sequence[str], needs: Mapping[str, PlannedRun]) -> str:
    """Return what tells a run from others of the same subject, as text; the order of options does not."""
    others = {name: [run.subject, run.key] for name, run in needs.items()}
    return json.dumps({"asked": options, "wants": list(wants), "needs": others}, sort_keys=True)
