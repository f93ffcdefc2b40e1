"""A model of a study at one point, written as a system file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench.core.records.parsing import toml_key, toml_value
from workbench.core.records.record import read_toml_table
from workbench.errors import WorkbenchError
from workbench.fmi.bundled import bundled_path, is_bundled
from workbench.study.description import Change
from workbench.system.files.read import is_system_file
from workbench.system.load import load

__all__ = ["system_at"]

# Options of a model that a system file has no place for.
_ELSEWHERE = ("bias", "interface", "solver", "step", "tolerance", "start")
_FILES = ("model", "linear")  # keys of a component that name files


def system_at(change: Change, folder: Path, remarks: Sequence[str]) -> str:
    """Return a system file as text; empty: the model cannot be written as one.

    Args:
        change: the model as a point has it.
        folder: of the study.
        remarks: lines of comment above it.
    """
    name = str(change.model)
    path = bundled_path(name) if is_bundled(name) else (folder / Path(name).expanduser()).resolve()
    given = dict(change.options.get("set", {}))
    try:
        if not is_system_file(name if is_bundled(name) else path):
            data = _around(name if is_bundled(name) else path.as_posix(), given)
        elif path.suffix.lower() == ".toml":
            data = _changed(read_toml_table(path), given, path.parent)
        else:
            return ""  # SSP: the command line says it
    except (WorkbenchError, KeyError):
        return ""
    left = {key: value for key, value in change.options.items() if key in _ELSEWHERE and value}
    notes = [f"It is opened with {key} = {toml_value(value)}." for key, value in left.items()]
    return "".join(f"# {' '.join(line.split())}\n" for line in (*remarks, *notes)) + _text(data)


def _around(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the system of one FMU, with its inputs and outputs."""
    with load(name) as model:
        inputs, outputs = ([v.name for v in group] for group in (model.inputs, model.outputs))
    return {
        "components": {"model": {"model": name, "set": dict(given)}},
        "inputs": {n: f"model.{n}" for n in inputs},
        "outputs": {n: f"model.{n}" for n in outputs},
    }


def _changed(data: dict[str, Any], given: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    components = {name: _placed(value, folder) for name, value in data["components"].items()}
    for full, value in given.items():
        owner = max((n for n in components if full.startswith(f"{n}.")), key=len, default="")
        if not owner:
            raise KeyError(full)
        components[owner] = _with(components[owner], full.removeprefix(f"{owner}."), value)
    return {**data, "components": components}


def _with(component: Any, name: str, value: object) -> dict[str, Any]:  # noqa: ANN401 - what TOML can hold
    """Return a component with one value: a parameter of a block or a gain, or what is set in an FMU."""
    if isinstance(component, int | float):
        component = {"gain": component}
    table: dict[str, Any] = {"model": component} if isinstance(component, str) else dict(component)
    if "model" in table:
        return {**table, "set": {**table.get("set", {}), name: value}}
    return {**table, name: value}


def _placed(component: Any, folder: Path) -> Any:  # noqa: ANN401 - what TOML can hold
    """Return a component with the files that it names in full."""
    if isinstance(component, str):
        return component if is_bundled(component) else (folder / component).resolve().as_posix()
    if not isinstance(component, dict):
        return component
    return {k: _placed(v, folder) if k in _FILES and isinstance(v, str) else v for k, v in component.items()}


def _text(data: Mapping[str, Any]) -> str:
    """Return TOML: single values first, then each table, its values one a line."""
    lines = [f"{toml_key(k)} = {toml_value(v)}" for k, v in data.items() if not isinstance(v, Mapping)]
    for name, table in data.items():
        if isinstance(table, Mapping):
            lines += ["", f"[{toml_key(name)}]", *(f"{toml_key(k)} = {toml_value(v)}" for k, v in table.items())]
    return "\n".join(lines).lstrip("\n") + "\n"
