"""System files (.toml): components, connections, inputs and outputs, paths relative to the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar, cast

from workbench.core.records.record import read_toml_table
from workbench.core.records.schema import DRAFT
from workbench.errors import InputError
from workbench.fmi.description import DefaultExperiment
from workbench.system.description import Component, Connection, FmuComponent, MasterOptions, SystemDescription
from workbench.system.files.read import is_system_file, read_system
from workbench.system.files.toml_components import component_schemas, read_component
from workbench.system.files.toml_schema import (
    ExperimentTable,
    SystemTable,
    json_schema,
    meaning,
    read_record,
    read_table,
    table_of,
)
from workbench.system.nested import Inner, embed

__all__ = ["connections_in", "read_toml", "system_schema"]


def read_toml(path: Path, parents: tuple[Path, ...] = ()) -> SystemDescription:
    """Return the system that a .toml file describes.

    Args:
        path: of the file.
        parents: the files of the systems that this one is part of.

    Raises:
        InputError: one line with the file, the table and the key: no such file, not TOML, a key that is unknown
            (near names in the message) or missing, a value of the wrong type, an FMU that is not there.
    """
    data = read_toml_table(path, twice=": an input takes one source")
    try:
        return _description(path, data, (*parents, path.resolve()))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _description(path: Path, data: Mapping[str, Any], parents: tuple[Path, ...]) -> SystemDescription:
    table = read_table(SystemTable, data, "")
    experiment = read_table(ExperimentTable, table.experiment, "[experiment]")
    parts = [_part(read_component(name, given, path.parent), parents) for name, given in table.components.items()]
    outer = SystemDescription(
        name=table.name or path.stem,
        components=(),
        connections=tuple(_connection(name, holder[key]) for name, holder, key in connections_in(table.connections)),
        inputs={name: (given,) if isinstance(given, str) else tuple(given) for name, given in table.inputs.items()},
        outputs=dict(table.outputs),
        default_experiment=DefaultExperiment(experiment.start, experiment.stop, experiment.tolerance, experiment.step),
        master=read_record(MasterOptions, table.master, "[master]"),
        source=str(path),
    )
    return embed(outer, parts)


def _part(component: Component, parents: tuple[Path, ...]) -> Component | Inner:
    """Return a component, or the system that stands in its place."""
    if not isinstance(component, FmuComponent) or not is_system_file(component.file):
        return component
    where, file = f"[components] {component.name}", Path(component.file)
    if component != FmuComponent(name=component.name, file=component.file):
        raise InputError(f"{where}: {file.name} is a system; set, interface, solver and step belong in its own file")
    if file in parents:
        raise InputError(f"{where}: {file.name} contains itself")
    system = read_toml(file, parents) if file.suffix.lower() == ".toml" else read_system(file)
    return Inner(component.name, system)


_Holder = TypeVar("_Holder", bound=Mapping[str, Any])


def connections_in(given: _Holder, prefix: str = "") -> Iterator[tuple[str, _Holder, str]]:
    """Yield each destination with the table and the key in it that hold its source.

    TOML reads an unquoted a.u as table a with key u: both ways are taken.

    Args:
        given: the table of connections.
        prefix: before the keys, of a table inside it.
    """
    for key, value in given.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict) and not _is_connection(name, value):
            yield from connections_in(cast("_Holder", value), f"{name}.")
        else:
            yield name, given, key


def _is_connection(name: str, value: Mapping[str, Any]) -> bool:
    """Whether a table describes a connection, rather than holding connections to inputs of a component."""
    return "." in name and not any(isinstance(v, dict) for v in value.values())


def _connection(destination: str, given: object) -> Connection:
    where = f'[connections] "{destination}"'
    if isinstance(given, str):
        return Connection(source=given, destination=destination)
    if not isinstance(given, dict):
        raise InputError(f'{where}: must be a source such as "plant.w" or {{from = "plant.w", gain = -1}}')
    return read_record(Connection, given, where, keys=_KEYS, destination=destination)


_KEYS = {"source": "from"}


def system_schema() -> dict[str, Any]:
    """Return the JSON Schema of a system file: what can be said without opening the FMUs that it names."""
    result = json_schema(SystemTable)
    source = {"type": "string", "description": "Output that the input takes, as plant.w."}
    table = json_schema(table_of(Connection, keys=_KEYS, known=("destination",)))
    # Without quotes, a.u is a table a with the key u.
    inner = {"type": "object", "additionalProperties": {"$ref": "#/$defs/connection"}}
    more = {**inner, "not": {"required": ["from"]}}  # else a misspelt key of a connection would be one to it
    tables: dict[str, dict[str, Any]] = {
        "components": {"type": "object", "additionalProperties": {"anyOf": list(component_schemas())}},
        "connections": {"type": "object", "additionalProperties": {"$ref": "#/$defs/connection"}},
        "experiment": json_schema(ExperimentTable),
        "master": json_schema(table_of(MasterOptions)),
    }
    result["properties"] |= {name: {**held, "description": meaning(SystemTable, name)} for name, held in tables.items()}
    return {"$schema": DRAFT, **result, "title": "System", "$defs": {"connection": {"anyOf": [source, table, more]}}}
