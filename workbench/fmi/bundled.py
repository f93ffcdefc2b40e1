"""FMUs that ship with the workbench: `fmu:NAME` (FMI 2.0) and `fmu:NAME@3` (FMI 3.0)."""

from __future__ import annotations

from pathlib import Path

from workbench.errors import InputError, suggest

__all__ = ["bundled_names", "bundled_path", "is_bundled"]

_PACKAGE = Path(__file__).resolve().parent.parent
# In a wheel the folder lies inside the package, in a checkout beside it.
_ROOTS = (_PACKAGE / "fmus", _PACKAGE.parent / "fmus")
_FOLDERS = {"2": "fmi2", "3": "fmi3"}


def is_bundled(name: str) -> bool:
    """Whether `name` asks for a bundled FMU."""
    return name.startswith("fmu:")


def bundled_names(version: str = "2") -> tuple[str, ...]:
    """Return the names of the bundled FMUs of one FMI version, sorted."""
    found = {p.stem for root in _ROOTS for p in (root / _FOLDERS[version]).glob("*.fmu")}
    return tuple(sorted(found))


def bundled_path(name: str) -> Path:
    """Return the file of `fmu:NAME` or `fmu:NAME@3`.

    Raises:
        InputError: no such name; the message lists the known ones.
    """
    stem, _, version = name.removeprefix("fmu:").partition("@")
    version = version or "2"
    if version not in _FOLDERS:
        raise InputError(f"{name}: FMI version '{version}' is not bundled; write @2 or @3")
    known = bundled_names(version)
    if stem not in known:
        raise InputError(f"{name}: no bundled FMU of that name; {suggest(stem, known)}")
    candidates = (root / _FOLDERS[version] / f"{stem}.fmu" for root in _ROOTS)
    return next(path for path in candidates if path.is_file())
