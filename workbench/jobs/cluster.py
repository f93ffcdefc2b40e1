"""A Dask cluster as the place where tasks run, in batches of about a second."""

from __future__ import annotations

import json
import logging
import math
import pickle
import queue
import re
import socket
import struct
import time
import warnings
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from workbench.core.machine.closable import Closable
from workbench.core.machine.files import content_of
from workbench.errors import InputError, LostError, WorkbenchError, one_line
from workbench.jobs.in_cluster import Batch, BatchReply, do_batch, proof, take_apart, the_same
from workbench.jobs.local_cluster import LocalCluster, distributed, security, three
from workbench.jobs.options import Limits, Scheduler, Workers
from workbench.jobs.runner import Lost, Reply, Runner
from workbench.jobs.version import Stamp, stamp
from workbench.jobs.worker_main import Task
from workbench.model.base import Recipe

__all__ = ["Cluster", "OnCluster", "reached"]

_CONNECT = 10.0  # [s]
_PATIENCE = 60.0  # without any worker [s]
_CLOSING = 1.0  # [s]
_WAIT = 0.1  # [s] between two checks for a request to stop
_LOOK = 1.0  # [s] between two counts of the workers

_WORTH = 1.0  # [s]: work in a batch
_REMEMBERED = 8  # batches from whose times the size of the next follows
_IN_ORDER = "0 ms"  # Dask begins what comes within a tenth of a second in any order else
_WAITING = 2  # batches for each thread of a worker: one in work, one that waits
_PROBES = 8  # batches of one job at the beginning
_SMALLEST = 4  # of what is worth a task: what a task costs itself is small beside it
_SHARE = 2  # the last batches are smaller: so many for each thread are left to share out

_LOUD = ("distributed", "tornado", "asyncio")
_CONFIGURED = "distributed.comm.tls.ca-file"
_LOCAL = re.compile(r"local:(\d+)")
_ADDRESS = re.compile(r"(?:(?:tcp|tls|ws|wss)://)?(\[[^\]\s]+\]|[^:/\[\]\s]+):(\d{1,5})/?")
_SILENT = ("tls:", "ws:", "wss:")  # there, who connects speaks first
_LENGTH = struct.Struct("<Q")  # with which the first message begins otherwise
_GREETING = 1 << 16  # [byte]: it is shorter
_NO_SCHEDULER = "something else than a Dask scheduler listens there; is the address right?"
_DISTRIBUTION = "fmi-workbench"


