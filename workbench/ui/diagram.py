"""A system file as a diagram: what the workbench reads in it, and edits that leave the rest of its text as it is."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Table

from workbench.core.records.parsing import from_toml, toml_value
from workbench.errors import InputError
from workbench.fmi.bundled import bundled_path, is_bundled, is_bundled_system
from workbench.system.block_table.registry import BLOCKS as KINDS
from workbench.system.block_table.registry import entry_of
from workbench.ui.root import NotHereError, ServedFolder

__all__ = ["BLOCKS", "EDITS", "PALETTE", "at_home", "drawn", "edited"]

# What can be added: name → entry in the file.
BLOCKS: Mapping[str, str] = {"gain": "1.0", "sum": '{sum = "+-"}', **{kind: entry_of(kind) for kind in KINDS}}
# Heading → names in BLOCKS, in the order of `workbench info --blocks`.
PALETTE: Mapping[str, list[str]] = {
    "linear": ["gain", "sum"],
    **{
        group: [k for k, block in KINDS.items() if block.group == group]
        for group in dict.fromkeys(block.group for block in KINDS.values())
    },
}
_Table = MutableMapping[str, Any]


def drawn(text: str, root: ServedFolder, name: str) -> dict[str, Any]:
    """Return what a system file says, ready for JSON.

    `components` have `name`, `label` (what stands in the box), `what` (as it is written), `model` (as the browser
    names it; empty: a block), `inputs` and `outputs` (of a block); `connections` have `from`, `to` and `more` (gain,
    unit, …); `inputs` and `outputs` are lists of [name, variable of a component]; `wrong` says what cannot be used.

    Args:
        text: of the file.
        root: the folder that is shown.
        name: of the file, to which paths in it are relative.

    Raises:
        InputError: it is not TOML, or no system.
        NotHereError: the name leads out of the folder.
    """
    from workbench.system.files.toml_file import connections_in  # noqa: PLC0415 - needs what the first page does not
    from workbench.system.files.toml_schema import SystemTable, read_table  # noqa: PLC0415

    table = read_table(SystemTable, _read(text), "")
    wrong: list[str] = []
    folder = bundled_path(name).parent if is_bundled_system(name) else root.path(name, new=True).parent
    components = [_component(part, given, root, folder, wrong) for part, given in table.components.items()]
    connections = [_connection(to, holder[key]) for to, holder, key in connections_in(table.connections)]
    inputs = {own: [target] if isinstance(target, str) else target for own, target in table.inputs.items()}
    return {
        "components": components,
        "connections": connections,
        "inputs": [[own, target] for own, targets in inputs.items() for target in targets],
        "outputs": [[own, source] for own, source in table.outputs.items()],
        "wrong": wrong,
    }


def _read(text: str) -> dict[str, Any]:
    try:
        return from_toml(text)
    except ValueError as error:
        raise InputError(f"this is not TOML yet: {error}") from None


def _component(name: str, given: object, root: ServedFolder, folder: Path, wrong: list[str]) -> dict[str, Any]:
    from workbench.system.blocks import block_ports  # noqa: PLC0415 - as above
    from workbench.system.description import FmuComponent  # noqa: PLC0415
    from workbench.system.files.toml_components import read_component  # noqa: PLC0415

    table = given if isinstance(given, dict) else {"gain" if isinstance(given, int | float) else "model": given}
    result: dict[str, Any] = {
        "name": name, "label": "", "what": _written(given), "model": "", "inputs": [], "outputs": [],
    }  # fmt: skip
    try:
        for key in ("model", "linear"):
            file = table.get(key)
            if isinstance(file, str) and not is_bundled(file) and folder.is_relative_to(root.folder):  # else: bundled
                file = root.find((folder / file).as_posix())
            if isinstance(file, str) and key == "model":
                result["model"] = file
        if not result["model"]:
            block = read_component(name, given, folder)
            if not isinstance(block, FmuComponent):
                inputs, outputs, _ = block_ports(block)
                result |= {"inputs": list(inputs), "outputs": list(outputs)}
        result["label"] = next(label(table) for key, label in _LABELS.items() if key in table)
    except (InputError, NotHereError) as error:
        wrong.append(str(error))
    return result


def _polynomial(coefficients: object, symbol: str) -> str:
    """Return a polynomial as it is written by hand, highest power first: 0.1 s + 1."""
    given = coefficients if isinstance(coefficients, list) else []
    text = ""
    for power, factor in zip(range(len(given) - 1, -1, -1), given, strict=True):
        if factor:
            size = f"{abs(factor):g}" if power == 0 or abs(factor) != 1 else ""
            raised = "" if power == 0 else symbol + ("" if power == 1 else str(power).translate(_RAISED))
            sign = "−" if factor < 0 else "+" if text else ""
            text += f" {sign} " if text else sign
            text += " ".join(filter(None, [size, raised]))
    return text or "0"


def _fraction(table: Mapping[str, Any]) -> str:
    symbol = "z" if table.get("dt") else "s"
    parts = [_polynomial(table.get(key), symbol) for key in ("numerator", "denominator")]
    return " / ".join(f"({part})" if " + " in part or " − " in part else part for part in parts)


_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")

# The key that tells what a component is → what stands in its box.
_LABELS: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "model": lambda table: str(table["model"]),
    "block": lambda table: str(table["block"]).replace("_", " "),
    "gain": lambda table: f"× {table['gain']}",
    "sum": lambda table: " ".join(map(str, table["sum"])).replace("-", "−"),
    "A": lambda table: f"{len(table['A'])} states",
    "linear": lambda table: str(table["linear"]),
    "numerator": _fraction,
}


def _connection(to: str, given: object) -> dict[str, Any]:
    if not isinstance(given, dict):
        return {"from": str(given), "to": to, "more": ""}
    more = ", ".join(f"{key} = {_written(value)}" for key, value in given.items() if key != "from")
    return {"from": str(given.get("from", "")), "to": to, "more": more}


def _written(value: object) -> str:
    return f"{{{_pairs(value)}}}" if isinstance(value, dict) else json.dumps(value, ensure_ascii=False, default=str)


def _pairs(table: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {_written(value)}" for key, value in table.items())


# -- edits ----------------------------------------------------------------------------------------


def edited(text: str, edit: str, *names: str) -> str:
    """Return the text of a system file with one change; all else in it, comments and line breaks too, stays as it is.

    Args:
        text: of the file.
        edit: one of `EDITS`.
        names: for "add" a block of `BLOCKS`, for "connect" an output and an input, for "cut" an input that loses its
            connection, for "remove" a component, which goes with all that is connected to it, for "set" a parameter
            and its value, for "insert" a block and the input whose wire it is put into.

    Raises:
        InputError: it is not TOML, no such edit, or the change cannot be made without touching the rest.
    """
    if edit not in EDITS:
        raise InputError(f"edit: '{edit}' is unknown; it must be one of {', '.join(EDITS)}")
    wanted = _read(text)
    try:
        EDITS[edit](wanted, *names)
        document = tomlkit.parse(text)
        EDITS[edit](document, *names)
        result = tomlkit.dumps(document)
        if _told(_read(result)) != _told(wanted):
            raise InputError("")
    except (InputError, TOMLKitError, KeyError, TypeError, AttributeError, ValueError):
        raise InputError("the picture cannot change this file; edit its text below") from None
    return result


def at_home(text: str, folder: Path) -> str:
    """Return the text of a system file with the paths of its parts as they are from anywhere.

    Args:
        text: of the file.
        folder: to which its paths are relative.

    Raises:
        InputError: it is not TOML.
    """
    _read(text)
    document = tomlkit.parse(text)
    components = document.get("components", {})
    for name, given in list(components.items()):
        table, keys = (given, ("model", "linear")) if isinstance(given, dict) else (components, (name,))
        for key in keys:
            file = table.get(key)
            if isinstance(file, str) and not is_bundled(file) and not is_bundled_system(file):
                table[key] = str((folder / file).resolve())
    return tomlkit.dumps(document)


def _told(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a system says, however its connections are written, and without empty tables."""
    from workbench.system.files.toml_file import connections_in  # noqa: PLC0415 - as above

    flat = {to: holder[key] for to, holder, key in connections_in(data.get("connections", {}))}
    rest = {key: value for key, value in data.items() if key != "connections" and value != {}}
    return {**rest, "connections": {to: value for to, value in flat.items() if value != {}}}


