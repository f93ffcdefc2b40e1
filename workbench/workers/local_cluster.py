"""A Dask scheduler and workers on this machine, in processes of their own, which end with this one."""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from importlib import import_module
from types import TracebackType
from typing import IO, Any, Self

from workbench.errors import InputError

__all__ = ["LocalCluster", "serve"]

_ENDING = 5.0  # [s]


class LocalCluster:
    """A scheduler and workers that answer to this machine alone.

    Args:
        workers: how many, each a process that does one task at a time.

    Attributes:
        address: of the scheduler.

    Raises:
        InputError: none is asked for, or it cannot be started.
    """

    def __init__(self, workers: int) -> None:
        if workers < 1:
            raise InputError(f"local:{workers}: a cluster needs at least 1 worker")
        code = f"from workbench.workers.local_cluster import serve; serve({workers}, sys.stdin)"
        flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]  # noqa: SLF001 - as `process`
        self._process = subprocess.Popen(
            [sys.executable, *flags, "-c", f"import sys; sys.path[:] = {sys.path!r}; {code}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,  # Ctrl-C is for who uses it
        )
        assert self._process.stdout is not None  # noqa: S101
        told = self._process.stdout.readline()
        if not told:
            self.close()
            raise InputError(f"local:{workers}: the cluster did not start (exit code {self._process.returncode})")
        self.address = told.strip()

    def close(self) -> None:
        """End it; any number of times."""
        with suppress(subprocess.TimeoutExpired, ValueError, OSError):
            self._process.communicate(timeout=_ENDING)
        self._process.kill()
        self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def serve(workers: int, until: IO[str], *, host: str = "127.0.0.1", port: int = 0) -> None:
    """Run a scheduler and workers in this process until a stream ends; tell the address on standard output.

    Args:
        workers: how many.
        until: its end ends them.
        host: that the scheduler listens on.
        port: likewise; 0: any.
    """
    distributed: Any = import_module("distributed")  # optional, slow to import, untyped
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, host=host, scheduler_port=port, dashboard_address=f"{host}:0"
    ) as cluster:
        sys.stdout.write(f"{cluster.scheduler_address}\n")
        sys.stdout.flush()
        until.read()
