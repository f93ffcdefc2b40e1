"""Find an FMU and unpack it into a folder that is removed with its owner."""

from __future__ import annotations

import errno
import lzma
import shutil
import stat
import struct
import weakref
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from workbench.core.machine.closable import Closable
from workbench.core.machine.files import named_path
from workbench.core.machine.scratch import remove, scratch_folder
from workbench.errors import FmuError, InputError
from workbench.fmi.bundled import bundled_path, is_bundled, what_is_meant
from workbench.fmi.platforms import is_foreign, note_left

__all__ = ["DAMAGED", "Unpacked", "damaged", "extract", "locate", "unpack"]

# What reading a zip archive raises that is not one, or not a whole one.
DAMAGED = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, ValueError)

_ARCHIVES = (".fmu", ".ssp", ".zip")
_GIT_LFS = b"version https://git-lfs"  # begins what git holds in place of a large file
_MODELS = "an .fmu, an unpacked FMU, fmu:NAME, or a system: .toml, .ssp, .ssd, system:NAME"

MAX_BYTES = 4 << 30  # unpacked, all files together
MAX_FILES = 100_000
MAX_RATIO = 500  # an archive that shrinks better than this is a bomb
HARMLESS = 64 << 20  # unpacked, all files together: no bomb, however well it shrinks
_SHOWN = 80  # characters of an entry's name in a message
_IN_A_FILE = (errno.EEXIST, errno.ENOTDIR, errno.EISDIR)
_MODEL_FILES = (".fmu", ".ssp", ".ssd")
_NAMED = 5  # files of a folder that a message names
_SKIPPED = ("sources", "documentation")  # never needed to run the FMU


class Unpacked(Closable):
    """An FMU as a folder.

    Obligations:
      1. `folder` exists and holds a modelDescription.xml until `close`.
      2. A folder that was made here leaves out sources, documentation and the binaries of other platforms.
      3. A folder that was made here is removed by `close`, when the object is collected, and at
         the end of the process; a folder of the user's is never touched.

    Attributes:
        source: what the user named.
        folder: where the files are.
    """

    def __init__(self, source: Path, folder: Path, *, owned: bool) -> None:
        self.source = source
        self.folder = folder
        self._remove = weakref.finalize(self, remove, folder) if owned else None

    def close(self) -> None:
        """Remove the folder if it was made here. Any number of times."""
        if self._remove is not None:
            self._remove()


def locate(model: str | Path) -> Path:
    """Return the file or folder that `model` names: a path or `fmu:NAME[@3]`.

    Raises:
        InputError: nothing there.
    """
    if is_bundled(str(model)):
        return bundled_path(str(model))
    path = named_path(model)
    if not path.exists():
        raise InputError(f"{model}: no such file; {what_is_meant(path)}give {_MODELS}")
    if not path.is_file() and not path.is_dir():
        raise InputError(f"{model}: this is a device or a pipe; give {_MODELS}")
    return path


def unpack(model: str | Path, called: str = "") -> Unpacked:
    """Unpack the FMU that `model` names, as far as it is needed to run here (a folder is used where it is).

    Args:
        model: a path or `fmu:NAME[@3]`.
        called: what the user calls it, where that is not its path: it lies in a package that was unpacked.

    Raises:
        InputError: nothing there.
        FmuError: not a zip archive, damaged, no modelDescription.xml inside, or an entry that
            would leave the target folder, is a link, or is absurdly large.
    """
    path = locate(model)
    source = Path(called or path)
    if path.is_dir():
        return _checked(Unpacked(source, path, owned=False), given_as_folder=True)
    folder = scratch_folder("fmu")
    unpacked = Unpacked(source, folder, owned=True)
    try:
        note_left(folder, extract(path, folder, wanted=_is_needed, called=called))
        return _checked(unpacked)
    except BaseException:
        unpacked.close()
        raise


def _checked(unpacked: Unpacked, *, given_as_folder: bool = False) -> Unpacked:
    if not (unpacked.folder / "modelDescription.xml").is_file():
        if given_as_folder:
            inside = sorted(p.name for p in unpacked.folder.iterdir() if p.suffix.lower() in _MODEL_FILES)
            which = f"name a model in it: {', '.join(inside[:_NAMED])}" if inside else f"give {_MODELS}"
            raise FmuError(
                f"{unpacked.source}: no modelDescription.xml in this folder, so it is not an unpacked FMU; {which}"
            )
        raise FmuError(f"{unpacked.source}: no modelDescription.xml inside; this is not an FMU")
    return unpacked


def _is_needed(file: PurePosixPath) -> bool:
    return file.parts[0] not in _SKIPPED and not is_foreign(file)


