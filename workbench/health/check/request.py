"""The health card of an FMU: what can be asked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import KW_ONLY, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.records.forms import Names
from workbench.core.records.option import option
from workbench.jobs.options import InWorkers, Workers
from workbench.model.loading import INTERFACES, Loading
from workbench.requests.request import MODEL_FILE, Request, function

if TYPE_CHECKING:
    from workbench.health.check.result import HealthCard

__all__ = ["Check", "check"]

_PATIENCE = 60.0  # [s]


class _Patient(Workers):
    """Where the checks run, and for how long each of them may."""

    scheduler: str | None = option("Not for checks.", default=None, python=True)
    timeout: float | None = option(
        "Time limit for one check [s]; inf for no limit.", metavar="S", positive=True, infinite=True, default=_PATIENCE
    )


class Check(Loading, InWorkers, Request[str | Path | Sequence[str | Path], "HealthCard"]):
    """Check whether FMUs do what they declare: a health card for each interface of an FMU, or of each FMU in a system.

    Each line has a verdict (good, watch, broken, not applicable), the evidence, and what follows for the analyses.
    The FMU runs in worker processes; a crash or a hang becomes a line, and the other checks go on in a new worker.
    After a run that fails on its way, the other checks look at a tenth of it. Of a system each FMU is checked by
    itself, with the start values and steps of the system.

    Not a proof: a check sees only test runs near the start values. What it calls broken has been observed.

    Returns:
        The card, whose `passed` tells whether no promise is broken.

    Raises:
        InputError: no such file, an unknown name, a value out of range.
        FmuError: the file cannot be read, or has no binary for this platform.

    Examples:
        >>> card = wb.check("fmu:FirstOrderLag", interface="me", only=["reset", "determinism"])
        >>> print(card.passed)
        True
    """

    command = "check"
    algorithm = "workbench.health.check.run:run"
    example = "workbench check fmu:Rudder --report health.html"
    written = "workbench.show.cases:JudgedFiles"
    subject = replace(
        MODEL_FILE,
        type="str | Path | Sequence[str | Path]",
        help="An FMU, as for `load`, or a system: .toml, .ssp; or several of them, for one card.",
        metavar="MODEL..",
        several=True,
    )
    counts = "checks"

    _: KW_ONLY
    only: Names | None = option(
        "Run these checks only: validation, runs, step, largest-step, real-time, reset, determinism, processes, "
        "instances, snapshots, promise, directional, dependencies, references, drift, start-time, starts, nominals, "
        "inputs, jumps, memory.",
        default=None,
        first=True,
    )
    skip: Names | None = option("Leave these checks out.", default=None, first=True)
    interface: str = option(
        "Interface to check, model exchange or co-simulation; auto checks each that the FMU offers.",
        choices=("auto", *INTERFACES),
        default="auto",
        group="Model",
    )
    workers: Workers | None = option(
        "Where the FMU runs and under which limits; by default in worker processes, with 60 s for each check.",
        default=None,
        group="Where it runs",
        part=_Patient,
    )

    @classmethod
    @contextmanager
    def opened(cls, given: Any, loading: Loading) -> Iterator[tuple[Any, tuple[str, ...]]]:  # noqa: ANN401, ARG003
        """Yield the path of the one model, or those of several: they are opened one after the other."""
        yield (given[0] if isinstance(given, list) and len(given) == 1 else given), ()

    @property
    def place(self) -> Workers:
        """Where the FMU runs."""
        return self._place(_Patient)

    def went_well(self, record: HealthCard) -> bool:
        """Return whether no promise is broken, and every check came to its end.

        Args:
            record: of this request.
        """
        return record.passed


check = function(Check)
