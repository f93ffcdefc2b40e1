"""Pack an FMU: a zip whose bytes depend on its contents only."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

_DATE = (1980, 1, 1, 0, 0, 0)  # the first date that zip knows
_UNIX = 3
_FILE_MODE = 0o100644 << 16


def pack(output: Path, files: Mapping[str, bytes]) -> None:
    """Write `files` (name in the archive → contents) to `output`, modelDescription.xml first.

    The archive is written beside its place and moved there, so that an interrupted build leaves the old
    one whole.
    """
    output.parent.mkdir(parents=True, exist_ok=True)
    partial = output.with_name(output.name + ".part")
    names = sorted(files, key=lambda name: (name != "modelDescription.xml", name))
    with zipfile.ZipFile(partial, "w") as archive:
        for name in names:
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = _UNIX
            entry.external_attr = _FILE_MODE
            archive.writestr(entry, files[name], compresslevel=9)
    partial.replace(output)
