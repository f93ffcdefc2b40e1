"""Runs of the model at given values: in worker processes, so that one that crashes is a value of the search."""

from __future__ import annotations

import hashlib
from collections import Counter, OrderedDict, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.data.excite.recording import Sampling, sampling_of
from workbench.errors import LostError, SimulationError, TimedOutError
from workbench.identification.calibrate.copies import of_copy
from workbench.identification.calibrate.data import PlayedData
from workbench.identification.calibrate.quantities import FreeValues
from workbench.identification.calibrate.responses import PlayedResponse
from workbench.jobs.job import Job
from workbench.jobs.runner import Lost, Reply, Runner, WorkItem, perform
from workbench.jobs.store import Store
from workbench.model import DescribedModel, Model
from workbench.model.operating_point import standing
from workbench.model.varied import with_parameters
from workbench.point.lin.pulses import communication_step
from workbench.point.trim.request import trim
from workbench.session.base import Session
from workbench.session.start_values import NotReachedError

__all__ = ["ModelRun", "ModelRuns", "RunOutputs", "RunPlace", "SamplingRun", "sampled"]

_Key = tuple[Any, ...]
_KEPT = 4  # times the quantities: runs whose outputs are remembered, for each data set


@dataclass(frozen=True)
class SamplingRun(WorkItem):
    """Find out how the model samples.

    Attributes:
        dt: interval of the data [s].
    """

    dt: float

    def run(self, model: Model) -> Iterator[tuple[Sampling, float | None]]:
        """Yield the grid, and the longest communication step [s]."""
        yield sampling_of(model, model.at, self.dt), communication_step(model, self.dt)


@dataclass(frozen=True, eq=False)
class RunOutputs(RecordPart):
    """What one run gave.

    Attributes:
        y: outputs, shape (n, p); None: it failed.
        reason: why.
        start: where it began; None: that was not asked.
    """

    y: Floats | None = field(metadata=entry(dims=("sample", "output")))
    reason: str = ""
    start: OperatingPoint | None = None


@dataclass(frozen=True, eq=False)
class ModelRun(WorkItem):
    """One run.

    Attributes:
        played: the data.
        parameters: name → value.
        states: state → initial value.
        rest: whether it starts in equilibrium with the first values of its inputs.
        where: whether it tells where it began.
    """

    played: PlayedData | PlayedResponse
    parameters: Mapping[str, float]
    states: Mapping[str, float]
    rest: bool
    where: bool = False

    def run(self, model: Model) -> Iterator[RunOutputs]:
        """Yield the outputs; a run that fails says why."""
        try:
            yield self._outputs(with_parameters(model, dict(self.parameters)))
        except (SimulationError, NotReachedError) as error:
            yield RunOutputs(None, str(error))

    def _outputs(self, model: Model) -> RunOutputs:
        data = self.played
        if self.rest:
            model = self._at_rest(model)
        if isinstance(data, PlayedResponse):
            return RunOutputs(data.computed(model), start=standing(model) if self.where else None)
        with self._open(model, data) as session:
            start = standing(model, session) if self.where else None
            points = data.reads[data.reads > session.time]
            record = session.advance(data.end, signals=data.signals, record=data.outputs, points=points)
        if data.late:
            rows = np.searchsorted(record.time, data.reads - data.tiny, side="left")
        else:
            rows = np.searchsorted(record.time, data.reads + data.tiny, side="right") - 1
        columns = [record.values[n][rows][data.rows[:, i].astype(int)] for i, n in enumerate(data.outputs)]
        return RunOutputs(np.column_stack(columns), start=start)

    def _open(self, model: Model, data: PlayedData) -> Session:
        if self.states:
            return model.open_at(values=dict(self.states), step=data.step)
        return model.open_session(step=data.step, signals=None if self.rest else data.signals)

    def _at_rest(self, model: Model) -> Model:
        signals = {} if isinstance(self.played, PlayedResponse) else self.played.signals
        found = trim(model, u0={name: signal(model.start_time) for name, signal in signals.items()}, in_process=True)
        if not found.converged:
            raise SimulationError("no equilibrium with the first values of the inputs")
        return model.starting_at(found.operating_point)