class Cluster(Scheduler, Closable):
    """A Dask cluster that stays connected for several analyses.

    Wherever `Workers(scheduler=…)` takes an address it takes a cluster. Its workers need the same workbench and no
    FMU. Each proves its state (versions of workbench and kernel, all sources) before it gets work; one that differs
    is refused. Without a `with` block around it each analysis connects anew.

    Args:
        scheduler: address of the scheduler (tcp://.., tls://..), its scheduler file (.json), or local:N for N workers
            on this machine, which end with the cluster.
        tls: files for tls://: certificate of the authority, own certificate, own key.
        patience: longest time without any worker [s].

    Attributes:
        address: of the scheduler.

    Raises:
        InputError: `distributed` is not installed, no scheduler answers there, it has no workers, or these run
            another state of the workbench.

    Examples:
        Two workers on this machine, two analyses.

        ```python
        with wb.Cluster("local:2") as cluster, wb.load("fmu:Rudder") as rudder:
            there = wb.Workers(scheduler=cluster)
            response = wb.nfr(rudder, "delC", "del", band=(0.5, 20.0), amplitudes=[1.0, 4.0], workers=there)
            models = wb.lin_over(rudder, {"mH": [0.0, 50.0, 100.0]}, inputs=["delC"], workers=there)
        ```
    """

    def __init__(self, scheduler: str, *, tls: Sequence[str] | None = None, patience: float = _PATIENCE) -> None:
        if not 0.0 < patience < math.inf:
            raise InputError(f"patience: {patience:g} s is not a positive finite number")
        self.address = scheduler
        self.tls = None if tls is None else three(tls)
        self.patience = patience
        self._client: Any = None
        self._closing = ExitStack()

    @classmethod
    def at(cls, workers: Workers) -> Cluster:
        """Return the cluster that is asked for.

        Args:
            workers: with a scheduler.
        """
        result = workers.scheduler
        return result if isinstance(result, Cluster) else cls(str(result), tls=workers.tls)

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process connects by itself."""
        return partial(Cluster, tls=self.tls, patience=self.patience), (self.address,)

    def __repr__(self) -> str:
        return f"Cluster({self.address!r})"

    @property
    def connected(self) -> bool:
        """Whether it is."""
        return self._client is not None

    @property
    def client(self) -> Any:  # noqa: ANN401 - distributed is untyped
        """The `distributed.Client`.

        Raises:
            InputError: it is not connected.
        """
        if self._client is None:
            raise InputError(f"scheduler {self.address}: is not connected; use it in a with block")
        return self._client

    @property
    def lost(self) -> bool:
        """Whether the scheduler does not answer any more."""
        return bool(self.client.status != "running")

    @property
    def dashboard(self) -> str:
        """Address of the page that shows what the cluster does; empty: there is none."""
        try:
            return str(self.client.dashboard_link)
        except (KeyError, OSError, AttributeError, ValueError):
            return ""

    @property
    def words(self) -> str:
        """Where it is, how many work there, and where that can be watched."""
        size = self.size
        shown = f"; dashboard: {self.dashboard}" if self.dashboard else ""
        return f"scheduler {self.address}: {size} worker{'s' if size != 1 else ''}{shown}"

    @property
    def size(self) -> int:
        """How many tasks it does at a time; 0 where it is not connected."""
        return sum(self.threads().values()) if self.connected else 0

    def threads(self) -> Mapping[str, int]:
        """Return address of each worker → how many tasks it does at a time.

        Raises:
            LostError: the scheduler does not answer.
        """
        try:
            return dict(self.client.nthreads())
        except (OSError, ValueError, AttributeError, RuntimeError):
            raise self.gone() from None

    def gone(self) -> LostError:
        """Return the error of a scheduler that does not answer."""
        return LostError(f"scheduler {self.address}: the connection was lost; what was finished before is kept")

    def __enter__(self) -> Self:
        with ExitStack() as undo:
            undo.enter_context(_quiet())
            local = _LOCAL.fullmatch(self.address)
            if local:
                self.address = undo.enter_context(LocalCluster(int(local[1]))).address
            self._client = _connected(self.address, self.tls)
            undo.callback(self._disconnect)
            self._wait_for_workers()
            self._compare(self.client.run(proof, on_error="return"))
            self._closing = undo.pop_all()
        return self

    def close(self) -> None:
        """Let go of it; any number of times."""
        self._closing.close()

    def _disconnect(self) -> None:
        client, self._client = self._client, None
        with suppress(Exception):  # nobody is there who could listen
            client.close(timeout=_CLOSING)

    def _wait_for_workers(self) -> None:
        with suppress(TimeoutError, OSError):  # asyncio's and distributed's are the former
            self.client.wait_for_workers(1, timeout=self.patience)
        if not self.threads():
            raise InputError(
                f"scheduler {self.address}: has no workers after {self.patience:g} s; "
                f"start some with: dask worker {self.address}"
            )

    def _compare(self, proofs: Mapping[str, Any]) -> None:
        """Refuse workers whose workbench is not in the state of this one."""
        for worker, result in proofs.items():
            if not isinstance(result, tuple):
                self.refuse(worker, f"no workbench that can prove its state ({self._version_at(worker)})")
            if result != tuple(stamp()):
                self.refuse(worker, str(Stamp(*result)) if len(result) == len(stamp()) else repr(result))

    def _version_at(self, worker: str) -> str:
        result = self.client.run(version, _DISTRIBUTION, workers=[worker], on_error="return").get(worker)
        return f"workbench {result}" if isinstance(result, str) else "none is installed"

    def refuse(self, worker: str, result: str) -> None:
        """Raise the error of a worker in another state.

        Args:
            worker: its address.
            result: its state.

        Raises:
            InputError: always.
        """
        raise InputError(
            f"scheduler {self.address}: worker {worker} has {result}; here is {stamp()}; install the same there"
        )

    def prove(self) -> None:
        """Compare the state of all workers again.

        Raises:
            InputError: one differs.
        """
        self._compare(self.client.run(proof, on_error="return"))


@contextmanager
def reached(workers: Workers) -> Iterator[tuple[Workers, str]]:
    """Yield where parts run with a cluster that is connected, and words on it where it was not before.

    Args:
        workers: with a scheduler.

    Raises:
        InputError: see `Cluster`.
    """
    cluster = Cluster.at(workers)
    if cluster.connected:
        yield workers, ""
        return
    with cluster:
        yield replace(workers, scheduler=cluster, tls=None), cluster.words


def _connected(address: str, tls: Sequence[str] | None) -> Any:  # noqa: ANN401 - distributed is untyped
    for file in tls or ():
        if not Path(file).is_file():
            raise InputError(f"scheduler {address}: {file}: no such file")
    library = distributed()
    where = _told_in(address) if address.endswith(".json") else address
    if where.startswith("tls:") and tls is None and not import_module("dask").config.get(_CONFIGURED, None):
        raise InputError(
            f"scheduler {address}: needs certificates: `tls` (CA, CERT, KEY), or {_CONFIGURED} in Dask's configuration"
        )
    _knock(address, where)
    own = {} if tls is None else {"security": security(tls)}
    try:
        return library.Client(address=where, timeout=_CONNECT, set_as_default=False, **own)
    except Exception as error:  # noqa: BLE001 - whatever comes of what an unknown program says
        raise InputError(f"scheduler {address}: {_NO_SCHEDULER} ({one_line(str(error))})") from None


def _told_in(file: str) -> str:
    """Return the address in a scheduler file.

    Raises:
        InputError: it is not there, or is not such a file.
    """
    try:
        return str(json.loads(content_of(Path(file)))["address"])
    except FileNotFoundError:
        raise InputError(
            f"scheduler {file}: no such file; dask scheduler --scheduler-file {file} writes it, where all can read it"
        ) from None
    except OSError as error:
        raise InputError(f"scheduler {file}: cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            f"scheduler {file}: is not a scheduler file: it must be JSON with an entry address, as dask scheduler "
            "--scheduler-file writes it"
        ) from None


def _knock(address: str, where: str) -> None:
    """Try whether a scheduler listens there: the library underneath would wait for ever for what it says first.

    Raises:
        InputError: none does, or it is not an address.
    """
    parts = _ADDRESS.fullmatch(where)
    if parts is None:
        named = "" if address == where else f" '{where}'"
        raise InputError(
            f"scheduler {address}: is not an address{named}; give tcp://host:8786, tls://host:8786, a scheduler file "
            "(.json), or local:N for N workers on this machine"
        )
    host, port = parts[1].strip("[]"), int(parts[2])
    try:
        with socket.create_connection((host, port), timeout=_CONNECT) as door, door.makefile("rb") as heard:
            said = b"" if where.startswith(_SILENT) else heard.read(_LENGTH.size)
    except TimeoutError:
        why = "it does not answer"
    except socket.gaierror:
        why = f"there is no host '{host}'"
    except ConnectionRefusedError:
        why = f"nobody listens at port {port} of {host}"
    except (OSError, UnicodeError, OverflowError) as error:
        why = one_line(str(error))
    else:
        if where.startswith(_SILENT) or (len(said) == _LENGTH.size and _LENGTH.unpack(said)[0] < _GREETING):
            return
        raise InputError(f"scheduler {address}: {_NO_SCHEDULER}")
    raise InputError(
        f"scheduler {address}: cannot be reached: {why}; does the scheduler run, and is its address right?"
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """Let what goes wrong be told in our words alone, not in the log of the libraries underneath as well."""
    distributed()  # which gives each of its loggers a level
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in _LOUD]
    logs = [logging.getLogger(name) for name in {*names, *_LOUD}]
    before = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for log, level in zip(logs, before, strict=True):
            log.setLevel(level)


class OnCluster(Runner):
    """Runs tasks on a cluster: each in a worker process of its own, as `Pool` does, inside a worker of the cluster.

    One task of the scheduler is a batch of jobs of about a second, as measured. As many batches are there as keep all
    workers busy, which may come and go. The FMU goes to each worker once, whatever is varied of it. A worker that
    dies costs nothing: its batches are done elsewhere, those that keep killing workers job by job.

    Args:
        cluster: is connected for as long as the runner lives, unless it is already.
        recipe: of the model; None: the tasks have none.
        limits: time and memory for each job.

    Raises:
        InputError: see `Cluster`.
    """

    def __init__(self, cluster: Cluster, recipe: Recipe | None, *, limits: Limits) -> None:
        self._cluster, self._limits = cluster, limits
        self._closing = ExitStack()
        if not cluster.connected:
            self._closing.enter_context(cluster)
        self._recipe, archives = take_apart(recipe)
        self._archives = tuple(archives)
        client = cluster.client
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large arguments, which these are on purpose
            self._sent = [
                client.submit(the_same, archive, key=f"workbench-fmu-{key}", pure=True)
                for key, archive in archives.items()
            ]
        self._in_work: dict[Any, list[Any]] = {}
        self._ready: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._alone: deque[Any] = deque()  # jobs whose batch killed workers
        self._times: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)
        self._slots, self._looked = 0, -math.inf
        self._begun = self._worked = time.monotonic()

    def run(self, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        self._begun = self._worked = time.monotonic()
        try:
            while jobs or self._alone or self._in_work:
                self._look()
                self._send(task, jobs)
                for future, result in self._results(self._finished()):
                    yield from self._take(future, result)
        finally:
            self._cancel()

    def close(self) -> None:
        self._cancel()
        self._sent = []
        self._closing.close()

    # -- sending -------------------------------------------------------------------------------

    def _look(self) -> None:
        """Count the workers now and then, which come and go."""
        now = time.monotonic()
        if now < self._looked + _LOOK:
            return
        self._slots, self._looked = self._cluster.size, now
        if self._slots:
            self._worked = now
        elif now > self._worked + self._cluster.patience:
            raise LostError(
                f"scheduler {self._cluster.address}: has had no workers for {self._cluster.patience:g} s; what was "
                "finished before is kept"
            )

    def _send(self, task: Task, jobs: deque[Any]) -> None:
        """Let enough batches be under way."""
        most = _WAITING * self._slots
        if not self._times and time.monotonic() < self._begun + _WORTH:
            most = min(_PROBES, most)  # the first tell how many are worth a task, unless they take longer
        while (jobs or self._alone) and len(self._in_work) < most:
            count = self._size(len(jobs))
            some = [self._alone.popleft()] if self._alone else [jobs.popleft() for _ in range(count)]
            batch = Batch(self._recipe, self._archives, task, tuple(some), self._limits)
            packed = pickle.dumps(batch, pickle.HIGHEST_PROTOCOL)
            future = self._cluster.client.submit(
                do_batch, tuple(stamp()), packed, *self._sent, pure=False, fifo_timeout=_IN_ORDER
            )
            self._in_work[future] = some
            future.add_done_callback(self._ready.put)

    def _size(self, left: int) -> int:
        """Return how many jobs take about a second; towards the end fewer, so that all workers end together."""
        jobs, seconds = (sum(column) for column in zip(*self._times, strict=True)) if self._times else (1, _WORTH)
        worth = int(_WORTH * jobs / max(seconds, 1e-9))
        shared = math.ceil(left / (_SHARE * max(self._slots, 1)))
        return max(1, min(worth, max(shared, worth // _SMALLEST), left))

    def _cancel(self) -> None:
        if self._in_work and self._cluster.connected and not self._cluster.lost:
            with suppress(OSError, RuntimeError, TimeoutError):
                self._cluster.client.cancel(list(self._in_work))
        self._in_work = {}

    # -- taking --------------------------------------------------------------------------------

    def _finished(self) -> list[Any]:
        """Wait a little; return what is finished."""
        result = []
        with suppress(queue.Empty):
            result.append(self._ready.get(timeout=_WAIT))
            while True:
                result.append(self._ready.get_nowait())
        if self.stopped:
            raise KeyboardInterrupt
        if self._cluster.lost:
            raise self._cluster.gone()
        return [future for future in result if future in self._in_work]

    def _results(self, futures: list[Any]) -> Iterator[tuple[Any, Any]]:
        """Yield what finished futures hold, or the exception that they ended with: in one call if all is well."""
        good = [future for future in futures if future.status == "finished"]
        gathered: dict[Any, Any] = {}
        with suppress(Exception):  # one of the holders died meanwhile; then each is asked for by itself
            gathered = dict(zip(good, self._cluster.client.gather(good), strict=True))
        for future in futures:
            try:
                result = gathered[future] if future in gathered else future.result(timeout=_PATIENCE)
            except Exception as error:  # noqa: BLE001 - whatever a worker raises
                result = error
            yield future, result

    def _take(self, future: Any, result: Any) -> Iterator[Reply | Lost]:  # noqa: ANN401 - distributed is untyped
        jobs = self._in_work.pop(future)
        self._worked = time.monotonic()
        if isinstance(result, Exception):
            yield from self._failed(jobs, result)
            return
        stamped, packed = result
        if tuple(stamped) != tuple(stamp()) or not packed:
            self._cluster.prove()
            self._cluster.refuse("that came later", str(Stamp(*stamped)))
        done: BatchReply = pickle.loads(packed)  # noqa: S301 - SECURITY.md says whom that trusts
        self._times.append((len(jobs), done.seconds))
        self.printed += done.printed
        self.stray += done.stray
        self.afterwards = tuple(dict.fromkeys([*self.afterwards, *done.afterwards]))
        for number, (job, items) in enumerate(zip(jobs, done.found, strict=bool(done.found))):
            yield from (Reply(job, pickle.loads(item)) for item in items)  # noqa: S301 - likewise
            if number in done.lost:
                yield Lost(job, done.lost[number])
        if done.error is not None:
            raise done.error

    def _failed(self, jobs: list[Any], error: Exception) -> Iterator[Lost]:
        """Take a batch that gave nothing."""
        if self._cluster.lost:
            raise self._cluster.gone()
        if type(error).__name__ == "KilledWorker":
            if len(jobs) > 1:
                self._alone.extend(jobs)
            else:
                yield Lost(jobs[0], LostError("each worker of the cluster that did this died; see the workers' log"))
            return
        self._cluster.prove()
        raise WorkbenchError(
            f"scheduler {self._cluster.address}: a worker could not do its part: {type(error).__name__}: {error}"
        )
