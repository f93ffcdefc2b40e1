"""A time history as a job for a worker process."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from workbench.analysis.simulate import SimulationResult, simulate
from workbench.core.operating_point import At
from workbench.errors import SimulationError
from workbench.model import Model
from workbench.model.placing import start_at
from workbench.origin import with_origin
from workbench.signals import Signal
from workbench.workers import Job, Reply, Workers, choose, perform

__all__ = ["SimulateJob", "simulate_in_worker"]


@dataclass(frozen=True, kw_only=True)
class SimulateJob(Job):
    """One time history; the fields are those of `simulate`."""

    stop: float | None
    inputs: Mapping[str, Signal]
    outputs: tuple[str, ...] | None = None
    interval: float | None = None

    def run(self, model: Model) -> Iterator[SimulationResult]:
        yield simulate(model, stop=self.stop, inputs=self.inputs, outputs=self.outputs, interval=self.interval)


@with_origin()
def simulate_in_worker(model: Model, job: SimulateJob, *, workers: Workers, at: At | None = None) -> SimulationResult:
    """Simulate where a crash of the FMU ends in an error.

    Args:
        model: what to run.
        job: what `simulate` is told.
        workers: where, and under which limits.
        at: see `simulate`.

    Raises:
        InputError, FmuError: see `simulate`.
        SimulationError: likewise, and where the worker crashed or met a limit (without a time).
    """
    placed, remarks = start_at(model, at)
    runner, _ = choose(placed, workers)
    with runner:
        for event in runner.run(perform, deque([job])):
            if isinstance(event, Reply) and isinstance(event.value, SimulationResult):
                return replace(event.value, notes=(*remarks, *event.value.notes))
            if not isinstance(event, Reply):
                raise SimulationError(event.reason)
    raise SimulationError("the worker gave no result")