@dataclass(eq=False, kw_only=True)
class RunPlace:
    """What runs the model, for all data, and what was run.

    Attributes:
        model: that is run.
        runner: runs it.
        joint: runs copies of it as one model, see `copies`; None: there are none.
        copies: how many.
        job: is told.
        rest: see `ModelRun`.
        store: where runs are kept; None: nowhere.
        count: runs that were made; one of copies counts as many.
        doing: what they are for, in words.
        failed: reason → runs.
        lost: of them, where the process ended: reason → how.
        start: where the first run began; None: none was made.
        checked: whether derivatives by joint runs were compared with those by a wider step.
    """

    model: Model
    runner: Runner
    joint: Runner | None
    copies: int
    job: Job
    rest: bool
    store: Store | None
    count: int = 0
    doing: str = "first run"
    failed: Counter[str] = field(default_factory=Counter)
    lost: dict[str, type[LostError]] = field(default_factory=dict)
    start: OperatingPoint | None = None
    checked: bool = False


class ModelRuns:
    """Outputs at coordinates, each run once.

    Args:
        place: where.
        data: what is played.
        quantities: of the coordinates.
    """

    def __init__(self, place: RunPlace, data: Sequence[PlayedData | PlayedResponse], quantities: FreeValues) -> None:
        self.place, self._data, self._quantities = place, tuple(data), quantities
        self._known: OrderedDict[_Key, RunOutputs] = OrderedDict()
        self._prints = [_print_of(one) for one in self._data] if place.store is not None else []

    def elsewhere(self, place: RunPlace) -> ModelRuns:
        """Return the runs of the same data in another place, none made yet."""
        return ModelRuns(place, self._data, self._quantities)

    def outputs(self, points: Sequence[Floats]) -> list[list[Floats | None]]:
        """Return the outputs of the sensors, [point][data] of shape (n, p); None: the run failed.

        Args:
            points: coordinates.

        Raises:
            KeyboardInterrupt: the job was stopped.
        """
        every = range(len(self._data))
        self._make([((z,), i) for z in points for i in every], self.place.runner)
        return [[self._seen(self._known[self._key((z,), i)].y, z, i) for i in every] for z in points]

    def together(self, points: Sequence[Floats]) -> list[list[Floats | None]] | None:
        """Return the outputs as `outputs` does, of runs that share their steps; None: they cannot be had.

        Args:
            points: coordinates.
        """
        place, every = self.place, range(len(self._data))
        if place.joint is None or len(points) > place.copies or any(isinstance(x, PlayedResponse) for x in self._data):
            return None
        filled = (*points, *[points[0]] * (place.copies - len(points)))
        self._make([(filled, i) for i in every], place.joint)
        parts = []
        for i in every:
            y = self._known[self._key(filled, i)].y
            if y is None:
                place.joint = None  # for good: what one of them cannot do each may do alone
                return None
            parts.append(np.split(y, place.copies, axis=1))
        return [[self._seen(parts[i][k], z, i) for i in every] for k, z in enumerate(points)]

    def _key(self, points: Sequence[Floats], i: int) -> _Key:
        sets = (self._quantities.of(z, kind, i) for z in points for kind in ("parameter", "state"))
        return (i, *(tuple(values.items()) for values in sets))

    def _run(self, points: Sequence[Floats], i: int) -> ModelRun:
        sets = [(self._quantities.of(z, "parameter", i), self._quantities.of(z, "state", i)) for z in points]
        model, data = self.place.model, self._data[i]
        if len(points) == 1 or not isinstance(data, PlayedData) or not isinstance(model, DescribedModel):
            return ModelRun(data, *sets[0], self.place.rest, where=self.place.start is None)
        at = {} if model.at is None else model.at.values
        count = len(points)
        played = replace(
            data, rows=np.tile(data.rows, (1, count)),
            outputs=tuple(of_copy(model, k, name) for k in range(count) for name in data.outputs),
        )  # fmt: skip
        named = [
            {of_copy(model, k, name): value for k in range(count) for name, value in values[k].items()}
            for values in ([s[0] for s in sets], [{**at, **s[1]} for s in sets])
        ]
        return ModelRun(played, named[0], named[1], rest=False)

    def _make(self, wanted: Sequence[tuple[Sequence[Floats], int]], runner: Runner) -> None:
        """Run what is not known yet."""
        every = {self._key(*one): one for one in wanted}
        runs = {k: self._run(*one) for k, one in every.items() if k not in self._known and not self._stored(k)}
        for again in (True, False):
            runs = self._made(runs, {key: len(every[key][0]) for key in runs}, runner, again=again)
        for key in every:
            if key not in self._known:
                raise SimulationError("a run of the model gave no answer")
            self._known.move_to_end(key)
        while len(self._known) > max(len(every), _KEPT * (2 * len(self._quantities) + 1) * len(self._data)):
            self._known.popitem(last=False)

    def _made(
        self, runs: Mapping[_Key, ModelRun], counts: Mapping[_Key, int], runner: Runner, *, again: bool
    ) -> dict[_Key, ModelRun]:
        """Run these; return those to be run once more: a process may have crashed of what was run in it before."""
        keys = {id(run): key for key, run in runs.items()}
        result = {}
        for event in runner.run(perform, deque(runs.values())) if runs else ():
            key = keys[id(event.job)]
            if isinstance(event, Lost) and again and not isinstance(event.error, TimedOutError):
                result[key] = runs[key]
                continue
            if isinstance(event, Lost):
                self.place.lost[event.reason] = type(event.error)
            found = RunOutputs(None, event.reason) if isinstance(event, Lost) else event.value
            self._take(key, found, counts[key])
        return result

    def _take(self, key: _Key, found: RunOutputs, count: int) -> None:
        self._known[key], place = found, self.place
        place.count += count
        if found.y is None:
            place.failed[found.reason] += count
        place.start = place.start or found.start
        if place.store is not None:
            place.store.save(self._name(key), found.to_dict())
        place.job.done(f"{place.doing}: run {place.count}", place.count, place.count + 1)

    def _name(self, key: _Key) -> str:
        return repr((self._prints[key[0]], *key[1:]))

    def _stored(self, key: _Key) -> bool:
        """Take a run from the store; False: it is not there."""
        store = self.place.store
        if store is None or (kept := store.get(self._name(key))) is None:
            return False
        with store.taken_apart():
            self._known[key] = RunOutputs.from_dict(kept)
        self.place.start = self.place.start or self._known[key].start
        return True

    def _seen(self, y: Floats | None, z: Floats, i: int) -> Floats | None:
        """Return what sensors show of outputs."""
        biases, scales = (self._quantities.of(z, kind, i) for kind in ("bias", "scale"))
        if y is None or not (biases or scales):
            return y
        names = self._data[i].outputs
        return np.asarray(y * [scales.get(n, 1.0) for n in names] + [biases.get(n, 0.0) for n in names])


def _print_of(played: PlayedData | PlayedResponse) -> str:
    """Return what tells data that are played from others."""
    values = [getattr(played, f.name) for f in fields(played)]
    parts = [x.tobytes() if isinstance(x, np.ndarray) else repr(x).encode() for x in values]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def sampled(runner: Runner, dts: Sequence[float]) -> list[tuple[Sampling, float | None]]:
    """Return how the model samples under data with these intervals.

    Args:
        runner: with the model.
        dts: [s].

    Raises:
        InputError, FmuError, SimulationError: the model cannot be started.
    """
    known: dict[float, tuple[Sampling, float | None]] = {}
    for event in runner.run(perform, deque(SamplingRun(dt) for dt in dict.fromkeys(dts))):
        if not isinstance(event, Reply):
            raise event.error
        known[event.job.dt] = event.value
    return [known[dt] for dt in dts]
