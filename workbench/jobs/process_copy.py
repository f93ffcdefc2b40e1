"""A worker process as a copy of this one (fork): what is imported here is there, too, and need not be imported again.

Right only where a process has run no code of an FMU, has no file open that a copy must not share, and where no thread
may hold a lock that is wanted in the copy.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import sys
import warnings
from contextlib import suppress
from typing import IO, NoReturn

from workbench.jobs.worker_main import main

__all__ = ["ProcessCopy", "can_copy"]

_PR_SET_PDEATHSIG = 1
_HIGHEST = 2  # descriptor of standard error


def can_copy() -> bool:
    """Return whether a copy of a process can do a worker's work: elsewhere than on Linux, libraries forbid it."""
    return sys.platform == "linux"


class ProcessCopy:
    """A copy of this process that serves it as a worker; of `subprocess.Popen` it has what is used.

    Args:
        theirs: the worker's end of the channel.
        rest: further arguments of `worker_main.main`.
        log: descriptor of the file that takes what is printed.

    Attributes:
        pid: its number.
        stdin: its end tells the worker that this process is gone.
        returncode: as `subprocess.Popen` has it; None: it was not seen to end.
    """

    def __init__(self, theirs: socket.socket, rest: tuple[int, str, tuple[str, ...]], log: int) -> None:
        self.returncode: int | None = None
        reading, writing = os.pipe()
        self.stdin: IO[bytes] | None = os.fdopen(writing, "wb", buffering=0)
        os.set_blocking(writing, False)  # nobody reads: an FMU that writes into it shall not wait
        try:
            with warnings.catch_warnings():
                # Other threads are OpenBLAS's, which it ends before a fork, and one that waits for signals.
                warnings.simplefilter("ignore", DeprecationWarning)
                self.pid = os.fork()
            if self.pid == 0:
                _serve(theirs, rest, log, reading)
        finally:
            os.close(reading)

    def poll(self) -> int | None:
        """Return the exit code, −n for signal n; None: it goes on."""
        return self._ended(os.WNOHANG)

    def wait(self) -> int | None:
        """Wait for its end; return the exit code."""
        return self._ended(0)

    def kill(self) -> None:
        """End it by force."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)

    def _ended(self, options: int) -> int | None:
        if self.returncode is None:
            try:
                pid, status = os.waitpid(self.pid, options)
            except ChildProcessError:  # somebody else took its exit code
                pid, status = self.pid, 0
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode


def _serve(theirs: socket.socket, rest: tuple[int, str, tuple[str, ...]], log: int, reading: int) -> NoReturn:
    """Be a worker as one that was started is: with a session, standard streams and a connection of its own only."""
    try:
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGCONT))  # see `worker_process`
        os.setsid()
        signal.set_wakeup_fd(-1)
        for own, standard in ((reading, 0), (log, 1), (log, 2)):
            os.dup2(own, standard)
        link = theirs.detach()
        for name in os.listdir("/proc/self/fd"):  # noqa: PTH208 - numbers
            if int(name) > _HIGHEST and int(name) != link:
                with suppress(OSError):  # of the list itself
                    os.close(int(name))
        main(link, *rest)
    except BaseException:  # noqa: BLE001 - as at the end of a process
        sys.excepthook(*sys.exc_info())
    finally:
        os._exit(1)  # never into what called this
