"""Whether an FMU's binary can be loaded, and how snapshots are taken: found out where a crash harms nobody."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from workbench.errors import WorkbenchError
from workbench.jobs import job as telling
from workbench.jobs.options import Limits
from workbench.jobs.pool import Pool
from workbench.jobs.runner import Lost, Reply, WorkItem, perform
from workbench.model import Model
from workbench.model.load import FmuModel, FmuRecipe

__all__ = ["Snapshots", "probe_snapshots"]

# A probe that takes longer finds nothing that is of use [s].
_PATIENCE = 20.0


@dataclass(frozen=True)
class Snapshots:
    """How snapshots are taken.

    Attributes:
        method: "state" (the FMU's own, proved by a probe) or "replay" of what was done since the start.
        why: why not the FMU's own state; empty where it is used.
    """

    method: str
    why: str = ""


@dataclass(frozen=True)
class _Probe(WorkItem):
    interface: str

    def run(self, model: Model) -> Iterator[Snapshots | str]:
        if not isinstance(model, FmuModel):
            return
        with replace(model.recipe, interface=self.interface, solver="auto").open() as probed:
            yield probed.why_not_loaded() or Snapshots(probed.snapshot_method(), probed.why_replay())


def probe_snapshots(
    recipe: FmuRecipe, interfaces: Sequence[str], limits: Limits, job: telling.Job
) -> dict[str, Snapshots | str]:
    """Load, take, disturb, restore and compare, in worker processes; a text: why the binary cannot be loaded.

    Args:
        recipe: of the FMU, with one of the interfaces.
        interfaces: those to be probed; they must be able to run on this platform.
        limits: of the processes; a probe has 20 s at most.
        job: ends the probe, and gets what the user should know of how they ran.
    """
    result: dict[str, Snapshots | str] = {}
    jobs: deque[_Probe] = deque(_Probe(name) for name in interfaces)
    patient = replace(limits, timeout=min(_PATIENCE, limits.timeout or _PATIENCE))
    with Pool(recipe, jobs=1, limits=patient) as pool, job.ended_by(pool.stop):
        try:
            for event in pool.run(perform, jobs):
                if isinstance(event, Reply):
                    result[event.job.interface] = event.value
                elif isinstance(event, Lost):
                    result[event.job.interface] = Snapshots("replay", f"the probe failed: {event.reason}")
        except WorkbenchError as error:
            result |= {n: Snapshots("replay", f"the probe failed: {error}") for n in interfaces if n not in result}
    job.notes += pool.remarks()
    return result
