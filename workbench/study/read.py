"""Read a study from its file."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from workbench.core.machine.bundled_files import bundled_files, find_bundled
from workbench.core.machine.files import close_files, named_path
from workbench.core.records.record import read_toml_table
from workbench.errors import InputError, suggest
from workbench.study.commands import COMMANDS, Command, Reference, meant, references
from workbench.study.description import Approval, Change, Study, StudyAnalysis
from workbench.study.position_in_file import Mistakes, in_file, known, place
from workbench.study.requirements import read_requirement
from workbench.study.requirements.base import Requirement, Scalar
from workbench.system.files.toml_schema import TomlTable, read_table

__all__ = ["bundled_studies", "has_envelope", "is_bundled_study", "locate_study", "read_study"]

_PREFIX = "study:"
# The runner gives these itself.
_OURS = {"json": "results are in the JSON of the study", "store": "the study has its own store"}
_FILES = (".fmu", ".toml", ".ssp", ".ssd", ".json")


class ApprovalTable(TomlTable):
    """Who has to agree with a study; without name and date the report has a line to sign.

    Attributes:
        role: e.g. "checked" or "chief engineer".
        name, date: of who has agreed; without it the report has a line to sign.
    """

    role: str = Field(min_length=1)
    name: str = ""
    date: str = ""


class StudyTable(TomlTable):
    """The whole file; what the tables hold is read table by table.

    Attributes:
        name: name of the study.
        description: what the study is about.
        id, author, revision: of the document, for the report.
        approvals: who has to agree.
        models: name → model.
        configurations: name → changes of models; everything is run in each of them.
        grid: "model.parameter" → list of values; everything is run at all combinations.
        envelope: parameters that spread, in place of a grid.
        analyses: name → analysis: a command with its options.
        requirements: what the results are compared with.
    """

    name: str | None = None
    description: str = ""
    id: str = ""
    author: str = ""
    revision: str = ""
    approvals: list[ApprovalTable] = Field(default_factory=list)
    models: dict[str, Any] = Field(default_factory=dict)
    configurations: dict[str, Any] = Field(default_factory=dict)
    grid: dict[str, Any] = Field(default_factory=dict)
    envelope: dict[str, Any] | None = None
    analyses: dict[str, Any]
    requirements: list[Any] = Field(default_factory=list)


class AnalysisTable(TomlTable):
    """The keys of an analysis that are no options of its command."""

    command: str


class ChangeTable(TomlTable):
    """What a configuration changes of a model. Times in [s].

    Attributes:
        model: FMU (.fmu, fmu:NAME), or a system.
        set: parameters and start values.
        bias: constants added to inputs.
        interface: me (model exchange), cs (co-simulation) or auto.
        solver: integrator for model exchange.
        step: communication step of co-simulation [s].
        tolerance: relative tolerance of the integrator.
        start: time at which runs begin [s].
    """

    model: str | None = None
    set: dict[str, Scalar] = Field(default_factory=dict)
    bias: dict[str, float] = Field(default_factory=dict)
    interface: Literal["auto", "me", "cs"] | None = None
    solver: Literal["auto", "vkm", "gear", "none", "fmu"] | None = None
    step: float | None = Field(default=None, gt=0.0)
    tolerance: float | None = Field(default=None, gt=0.0, lt=1.0)
    start: float | None = None


class ModelTable(ChangeTable):
    """A model: an FMU, `fmu:NAME`, or a system, and how it is opened."""

    model: str


def is_bundled_study(name: str) -> bool:
    """Whether `name` asks for a bundled study."""
    return name.startswith(_PREFIX)


def bundled_studies() -> dict[str, Path]:
    """Return the bundled studies, name → file."""
    return bundled_files("studies")


def has_envelope(name: str) -> bool:
    """Return whether a name is that of a study with a table [envelope], as far as it can be read.

    Args:
        name: a path or `study:NAME`; any other word has none.
    """
    if not (is_bundled_study(name) or name.lower().endswith(".toml")):
        return False
    try:
        with locate_study(name).open("rb") as file:
            return "envelope" in tomllib.load(file)
    except (InputError, OSError, ValueError, RecursionError):  # what is wrong with it, who reads it says
        return False


def locate_study(name: str | Path) -> Path:
    """Return the file of a study: a path or `study:NAME`.

    Raises:
        InputError: nothing there; the message names near files.
    """
    if is_bundled_study(str(name)):
        return find_bundled(str(name), bundled_studies(), "study")
    path = named_path(name)
    if path.is_file():
        return path
    if path.is_dir():
        raise InputError(f"{name}: is a folder; name the study in it")
    if path.exists():
        raise InputError(f"{name}: is a device or a pipe; a study is a .toml file, or study:NAME")
    if str(name) in bundled_studies():
        raise InputError(f"{name}: no such file; did you mean {_PREFIX}{name}?")
    near = close_files(path, [".toml"])
    hint = f"did you mean {', '.join(near)}? Else " if near else ""
    raise InputError(f"{name}: no such file; {hint}give a study as .toml, or study:NAME")


def read_study(name: str | Path, *, folder: Path | None = None) -> Study:
    """Return the study that a file describes.

    Args:
        name: a path, or `study:NAME`.
        folder: that paths in it are relative to; None: its own. For drafts, which lie elsewhere.

    Raises:
        InputError: one line with the file, the table and the key: no such file, not TOML, a key that is unknown (near
            names in the message) or missing, a value of the wrong type, a name that is not there or given twice, a
            requirement without a limit or for another kind of analysis.
    """
    path = locate_study(name)
    if _is_archive(path):
        raise InputError(
            f"{path}: is an FMU or another archive, not a study; workbench info {path} shows what is in an FMU, "
            "workbench run --example prints a study to begin with"
        )
    data = read_toml_table(path)
    if "components" in data and "analyses" not in data:
        raise InputError(
            f"{path}: is a system, not a study: info, check, simulate, lin, nfr, loop and others take it, as does a "
            "study as one of its models"
        )
    with in_file(path):
        study = _study(path, data, folder or path.parent)
        _check_references(study)
    return study


def _is_archive(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4) == b"PK\x03\x04"


def _check_references(study: Study) -> None:
    """Check that no reference leads nowhere or back.

    Raises:
        InputError: one line with the table and the key.
    """
    for analysis in study.analyses.values():
        for reference in analysis.references:
            _check_reference(analysis, reference, study)
    for name in study.analyses:
        _check_circle(name, study, ())


def _check_reference(analysis: StudyAnalysis, reference: Reference, study: Study) -> None:
    where = f"[analyses.{analysis.name}]"
    known(where, "analysis", reference.analysis, study.analyses)
    source = study.analyses[reference.analysis]
    if reference.kind == "json":
        return
    if "csv" not in source.command.options:
        raise InputError(f"{where}: [analyses.{source.name}] runs {source.command.name}, which writes no CSV")
    if "csv" in source.options:
        raise InputError(
            f"[analyses.{source.name}]: leave 'csv' out: [analyses.{analysis.name}] takes it from the store"
        )


def _check_circle(name: str, study: Study, before: tuple[str, ...]) -> None:
    if name in before:
        raise InputError(f"[analyses.{name}]: needs its own result, by way of {', '.join(before)}")
    for reference in study.analyses[name].references:
        _check_circle(reference.analysis, study, (*before, name))


def _study(path: Path, data: Mapping[str, Any], folder: Path) -> Study:
    table = read_table(StudyTable, data, "")
    mistakes = Mistakes()
    models = {name: Change(model=None, options={}) for name in table.models}
    for name, given in table.models.items():
        with mistakes.kept():
            models[name] = _model(name, given, folder)
    analyses: dict[str, StudyAnalysis] = {}
    for name, given in table.analyses.items():
        with mistakes.kept():
            analyses[name] = _analysis(name, given, models, folder)
    if not table.analyses:
        raise InputError("[analyses]: is empty; give at least one, as in [analyses.response]")
    configurations: dict[str, dict[str, Change]] = {name: {} for name in table.configurations}
    for name, given in table.configurations.items():
        with mistakes.kept():
            configurations[name] = _configuration(name, given, models, folder)
    grid: dict[str, tuple[Scalar, ...]] = {}
    with mistakes.kept():
        grid |= _grid(table.grid, models)
    unread = table.analyses.keys() - analyses.keys()
    requirements: list[Requirement] = []
    for number, given in enumerate(table.requirements, start=1):
        with mistakes.kept():
            requirements += _requirement(
                number,
                given,
                analyses=analyses,
                unread=unread,
                configurations=configurations,
                grid=grid,
                before=requirements,
            )
    mistakes.tell()
    study = Study(
        name=table.name or path.stem,
        description=table.description,
        path=path,
        models=models,
        configurations=configurations,
        grid=grid,
        analyses=analyses,
        requirements=tuple(requirements),
        id=table.id,
        author=table.author,
        revision=table.revision,
        approvals=tuple(Approval(role=a.role, name=a.name, date=a.date) for a in table.approvals),
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        between=_between(requirements),
    )
    if table.envelope is None:
        return study
    from workbench.study.envelope_table import read_envelope  # noqa: PLC0415 - few studies have one, and it is slow

    return replace(study, envelope=read_envelope(table.envelope, study))


def _between(requirements: Sequence[Requirement]) -> dict[str, bool]:
    """Return the analyses whose rows a requirement reads between → whether nothing else reads them."""
    readers = [(name, r.between_rows) for r in requirements for name in r.analyses]
    names = dict.fromkeys(name for name, between in readers if between)
    return {name: all(between for other, between in readers if other == name) for name in names}


# -- models ------------------------------------------------------------------------------------


def _model(name: str, given: object, folder: Path) -> Change:
    where = f"[models] {name}"
    if isinstance(given, str):
        given = {"model": given}
    if not isinstance(given, dict):
        raise InputError(f'{where}: must be a file such as "Plant.fmu" or a table such as {{model = "Plant.fmu"}}')
    return _change(read_table(ModelTable, given, where), where, folder)


def _change(table: ChangeTable, where: str, folder: Path) -> Change:
    if table.model is not None:
        existing(table.model, folder, where)
    options = {k: v for k, v in table.model_dump(exclude={"model"}).items() if v not in (None, {})}
    return Change(model=table.model, options=options)


def existing(model: str, folder: Path, where: str) -> Path:
    """Return the file of a model.

    Raises:
        InputError: nothing there; the message names near files of that folder.
    """
    from workbench.fmi.bundled import bundled_path, is_bundled  # noqa: PLC0415

    if is_bundled(model):
        try:
            return bundled_path(model)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
    path = (folder / named_path(model)).resolve()
    if path.exists():
        return path
    near = [p.name for p in path.parent.glob(f"*{path.suffix}")] if path.parent.is_dir() else []
    raise InputError(f"{where}: no such file: {path}; {suggest(path.name, near)}{'' if near else ' in that folder'}")


def _configuration(name: str, given: object, models: Mapping[str, Change], folder: Path) -> dict[str, Change]:
    where = f"[configurations.{name}]"
    if not isinstance(given, dict):
        raise InputError(f"{where}: must be a table of models, as in {name} = {{plant = {{set = {{k = 2.0}}}}}}")
    changes: dict[str, Change] = {}
    for model, change in given.items():
        known(where, "model", model, models)
        inner = {"model": change} if isinstance(change, str) else change
        if not isinstance(inner, dict):
            raise InputError(f"{where}: {model} must be a file or a table such as {{set = {{k = 2.0}}}}")
        changes[model] = _change(read_table(ChangeTable, inner, f"{where} {model}"), f"{where} {model}", folder)
    return changes


def _grid(given: Mapping[str, Any], models: Mapping[str, Change]) -> Iterator[tuple[str, tuple[Scalar, ...]]]:
    for name, values in _flat(given):
        where = f'[grid] "{name}"'
        model, dot, _ = name.partition(".")
        if not dot:
            raise InputError(f'{where}: must be "model.parameter"; models: {", ".join(models) or "none"}')
        known(where, "model", model, models)
        if (
            not isinstance(values, list)
            or not values
            or not all(isinstance(v, bool | int | float | str) for v in values)
        ):
            raise InputError(f"{where}: must be a list of values, as in [1.0, 2.0]")
        if len(set(map(repr, values))) < len(values):
            raise InputError(f"{where}: a value appears twice")
        yield name, tuple(values)


def _flat(given: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield names and values. TOML reads an unquoted plant.k as table plant with key k: both ways are taken."""
    for key, value in given.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


