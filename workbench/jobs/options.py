"""Where an analysis runs its FMU, and under which limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, TypeVar

from workbench.core.records.forms import LISTED, ONE, Form
from workbench.core.records.option import Options, option, recast
from workbench.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = [
    "DEFAULT_TIMEOUT",
    "InParts",
    "InWhole",
    "InWorker",
    "InWorkers",
    "Limits",
    "Parts",
    "Scheduler",
    "Worker",
    "Workers",
]

_Place = TypeVar("_Place", bound="Worker")

# Long enough for any point that anybody waits for; short enough that a night's sweep survives a hang.
DEFAULT_TIMEOUT = 3600.0

# Larger limits are mistakes, and more than clocks and addresses can count: 30,000 years, an exabyte.
_MOST = 1e12


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one result may cost.

    Attributes:
        timeout: longest time without a result [s]; None or inf: any.
        memory: how much the FMU may allocate, on top of the worker's own [MB]; None: any.
        confine: whether it may neither write files nor use a network.

    Raises:
        InputError: a limit that is not positive, or beyond all reason.
    """

    timeout: float | None = DEFAULT_TIMEOUT
    memory: float | None = None
    confine: bool = False

    @property
    def apart(self) -> bool:
        """Whether a process under these limits cannot do other work later, or have done other work before."""
        return self.confine or self.memory is not None

    def __post_init__(self) -> None:
        for name, value, unit in (("timeout", self.timeout, "s"), ("memory limit", self.memory, "MB")):
            if value is not None and not value > 0.0:
                raise InputError(f"{name}: {value:g} {unit} is not a positive number")
            if value is not None and _MOST < value < math.inf:
                raise InputError(
                    f"{name}: more than {_MOST:g} {unit} is as good as no limit; leave it out, or take inf"
                )


