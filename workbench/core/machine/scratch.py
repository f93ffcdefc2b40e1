"""Temporary folders that do not outlive their process for long."""

from __future__ import annotations

import atexit
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from workbench.core.machine.locks import forkable_lock

__all__ = ["remove", "remove_if_dead", "scratch", "scratch_folder"]

_PREFIX = "fmi-workbench-"
_LOCK = "lock"
_UNLOCKED = -1  # in place of a descriptor, where files cannot be locked
_beginning = forkable_lock()


class _Mine:
    """The folder of this process, in which all others are.

    Attributes:
        folder: None: there is none yet.
        lock: descriptor of the locked file in it, which tells that the process lives; the system frees it. Without
            locks nobody takes the folder for that of a dead process, whose own it then remains.
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
    with _beginning:
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
    for left in parent.glob(f"{_PREFIX}*"):
        remove_if_dead(left)
    while True:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=parent)).resolve()
        lock = _lock_of(folder)
        if lock is not None:
            break  # else another process took it, before it was locked, for that of a dead one, and removes it
    _Mine.folder, _Mine.lock, _Mine.process = folder, lock, os.getpid()


def remove_if_dead(folder: Path) -> bool:
    """Remove a folder whose process is gone, or was before it had locked the folder; return whether it was.

    Args:
        folder: that a process had for all of its own.
    """
    try:
        owner = folder.lstat()
        if not stat.S_ISDIR(owner.st_mode) or (hasattr(os, "getuid") and owner.st_uid != os.getuid()):
            return False  # a link, or somebody else's
        if not (folder / _LOCK).exists() and any(folder.iterdir()):
            return False  # ours begin with the lock: somebody else gave it such a name
    except OSError:
        return False
    lock = _lock_of(folder)
    if lock in (None, _UNLOCKED):
        return False
    if sys.platform == "win32":
        os.close(lock)  # what is open cannot be removed there
    for left in folder.iterdir():  # the lock last: what is left of a folder without it is left alone
        if left.name != _LOCK:
            shutil.rmtree(left, ignore_errors=True) if left.is_dir() else left.unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)
    if sys.platform != "win32":
        os.close(lock)
    return True


def _lock_of(folder: Path) -> int | None:
    """Return the descriptor of a folder's locked file; None: another process has it, or removes the folder.

    `_UNLOCKED`: the system locks no files here, as in a confined process or on some network file systems.

    Whoever has the lock of the file that is in the folder now has the folder: one that was removed meanwhile, and made
    anew, is another file.
    """
    try:
        lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
    except OSError:
        return None
    try:
        if _locked(lock) and os.path.samestat(os.fstat(lock), (folder / _LOCK).stat()):
            return lock
    except FileNotFoundError:
        pass
    except OSError:
        os.close(lock)
        return _UNLOCKED
    os.close(lock)
    return None


def _locked(file: int) -> bool:
    """Lock a file unless another process has; return whether it is.

    Raises:
        OSError: the system locks no files here.
    """
    if sys.platform == "win32":
        import msvcrt  # noqa: PLC0415 - Windows only

        with suppress(OSError):  # it does not say why
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
            return True
        return False
    import fcntl  # noqa: PLC0415 - not on Windows

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
