"""Which analyses a study runs: one for each that differs by model, options or files."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.errors import InputError
from workbench.study.arguments import arguments
from workbench.study.commands import Command, Commands
from workbench.study.description import Analysis, Change, Point, Reference, Study, Word
from workbench.study.fingerprint import Hashes, code_hash
from workbench.study.place import place
from workbench.study.points import model_at, part_of, points
from workbench.study.references import words_of

__all__ = ["OUTPUTS", "Plan", "Run", "make_plan"]

# Options by which commands write files; their paths are kept apart for each point.
OUTPUTS = ("plot", "csv", "report", "bode", "out")


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One analysis at one point.

    Attributes:
        analysis: what is run.
        point: as far as it concerns the analysis.
        words: the arguments, references in them.
        models: as the point has them.
        wants: CSV files that other analyses take.
        needs: name of an analysis referred to → its run.
        subject: what the result depends on, but the arguments: for the store.
        key: the arguments, and all that those referred to depend on: for the store.
        files: that the run writes by its own options.
    """

    analysis: Analysis
    point: Point
    words: tuple[Word, ...]
    models: tuple[Change, ...]
    wants: tuple[str, ...]
    needs: Mapping[str, Run]
    subject: Mapping[str, Any]
    key: str
    files: tuple[Path, ...]

    @property
    def label(self) -> str:
        """For people: "response (worn)"."""
        return f"{self.analysis.name} ({self.point.label})" if self.point.label else self.analysis.name

    @property
    def command_line(self) -> str:
        """What does the same by hand; results of others stand as NAME.json."""
        words = [w if isinstance(w, str) else f"{w.prefix}{_file_name(w)}" for w in self.words]
        return shlex.join(["workbench", *words])


def _file_name(reference: Reference) -> str:
    kind = reference.kind
    return f"{reference.analysis}.{kind}" if kind in ("json", "csv") else f"{reference.analysis}_{kind}.csv"


@dataclass(frozen=True, kw_only=True)
class Plan:
    """All runs of a study.

    Attributes:
        points: of the grid.
        runs: each once, those referred to before those that refer to them.
        at: (analysis, number of the point) → its run.
        notes: what should be known before, one line each.
    """

    points: Sequence[Point]
    runs: Sequence[Run]
    at: Mapping[tuple[str, int], Run]
    notes: Sequence[str]


def make_plan(study: Study, commands: Commands) -> Plan:
    """Return what has to be run.

    Args:
        study: what was asked for.
        commands: that do the analyses.

    Raises:
        InputError: a file cannot be read; a parameter of the grid for a command that has no `set`.
    """
    return _Planner(study, commands).plan()


class _Planner:
    """Makes runs, each once.

    Args:
        study: what was asked for.
        commands: that do the analyses.
    """

    def __init__(self, study: Study, commands: Commands) -> None:
        self._study, self._commands = study, commands
        self._words = {name: words_of(analysis, commands) for name, analysis in study.analyses.items()}
        self._references = {n: [w for w in words if isinstance(w, Reference)] for n, words in self._words.items()}
        self._runs: dict[str, Run] = {}
        self._notes: dict[str, None] = {}
        self._files = Hashes(study.folder)
        self._common = {"workbench": __version__, "code": code_hash()}

    def plan(self) -> Plan:
        """Return all of it."""
        every = points(self._study)
        at: dict[tuple[str, int], Run] = {}
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

    def _run(self, name: str, point: Point, needs: Mapping[str, Run]) -> Run:
        analysis = self._study.analyses[name]
        command = self._commands.get(analysis.command)
        models = tuple(model_at(self._study, model, point) for model in analysis.models)
        part = part_of(self._study, point, self._models(name))
        words, files = self._renamed([*self._model_words(analysis, command, models), *self._words[name]], part)
        wants = tuple(sorted({w.kind for w in self._wanted(name)} - {"json"}))
        words = [analysis.command, *words]
        subject = {**self._common, "command": analysis.command, "files": self._hashes(models, words)}
        key = _key(words, wants, needs)
        identity = json.dumps([subject, key], sort_keys=True)
        if identity not in self._runs:
            self._runs[identity] = Run(
                analysis=analysis, point=part, words=tuple(words), models=models, wants=wants, needs=needs,
                subject=subject, key=key, files=tuple(files),
            )  # fmt: skip
        return self._runs[identity]

    def _wanted(self, name: str) -> Iterator[Reference]:
        for references in self._references.values():
            yield from (r for r in references if r.analysis == name)

    def _model_words(self, analysis: Analysis, command: Command, models: Sequence[Change]) -> list[Word]:
        """Return the models and their options, but those that the analysis gives itself."""
        if not models:
            return []
        where = f"[analyses.{analysis.name}]"
        if any(model.options != models[0].options for model in models):
            raise InputError(
                f"{where}: '{command.name}' opens all its models in the same way, but their set, bias, … differ"
            )
        options = {}
        for name, value in models[0].options.items():
            if name not in command.options:
                self._not_taken(where, command, name, models[0])
            elif isinstance(value, Mapping) and isinstance(analysis.options.get(name), Mapping):
                options[name] = {k: v for k, v in value.items() if k not in analysis.options[name]}
            elif isinstance(value, Mapping) or name not in analysis.options:
                options[name] = value
        with place(where):
            return [*(str(model.model) for model in models), *arguments(command, options)]

    def _not_taken(self, where: str, command: Command, name: str, model: Change) -> None:
        self._notes[f"{where}: '{command.name}' has no option {name}; it uses {model.model} as it is"] = None

    def _renamed(self, words: Sequence[Word], point: Point) -> tuple[list[Word], list[Path]]:
        """Keep files that are written at several points apart; return the arguments and the files."""
        found: list[Word] = []
        files: list[Path] = []
        for word in words:
            name, equals, value = word.partition("=") if isinstance(word, str) else ("", "", "")
            if equals and name.removeprefix("--") in OUTPUTS and name.startswith("--"):
                path = _with_label(Path(value), point.label)
                files.append(self._study.folder / path)
                found.append(f"{name}={path}")
            else:
                found.append(word)
        return found, files

    def _hashes(self, models: Sequence[Change], words: Sequence[Word]) -> dict[str, str]:
        """Return the hashes of all files that the arguments name, systems with their FMUs."""
        found: dict[str, str] = {}
        for model in models:
            found |= self._files.of_model(str(model.model))
        for word in words:
            if isinstance(word, str) and not _writes(word):
                found |= self._files.of_word(word)
        return found


def _writes(word: str) -> bool:
    return any(word.startswith(f"--{name}=") for name in OUTPUTS)


def _with_label(path: Path, label: str) -> Path:
    plain = "".join(c if c.isalnum() or c in "._=-" else "_" for c in label.replace(" ", ""))
    return path.with_stem(f"{path.stem}_{plain}") if plain else path


def _key(words: Sequence[Word], wants: Sequence[str], needs: Mapping[str, Run]) -> str:
    """Return what tells a run from others of the same subject, as text."""
    plain = [w if isinstance(w, str) else {"from": w.analysis, "as": w.kind, "prefix": w.prefix} for w in words]
    others = {name: [run.subject, run.key] for name, run in needs.items()}
    return json.dumps({"arguments": plain, "wants": list(wants), "needs": others}, sort_keys=True)
