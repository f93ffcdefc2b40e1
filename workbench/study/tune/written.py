"""The system with the values found, as a file."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from workbench.core.machine.files import replacing
from workbench.fmi.bundled import bundled_path, is_bundled
from workbench.system.files.read import read_system
from workbench.system.files.ssp_write import write_ssp
from workbench.system.files.toml_write import write_toml
from workbench.system.parameters import with_values

__all__ = ["write_tuned"]

_FILES = ("model", "linear")  # keys of a component that name files


def write_tuned(name: str, values: Mapping[str, float], path: Path) -> None:
    """Write a system with other parameters; comments of a .toml stay where tomlkit is installed.

    Args:
        name: of the system's file, or of a bundled one.
        values: full name → value.
        path: of the new file, .toml or .ssp.

    Raises:
        InputError: it cannot be read or written.
    """
    source = bundled_path(name) if is_bundled(name) else Path(name).expanduser()
    wanted = with_values(read_system(name), values)
    if path.suffix.lower() == ".ssp":
        write_ssp(wanted, path)
    elif source.suffix.lower() == ".toml" and find_spec("tomlkit") is not None:
        text = _edited(source, values, source.resolve().parent != path.resolve().parent)
        with replacing(path) as part:
            part.write_text(text, encoding="utf-8")
    else:
        write_toml(wanted, path)


def _edited(source: Path, values: Mapping[str, float], moved: bool) -> str:  # noqa: FBT001 - private
    """Return the text of a file with other values; the paths in it in full where it is moved."""
    import tomlkit  # noqa: PLC0415 - optional

    document = tomlkit.parse(source.read_text(encoding="utf-8"))
    components: Any = document["components"]
    for component in list(components) if moved else ():
        given = components[component]
        table, keys = (given, _FILES) if isinstance(given, dict) else (components, (component,))
        for key in keys:
            file = table.get(key)
            if isinstance(file, str) and not is_bundled(file):
                table[key] = (source.parent / file).resolve().as_posix()
    for full, value in values.items():
        owner = max((c for c in components if full.startswith(f"{c}.")), key=len)
        _put(components, owner, full.removeprefix(f"{owner}."), value)
    return tomlkit.dumps(document)


def _put(components: Any, owner: str, name: str, value: float) -> None:  # noqa: ANN401 - tables of TOML
    """Give a parameter of a block, a gain or an FMU another value."""
    import tomlkit  # noqa: PLC0415 - optional

    given = components[owner]
    if isinstance(given, int | float):  # the short form of a gain
        components[owner] = value
        return
    if isinstance(given, str):
        components[owner] = tomlkit.inline_table()
        components[owner]["model"] = given
        given = components[owner]
    if "model" not in given:
        given[name] = value
        return
    if "set" not in given:
        given["set"] = tomlkit.inline_table()
    given["set"][name] = value
