"""Temporary folders that do not outlive their process for long."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["remove", "scratch", "scratch_folder"]

_PREFIX = "fmi-workbench-"
_LOCK = "lock"


class _Mine:
    """The folder of this process, in which all others are.

    Attributes:
        folder: None: there is none yet.
        lock: descriptor of the locked file in it, which tells that the process lives; the system frees it.
        process: whose folder it is; another one is a copy made by fork.
    """

    folder: Path | None = None
    lock = -1
    process = 0


def scratch_folder(name: str) -> Path:
    """Return a new, empty folder, which is removed at the end of this process, and if that crashes, by the next one.

    Args:
        name: begins the folder's name.
    """
    if _Mine.folder is None or _Mine.process != os.getpid() or not _Mine.folder.is_dir():
        _begin()
    return Path(tempfile.mkdtemp(prefix=f"{name}-", dir=_Mine.folder))


def remove(folder: Path) -> None:
    """Remove one of this process's folders; a copy of the process made by fork leaves it to the original.

    Args:
        folder: that `scratch_folder` made.
    """
    if _Mine.process == os.getpid() and folder.parent == _Mine.folder:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def scratch(name: str) -> Iterator[Path]:
    """Yield such a folder; it is removed afterwards.

    Args:
        name: begins the folder's name.
    """
    folder = scratch_folder(name)
    try:
        yield folder
    finally:
        remove(folder)


@atexit.register
def _end() -> None:
    if _Mine.folder is not None and _Mine.process == os.getpid():
        shutil.rmtree(_Mine.folder, ignore_errors=True)


def _begin() -> None:
    parent = Path(tempfile.gettempdir())
    for left in parent.glob(f"{_PREFIX}*/{_LOCK}"):
        _remove_if_dead(left)
    _Mine.folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=parent)).resolve()
    _Mine.process = os.getpid()
    # Under another name until it is locked, so that no other process takes it for that of a dead one.
    new = _Mine.folder / ("new" if sys.platform != "win32" else _LOCK)
    _Mine.lock = os.open(new, os.O_RDWR | os.O_CREAT, 0o600)
    _locked(_Mine.lock)
    new.rename(_Mine.folder / _LOCK)


def _remove_if_dead(lock: Path) -> None:
    """Remove a folder whose process is gone."""
    with suppress(OSError):  # somebody else's, or another process is removing it
        found = os.open(lock, os.O_RDWR)
        try:
            if _locked(found):
                shutil.rmtree(lock.parent, ignore_errors=True)
        finally:
            os.close(found)


def _locked(file: int) -> bool:
    """Lock a file unless another process has; return whether it is."""
    try:
        if sys.platform == "win32":
            import msvcrt  # noqa: PLC0415 - Windows only

            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl  # noqa: PLC0415 - not on Windows

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