# -- analyses and requirements -----------------------------------------------------------------


def _analysis(name: str, given: object, models: dict[str, Change], folder: Path) -> StudyAnalysis:
    where = f"[analyses.{name}]"
    if not isinstance(given, dict):
        raise InputError(f'{where}: must be a table with a command, as in command = "nfr"')
    name_of = read_table(AnalysisTable, {k: v for k, v in given.items() if k == "command"}, where).command
    known(where, "command", name_of, COMMANDS)
    facts = meant(name_of, given)
    own = {"command", facts.request.chosen_by.lstrip("-")}
    options: dict[str, Any] = {}
    mistakes = Mistakes()
    for key, value in given.items():
        with mistakes.kept(), place(where):
            if key in _OURS:
                raise InputError(f"leave '{key}' out: {_OURS[key]}")
            if key not in own:
                options[facts.key(key)] = _option(facts, key, value, folder)
    mistakes.tell()
    request: list[object] = []
    if facts.on_models and not isinstance(options.get(facts.subject), Reference):
        request = _asked(where, facts, options.pop(facts.subject, None), models)
    names = tuple(_model_of(where, model, models, folder) for model in request)
    return StudyAnalysis(name=name, command=facts, models=names, options=options)


def _option(facts: Command, key: str, value: Any, folder: Path) -> Any:  # noqa: ANN401 - what TOML can hold
    """Return the value of an option with references as such; without any it is read, and refused if it is wrong."""
    result = _referring(key, value)
    if not any(references(result)):
        with chdir(folder):
            facts.values({facts.key(key): result})
    return result


