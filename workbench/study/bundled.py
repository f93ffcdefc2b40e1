"""Studies that ship with the workbench: `study:NAME`."""

from __future__ import annotations

from pathlib import Path

from workbench.bundled import bundled_files, find_bundled
from workbench.errors import InputError, suggest

__all__ = ["bundled_studies", "is_bundled_study", "locate_study"]

_PREFIX = "study:"


def is_bundled_study(name: str) -> bool:
    """Whether `name` asks for a bundled study."""
    return name.startswith(_PREFIX)


def bundled_studies() -> dict[str, Path]:
    """Return the bundled studies, name → file."""
    return bundled_files("studies")


def locate_study(name: str | Path) -> Path:
    """Return the file of a study: a path or `study:NAME`.

    Raises:
        InputError: nothing there; the message names near files.
    """
    if is_bundled_study(str(name)):
        return find_bundled(str(name), bundled_studies(), "study")
    path = Path(name).expanduser()
    if path.is_file():
        return path
    if path.is_dir():
        raise InputError(f"{name}: is a folder; name the study in it")
    if str(name) in bundled_studies():
        raise InputError(f"{name}: no such file; did you mean {_PREFIX}{name}?")
    near = [p.name for p in path.parent.glob("*.toml")] if path.parent.is_dir() else []
    hint = f"; {suggest(path.name, near)}" if near else ""
    raise InputError(f"{name}: no such file{hint}; give a study as .toml, or study:NAME")
