"""Components of a system file: FMUs, linear systems, gains, sums and blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.machine.files import content_of, named_path
from workbench.core.records.forms import whole
from workbench.core.records.option import options_of
from workbench.core.records.parsing import from_json
from workbench.core.records.schema import table_schema
from workbench.core.values.arrays import Floats
from workbench.errors import InputError, close_names, suggest
from workbench.fmi.bundled import bundled_path, is_bundled, is_bundled_system
from workbench.system.block_table.linear import realised
from workbench.system.block_table.registry import BLOCKS
from workbench.system.description import (
    BlockComponent,
    Component,
    FmuComponent,
    GainComponent,
    LinearComponent,
    SumComponent,
)
from workbench.system.files.toml_schema import (
    FmuTable,
    LinearFileTable,
    LinearTable,
    SumTable,
    TransferTable,
    UnitsTable,
    json_schema,
    meaning,
    read_record,
    read_table,
    table_of,
)

__all__ = ["component_schemas", "existing_fmu", "read_component"]


def read_component(name: str, given: object, folder: Path) -> Component:
    """Return a component of a system file.

    Args:
        name: of the component.
        given: its entry: a file, a number (gain) or a table.
        folder: that of the system file; paths are relative to it.

    Raises:
        InputError: a key that is unknown or missing, a value of the wrong type, no such FMU, shapes that do not fit.
    """
    where = f"[components] {name}"
    if isinstance(given, str):
        given = {"model": given}
    elif isinstance(given, int | float) and not isinstance(given, bool):
        given = {"gain": given}
    if not isinstance(given, dict):
        raise InputError(f'{where}: must be a file such as "Plant.fmu" or a table such as {{model = "Plant.fmu"}}')
    reader = next((r for key, r in _READERS.items() if key in given), None)
    if reader is None:
        raise InputError(f"{where}: {_what_is_missing(given)}")
    return reader(name, given, _Context(where, folder))


def _what_is_missing(given: Mapping[str, Any]) -> str:
    choices = ", ".join(_READERS)
    for key in given:
        if key in BLOCKS:
            return f"key '{key}' is a block's kind; write {{block = \"{key}\", …}} (workbench info --blocks {key})"
        if close_names(str(key), _READERS):
            return f"key '{key}' is unknown; {suggest(str(key), _READERS)}"
    return f"does not say what it is; give one of: {choices}"


@dataclass(frozen=True)
class _Context:
    """Where a component stands: the table, for messages, and the folder of the file."""

    where: str
    folder: Path


def _fmu(name: str, given: Mapping[str, Any], place: _Context) -> FmuComponent:
    table = read_table(FmuTable, given, place.where)
    return FmuComponent(
        name=name,
        file=existing_fmu(table.model, place.folder, place.where),
        interface=table.interface,
        set={name: whole(value) if isinstance(value, list) else value for name, value in table.set.items()},
        step=table.step,
        solver=table.solver,
        dependencies=table.dependencies,
    )


def existing_fmu(model: str, folder: Path, where: str) -> str:
    """Return the absolute path of an FMU or a system, or `fmu:NAME` as it is.

    Raises:
        InputError: nothing there; the message names near files of that folder.
    """
    if is_bundled(model):
        try:
            bundled = bundled_path(model)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        return str(bundled) if is_bundled_system(model) else model
    path = (folder / named_path(model)).resolve()
    if path.exists():
        return str(path)
    near = [p.name for p in path.parent.glob("*.fmu")] if path.parent.is_dir() else []
    raise InputError(f"{where}: no such file: {path}; {suggest(path.name, near)}{'' if near else ' in that folder'}")


def _gain(name: str, given: Mapping[str, Any], place: _Context) -> GainComponent:
    gain = read_record(GainComponent, given, place.where, name=name)
    _check_ports(gain.units, ["u", "y"], place.where)
    return gain


def _sum(name: str, given: Mapping[str, Any], place: _Context) -> SumComponent:
    table = read_table(SumTable, given, place.where)
    signs = table.sum if isinstance(table.sum, list) else [_sign(letter, place.where) for letter in table.sum]
    if not signs:
        raise InputError(f"{place.where}: key 'sum' is empty; write one sign for each input, such as \"+-\"")
    return SumComponent(name=name, signs=tuple(signs), unit=table.unit)


def _sign(letter: str, where: str) -> float:
    if letter not in "+-":
        raise InputError(f"{where}: key 'sum' holds '{letter}'; write one + or - for each input, or a list of factors")
    return 1.0 if letter == "+" else -1.0


# -- linear systems -------------------------------------------------------------------------------


def _state_space(name: str, given: Mapping[str, Any], place: _Context) -> LinearComponent:
    table = read_table(LinearTable, given, place.where)
    B, C = _matrix("B", table.B, place.where), _matrix("C", table.C, place.where)
    D = np.zeros((len(C), B.shape[1])) if table.D is None else _matrix("D", table.D, place.where)
    return _linear(name, (_matrix("A", table.A, place.where), B, C, D), table, place.where)


def _linear_file(name: str, given: Mapping[str, Any], place: _Context) -> LinearComponent:
    """Read matrices too large for a system file from JSON beside it."""
    table = read_table(LinearFileTable, given, place.where)
    path = (place.folder / Path(table.linear).expanduser()).resolve()
    try:
        data = from_json(content_of(path).decode("utf-8"))
    except OSError as error:
        near = [p.name for p in path.parent.glob("*.json")] if path.parent.is_dir() else []
        hint = suggest(path.name, near) + ("" if near else " in that folder")
        raise InputError(f"{place.where}: {path} cannot be read: {error.strerror or error}; {hint}") from None
    except ValueError as error:
        raise InputError(f"{place.where}: {path} is not JSON: {error}") from None
    if not isinstance(data, dict) or not {"A", "B", "C", "D"} <= data.keys():
        raise InputError(f"{place.where}: {path} contains no linear model: keys A, B, C and D are needed")
    offsets = [key for key in ("u0", "y0", "x0", "dx0") if _nonzero(data.get(key))]
    if offsets:
        raise InputError(
            f"{place.where}: {path}: the model is valid around an operating point ({offsets[0]} is not 0); export it "
            "as an FMU"
        )
    named = {"input_names": "inputs", "output_names": "outputs", "state_names": "states"}
    kept = {named.get(k, str(k)): v for k, v in data.items() if k in {"A", "B", "C", "D", "dt", *named}}
    linear = _state_space(name, {**kept, "units": {**(data.get("units") or {}), **table.units}}, place)
    return replace(linear, file=str(path))


def _nonzero(value: object) -> bool:
    numbers = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return any(bool(x) for x in numbers)


def _transfer(name: str, given: Mapping[str, Any], place: _Context) -> LinearComponent:
    table = read_table(TransferTable, given, place.where)
    try:
        result = realised(table.numerator, table.denominator)
    except InputError as error:
        raise InputError(f"{place.where}: {error}") from None
    return _linear(name, (result.a, result.b, result.c, result.d), table, place.where)


def _matrix(key: str, rows: list[list[float]], where: str) -> Floats:
    lengths = {len(row) for row in rows}
    if len(lengths) > 1:
        raise InputError(f"{where}: key '{key}' has rows of different lengths: {sorted(lengths)}")
    return np.array(rows, dtype=np.float64).reshape(len(rows), lengths.pop() if lengths else 0)


def _linear(
    name: str,
    matrices: tuple[Floats, Floats, Floats, Floats],
    table: LinearTable | TransferTable,
    where: str,
) -> LinearComponent:
    A, B, C, D = (np.asarray(m, dtype=np.float64) for m in matrices)
    n, m, p = len(A), D.shape[1], D.shape[0]
    for key, matrix, shape in (("A", A, (n, n)), ("B", B, (n, m)), ("C", C, (p, n)), ("D", D, (p, m))):
        if matrix.size != shape[0] * shape[1] or (matrix.size and matrix.shape != shape):
            raise InputError(f"{where}: key '{key}' has shape {matrix.shape}, but {shape} is needed for {n} states")
    inputs = _names("inputs", table.inputs, "u", m, where)
    outputs = _names("outputs", table.outputs, "y", p, where)
    states = _names("states", table.states, "x", n, where)
    x0 = [0.0] * n if table.x0 is None else table.x0
    if len(x0) != n:
        raise InputError(f"{where}: key 'x0' has {len(x0)} values, but there are {n} states")
    _check_ports(table.units, [*inputs, *outputs], where)
    return LinearComponent(
        name=name,
        A=A.reshape(n, n),
        B=B.reshape(n, m),
        C=C.reshape(p, n),
        D=D,
        dt=table.dt,
        input_names=inputs,
        output_names=outputs,
        state_names=states,
        x0=np.array(x0, dtype=np.float64),
        units=table.units,
    )


def _names(key: str, given: list[str] | None, letter: str, count: int, where: str) -> tuple[str, ...]:
    """Return the names of inputs, outputs or states; one input or output alone is `u` or `y`."""
    if given is None:
        return (letter,) if count == 1 and letter != "x" else tuple(f"{letter}{k + 1}" for k in range(count))
    if len(given) != count:
        raise InputError(f"{where}: key '{key}' has {len(given)} names, but there are {count}")
    if len(set(given)) < count:
        raise InputError(f"{where}: key '{key}' holds a name twice")
    return tuple(given)


def _check_ports(units: Mapping[str, str], known: list[str], where: str) -> None:
    for name in units:
        if name not in known:
            raise InputError(f"{where}: key 'units' names '{name}', no input or output of it; {suggest(name, known)}")


_Reader = Callable[[str, Mapping[str, Any], _Context], Component]


def _block(name: str, given: Mapping[str, Any], place: _Context) -> BlockComponent:
    parameters = {key: value for key, value in given.items() if key not in ("block", "units")}
    units = read_table(UnitsTable, {"units": given.get("units", {})}, place.where).units
    try:
        return BlockComponent(name=name, kind=given["block"], parameters=parameters, units=units)
    except InputError as error:
        raise InputError(f"{place.where}: {str(error).removeprefix(f'component {name}: ')}") from None


# The key that tells what a component is → how to read it.
_READERS: Mapping[str, _Reader] = {
    "model": _fmu,
    "block": _block,
    "gain": _gain,
    "sum": _sum,
    "A": _state_space,
    "linear": _linear_file,
    "numerator": _transfer,
}


def component_schemas() -> Iterator[dict[str, Any]]:
    """Yield the JSON Schema of each way of writing a component."""
    yield {"type": "string", "description": "FMU, or system, of the component."}
    yield {"type": "number", "description": "Gain of the component."}
    for kind in (FmuTable, table_of(GainComponent, known=("name",)), SumTable, LinearTable, LinearFileTable):
        yield json_schema(kind)
    yield json_schema(TransferTable)
    for name, block in BLOCKS.items():
        result = table_schema({d.name: d for d in options_of(block)})
        units = {
            "description": meaning(UnitsTable, "units"),
            "type": "object",
            "additionalProperties": {"type": "string"},
        }
        own = {"block": {"const": name}, "units": units}
        properties = {**own, **result["properties"]}
        yield {**result, "properties": properties, "required": ["block", *result["required"]], "title": name}
