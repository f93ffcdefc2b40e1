"""Read the description of an FMU, and the terminals beside it: once a process, and large ones once a machine."""

from __future__ import annotations

import codecs
import hashlib
import zipfile
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from workbench.core.machine.cycles import undisturbed
from workbench.core.machine.locks import forkable_lock
from workbench.errors import FmuError
from workbench.fmi.archive import DAMAGED, damaged
from workbench.fmi.declared_xml import read_declared
from workbench.fmi.description import ModelDescription
from workbench.fmi.description_maker import described
from workbench.fmi.kept import keep, kept
from workbench.fmi.platforms import platforms_in
from workbench.fmi.structure import with_structure
from workbench.fmi.terminals import terminals_in

__all__ = ["DESCRIPTION", "described_at", "read_description"]

DESCRIPTION = "modelDescription.xml"
MAX_XML_BYTES = 512 << 20

_LARGE = 1 << 20  # below, reading anew is as fast [bytes]
_MOST = 8
_known: OrderedDict[str, ModelDescription] = OrderedDict()  # by SHA-256 of the file and the sizes
_reading = forkable_lock()


def read_description(folder: Path, *, source: str, structure: Mapping[str, int] | None = None) -> ModelDescription:
    """Read the description of an unpacked FMU, leniently: what it bends is told in `notes` and `problems`.

    Args:
        folder: where it is unpacked.
        source: what the user named, for messages.
        structure: structural parameters → values other than those in the file; arrays have the sizes that follow.

    Raises:
        FmuError: not well-formed, has a document type or entities, or bends rules so far that it
            cannot be read.
    """
    result = _described(_data_in(folder, source), source, structure or {})
    terminals, remarks = terminals_in(folder)
    return replace(result, platforms=platforms_in(folder), terminals=terminals, notes=(*result.notes, *remarks))


def described_at(path: Path, called: str = "") -> ModelDescription:
    """Read the description of an FMU without unpacking it; `platforms` and `terminals` stay empty.

    Args:
        path: an FMU, or the folder of an unpacked one.
        called: what the user calls it; empty: by its path.

    Raises:
        FmuError: not an FMU, or see `read_description`.
    """
    source = called or str(path)
    if path.is_dir():
        return _described(_data_in(path, source), source, {})
    try:
        with zipfile.ZipFile(path) as archive:
            _check_size(archive.getinfo(DESCRIPTION).file_size, source)
            data = archive.read(DESCRIPTION)
    except KeyError:
        raise FmuError(f"{source}: no {DESCRIPTION} inside; this is not an FMU") from None
    except DAMAGED:
        raise damaged(path, source) from None
    except (OSError, RuntimeError, NotImplementedError) as error:
        raise FmuError(f"{source}: cannot be read: {error}") from None
    return _described(data, source, {})


def _data_in(folder: Path, source: str) -> bytes:
    path = folder / DESCRIPTION
    _check_size(path.stat().st_size, source)
    return path.read_bytes()


def _check_size(size: int, source: str) -> None:
    if size > MAX_XML_BYTES:
        raise FmuError(f"{source}: {DESCRIPTION} is larger than {MAX_XML_BYTES >> 20} MiB")


def _described(data: bytes, source: str, structure: Mapping[str, int]) -> ModelDescription:
    whole = hashlib.sha256(data)
    whole.update("".join(f"\0{name}={structure[name]}" for name in sorted(structure)).encode())
    digest = whole.hexdigest()
    with _reading:
        if digest in _known:
            _known.move_to_end(digest)
            return _known[digest]
    result = kept(digest) if len(data) > _LARGE else None
    if result is None:
        result = _read(data, source, structure)
        if len(data) > _LARGE:
            keep(digest, result)
    with _reading:
        _known[digest] = result
        while len(_known) > _MOST:
            _known.popitem(last=False)
    return result


def _read(data: bytes, source: str, structure: Mapping[str, int]) -> ModelDescription:
    _refuse_entities(data, source)
    try:
        with undisturbed():
            declared = read_declared(data)
            if structure:
                with_structure(declared, structure)
            return described(declared, resized=bool(structure))
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
