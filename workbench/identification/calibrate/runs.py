"""Runs of the model at given values: in worker processes, so that one that crashes is a value of the search."""

from __future__ import annotations

from collections import Counter, OrderedDict, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.data.excite.recording import Sampling, sampling_of
from workbench.errors import SimulationError
from workbench.identification.calibrate.data import PlayedData
from workbench.identification.calibrate.quantities import FreeValues
from workbench.identification.calibrate.responses import PlayedResponse
from workbench.jobs.job import Job
from workbench.jobs.runner import Lost, Reply, Runner, WorkItem, perform
from workbench.model import Model
from workbench.model.operating_point import standing
from workbench.model.varied import with_parameters
from workbench.point.lin.pulses import communication_step
from workbench.point.trim.request import trim
from workbench.session.base import Session
from workbench.session.start_values import NotReachedError

__all__ = ["ModelRun", "ModelRuns", "RunOutputs", "SamplingRun", "sampled"]

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
class RunOutputs:
    """What one run gave.

    Attributes:
        y: outputs, shape (n, p); None: it failed.
        reason: why.
        start: where it began; None: that was not asked.
    """

    y: Floats | None
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


class ModelRuns:
    """Outputs at coordinates, run where the job runs its parts, each once.

    Args:
        runner: runs them.
        job: is told how many were made.
        data: what is played.
        quantities: of the coordinates.
        rest: see `ModelRun`.

    Attributes:
        count: runs that were made.
        doing: what they are for, in words.
        failed: reason → runs.
        start: where the first run began; None: none was made.
    """

    def __init__(
        self,
        runner: Runner,
        job: Job,
        data: Sequence[PlayedData | PlayedResponse],
        quantities: FreeValues,
        *,
        rest: bool,
    ) -> None:
        self._runner, self._job, self._data, self._quantities = runner, job, tuple(data), quantities
        self._rest = rest
        self._known: OrderedDict[tuple[object, ...], RunOutputs] = OrderedDict()
        self.count = 0
        self.doing = "first run"
        self.failed: Counter[str] = Counter()
        self.start: OperatingPoint | None = None

    def outputs(self, points: Sequence[Floats]) -> list[list[Floats | None]]:
        """Return the outputs of the sensors, [point][data] of shape (n, p); None: the run failed.

        Args:
            points: coordinates.

        Raises:
            KeyboardInterrupt: the job was stopped.
        """
        every = range(len(self._data))
        wanted = {self._key(z, i): (z, i) for z in points for i in every}
        self._make({key: place for key, place in wanted.items() if key not in self._known})
        result = [[self._seen(self._known[self._key(z, i)].y, z, i) for i in every] for z in points]
        while len(self._known) > max(len(wanted), _KEPT * (2 * len(self._quantities) + 1) * len(self._data)):
            self._known.popitem(last=False)
        return result

    def _key(self, z: Floats, i: int) -> tuple[object, ...]:
        sets = (self._quantities.of(z, kind, i) for kind in ("parameter", "state"))
        return (i, *(tuple(values.items()) for values in sets))

    def _make(self, missing: Mapping[tuple[object, ...], tuple[Floats, int]]) -> None:
        items: dict[int, tuple[object, ...]] = {}
        todo: deque[ModelRun] = deque()
        for key, (z, i) in missing.items():
            parameters, states = (self._quantities.of(z, kind, i) for kind in ("parameter", "state"))
            where = self.start is None and not todo
            todo.append(ModelRun(self._data[i], parameters, states, self._rest, where=where))
            items[id(todo[-1])] = key
        held = tuple(todo)  # so that no other object has the id of one that is done
        for event in self._runner.run(perform, todo):
            answer = RunOutputs(None, event.reason) if isinstance(event, Lost) else event.value
            self._take(items[id(event.job)], answer)
        if held and not all(key in self._known for key in missing):
            raise SimulationError("a run of the model gave no answer")

    def _take(self, key: tuple[object, ...], found: RunOutputs) -> None:
        self._known[key] = found
        self.count += 1
        if found.y is None:
            self.failed[found.reason] += 1
        self.start = self.start or found.start
        made = self._job.reached[0] + 1  # of all problems
        self._job.done(f"{self.doing}: run {made}", made, made + 1)

    def _seen(self, y: Floats | None, z: Floats, i: int) -> Floats | None:
        """Return what sensors show of outputs."""
        biases, scales = (self._quantities.of(z, kind, i) for kind in ("bias", "scale"))
        if y is None or not (biases or scales):
            return y
        names = self._data[i].outputs
        return np.asarray(y * [scales.get(n, 1.0) for n in names] + [biases.get(n, 0.0) for n in names])


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
