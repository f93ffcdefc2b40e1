"""Names of variables in a study, looked up in its models before anything runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.core.records.names_in_text import check_names as refuse_names
from workbench.core.records.names_in_text import split_names
from workbench.errors import InputError, WorkbenchError
from workbench.fmi.bundled import is_bundled
from workbench.model.described_model import DescribedModel
from workbench.study.description import Change, Study
from workbench.study.plan import PlannedRun
from workbench.study.position_in_file import place
from workbench.system.load import load

__all__ = ["check_names", "units_of"]

# Options that name variables, whatever the command.
_NAMES = ("input", "inputs", "output", "outputs")
_MATRICES = ".json"  # of a linear model: it has no variables to look for
_VALUES = ("set", "bias")


def check_names(study: Study, runs: Sequence[PlannedRun]) -> None:
    """Open each model once and look for the variables that the analyses name.

    Args:
        study: that they belong to.
        runs: that are going to be run.

    Raises:
        InputError: no such parameter, input or output; near names in the message.
        FmuError: a model cannot be opened.
    """
    opened: dict[tuple[str, str], _ModelNames] = {}
    for run in runs:
        for name, model in zip(run.analysis.models, run.models, strict=True):
            if Path(str(model.model)).suffix.lower() == _MATRICES:
                continue
            # Which parameters are set counts, not their values: a grid opens its models once.
            key = (str(model.model), repr([sorted(model.options.get(o, ())) for o in _VALUES]))
            if key not in opened:
                opened[key] = _open(study, name, model)
            with place(f"[analyses.{run.analysis.name}]"):
                _check(run, str(model.model), opened[key])


def units_of(study: Study, names: Sequence[str]) -> dict[str, str]:
    """Return the units of parameters, those that are known; each model is opened once.

    Args:
        study: that they belong to.
        names: "model.parameter".
    """
    result: dict[str, str] = {}
    for model in dict.fromkeys(name.partition(".")[0] for name in names):
        try:
            with _opened(study, study.models[model]) as opened:
                variables = (*opened.description.variables, *opened.parameters)
                result |= {f"{model}.{v.name}": v.unit for v in variables if v.unit}
        except (KeyError, WorkbenchError):
            continue  # results that are kept may be looked at without the model
    return {name: result[name] for name in names if name in result}


@dataclass(frozen=True)
class _ModelNames:
    """The variables of a model.

    Attributes:
        every: all of them.
        inputs: what can be forced, for suggestions.
        outputs: what is usually recorded, for suggestions.
    """

    every: frozenset[str]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


def _opened(study: Study, model: Change) -> DescribedModel:
    file = str(model.model)
    path = file if is_bundled(file) else str(study.folder / Path(file).expanduser())
    values = {option: dict(model.options.get(option, {})) for option in _VALUES}
    return load(path, start_values=values["set"], bias=values["bias"])


def _open(study: Study, name: str, model: Change) -> _ModelNames:
    try:
        with _opened(study, model) as opened:
            return _names(opened)
    except InputError as error:
        message = str(error).removeprefix("start_values: ")  # in a study the table says that
        raise InputError(f"{_where(study, name, message)}: {message}") from None


def _names(model: DescribedModel) -> _ModelNames:
    groups = (model.description.variables, model.inputs, model.outputs, model.parameters, model.states)
    every = frozenset(v.name for group in groups for v in group)
    outputs = tuple(v.name for v in (*model.outputs, *model.states))
    return _ModelNames(every, tuple(v.name for v in model.inputs), outputs)


def _where(study: Study, model: str, message: str) -> str:
    """Return the table that names what the model complains about."""
    spreads = () if study.envelope is None else study.envelope.spreads
    tables = {**dict.fromkeys(study.grid, "[grid]"), **{s.name: "[envelope.parameters]" for s in spreads}}
    for name, table in tables.items():
        owner, _, parameter = name.partition(".")
        if owner == model and parameter in message:
            return f'{table} "{name}"'
    return f"[models] {model}"


def _check(run: PlannedRun, file: str, names: _ModelNames) -> None:
    for key, name in _named(run.analysis.options):
        if name not in names.every:
            known, kinds = (names.inputs, ("input",)) if key.startswith("in") else (names.outputs, ("output", "state"))
            refuse_names([name], known, kinds=kinds, what=key, model=file)


def _named(options: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield (key, name of a variable)."""
    for key, value in options.items():
        if key not in _NAMES:
            continue
        items = list(value) if isinstance(value, list | Mapping) else [value]
        for item in items:
            if isinstance(item, str):
                yield from ((key, part) for part in _parts(item))


def _parts(text: str) -> list[str]:
    """Return the names in "a,b" or in "a=step:time=1,value=2"."""
    name, equals, _ = text.partition("=")
    return [name.strip()] if equals else split_names(text)
