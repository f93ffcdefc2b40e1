"""The files of an .ssp package that is being written: named, packed, the same bytes for the same content."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path
from urllib.parse import quote

from workbench.core.machine.files import replacing
from workbench.fmi.archive import locate

__all__ = ["Resources"]

_EPOCH = (1980, 1, 1, 0, 0, 0)


class Resources:
    """What goes into the folder `resources`."""

    def __init__(self) -> None:
        self._files: dict[str, Path | bytes] = {}
        self._fmus: dict[Path, str] = {}

    def add_fmu(self, file: str, component: str) -> str:
        """Add an FMU (once, however often it is used) and return its URI in the package.

        Args:
            file: a path, an unpacked FMU's folder, or `fmu:NAME`.
            component: gives the name where another FMU has that of the file.
        """
        path = locate(file).resolve()
        if path not in self._fmus:
            name = path.name if path.suffix.lower() == ".fmu" else f"{path.name}.fmu"
            if name in self._files:
                name = f"{component}_{name}"
            self._fmus[path] = self.add(name, path if path.is_file() else _packed(path))
        return self._fmus[path]

    def add(self, name: str, content: Path | bytes) -> str:
        """Add a file and return its URI in the package."""
        stem, dot, suffix = re.sub(r'[\\/:*?"<>|\x00-\x1f]', "_", name).rpartition(".")
        free, count = f"{stem}{dot}{suffix}", 1
        while free in self._files:
            count += 1
            free = f"{stem}_{count}{dot}{suffix}"
        self._files[free] = content
        return quote(f"resources/{free}")

    def write(self, target: Path, structure: bytes) -> None:
        """Write the package; a file that stood there stays until the new one is complete.

        Raises:
            InputError: it cannot be written.
        """
        with replacing(target) as part, zipfile.ZipFile(part, "w") as archive:
            _put(archive, "SystemStructure.ssd", structure)
            for name, content in self._files.items():
                _put(archive, f"resources/{name}", content if isinstance(content, bytes) else content.read_bytes())


def _put(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    info = zipfile.ZipInfo(name, _EPOCH)
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = 0o644 << 16
    archive.writestr(info, content)


def _packed(folder: Path) -> bytes:
    """Return the files of an unpacked FMU as an .fmu."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for file in sorted(p for p in folder.rglob("*") if p.is_file()):
            _put(archive, file.relative_to(folder).as_posix(), file.read_bytes())
    return buffer.getvalue()
