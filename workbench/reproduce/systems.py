"""Where the bundled system files lie."""

from __future__ import annotations

from pathlib import Path

from workbench.errors import InputError, suggest

__all__ = ["system_file"]

_PACKAGE = Path(__file__).resolve().parent.parent
# In a wheel the folder lies inside the package, in a checkout beside it.
_ROOTS = (_PACKAGE / "systems", _PACKAGE.parent / "systems")


def system_file(name: str) -> str:
    """Return the path of a bundled system file.

    Args:
        name: without its suffix, such as "failed_aileron".

    Raises:
        InputError: there is none of that name.
    """
    found = {p.stem: p for root in reversed(_ROOTS) for p in root.glob("*.toml")}
    if name not in found:
        raise InputError(f"no bundled system '{name}'; {suggest(name, found)}")
    return str(found[name])
