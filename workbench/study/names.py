"""Names of variables in a study, looked up in its models before anything runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench.errors import InputError, suggest
from workbench.fmi.bundled import is_bundled
from workbench.study.description import Change, Study
from workbench.study.place import place
from workbench.study.plan import Run
from workbench.system.load import load

__all__ = ["check_names"]

# Options that name variables, whatever the command.
_NAMES = ("input", "inputs", "output", "outputs")
_VALUES = ("set", "bias")


def check_names(study: Study, runs: Sequence[Run]) -> None:
    """Open each model once and look for the variables that the analyses name.

    Args:
        study: that they belong to.
        runs: that are going to be run.

    Raises:
        InputError: no such parameter, input or output; near names in the message.
        FmuError: a model cannot be opened.
    """
    known: dict[tuple[str, str], frozenset[str]] = {}
    for run in runs:
        if run.model is None:
            continue
        # Which parameters are set counts, not their values: a grid opens its models once.
        key = (str(run.model.model), repr([sorted(run.model.options.get(o, ())) for o in _VALUES]))
        with place(_where(study, run)):
            if key not in known:
                known[key] = _variables(study, run.model)
        with place(f"[analyses.{run.analysis.name}]"):
            _check(run, known[key])


def _where(study: Study, run: Run) -> str:
    """Return the tables that may be wrong where a model cannot be opened."""
    grid = any(name.partition(".")[0] == run.analysis.model for name in study.grid)
    return f"[models] {run.analysis.model}{' or [grid]' if grid else ''}"


def _variables(study: Study, model: Change) -> frozenset[str]:
    file = str(model.model)
    path = file if is_bundled(file) else str(study.folder / Path(file).expanduser())
    values = {option: dict(model.options.get(option, {})) for option in _VALUES}
    with load(path, start_values=values["set"], bias=values["bias"]) as opened:
        every = (opened.description.variables, opened.inputs, opened.outputs, opened.parameters, opened.states)
        return frozenset(v.name for group in every for v in group)


def _check(run: Run, known: frozenset[str]) -> None:
    for key, name in _named(run.analysis.options):
        if name not in known:
            file = run.model.model if run.model is not None else ""
            raise InputError(f"{key} '{name}' is no variable of {file}; {suggest(name, known)}")


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
    return [name.strip()] if equals else [part.strip() for part in text.split(",") if part.strip()]
