"""Files that are written, as a whole or not at all; FMUs as zips whose bytes depend on their contents only."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import zipfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from workbench.errors import InputError, close_names, one_line

__all__ = ["cache_folder", "close_files", "content_of", "file_path", "file_to_write", "named_path", "pack", "replacing"]

_DATE = (1980, 1, 1, 0, 0, 0)  # the first date that zip knows
_UNIX = 3
_SHOWN = 60  # characters of a name that no file can have
_FILE_MODE = 0o100644 << 16
_LEVEL = 9  # of compression: written once, kept and copied often


def file_path(given: object, *, otherwise: str = "") -> Path:
    """Return the path of a file that Python names.

    Args:
        given: by a text or a path.
        otherwise: what to do with anything else.

    Raises:
        InputError: it is anything else.
    """
    if isinstance(given, str | os.PathLike):
        return Path(given)
    words = f"a value of class {type(given).__name__} is not the name of a file"
    raise InputError(f"{words}; {otherwise}" if otherwise else words)


def named_path(path: str | Path) -> Path:
    """Return a path that somebody has named; asking for one that no file can have would fail otherwise.

    Args:
        path: as it was given; "~" is the home folder.

    Raises:
        InputError: the system takes no such name.
    """
    result = Path(path).expanduser()
    try:
        with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
            result.lstat()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        text = str(path)
        shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
        raise InputError(f"'{one_line(shown)}': no file can have this name: {why}") from None
    return result


def close_files(missing: Path, suffixes: Collection[str]) -> list[str]:
    """Return files of a folder that one that is not there may be a misspelling of, the closest first.

    Args:
        missing: what is not there.
        suffixes: of files that would do, such as ".toml".
    """
    folder = missing.parent
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in suffixes) if folder.is_dir() else []
    near = close_names(missing.stem, (p.stem for p in files))  # suffixes are alike in any case
    return [p.name for stem in near for p in files if p.stem == stem]


def content_of(path: Path) -> bytes:
    """Return what is in a file that somebody has named, or comes out of a pipe.

    A device, such as /dev/zero, is not read: it may have no end.

    Args:
        path: of the file.

    Raises:
        OSError: it cannot be read; `strerror` says why.
    """
    with path.open("rb") as file:
        kind = os.fstat(file.fileno()).st_mode
        if stat.S_ISCHR(kind) or stat.S_ISBLK(kind):
            raise OSError(errno.EINVAL, "it is a device, not a file")
        return file.read()


def cache_folder(name: str) -> Path:
    """Return the folder for what can be made again, of this user; it may not exist.

    Args:
        name: of what lies there.
    """
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "fmi-workbench" / name


def file_to_write(path: str | Path, suffix: str = "", *, option: str = "") -> Path:
    """Return a path where a file can be written.

    Args:
        path: of the file.
        suffix: that it must have; empty: any.
        option: that was given, for the message.

    Raises:
        InputError: another suffix, a folder, or a folder that does not exist.
    """
    target, said = named_path(path), f"{option}: " if option else ""
    if suffix and target.suffix.lower() != suffix:
        raise InputError(f"{said}'{path}' must end in {suffix}: it is the file to write")
    if target.is_dir():
        raise InputError(f"{said}'{path}' is a folder; name a file in it")
    if not target.parent.is_dir():
        raise InputError(f"{said}the folder '{target.parent}' does not exist")
    return target


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield where to write a file; it takes its place when all of it is written.

    A file that stood there is left as it was if anything goes wrong, say because the disk is full. A device or a named
    pipe, such as /dev/stdout, is written to directly.

    Args:
        path: of the file; a link is followed.

    Raises:
        InputError: it cannot be written.
    """
    target = file_path(path)
    try:
        if target.exists() and not target.is_file() and not target.is_dir():
            yield target
            return
        real = target.resolve()
        part = real.with_name(f".part-{os.getpid()}-{real.name}")
        try:
            yield part
            # The system may put the name on the disk before the contents: after a power cut both would be lost.
            _on_disk(part)
            if real.exists():
                shutil.copymode(real, part)
            part.replace(real)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


def _on_disk(path: Path) -> None:
    """Wait until what was written is on the disk; if it cannot be, as on a full one, this says so."""
    file = os.open(path, os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def pack(output: Path, files: Mapping[str, bytes]) -> None:
    """Write `files` (name in the archive → contents) to `output`, modelDescription.xml first.

    An interrupted build leaves the old one whole.

    Raises:
        InputError: it cannot be written.
    """
    output.parent.mkdir(parents=True, exist_ok=True)
    names = sorted(files, key=lambda name: (name != "modelDescription.xml", name))
    with replacing(output) as part, zipfile.ZipFile(part, "w") as archive:
        for name in names:
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = _UNIX
            entry.external_attr = _FILE_MODE
            archive.writestr(entry, files[name], compresslevel=_LEVEL)
