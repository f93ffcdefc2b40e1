"""An experiment as a job for a worker process."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import numpy as np

from workbench.analysis.excite.run import Begin, ExciteTask, Rows, measure
from workbench.errors import InputError, SimulationError
from workbench.model import Model
from workbench.session.base import Floats
from workbench.workers import Job, Remark

__all__ = ["ExciteJob"]

WORRYING_CHANGE = 0.01  # of an output's range, with half the communication step


@dataclass(frozen=True, eq=False)
class ExciteJob(Job):
    """The experiment where a crash of the FMU ends in an error.

    Attributes:
        task: what to do.
        verify: run again with half the communication step.
    """

    task: ExciteTask
    verify: bool

    def run(self, model: Model) -> Iterator[Begin | Rows | Remark | int]:
        begin: Begin | None = None
        pieces: list[Rows] = []
        for item in measure(model, self.task):
            if isinstance(item, Begin):
                begin = item
            else:
                pieces.append(item)
            yield item
        if self.verify and model.interface == "cs" and begin is not None:
            yield from _verify(model, self.task, begin, np.vstack([p.y for p in pieces]))


def _verify(model: Model, task: ExciteTask, begin: Begin, y: Floats) -> Iterator[Remark | int]:
    """Repeat the identification part with half the communication step; yields progress, then remarks."""
    step = begin.step or begin.sampling.dt
    advice = f"use a step below {step:.3g} s, or interface me"
    try:
        other = yield from _again(model, replace(task, step=0.5 * step), len(begin.sequences.identification.values))
    except SimulationError as error:
        yield Remark(f"with half the communication step the run fails ({error}); {advice}")
        return
    except InputError:  # a constant step that cannot be halved
        return
    change = np.max(np.abs(other - y[: len(other)]), axis=0) / np.maximum(np.ptp(other, axis=0), 1e-300)
    for name, value in zip(task.outputs, change.tolist(), strict=True):
        if value > WORRYING_CHANGE:
            words = f"{name} changes by {100.0 * value:.3g} % of its range with half the communication step"
            yield Remark(f"{words}; {advice}")


def _again(model: Model, task: ExciteTask, count: int) -> Generator[int, None, Floats]:
    """Run the first `count` samples; yields progress, returns the outputs."""
    seen: list[Floats] = []
    for item in measure(model, task):
        if isinstance(item, Rows):
            seen.append(item.y)
            yield len(item.y)
        if sum(len(y) for y in seen) >= count:
            break
    return np.vstack(seen)[:count]