def _add(document: _Table, block: str) -> str:
    """Add a block, and return its name."""
    components = _section(document, "components")
    stem, _, _ = block.partition(" ")
    names = (stem if k == 1 else f"{stem}{k}" for k in range(1, len(components) + 2))
    name = next(name for name in names if name not in components)
    _put(components, name, f"{name} = {BLOCKS[block]}")
    return name


def _insert(document: _Table, block: str, destination: str) -> None:
    """Put a block into the wire to an input: what the wire says besides its source stays with its first part."""
    from workbench.system.blocks import block_ports  # noqa: PLC0415 - as above
    from workbench.system.description import FmuComponent  # noqa: PLC0415
    from workbench.system.files.toml_components import read_component  # noqa: PLC0415
    from workbench.system.files.toml_file import connections_in  # noqa: PLC0415

    wires = {to: (holder, key) for to, holder, key in connections_in(document.get("connections", {}))}
    holder, key = wires[destination]
    given, name = holder[key], _add(document, block)
    made = read_component(name, from_toml(f"block = {BLOCKS[block]}")["block"], Path())
    if isinstance(made, FmuComponent):
        raise InputError(f"{block} is not a block")
    first = f"{name}.{next(iter(block_ports(made)[0]))}"
    source = toml_value(given.unwrap() if hasattr(given, "unwrap") else given)
    holder[key] = f"{name}.y"
    _put(_section(document, "connections"), first, f"{json.dumps(first)} = {source}")