def _referring(key: str, value: Any) -> Any:  # noqa: ANN401 - what TOML can hold
    """Return a value with references as such."""
    if isinstance(value, list):
        return [_referring(key, item) for item in value]
    if not isinstance(value, Mapping):
        return value
    if "from" not in value:
        return {name: _referring(key, item) for name, item in value.items()}
    unknown = set(value) - {"from", "as"}
    if unknown:
        raise InputError(f"key '{key}': '{min(unknown)}' is unknown beside 'from'; known: as, from")
    if not all(isinstance(v, str) for v in value.values()):
        raise InputError(f"key '{key}': from and as must be strings")
    return Reference(analysis=value["from"], kind=value.get("as", "json"))


def _asked(where: str, command: Command, given: object, models: Mapping[str, Change]) -> list[object]:
    """Return the models that an analysis names: one, or as many as its command takes."""
    if given is None:
        raise InputError(f"{where}: key '{command.subject}' is missing; models: {', '.join(models) or 'none'}")
    if not isinstance(given, list):
        return [given]
    if not command.several or not given:
        raise InputError(f"{where}: key '{command.subject}' takes {'at least ' if command.several else ''}one model")
    return given


def _model_of(where: str, model: object, models: dict[str, Change], folder: Path) -> str:
    """Return the name of an analysis's model; a file or `fmu:NAME` is taken as a model of that name."""
    if not isinstance(model, str):
        raise InputError(f"{where}: a model must be named by a string, not {model!r}")
    if model not in models and (":" in model or Path(model).suffix.lower() in _FILES):
        existing(model, folder, where)
        models[model] = Change(model=model)
    known(where, "model", model, models)
    return model


