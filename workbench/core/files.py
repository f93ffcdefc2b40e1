"""Files that are going to be written."""

from __future__ import annotations

from pathlib import Path

from workbench.errors import InputError

__all__ = ["file_to_write"]


def file_to_write(path: str | Path, suffix: str = "", *, option: str = "") -> Path:
    """Return a path where a file can be written.

    Args:
        path: of the file.
        suffix: that it must have; empty: any.
        option: that was given, for the message.

    Raises:
        InputError: another suffix, a folder, or a folder that does not exist.
    """
    target, said = Path(path), f"{option}: " if option else ""
    if suffix and target.suffix.lower() != suffix:
        raise InputError(f"{said}'{path}' must end in {suffix}: it is the file to write")
    if target.is_dir():
        raise InputError(f"{said}'{path}' is a folder; name a file in it")
    if not target.parent.is_dir():
        raise InputError(f"{said}the folder '{target.parent}' does not exist")
    return target
