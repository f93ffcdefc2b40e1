"""Attempts to reach beyond a confined process, each on things that were made for it: `scripts/escapes.py` prints them.

An attempt has a folder with something precious, a process as victim that stands for the workbench's own, somebody who
listens, and a terminal. None names another process, and none does harm where it comes through: where an attack would
be one on the machine, its arguments are such that the system says "wrong arguments" to whoever may, and nothing more.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import signal
import socket
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree

from tests.escape_calls import CALL_NUMBERS
from workbench.jobs.confine import confine

__all__ = ["ATTEMPTS", "Ground", "attempt", "call", "outcomes", "tries"]

# What the system says to somebody who may not: not allowed, no such call, not from there to here.
REFUSALS = {errno.EPERM, errno.EACCES, errno.ENOSYS, errno.EXDEV}

_COLUMN = 0 if platform.machine() == "x86_64" else 1
_PATIENCE = 60  # [s]: an attempt that takes longer is told as one that came through


@dataclass(frozen=True)
class Ground:
    """What an attempt may try itself on.

    Attributes:
        home: folder that is not the process's own, with the file "precious" in it, and others.
        own: folder in which it may write.
        victim: number of a process outside, which leads a group of its own.
        port: of TCP and UDP at which somebody listens on this machine.
        terminal: path of a terminal.
    """

    home: Path
    own: Path
    victim: int
    port: int
    terminal: str

    @property
    def precious(self) -> Path:
        """File that the process did not make."""
        return self.home / "precious"


Attempt = Callable[[Ground], object]
ATTEMPTS: dict[str, Attempt] = {}


def tries(name: str, attempt: Attempt) -> None:
    """Add an attempt: it comes through unless it raises an OSError that refuses."""
    if name in ATTEMPTS:
        raise ValueError(f"{name} is there twice")
    ATTEMPTS[name] = attempt


def attempt(name: str) -> Callable[[Attempt], Attempt]:
    """Return a decorator that adds an attempt."""

    def add(function: Attempt) -> Attempt:
        tries(name, function)
        return function

    return add


def call(name: str, *arguments: object) -> int:
    """Make a system call.

    Raises:
        OSError: it failed.
    """
    number = CALL_NUMBERS[name][_COLUMN]
    if number is None:
        raise OSError(errno.ENOSYS, "not on this processor")
    return raw_call(name, number, *arguments)


def raw_call(name: str, number: int, *arguments: object) -> int:
    """Make the system call of that number; `name` is for the error.

    Raises:
        OSError: it failed.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    libc.syscall.restype = ctypes.c_long
    given = (
        ctypes.c_long(a) if isinstance(a, int) else os.fsencode(a) if isinstance(a, Path) else a for a in arguments
    )
    result = int(libc.syscall(ctypes.c_long(number), *given))
    if result < 0:
        raise OSError(ctypes.get_errno(), name)
    return result


# -- how they are made ---------------------------------------------------------------------------


def outcomes(*, confined: bool) -> Iterator[tuple[str, str]]:
    """Yield the name of each attempt and what became of it: "reached", or the refusal in words."""
    for name, function in ATTEMPTS.items():
        with _ground() as ground:
            yield name, _outcome(function, ground, confined=confined)


@contextmanager
def _ground() -> Iterator[Ground]:
    with ExitStack() as undo:
        folder = Path(tempfile.mkdtemp(prefix="escapes-"))
        undo.callback(rmtree, folder, ignore_errors=True)
        home, own = folder / "home", folder / "own"
        for made in (home, own, home / "empty"):
            made.mkdir()
        (home / "precious").write_text("work of years")
        victim = subprocess.Popen(["sleep", "600"], cwd=home, start_new_session=True)
        undo.callback(victim.wait)
        undo.callback(victim.kill)
        port = _listeners(undo, home)
        master, slave = os.openpty()
        undo.callback(os.close, master)
        undo.callback(os.close, slave)
        yield Ground(home, own, victim.pid, port, os.ttyname(slave))


def _listeners(undo: ExitStack, home: Path) -> int:
    tcp = undo.enter_context(socket.socket())
    tcp.bind(("127.0.0.1", 0))
    tcp.listen()
    port = int(tcp.getsockname()[1])
    udp = undo.enter_context(socket.socket(type=socket.SOCK_DGRAM))
    udp.bind(("127.0.0.1", port))
    for kind, name in ((socket.SOCK_STREAM, "stream"), (socket.SOCK_DGRAM, "datagrams")):
        unix = undo.enter_context(socket.socket(socket.AF_UNIX, kind))
        unix.bind(str(home / name))
        if kind == socket.SOCK_STREAM:
            unix.listen()
    return port


def _outcome(function: Attempt, ground: Ground, *, confined: bool) -> str:
    """Make one attempt in a process of its own; return what became of it."""
    hears, tells = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(hears)
        signal.alarm(_PATIENCE)
        with open(os.devnull, "rb") as nothing:  # noqa: PTH123 - a descriptor
            os.dup2(nothing.fileno(), 0)
        said = b"not confined"
        try:
            if confined:
                confine(str(ground.own))
            said = _said(function, ground)
        finally:
            os.write(tells, said)
            os._exit(0)
    os.close(tells)
    with open(hears, "rb") as answer:  # noqa: PTH123 - a descriptor
        said = answer.read()
    os.waitpid(child, 0)
    return said.decode() or "reached: the process that tried it ended"


def _said(function: Attempt, ground: Ground) -> bytes:
    try:
        function(ground)
    except OSError as error:
        if error.errno in REFUSALS:
            return os.strerror(error.errno).encode()
        return f"reached: {error}".encode()
    except BaseException as error:  # noqa: BLE001 - a fault of the attempt counts as one that came through
        return f"reached? {error!r}".encode()
    return b"reached"
