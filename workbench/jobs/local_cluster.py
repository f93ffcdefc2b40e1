"""A Dask scheduler and workers on this machine, in processes of their own, which end with this one."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import IO, Any

from workbench.core.machine.closable import Closable
from workbench.errors import InputError

__all__ = ["LocalCluster", "distributed", "security", "serve", "started", "three"]

# Time for the processes to end in good order [s]. Their results are here, and Ctrl-C is to be obeyed soon.
_ENDING = 1.0

# Time for its workers to notice that it is gone, and between two checks whether they have ended [s].
_LEAVING, _PAUSE = 5.0, 0.02

# What Dask does while nothing happens takes 5 % of a core for each process otherwise.
_IDLE = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}


def distributed() -> Any:  # noqa: ANN401 - it is untyped
    """Return the library, which is optional and slow to import.

    Raises:
        InputError: it is not installed.
    """
    try:
        return import_module("distributed")
    except ImportError:
        raise InputError('a cluster needs distributed: pip install "fmi-workbench[cluster]"') from None


def three(tls: Sequence[str]) -> tuple[str, str, str]:
    """Return the files for TLS.

    Args:
        tls: see `security`.

    Raises:
        InputError: another number of files.
    """
    if len(tls) != 3:
        raise InputError("tls: takes three files: certificate of the authority, own certificate, own key")
    return tls[0], tls[1], tls[2]


def security(tls: Sequence[str]) -> Any:  # noqa: ANN401 - distributed is untyped
    """Return what `distributed` wants for TLS, the same for scheduler, workers and client.

    Args:
        tls: files: certificate of the authority, own certificate, own key.

    Raises:
        InputError: another number of files, or one is not there.
    """
    ca, certificate, key = three(tls)
    for file in tls:
        if not Path(file).is_file():
            raise InputError(f"tls: {file}: no such file")
    own = {f"tls_{who}_{what}": file for who in ("scheduler", "worker", "client") for what, file in
           (("cert", certificate), ("key", key))}  # fmt: skip
    return distributed().Security(tls_ca_file=ca, require_encryption=True, **own)


@contextmanager
def started(workers: int, *, host: str = "127.0.0.1", port: int = 0, tls: Sequence[str] | None = None) -> Iterator[Any]:
    """Yield a `distributed.LocalCluster`: a scheduler in this process, workers that do one task at a time in others.

    Args:
        workers: how many.
        host: that the scheduler listens on.
        port: likewise; 0: any.
        tls: see `security`; None: without.

    Raises:
        InputError: none is asked for, it cannot listen there, or `distributed` is not installed.
    """
    if workers < 1:
        raise InputError(f"local:{workers}: a cluster needs at least 1 worker")
    library = distributed()
    import_module("dask").config.set(_IDLE)  # of this process, and of the workers that it starts
    _knock(host, port)
    try:
        cluster = library.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host=f"tls://{host}" if tls else host,
            scheduler_port=port,
            dashboard_address=f"{host}:0",
            security=security(tls) if tls else None,
        )
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"a cluster cannot be started: {error}") from None
    with cluster:
        yield cluster


def _knock(host: str, port: int) -> None:
    """Try whether a scheduler can listen there: what Dask says where it cannot fills a page."""
    try:
        with socket.create_server((host, port)):
            pass
    except (OSError, OverflowError) as error:
        why = os.strerror(number) if (number := getattr(error, "errno", None) or 0) > 0 else error
        raise InputError(f"a cluster cannot listen at {host}:{port}: {why}; give another port, or 0 for any") from None


def serve(workers: int, until: IO[str]) -> None:
    """Run a scheduler and workers in this process until a stream ends; tell the address on standard output."""
    with started(workers) as cluster:
        sys.stdout.write(f"{cluster.scheduler_address}\n")
        sys.stdout.flush()
        until.read()


class LocalCluster(Closable):
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
        distributed()  # else there is no reason to begin
        code = f"from workbench.jobs.local_cluster import serve; serve({workers}, sys.stdin)"
        flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]  # noqa: SLF001 - as `process`
        self._process = subprocess.Popen(
            [sys.executable, *flags, "-c", f"import sys; sys.path[:] = {sys.path!r}; {code}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,  # Ctrl-C is for who uses it
        )
        line = "" if self._process.stdout is None else self._process.stdout.readline()
        if not line:
            self.close()
            raise InputError(f"local:{workers}: the cluster did not start (exit code {self._process.returncode})")
        self.address = line.strip()

    @property
    def pid(self) -> int:
        """Number of the scheduler's process, the parent of the workers."""
        return self._process.pid

    def _end_group(self) -> None:
        """Let the workers end, which see that the scheduler's process is gone, then end by force what is left.

        With them ends the process that gives back the names of their semaphores: killed beside them it gives none.
        """
        if os.name != "posix":
            return
        until = time.monotonic() + _LEAVING
        with suppress(OSError):
            while time.monotonic() < until:
                os.killpg(self._process.pid, 0)  # until nobody is left; it leads a group
                self._process.poll()
                time.sleep(_PAUSE)
            os.killpg(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        """End it; any number of times."""
        try:
            self._process.communicate(timeout=_ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._end_group()
        except (ValueError, OSError):
            pass  # its pipes are closed: this is not the first time
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