def _requirement(
    number: int,
    data: object,
    *,
    analyses: Mapping[str, StudyAnalysis],
    unread: Collection[str],
    configurations: Mapping[str, object],
    grid: Mapping[str, tuple[Scalar, ...]],
    before: Sequence[Requirement],
) -> Iterator[Requirement]:
    """Yield a requirement, unless it is about an analysis with which something is wrong."""
    where = _where(number, data)
    mistakes, every = Mistakes(), [*analyses, *unread]
    _check_judged(where, data)
    with mistakes.kept():
        requirement = read_requirement(data, where)
    if isinstance(data, Mapping) and isinstance(name := data.get("analysis"), str):
        with mistakes.kept():
            known(where, "analysis", name, every)
    mistakes.tell()
    if any(r.name == requirement.name for r in before):
        raise InputError(f"{where}: the name appears twice; give each requirement its own name")
    for name in requirement.analyses:
        known(where, "analysis", name, every)
    for name in requirement.configurations or ():
        known(where, "configuration", name, configurations)
    _check_grid(where, requirement, grid)
    if not set(requirement.analyses) & set(unread):
        requirement.check(where, [analyses[name].command.name for name in requirement.analyses])
        yield requirement


def _check_judged(where: str, data: object) -> None:
    """Refuse a requirement that would be judged at no point."""
    given = data if isinstance(data, Mapping) else {}
    values = given.get("grid")
    lists = {"configurations": given.get("configurations")}
    lists |= {f"grid: {name}": value for name, value in values.items()} if isinstance(values, Mapping) else {}
    for name, value in lists.items():
        if value == []:
            raise InputError(
                f"{where}: {name}: is empty, so that it would be judged nowhere; leave it out for everywhere"
            )


def _check_grid(where: str, requirement: Requirement, grid: Mapping[str, tuple[Scalar, ...]]) -> None:
    for name, values in requirement.grid.items():
        known(f"{where}: grid", "parameter", name, grid)
        for value in values if isinstance(values, list) else [values]:
            if value not in grid[name]:
                had = ", ".join(map(str, grid[name]))
                raise InputError(f"{where}: grid: {name} is never {value}; it is: {had}")


def _where(number: int, data: object) -> str:
    name = data.get("name") if isinstance(data, Mapping) else None
    return f'[[requirements]] "{name}"' if isinstance(name, str) and name else f"[[requirements]] number {number}"
