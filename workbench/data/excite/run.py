"""Record identification experiments on a model."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.data.excite.design import crest_factors, cross_correlation
from workbench.data.excite.recording import Begin, Samples, measure
from workbench.data.excite.request import Excite
from workbench.data.excite.result import ExciteResult, SignalFacts
from workbench.data.experiment.experiment import Experiment, make_experiment
from workbench.errors import InputError, SimulationError
from workbench.jobs import job as telling
from workbench.jobs.runner import Remark, Reply, WorkItem, perform
from workbench.jobs.runner_choice import at_work
from workbench.model import Model
from workbench.model.names import declared_units
from workbench.model.operating_point import find_point

__all__ = ["run"]

CORRELATED = 0.2  # two inputs more alike than this are hard to tell apart


def assemble(
    model: Model, request: Excite, begin: Begin, pieces: Sequence[Samples], *, notes: Sequence[str]
) -> ExciteResult:
    """Return the result of a run, also of one that ended early.

    Args:
        model: what ran.
        request: the experiment.
        begin: what was known before.
        pieces: the samples, in their order; two of the identification part at least.
        notes: found out while it ran.
    """
    u, y = np.vstack([p.u for p in pieces]), np.vstack([p.y for p in pieces])
    # Times are told to the digits that are meant: 0.066, not 0.06600000000000002.
    rows = (np.round(begin.time + begin.sampling.dt * np.arange(len(u)), 12), u, y)
    first, second = begin.sequences.identification, begin.sequences.validation
    start = len(first.values)
    identification = _part(model, request, rows, slice(first.skip, start))
    validation = None
    if second is not None and len(u) >= start + second.skip + 2:
        validation = _part(model, request, rows, slice(start + second.skip, None))
    facts = _facts(begin, identification)
    every = [*begin.sampling.notes, *begin.sequences.notes, *begin.notes, *_doubts(facts), *_missing(begin, u), *notes]
    return ExciteResult(
        model=model.name,
        interface=model.interface,
        solver=model.solver,
        identification=identification,
        validation=validation,
        design=facts,
        u0=dict(zip(request.inputs, begin.u0.tolist(), strict=True)),
        y0=dict(zip(request.outputs, begin.y0.tolist(), strict=True)),
        notes=tuple(dict.fromkeys(every)),
        operating_point=begin.operating_point,
    )


def _part(model: Model, request: Excite, rows: tuple[Floats, Floats, Floats], chosen: slice) -> Experiment:
    time, u, y = rows
    known = declared_units(model, [*request.inputs, *request.outputs])
    return make_experiment(
        time[chosen],
        u[chosen],
        y[chosen],
        input_names=request.inputs,
        output_names=request.outputs,
        input_units=[known[n] for n in request.inputs],
        output_units=[known[n] for n in request.outputs],
        name=model.name,
        loops=model.closed_loops([*request.inputs, *request.outputs], until=float(time[-1])),
    )


def _facts(begin: Begin, identification: Experiment) -> SignalFacts:
    sequences, dt = begin.sequences, begin.sampling.dt
    alike = cross_correlation(identification.u)
    return SignalFacts(
        kind=sequences.kind,
        dt=dt,
        period=sequences.period,
        clock=sequences.clock,
        order=sequences.order,
        lines=sequences.lines,
        band=sequences.band,
        amplitude=tuple((0.5 * np.ptp(identification.u, axis=0)).tolist()),
        crest_factor=crest_factors(identification.u),
        cross_correlation=None if alike is None else alike[0],
        cross_correlation_lag=None if alike is None else alike[1] * dt,
    )


def _doubts(facts: SignalFacts) -> list[str]:
    if facts.cross_correlation is None or facts.cross_correlation <= CORRELATED:
        return []
    where = f"{facts.cross_correlation:.2g} at a lag of {facts.cross_correlation_lag:.4g} s"
    return [f"two inputs are correlated ({where}): record longer, or use a higher rate"]


def _missing(begin: Begin, u: Floats) -> list[str]:
    return [] if len(u) == begin.total else [f"ended early: {len(u)} of {begin.total} samples were recorded"]


WORRYING_CHANGE = 0.01  # of an output's range, with half the communication step


def run(model: Model, request: Excite, job: telling.Job) -> ExciteResult:
    """Record an experiment; see `Excite`."""
    point, remarks = find_point(model, request.at)
    plain = replace(
        request,
        inputs=tuple(dict.fromkeys(request.inputs)),
        outputs=tuple(dict.fromkeys(request.outputs)),
        at=None,
        workers=None,
        progress=None,
    )
    recording = _ExperimentRun(model, plain, [*remarks])
    job.partial = recording.result
    with at_work(model, request.place, job) as runner:
        for event in runner.run(perform, deque([_ExciteJob(plain, point)])):
            if not isinstance(event, Reply):
                raise event.error
            recording.take(event.value)
            job.done(f"{recording.done} of {recording.total} samples", recording.done, recording.total)
    result = recording.result()
    if result is None:
        raise SimulationError("nothing was recorded")
    return result


@dataclass
class _ExperimentRun:
    """An experiment under way: what is recorded is kept, whatever ends it.

    Attributes:
        model: what runs.
        asked: the experiment.
        notes: found out while it runs.
        begin: what is known before the first sample; None: it has not begun.
        pieces: the samples so far.
        done: how many samples were run, those of a repetition counted.
        total: how many there will be.
    """

    model: Model
    asked: Excite
    notes: list[str]
    begin: Begin | None = None
    pieces: list[Samples] = field(default_factory=list)
    done: int = 0
    total: int = 1

    def take(self, item: object) -> None:
        """Take what the job yields."""
        if isinstance(item, Begin):
            self.begin, self.pieces, self.done = item, [], 0
            again = self.model.interface == "cs" and self.asked.verify_step
            self.total = item.total + (len(item.sequences.identification.values) if again else 0)
        elif isinstance(item, Samples):
            self.pieces.append(item)
            self.done += len(item.u)
        elif isinstance(item, int):
            self.done += item
        elif isinstance(item, Remark):
            self.notes.append(item.text)

    def result(self) -> ExciteResult | None:
        """Return what was recorded so far; None: too little.

        Raises:
            SimulationError: it is not finite.
        """
        if self.begin is None or sum(len(p.u) for p in self.pieces) < self.begin.sequences.identification.skip + 2:
            return None
        return assemble(self.model, self.asked, self.begin, self.pieces, notes=self.notes)


# -- in a worker -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _ExciteJob(WorkItem):
    """The experiment where a crash of the FMU ends in an error.

    Attributes:
        asked: the experiment.
        at: operating point; None: the model's start values.
    """

    asked: Excite
    at: OperatingPoint | None

    def run(self, model: Model) -> Iterator[Begin | Samples | Remark | int]:
        begin: Begin | None = None
        pieces: list[Samples] = []
        for item in self._measured(model):
            if isinstance(item, Begin):
                begin, pieces = item, []
            else:
                pieces.append(item)
            yield item
        if self.asked.verify_step and model.interface == "cs" and begin is not None:
            yield from self._verify(model, begin, np.vstack([p.y for p in pieces]))

    def _measured(self, model: Model) -> Iterator[Begin | Samples]:
        """Run the experiment; once more from its begin where its failure showed what lets the FMU go on."""
        known = model.remarks()
        try:
            yield from measure(model, self.asked, self.at)
        except SimulationError:
            if model.remarks() == known:
                raise
            yield from measure(model, self.asked, self.at)

    def _verify(self, model: Model, begin: Begin, y: Floats) -> Iterator[Remark | int]:
        """Repeat the identification part with half the communication step; yields progress, then remarks."""
        step = begin.step or begin.sampling.dt
        advice = model.way_out(f"use a step below {step:.3g} s")
        try:
            other = yield from self._again(model, 0.5 * step, len(begin.sequences.identification.values))
        except SimulationError as error:
            yield Remark(f"with half the communication step the run fails ({error}); {advice}")
            return
        except InputError:  # a constant step that cannot be halved
            return
        change = np.max(np.abs(other - y[: len(other)]), axis=0) / np.maximum(np.ptp(other, axis=0), 1e-300)
        for name, value in zip(self.asked.outputs, change.tolist(), strict=True):
            if value > WORRYING_CHANGE:
                words = f"{name} changes by {100.0 * value:.3g} % of its range with half the communication step"
                yield Remark(f"{words}; {advice}")

    def _again(self, model: Model, step: float, count: int) -> Generator[int, None, Floats]:
        """Run the first `count` samples with another communication step; yields progress, returns the outputs."""
        seen: list[Floats] = []
        for item in measure(model, self.asked, self.at, step):
            if isinstance(item, Samples):
                seen.append(item.y)
                yield len(item.y)
            if sum(len(y) for y in seen) >= count:
                break
        return np.vstack(seen)[:count]
