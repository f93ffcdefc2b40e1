"""The source report's figures, measured now: what can be asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, replace
from typing import TYPE_CHECKING, Self

from workbench.core.records.forms import File
from workbench.core.records.option import option
from workbench.jobs.options import Workers
from workbench.requests.request import Request, Subject, function

if TYPE_CHECKING:
    from scripts.reproduce.result import ReproduceResult, TargetList

__all__ = ["Reproduce", "ReproduceCommand", "reproduce"]

_LONGEST = 600.0  # [s], of one experiment: a hundred times what it takes


class _Experiments(Workers):
    """How many experiments are measured at a time, each in a process of its own."""

    timeout: float | None = option(
        "Time limit for one experiment [s]; 600 by default, inf for no limit.", metavar="S", default=_LONGEST
    )


class Reproduce(Request[Sequence[str], "ReproduceResult"]):
    """Measure figures and tables of the source report now, from the bundled FMUs, and compare with what it prints.

    Each is met, missed, or not reachable for a reason in the source report itself. Targets and tolerances stand in
    `targets.toml` beside this module. An experiment that fails is a miss of its targets, with its reason; the others
    go on.

    Raises:
        InputError: a word that is not a chapter, figure or target; not a folder; an executor; pictures for a
            folder, or no answer, from a cluster.
    """

    command = "reproduce"
    algorithm = "scripts.reproduce.run:run"
    example = "python scripts/dev.py reproduce figure 48 --report page.html"
    subject = Subject(
        name="selection",
        type="Sequence[str]",
        help='Chapters ("3", "8.3"), figures ("fig31", "figure 48"), targets ("cycle-rate") or how their names begin '
        '("rudder"); by default all.',
        metavar="CHAPTER|FIGURE|TARGET",
        words="3, 8.3, fig31, figure 48, cycle-rate, or the beginning of names: rudder. By default all.",
        argument="what",
        several=True,
        optional=True,
    )
    counts = "experiments"
    unwritten = ("plot",)

    _: KW_ONLY
    drawings: bool = option("Make the pictures, for a page.", default=False, python=True)
    folder: File | None = option(
        "Write the pictures into a folder, as png.", flag="--pictures", metavar="FOLDER", default=None
    )
    workers: Workers | None = option(
        "How many experiments are measured at a time, each in a process of its own; by default one per core.",
        default=None,
        part=_Experiments,
    )

    @property
    def place(self) -> Workers:
        """Where the experiments run."""
        return self.workers or _Experiments()

    def for_page(self) -> Self:
        """Return the request with the pictures: they are drawn where they are measured."""
        return replace(self, drawings=True)

    def went_well(self, record: ReproduceResult | TargetList) -> bool:
        """Return whether no target is missed but those that are known to be.

        Args:
            record: of this request.
        """
        return not record.unexpected


class ReproduceCommand(Reproduce):
    """Measure figures and tables of the source report now, from the bundled FMUs, and compare with what it prints.

    Each is met, missed, or not reachable for a reason in the source report itself.
    """

    algorithm = "scripts.reproduce.run:run_command"

    _: KW_ONLY
    only_list: bool = option("Show targets and tolerances; measure nothing.", flag="--list", default=False)


reproduce = function(Reproduce)
