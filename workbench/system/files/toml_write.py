"""Write a system as a system file (.toml)."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from workbench.core.machine.files import file_to_write, replacing
from workbench.core.records.parsing import toml_key, toml_value
from workbench.errors import InputError
from workbench.fmi.bundled import is_bundled
from workbench.system.description import (
    BlockComponent,
    Component,
    Connection,
    FmuComponent,
    FunctionComponent,
    GainComponent,
    LinearComponent,
    SystemDescription,
    to_write,
)

__all__ = ["write_toml"]


def write_toml(description: SystemDescription, path: str | Path) -> None:
    """Write a system as a system file (.toml), which `read_system` reads back; the same system gives the same text.

    FMUs stay where they are: their paths are written relative to the file. Matrices stand in the file itself.

    Args:
        description: the system.
        path: the .toml file to write.

    Raises:
        InputError: another suffix, a folder that does not exist, or what a system file has no place for: a Python
            function, units that the system defines itself, FMUs that were unpacked from an .ssp.

    Examples:
        >>> wb.write_toml(wb.read_system("system:rudder_loop"), "rudder_loop.toml")
        >>> print([component.name for component in wb.read_system("rudder_loop.toml").components])
        ['plant', 'error', 'gain']
    """
    description = to_write(description)
    target = file_to_write(path, ".toml")
    if inside := [c.called for c in description.components if isinstance(c, FmuComponent) and c.called]:
        raise InputError(f"{target}: {inside[0]} is inside a package; write an .ssp instead")
    if description.units:
        names = ", ".join(description.units)
        raise InputError(f"{target}: a system file cannot define units ({names}); write an .ssp instead")
    tables = _tables(description, target.parent.resolve())
    lines = [f"name = {toml_value(description.name)}"]
    for heading, table in tables.items():
        if table:
            lines += ["", f"[{heading}]", *(f"{toml_key(key)} = {toml_value(value)}" for key, value in table.items())]
    with replacing(target) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _tables(description: SystemDescription, folder: Path) -> Mapping[str, Mapping[str, object]]:
    times = description.default_experiment
    experiment = {
        "start": times.start_time, "stop": times.stop_time, "step": times.step, "tolerance": times.tolerance
    }  # fmt: skip
    return {
        "components": {c.name: _component(c, folder) for c in description.components},
        "connections": {c.destination: _connection(c) for c in description.connections},
        "inputs": {k: driven[0] if len(driven) == 1 else driven for k, driven in description.inputs.items()},
        "outputs": description.outputs,
        "experiment": {key: value for key, value in experiment.items() if value is not None},
        "master": description.master.given(),
    }


def _connection(connection: Connection) -> object:
    usual = Connection(source=connection.source, destination=connection.destination)
    if connection == usual:
        return connection.source
    return {"from": connection.source, **_beside(connection, usual)}


def _beside(part: FmuComponent | Connection, usual: FmuComponent | Connection) -> dict[str, Any]:
    """Return those fields that differ from what they usually are; the keys of a file are named as they are."""
    values = ((f.name, getattr(part, f.name), getattr(usual, f.name)) for f in fields(part))
    return {name: value for name, value, other in values if value != other}


def _component(component: Component, folder: Path) -> Mapping[str, Any]:
    return dict(_entries(component, folder))


def _entries(component: Component, folder: Path) -> Iterator[tuple[str, Any]]:
    """Yield the keys of a component's table."""
    if isinstance(component, FmuComponent):
        yield from _fmu(component, folder)
    elif isinstance(component, LinearComponent):
        yield from ((key, getattr(component, key).tolist()) for key in ("A", "B", "C", "D", "x0"))
        yield from (("inputs", list(component.input_names)), ("outputs", list(component.output_names)))
        yield from (("states", list(component.state_names)), ("dt", float(component.dt)))
    elif isinstance(component, GainComponent):
        yield "gain", float(component.gain)
    elif isinstance(component, BlockComponent):
        yield from (("block", component.kind), *component.block.given.items())
    elif isinstance(component, FunctionComponent):
        raise InputError(f"component {component.name} is a Python function, which no file can hold")
    else:
        yield "sum", [float(sign) for sign in component.signs]
        if component.unit is not None:
            yield "unit", component.unit
        return
    if component.units:
        yield "units", dict(component.units)


def _fmu(component: FmuComponent, folder: Path) -> Iterator[tuple[str, Any]]:
    if component.units:
        raise InputError(
            f"component {component.name}: a system file cannot declare units of an FMU; write an .ssp instead"
        )
    file = component.file
    yield "model", file if is_bundled(file) else _relative(Path(file), folder)
    yield from _beside(component, FmuComponent(name=component.name, file=component.file)).items()


def _relative(file: Path, folder: Path) -> str:
    """Return a path from a folder, with slashes; on another drive than the folder's, the whole path."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:
        return file.as_posix()
