"""Studies that ship with the workbench: `study:NAME`."""

from __future__ import annotations

from pathlib import Path

from workbench.errors import InputError, suggest

__all__ = ["bundled_studies", "is_bundled_study", "locate_study"]

_PACKAGE = Path(__file__).resolve().parent.parent
# In a wheel the folder lies inside the package, in a checkout beside it.
_ROOTS = (_PACKAGE / "studies", _PACKAGE.parent / "studies")
_PREFIX = "study:"


def is_bundled_study(name: str) -> bool:
    """Whether `name` asks for a bundled study."""
    return name.startswith(_PREFIX)


def bundled_studies() -> dict[str, Path]:
    """Return the bundled studies, name → file."""
    files = [path for root in reversed(_ROOTS) for path in sorted(root.glob("*.toml"))]
    return {path.stem: path for path in files}


def locate_study(name: str | Path) -> Path:
    """Return the file of a study: a path or `study:NAME`.

    Raises:
        InputError: nothing there; the message names near files.
    """
    if is_bundled_study(str(name)):
        known = bundled_studies()
        stem = str(name).removeprefix(_PREFIX)
        if stem not in known:
            raise InputError(f"{name}: no bundled study of that name; {suggest(stem, known)}")
        return known[stem]
    path = Path(name).expanduser()
    if path.is_file():
        return path
    if path.is_dir():
        raise InputError(f"{name}: is a folder; name the study in it")
    near = [p.name for p in path.parent.glob("*.toml")] if path.parent.is_dir() else []
    hint = f"; {suggest(path.name, near)}" if near else ""
    raise InputError(f"{name}: no such file{hint}; give a study as .toml, or study:NAME")