class Worker(Options):
    """Under which limits one worker process runs an FMU.

    Attributes:
        in_process: run in this process: for debugging, and for FMUs that are trusted.
        timeout: longest time for one result [s]; None: any. For worker processes only.
        memory_limit: how much an FMU may allocate [MB]; None: any. For worker processes only.
        confine: whether an FMU may neither write files nor use a network. For worker processes only.

    Raises:
        InputError: confined, but in this process; an impossible limit.
    """

    _: KW_ONLY
    in_process: bool = option(
        "Run the FMU in this process, for debugging; a crash of the FMU ends everything.", default=False
    )
    timeout: float | None = option(
        "Time limit for one result, as a point of a sweep or a run [s]; inf for no limit.",
        metavar="S",
        positive=True,
        infinite=True,
        default=DEFAULT_TIMEOUT,
    )
    memory_limit: float | None = option(
        "Memory that an FMU may allocate (Linux).", unit="MB", metavar="MB", positive=True, infinite=True, default=None
    )
    confine: bool = option(
        "Keep the FMU from networks, and from writing files outside its own temporary folder; refused where the "
        "system cannot (it needs Linux 6.2 with Landlock).",
        default=False,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.limits  # checked where they are written, also where they will not apply
        if self.confine and self.in_process:
            raise InputError("confine: this process cannot be confined; leave in process out")

    @property
    def limits(self) -> Limits:
        """All limits together."""
        return Limits(timeout=self.timeout, memory=self.memory_limit, confine=self.confine)


class Scheduler:
    """What stands for the address of a Dask scheduler; see `workbench.jobs.cluster`.

    Attributes:
        address: of the scheduler.
    """

    address: str


def _scheduler(value: object) -> object:
    if isinstance(value, Scheduler) or (isinstance(value, str) and value):
        return value
    raise ValueError(f"{value!r} is not the address of a scheduler, such as tcp://host:8786, nor a Cluster")


def _files(value: Sequence[str]) -> tuple[str, ...]:
    result = tuple(str(name).strip() for name in (value.split(",") if isinstance(value, str) else value))
    if len(result) != 3 or not all(result):
        raise ValueError("takes three files: certificate of the authority, own certificate, own key")
    return result


_ADDRESS = Form(
    metavar="tcp://..", read=_scheduler, layout=replace(ONE, join=lambda value: [getattr(value, "address", value)])
)
_FILES = Form(metavar="CA,CERT,KEY", read=_files, layout=LISTED)

if TYPE_CHECKING:
    _Address = str | Scheduler
    _Files = Sequence[str]
else:
    _Address = Annotated[object, _ADDRESS]
    _Files = Annotated[object, _FILES]


class Workers(Worker):
    """Where and under which limits an analysis runs its FMU.

    Attributes:
        jobs: most worker processes at a time; None: as many as cores.
        in_process, timeout, memory_limit, confine: see `Worker`.
        executor: anything that is a `concurrent.futures.Executor`, in place of worker processes.
        scheduler: a Dask cluster in place of worker processes of this machine: an address, or a `Cluster`.
        tls: files for an address that begins with tls://.

    Raises:
        InputError: fewer than one job, two places at once, or confined where that is not possible.
    """

    _: KW_ONLY
    jobs: int | None = option("Number of worker processes; by default one per core.", metavar="N", default=None)
    scheduler: _Address | None = option(
        "Dask cluster on which the parts run: address of its scheduler (tcp://.., tls://..), scheduler file (.json), "
        "or local:N for N workers on this machine.",
        default=None,
    )
    tls: _Files | None = option(
        "Files for tls://..: certificate of the authority, own certificate, own key.",
        flag="--scheduler-tls",
        default=None,
    )
    executor: Executor | None = option(
        "Executor to use instead of worker processes; it stays open.", default=None, python=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.jobs is not None and self.jobs < 1:
            raise InputError(f"jobs: {self.jobs} is too few; take at least 1")
        if self.in_process and (self.jobs or 1) > 1:
            raise InputError(f"in process: points run one after the other, so there cannot be {self.jobs} jobs")
        places = {"in process": self.in_process, "an executor": self.executor, "a scheduler": self.scheduler}
        chosen = [name for name, wanted in places.items() if wanted]
        if len(chosen) > 1:
            raise InputError(f"{' and '.join(chosen)}: choose one place to run the points")
        if self.tls and self.scheduler is None:
            raise InputError("tls: names the files for a scheduler; give its address, too")
        if self.scheduler is not None and self.jobs is not None:
            raise InputError("a scheduler: its cluster decides how many jobs run at a time; leave jobs out")
        limited = self.memory_limit is not None or self.timeout not in (DEFAULT_TIMEOUT, type(self).timeout)
        if chosen and self.confine:
            raise InputError(
                f"{chosen[0]}: confinement needs the workbench's own worker processes here; leave one of the two out"
            )
        if (self.in_process or self.executor) and limited:
            raise InputError(f"{chosen[0]}: time and memory limits need the workbench's own worker processes")


class Parts(Workers):
    """Where the parts of an analysis run that does them one after the other unless told otherwise.

    Attributes:
        jobs: most worker processes at a time; None: the parts run one after the other where the analysis does.
        in_process, timeout, memory_limit, executor, scheduler, tls: see `Workers`.
    """

    _: KW_ONLY
    jobs: int | None = option(
        "Number of worker processes for the parts; by default they run one after the other.", metavar="N", default=None
    )

    @property
    def apart(self) -> Workers:
        """Where each part runs."""
        alone = (self.jobs or 1) == 1 and self.executor is None and self.scheduler is None
        return Workers(in_process=True) if alone else self


class InWorker(Options):
    """The part of a request that says where its FMU runs: all of it in one place."""

    _: KW_ONLY
    workers: Worker | None = option(
        "Limits of the worker process that runs the FMU; by default an hour for one result.",
        default=None,
        group="Where it runs",
    )
    in_process: bool = option(
        "Run the FMU in this process: for debugging, and for FMUs that are trusted; a crash of the FMU ends "
        "everything. A model that is not a file runs in this process in any case.",
        default=False,
        python=True,
    )
    confine: bool = option(
        "Keep the FMU from networks, and from writing files outside its own temporary folder; as in `workers`.",
        default=False,
        python=True,
    )

    @cached_property
    def place(self) -> Worker:
        """Where the FMU runs."""
        return self._place(Worker)

    def _place(self, kind: type[_Place]) -> _Place:
        request: object = self.workers
        if not isinstance(request, Worker | None):
            raise InputError(f"workers: {request!r} does not say where; give wb.Workers(timeout=60)")
        elsewhere = isinstance(self.workers, Workers) and (self.workers.scheduler or self.workers.executor)
        if elsewhere and not issubclass(kind, Workers):
            raise InputError("a scheduler or executor: this analysis has no parts to run there; leave it out")
        result = recast(kind, self.workers) if self.workers is not None else kind()
        own = {name: True for name in ("in_process", "confine") if getattr(self, name)}
        return recast(kind, result, **own) if own else result


class InWorkers(InWorker):
    """The part of a request that says where its FMU runs, in several places at a time."""

    _: KW_ONLY
    workers: Workers | None = option(
        "Where the FMU runs and under which limits; by default in one worker process per core, so that a crash costs "
        "only one point.",
        default=None,
        group="Where it runs",
    )

    @cached_property
    def place(self) -> Workers:
        """Where the FMU runs."""
        return self._place(Workers)


class Whole(Workers):
    """Where an analysis runs as a whole.

    Attributes:
        jobs: 1.
        in_process, timeout, memory_limit, executor, scheduler, tls: see `Workers`.
    """

    _: KW_ONLY
    jobs: int | None = option("Not for one run.", default=None, python=True)


class InParts(InWorker):
    """The part of a request that says where it runs, and where its parts do."""

    _: KW_ONLY
    workers: Workers | None = option(
        "Limits of the worker process that runs the FMU, and where the parts of the analysis run; by default one after "
        "the other.",
        default=None,
        group="Where it runs",
        part=Parts,
    )

    @property
    def place(self) -> Parts:
        """Where the FMU runs."""
        return self._place(Parts)


class InWhole(InWorker):
    """The part of a request that says where all of it runs, on this machine or on a cluster."""

    _: KW_ONLY
    workers: Worker | None = option(
        "Limits of the worker process that runs the FMU, or the cluster that it runs on; by default an hour for one "
        "result.",
        default=None,
        group="Where it runs",
        part=Whole,
    )

    @property
    def place(self) -> Whole:
        """Where the FMU runs."""
        return self._place(Whole)