def damaged(path: Path, source: str) -> FmuError:
    """Return the error for a file that is no archive, though its name says so, or that was not meant to be one.

    Args:
        path: of the file.
        source: what the user calls it.
    """
    with path.open("rb") as file:
        if file.read(len(_GIT_LFS)) == _GIT_LFS:
            return FmuError(f"{source}: is a pointer of git-lfs, not the file itself; fetch it with 'git lfs pull'")
    if Path(source).suffix.lower() in _ARCHIVES:
        return FmuError(f"{source}: not a zip archive or damaged; copy or export it again")
    return FmuError(f"{source}: is not an FMU, a system or an SSP package; give {_MODELS}")


def extract(
    path: Path, folder: Path, *, wanted: Callable[[PurePosixPath], bool] = lambda _: True, called: str = ""
) -> list[PurePosixPath]:
    """Extract a zip archive into an empty folder.

    Args:
        path: of the archive.
        folder: where its files go.
        wanted: whether a file of the archive is to be extracted.
        called: what the user calls the archive; empty: by its path.

    Returns:
        The files that were not wanted.

    Raises:
        FmuError: damaged, or an entry that would leave the folder, is a link, or is absurdly large.
    """
    source = called or str(path)
    if not path.is_file():  # a pipe cannot be read twice, and /dev/zero has no end
        raise FmuError(f"{source}: is not a file; an archive is needed")
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            _check_sizes(source, entries)
            named = [(entry, _safe_name(source, entry)) for entry in entries]
            _check_names(source, named)
            for entry, name in named:
                if name.parts and wanted(name):
                    try:
                        _extract_entry(archive, entry, folder.joinpath(*name.parts))
                    except OSError as error:
                        raise FmuError(f"{source}: {_cannot_be_unpacked(name, error)}") from None
            return [name for entry, name in named if not (_is_folder(entry) or wanted(name))]
    except DAMAGED:
        raise damaged(path, source) from None
    except OSError as error:
        raise FmuError(f"{source}: cannot be read: {error.strerror or error}") from None
    except (RuntimeError, NotImplementedError) as error:
        raise FmuError(f"{source}: cannot be unpacked: {error}") from None


def _cannot_be_unpacked(name: PurePosixPath, error: OSError) -> str:
    text = str(name)
    shown = text if len(text) <= _SHOWN else f"{text[: _SHOWN // 2]}…{text[-_SHOWN // 2 :]}"
    if error.errno in _IN_A_FILE:
        return f"entry '{shown}' is in conflict with another: one name is a file and a folder; pack it again"
    hints = {
        errno.ENOSPC: "; make room in the folder for temporary files, or set TMPDIR to another",
        errno.ENAMETOOLONG: "; pack it again with a shorter name",
    }
    return f"entry '{shown}' cannot be unpacked: {error.strerror or error}{hints.get(error.errno or 0, '')}"


def _check_sizes(source: str, entries: list[zipfile.ZipInfo]) -> None:
    total = sum(e.file_size for e in entries)
    packed = max(1, sum(e.compress_size for e in entries))
    if total > MAX_BYTES or len(entries) > MAX_FILES:
        raise FmuError(f"{source}: would unpack to {total >> 20} MiB in {len(entries)} files; refused")
    if total > HARMLESS and total > MAX_RATIO * packed:
        raise FmuError(f"{source}: unpacks {total // packed} times larger, as zip bombs do; refused")


def _check_names(source: str, named: list[tuple[zipfile.ZipInfo, PurePosixPath]]) -> None:
    known: dict[PurePosixPath, zipfile.ZipInfo] = {}
    for entry, name in named:
        other = known.setdefault(name, entry)
        if not _is_folder(entry) and (other.CRC, other.file_size) != (entry.CRC, entry.file_size):
            raise FmuError(f"{source}: '{name}' is in it twice, with different contents; which counts? Pack it again")


def _is_folder(entry: zipfile.ZipInfo) -> bool:
    return entry.filename.endswith(("/", "\\"))


def _extract_entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path) -> None:
    if _is_folder(entry):  # also an empty one: JModelica's FMUs ask for theirs
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    # zipfile stops at the declared size, so a lying header cannot write more than was checked.
    with archive.open(entry) as source, target.open("wb") as sink:
        shutil.copyfileobj(source, sink)


def _safe_name(source: str, entry: zipfile.ZipInfo) -> PurePosixPath:
    name = PurePosixPath(entry.filename.replace("\\", "/"))
    if name.is_absolute() or ".." in name.parts or ":" in entry.filename or not (name.parts or _is_folder(entry)):
        raise FmuError(f"{source}: entry '{entry.filename}' would leave the target folder; refused")
    if stat.S_ISLNK(entry.external_attr >> 16):
        raise FmuError(f"{source}: entry '{entry.filename}' is a symbolic link; refused")
    return name
