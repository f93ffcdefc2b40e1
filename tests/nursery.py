"""Worker processes of the tests: copies of one process that has imported what workers need (Linux).

`copied_workers` is in force in every test (`tests/conftest.py`). The package starts each worker anew, and it imports
all that its first task needs: a second for each FMU that crashed, and for each test with another environment. Here one
process for each test process, in which no FMU ever runs, imports that once and forks the workers. What a worker does
from `worker_main.main` on is the same. A test about the start of a worker asks for `started_workers`; confined workers
and those with other settings of Python or BLAS are always started.
"""

from __future__ import annotations

import gc
import os
import pickle
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from importlib import import_module
from typing import IO

import pytest

import workbench.jobs.worker_process
from workbench.jobs.process_copy import ProcessCopy, _serve, can_copy

__all__ = ["copied_workers", "started_workers"]

_started = workbench.jobs.worker_process._started

# Settings that are read before the first line of a worker.
_EARLY = ("LD_", "MALLOC_", "OMP_", "OPENBLAS_", "PYTHON")
_LONGEST = 1 << 20  # of an order [byte]


def _early() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name.startswith(_EARLY)}


class _Nursery:
    """The process that is copied, seen from the tests; it imports when the first worker is wanted."""

    def __init__(self) -> None:
        self.owner, self.settings = os.getpid(), _early()
        self._lock = threading.Lock()
        self._end, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            path = [os.path.abspath(folder) for folder in sys.path]  # noqa: PTH100 - of text
            code = f"import sys; sys.path[:] = {path!r}; from tests.nursery import serve; serve({theirs.fileno()})"
            flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]
            self._process = subprocess.Popen(
                [sys.executable, *flags, "-c", code], pass_fds=[theirs.fileno()], start_new_session=True
            )

    def ask(self, order: object, *descriptors: int) -> int:
        with self._lock:
            socket.send_fds(self._end, [pickle.dumps(order)], descriptors)
            return int(self._end.recv(32))

    def close(self) -> None:
        self._end.close()
        self._process.kill()
        self._process.wait()


class _Copy(ProcessCopy):
    """A worker that the nursery has forked: it alone can take its exit code."""

    def __init__(
        self, nursery: _Nursery, theirs: socket.socket, rest: tuple[int, str, tuple[str, ...]], log: int
    ) -> None:
        self.returncode = None
        self._nursery = nursery
        reading, writing = os.pipe()
        self.stdin: IO[bytes] | None = os.fdopen(writing, "wb", buffering=0)
        os.set_blocking(writing, False)
        try:
            order = (dict(os.environ), list(sys.path), os.getcwd(), rest[1:])  # noqa: PTH109 - a text
            self.pid = nursery.ask(order, theirs.fileno(), log, reading)
        finally:
            os.close(reading)
        self._life = os.pidfd_open(self.pid)

    def _ended(self, options: int) -> int | None:
        if self.returncode is not None:
            return self.returncode
        if options & os.WNOHANG:  # its number stays its own: nobody takes its exit code yet
            return 0 if select.select([self._life], [], [], 0.0)[0] else None
        self.returncode = self._nursery.ask(self.pid)
        os.close(self._life)
        return self.returncode


def serve(link: int) -> None:
    """Fork a worker for each order, in the nursery.

    Args:
        link: descriptor of the connection to the tests; its end is the end of this process.
    """
    end, ready = socket.socket(fileno=link), False
    while True:
        data, descriptors, _, _ = socket.recv_fds(end, _LONGEST, 3)
        if not data:
            os._exit(0)
        order = pickle.loads(data)  # noqa: S301 - of the tests
        if isinstance(order, int):
            _, status = os.waitpid(order, 0)
            end.send(b"%d" % os.waitstatus_to_exitcode(status))
            continue
        if not ready:
            ready = _import_all()
        parent = os.getpid()
        pid = os.fork()
        if pid == 0:
            _be_worker(parent, descriptors, *order)
        for descriptor in descriptors:
            os.close(descriptor)
        end.send(b"%d" % pid)


def _import_all() -> bool:
    from workbench.commands import REQUESTS, request_of
    from workbench.core.machine.cycles import seldom
    from workbench.requests.request import modules_of

    seldom()
    for module in {module for name in REQUESTS for module in modules_of(request_of(name))}:
        import_module(module)
    gc.collect()
    gc.freeze()
    return True


def _be_worker(
    parent: int,
    descriptors: list[int],
    environment: dict[str, str],
    path: list[str],
    folder: str,
    rest: tuple[str, tuple[str, ...]],
) -> None:
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:] = path
    os.chdir(folder)
    theirs, log, reading = descriptors
    _serve(socket.socket(fileno=theirs), (parent, *rest), log, reading)


@pytest.fixture(scope="session", autouse=True)
def copied_workers() -> Iterator[None]:
    """Fork workers where they need not be started."""
    if not can_copy() or "WORKBENCH_TRACED" in os.environ:  # the lines that workers run are recorded in an open file
        yield
        return
    nursery = _Nursery()

    def copied(
        theirs: socket.socket, rest: tuple[int, str, tuple[str, ...]], log: int, first: str
    ) -> subprocess.Popen[bytes] | ProcessCopy:
        if first or os.getpid() != nursery.owner or _early() != nursery.settings:
            return _started(theirs, rest, log, first)
        return _Copy(nursery, theirs, rest, log)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workbench.jobs.worker_process, "_started", copied)
        yield
    workbench.jobs.worker_process._end_all()
    nursery.close()


@pytest.fixture
def started_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start workers as users do; none that waits is taken."""
    while workbench.jobs.worker_process._idle:
        workbench.jobs.worker_process._idle.pop().kill()
    monkeypatch.setattr(workbench.jobs.worker_process, "_started", _started)
