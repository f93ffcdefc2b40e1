"""Where an analysis runs its FMU, and under which limits."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import KW_ONLY, dataclass
from typing import TypeVar

from workbench.core.option import Options, option, recast
from workbench.errors import InputError

__all__ = ["DEFAULT_TIMEOUT", "InWorker", "InWorkers", "Limits", "Worker", "Workers"]

_Place = TypeVar("_Place", bound="Worker")

# Long enough for any point that anybody waits for; short enough that a night's sweep survives a hang.
DEFAULT_TIMEOUT = 3600.0


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one result may cost.

    Attributes:
        timeout: longest time without a result [s]; None or inf: any.
        memory: how much the FMU may allocate, on top of the worker's own [MB]; None: any.
        confine: whether it may neither write files nor use a network.

    Raises:
        InputError: a limit that is not positive.
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


class Worker(Options):
    """Under which limits one worker process runs an FMU.

    Attributes:
        in_process: run in this process: for debugging, and for FMUs that are trusted.
        timeout: longest time for one result [s]; None: any. For worker processes only.
        memory_limit: how much an FMU may allocate [MB]; None: any. For worker processes only.
        confine: whether an FMU may neither write files nor use a network. For worker processes only.

    Raises:
        InputError: confined, but in this process.
    """

    _: KW_ONLY
    in_process: bool = option(
        "Run the FMU in this process, for debugging; a crash of the FMU ends everything.", default=False
    )
    timeout: float | None = option(
        "Time limit for one result [s]; inf for no limit.", metavar="S", default=DEFAULT_TIMEOUT
    )
    memory_limit: float | None = option(
        "Memory that an FMU may allocate (Linux).", unit="MB", metavar="MB", default=None
    )
    confine: bool = option(
        "Keep the FMU from networks, and from writing files outside its own temporary folder; refused where the "
        "system cannot (it needs Linux 6.2 with Landlock).",
        default=False,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.confine and self.in_process:
            raise InputError("confine: this process cannot be confined; leave in process out")

    @property
    def limits(self) -> Limits:
        """All limits together."""
        return Limits(timeout=self.timeout, memory=self.memory_limit, confine=self.confine)


class Workers(Worker):
    """Where and under which limits an analysis runs its FMU.

    Attributes:
        jobs: most worker processes at a time; None: as many as cores.
        in_process, timeout, memory_limit, confine: see `Worker`.
        executor: anything that is a `concurrent.futures.Executor`, in place of worker processes.
        scheduler: address of a Dask scheduler, in place of worker processes.

    Raises:
        InputError: fewer than one job, or two places at once.
    """

    _: KW_ONLY
    jobs: int | None = option("Number of worker processes; by default one per core.", metavar="N", default=None)
    scheduler: str | None = option(
        "Address of a Dask scheduler; the points run on its cluster.", metavar="tcp://..", default=None
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
        asked = [name for name, wanted in places.items() if wanted]
        if len(asked) > 1:
            raise InputError(f"{' and '.join(asked)}: choose one place to run the points")
        if asked and self.limits != Limits(timeout=type(self).timeout):
            what = "confinement needs" if self.confine else "time and memory limits need"
            raise InputError(f"{asked[0]}: {what} the workbench's own worker processes")


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

    @property
    def place(self) -> Worker:
        """Where the FMU runs."""
        return self._place(Worker)

    def _place(self, kind: type[_Place]) -> _Place:
        found = recast(kind, self.workers) if self.workers is not None else kind()
        own = {name: True for name in ("in_process", "confine") if getattr(self, name)}
        return recast(kind, found, **own) if own else found


class InWorkers(InWorker):
    """The part of a request that says where its FMU runs, in several places at a time."""

    _: KW_ONLY
    workers: Workers | None = option(
        "Where the FMU runs and under which limits; by default in one worker process per core, so that a crash costs "
        "only one point.",
        default=None,
        group="Where it runs",
    )

    @property
    def place(self) -> Workers:
        """Where the FMU runs."""
        return self._place(Workers)