def _connect(document: _Table, source: str, destination: str) -> None:
    _cut(document, destination)  # an input has one source
    connections = _section(document, "connections")
    _put(connections, destination, f"{json.dumps(destination)} = {json.dumps(source)}")


def _cut(document: _Table, destination: str) -> None:
    _drop(document, lambda to, _: to == destination)


def _drop(document: _Table, unwanted: Callable[[str, str], bool]) -> None:
    from workbench.system.files.toml_file import connections_in  # noqa: PLC0415 - as above

    for to, holder, key in list(connections_in(document.get("connections", {}))):
        given = holder[key]
        if unwanted(to, str(given.get("from", "")) if isinstance(given, dict) else str(given)):
            del holder[key]


def _remove(document: _Table, name: str) -> None:
    def own(variable: str) -> bool:
        return variable.startswith(f"{name}.")

    del document["components"][name]
    _drop(document, lambda to, source: own(to) or own(source))
    for section in ("inputs", "outputs"):
        table = document.get(section, {})
        for key in list(table):
            targets = table[key]
            if isinstance(targets, str):
                if own(targets):
                    del table[key]
                continue
            for target in [t for t in targets if own(t)]:
                targets.remove(target)
            if not targets:
                del table[key]


def _set(document: _Table, name: str, value: str) -> None:
    """Give a parameter of a block or a gain, "component.parameter", another value."""
    component, _, parameter = name.rpartition(".")
    number = from_toml(f"value = {value}")["value"]
    components = document["components"]
    if isinstance(components[component], int | float):  # the short form of a gain
        components[component] = number
    else:
        components[component][parameter] = number


EDITS: Mapping[str, Callable[..., object]] = {
    "add": _add, "connect": _connect, "cut": _cut, "insert": _insert, "remove": _remove, "set": _set,
}  # fmt: skip


def _section(document: _Table, name: str) -> _Table:
    if name not in document:
        document[name] = tomlkit.table() if isinstance(document, tomlkit.TOMLDocument) else {}
    result: _Table = document[name]
    return result


def _put(table: _Table, key: str, line: str) -> None:
    """Append an entry, before the comments that stand between it and the next table: they belong to that."""
    entry = tomlkit.parse(line + "\n")
    if not isinstance(table, Table):
        table[key] = from_toml(line)[key]
        return
    body = table.value.body
    after = list(_last_remarks(body))
    table.add(key, entry[key])
    body.extend(reversed(after))


def _last_remarks(body: list[Any]) -> Iterator[Any]:
    while body and body[-1][0] is None:
        yield body.pop()
