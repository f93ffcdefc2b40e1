"""Read the description of an FMU: once a process, and large ones once a machine."""

from __future__ import annotations

import codecs
import hashlib
import zipfile
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

from workbench.core.locks import forkable_lock
from workbench.errors import FmuError
from workbench.fmi.archive import DAMAGED
from workbench.fmi.declared_xml import read_declared
from workbench.fmi.description import Description
from workbench.fmi.kept import keep, kept, undisturbed
from workbench.fmi.meaning import described
from workbench.fmi.platforms import platforms_in

__all__ = ["DESCRIPTION", "described_at", "read_description"]

DESCRIPTION = "modelDescription.xml"
MAX_XML_BYTES = 512 << 20

_LARGE = 1 << 20  # below, reading anew is as fast [bytes]
_MOST = 8
_known: OrderedDict[str, Description] = OrderedDict()  # by SHA-256 of the file
_reading = forkable_lock()


def read_description(folder: Path, *, source: str) -> Description:
    """Read the description of an unpacked FMU, leniently: what it bends is told in `notes` and `problems`.

    Args:
        folder: where it is unpacked.
        source: what the user named, for messages.

    Raises:
        FmuError: not well-formed, has a document type or entities, or bends rules so far that it
            cannot be read.
    """
    path = folder / DESCRIPTION
    _check_size(path.stat().st_size, source)
    return replace(_described(path.read_bytes(), source), platforms=platforms_in(folder))


def described_at(path: Path) -> Description:
    """Read the description of an FMU without unpacking it; `platforms` stays empty.

    Args:
        path: an FMU, or the folder of an unpacked one.

    Raises:
        FmuError: no FMU, or see `read_description`.
    """
    if path.is_dir():
        return replace(read_description(path, source=str(path)), platforms=())
    try:
        with zipfile.ZipFile(path) as archive:
            _check_size(archive.getinfo(DESCRIPTION).file_size, str(path))
            data = archive.read(DESCRIPTION)
    except KeyError:
        raise FmuError(f"{path}: no {DESCRIPTION} inside; this is not an FMU") from None
    except DAMAGED:
        raise FmuError(f"{path}: not a zip archive or damaged; copy or export it again") from None
    except (OSError, RuntimeError, NotImplementedError) as error:
        raise FmuError(f"{path}: cannot be read: {error}") from None
    return _described(data, str(path))


def _check_size(size: int, source: str) -> None:
    if size > MAX_XML_BYTES:
        raise FmuError(f"{source}: {DESCRIPTION} is larger than {MAX_XML_BYTES >> 20} MiB")


def _described(data: bytes, source: str) -> Description:
    digest = hashlib.sha256(data).hexdigest()
    with _reading:
        if digest in _known:
            _known.move_to_end(digest)
            return _known[digest]
    found = _large(data, digest, source) if len(data) > _LARGE else _read(data, source)
    with _reading:
        _known[digest] = found
        while len(_known) > _MOST:
            _known.popitem(last=False)
    return found


def _large(data: bytes, digest: str, source: str) -> Description:
    found = kept(digest)
    if found is None:
        found = _read(data, source)
        keep(digest, found)
    return found


def _read(data: bytes, source: str) -> Description:
    _refuse_entities(data, source)
    try:
        with undisturbed():
            return described(read_declared(data))
    except FmuError as error:
        raise FmuError(f"{source}: {DESCRIPTION} cannot be read: {error}") from None


def _refuse_entities(data: bytes, source: str) -> None:
    utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\0" in data[:4]
    if utf16:
        data = data.replace(b"\0", b"")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise FmuError(
            f"{source}: {DESCRIPTION} declares a document type or entities, which FMI does "
            "not use and XML bombs do; refused"
        )
