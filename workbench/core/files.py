"""Files that are going to be written; FMUs as zips whose bytes depend on their contents only."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

from workbench.errors import InputError

__all__ = ["file_to_write", "pack"]

_DATE = (1980, 1, 1, 0, 0, 0)  # the first date that zip knows
_UNIX = 3
_FILE_MODE = 0o100644 << 16


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


def pack(output: Path, files: Mapping[str, bytes]) -> None:
    """Write `files` (name in the archive → contents) to `output`, modelDescription.xml first.

    The archive is written beside its place and moved there, so that an interrupted build leaves the old
    one whole.
    """
    output.parent.mkdir(parents=True, exist_ok=True)
    partial = output.with_name(output.name + ".part")
    names = sorted(files, key=lambda name: (name != "modelDescription.xml", name))
    try:
        with zipfile.ZipFile(partial, "w") as archive:
            for name in names:
                entry = zipfile.ZipInfo(name, _DATE)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.create_system = _UNIX
                entry.external_attr = _FILE_MODE
                archive.writestr(entry, files[name], compresslevel=9)
        partial.replace(output)
    except OSError:
        partial.unlink(missing_ok=True)
        raise
