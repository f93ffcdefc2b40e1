"""Play sequences into one resumed session, in step with its own sampling, and record what comes out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.data.excite.design import Sequences, each
from workbench.data.excite.request import Excite
from workbench.errors import InputError
from workbench.model import DescribedModel, Model
from workbench.model.names import check_variables
from workbench.model.operating_point import bias_of, standing
from workbench.model.sample_rates import Rates, sampled
from workbench.point.lin.pulses import communication_step
from workbench.session.base import Recorded, Session
from workbench.signals.kinds import Constant, Signal, Table

__all__ = ["Begin", "Samples", "measure", "sampling_of"]

CHUNKS = 50  # pieces in which a run is reported, unless they are out of these bounds [samples]
_SHORTEST_CHUNK, _LONGEST_CHUNK = 100, 2000
_LOOKS = 100  # at the outputs while they settle
_SAME = 1e-9  # of an interval: two times closer than that are one
_OFF = 1e-3  # relative: by how much an output may miss the operating point without a word
_REST = 0.01  # of its magnitude: by how much an output may still move after settling


@dataclass(frozen=True, eq=False)
class Begin:
    """What is known before the first sample.

    Attributes:
        sampling: the grid.
        sequences: what will be played.
        u0: middles of the inputs as the model sees them, shape (m,).
        y0: outputs before the first sample, shape (p,).
        time: of the first sample [s].
        total: samples that will be run.
        step: communication step of a co-simulation [s].
        notes: doubts about the point.
        operating_point: where the session stands at first.
    """

    sampling: Sampling
    sequences: Sequences
    u0: Floats
    y0: Floats
    time: float
    total: int
    step: float | None = None
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None


@dataclass(frozen=True, eq=False)
class Samples:
    """Some samples.

    Attributes:
        first: which one the first of them is, counted from the first one that is run.
        u, y: shapes (n, m) and (n, p); the inputs as the model saw them.
    """

    first: int
    u: Floats
    y: Floats


def measure(
    model: Model, request: Excite, at: OperatingPoint | None, step: float | None = None
) -> Iterator[Begin | Samples]:
    """Run the experiment; yields `Begin`, then the samples in their order.

    Args:
        model: what to run; it stays open.
        request: the experiment.
        at: operating point; None: the model's start values.
        step: longest communication step of a co-simulation [s]; None: the FMU's own, or the sampling interval.

    Raises:
        InputError: unknown name, a design that does not fit, an operating point of another model.
        FmuError: the FMU cannot be instantiated.
        SimulationError: the model failed while running.
    """
    _check(model, request)
    sampling = sampling_of(model, at, request.dt)
    design = request.design
    sequences = design.sequences(
        len(request.inputs), dt=sampling.dt, samples=request.samples, validation=request.validation
    )
    step = communication_step(model, sampling.dt) if step is None else step
    with _open(model, request, at, step) as session:
        notes = [*model.remarks()]
        where = standing(model, session)
        start = np.array(list(session.values(request.inputs).values()))
        bias = np.array([bias_of(model, name, at) for name in request.inputs])
        middle = start - bias if design.offset is None else each("offset", design.offset, len(request.inputs))
        time = sampling.begin(session.time + request.settle)
        notes += _settle(session, request, middle, time - sampling.lead)
        if request.settle > 0.0 and design.offset is None:
            notes += _misses(session, at)
        if request.settle <= 0.0 and not np.allclose(middle + bias, start, rtol=1e-9, atol=0.0):
            notes.append("the mean of the signal differs from the operating point's input: let the model settle first")
        y0 = np.array(list(session.values(request.outputs).values()))
        played = _Played.of(request, sampling, sequences, middle=middle, time=time)
        total = len(played.reads)
        yield Begin(sampling, sequences, middle + bias, y0, time, total, step, tuple(notes), where)
        yield from played.run(session)


def _check(model: Model, request: Excite) -> None:
    if not request.inputs or not request.outputs:
        raise InputError("name an input to force and an output to record")
    check_variables(model, request.inputs, "input", what="inputs")
    check_variables(model, request.outputs, "variable", what="outputs")
    for name in request.inputs:
        if name in request.outputs:
            raise InputError(f"'{name}' cannot be both an input and an output of the experiment")


def _open(model: Model, request: Excite, at: OperatingPoint | None, step: float | None) -> Session:
    """Return a session at the operating point."""
    if at is None:
        return model.open_session(step=step)
    # What is to settle is looked at when it has.
    outputs = at.y if request.settle <= 0.0 else {}
    return model.open_at(time=at.time, values=at.values, outputs=outputs, step=step)


def _misses(session: Session, at: OperatingPoint | None) -> tuple[str, ...]:
    """Return a remark where the session has settled elsewhere than at the operating point."""
    if at is None or not at.y:
        return ()
    result = session.values(list(at.y))
    far = [n for n, y in at.y.items() if abs(result[n] - y) > _OFF * max(abs(y), abs(result[n]), _OFF)]
    if not far:
        return ()
    return (f"{far[0]} is {result[far[0]]:.6g} after settling, but {at.y[far[0]]:.6g} at the operating point",)


def _settle(session: Session, request: Excite, middle: Floats, until: float) -> tuple[str, ...]:
    """Let the inputs rest at their middles; return a remark where outputs still move at the end."""
    if not until > session.time:
        return ()
    points = np.linspace(session.time, until, _LOOKS + 1)[1:]
    held = {name: Constant(value) for name, value in zip(request.inputs, middle.tolist(), strict=True)}
    record = session.advance(until, signals=held, record=request.outputs, points=points)
    if request.settle <= 0.0:
        return ()
    late = record.time >= points[-_LOOKS // 5]
    for name in request.outputs:
        values = record.values[name][late]
        if np.ptp(values) > _REST * max(float(np.max(np.abs(values))), 1e-300):
            return (f"{name} still moves by {np.ptp(values):.3g} at the end of settling; settle longer, or trim first",)
    return ()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Played:
    """Sequences laid out in time.

    Attributes:
        outputs: names.
        signals: what forces each input.
        begins: where each sample's interval begins, and the last one ends, shape (n + 1,) [s].
        reads: when each sample is read, shape (n,) [s].
        late: read the left limit there, else the right one.
        tiny: times closer than that are one [s].
    """

    outputs: tuple[str, ...]
    signals: Mapping[str, Signal]
    begins: Floats
    reads: Floats
    late: bool
    tiny: float

    @classmethod
    def of(cls, request: Excite, sampling: Sampling, sequences: Sequences, *, middle: Floats, time: float) -> _Played:
        parts = [p for p in (sequences.identification, sequences.validation) if p is not None]
        values = np.vstack([part.values for part in parts])
        begins = np.asarray(time - sampling.lead + sampling.dt * np.arange(len(values) + 1), dtype=np.float64)
        reads = begins[1:] if sampling.late else begins[:-1] + 2.0 * sampling.lead
        return cls(
            outputs=tuple(request.outputs),
            signals={n: _staircase(begins, middle[i] + values[:, i]) for i, n in enumerate(request.inputs)},
            begins=begins,
            reads=reads,
            late=sampling.late,
            tiny=_SAME * sampling.dt,
        )

    def run(self, session: Session) -> Iterator[Samples]:
        """Advance to the end, a piece at a time."""
        count = len(self.reads)
        size = min(max(_SHORTEST_CHUNK, -(-count // CHUNKS)), _LONGEST_CHUNK)
        for first in range(0, count, size):
            last = min(first + size, count)
            reads, end = self.reads[first:last], float(self.begins[last])
            points = reads[reads > session.time]
            record = session.advance(end, signals=self.signals, record=self.outputs, points=points)
            yield self._rows(record, first, reads)

    def _rows(self, record: Recorded, first: int, reads: Floats) -> Samples:
        if self.late:
            rows = np.searchsorted(record.time, reads - self.tiny, side="left")
        else:
            rows = np.searchsorted(record.time, reads + self.tiny, side="right") - 1
        return Samples(
            first,
            np.column_stack([record.inputs[n][rows] for n in self.signals]),
            np.column_stack([record.values[n][rows] for n in self.outputs]),
        )


def _staircase(begins: Floats, values: Floats) -> Table:
    """Return the held signal; values that stay make no step."""
    changes = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    return Table(begins[changes].tolist(), values[changes].tolist(), interpolate="hold")


# -- when it samples, and on which side of that inputs change -------------------------------------

LEAD = 1e-6  # of an interval: how long before a sample of the model the input changes
_MULTIPLE = 1e-6  # likewise, of the interval and the model's period


@dataclass(frozen=True)
class Sampling:
    """The grid of an experiment.

    Attributes:
        dt: sampling interval [s].
        period: of a sampled model [s]; None: continuous, or not known.
        first: first sample of the model after its start [s]; None likewise.
        lead: time by which inputs change before a sample of the model, and outputs are read after it [s].
        late: outputs are read at the end of the interval: a sampled co-simulation that takes no short steps.
        notes: what was chosen and what does not fit.
    """

    dt: float
    period: float | None = None
    first: float | None = None
    lead: float = 0.0
    late: bool = False
    notes: tuple[str, ...] = ()

    def begin(self, earliest: float) -> float:
        """Return the first sample at or after a time that falls on the model's own [s]."""
        if self.period is None or self.first is None:
            return earliest
        return self.first + self.period * max(0, int(np.ceil((earliest - self.first) / self.period - _MULTIPLE)))


def _first(model: Model, rates: Rates, start: float) -> float:
    """Return the first sample after the start [s]."""
    if len(rates.ticks):
        return float(rates.ticks[0])
    begin = rates.start(start) if model.declared_rates().samplers else start
    return begin if begin > start else begin + rates.period


def sampling_of(model: Model, at: OperatingPoint | None, dt: float | None) -> Sampling:
    """Return the grid for a model.

    Args:
        model: what will run.
        at: where it starts; None: at its start values.
        dt: sampling interval [s]; None: the model's own period.

    Raises:
        InputError: no interval, neither given nor the model's own.
    """
    rates = sampled(model, at)
    period = float(f"{rates.period:.12g}") if rates.periods else None
    if dt is None and period is None:
        raise InputError(f"{model.name}: has no sampling period of its own; give the sampling interval, `dt`")
    interval = dt or period or 0.0
    if period is None:
        return Sampling(interval)
    steady = model.interface == "cs" and not _steps_vary(model)
    return Sampling(
        dt=interval,
        period=period,
        first=_first(model, rates, at.time if at else model.start_time),
        lead=0.0 if steady else LEAD * min(interval, period),
        late=steady,
        notes=(*_remarks(interval, period, rates.periods, chosen=dt is None), *rates.notes),
    )


def _remarks(dt: float, period: float, rates: Sequence[float], *, chosen: bool) -> tuple[str, ...]:
    several = f", in which its samples every {', '.join(f'{r:.6g}' for r in rates)} s repeat" if len(rates) > 1 else ""
    if chosen:
        return (f"sampled every {period:.6g} s, the model's own period{several}",)
    ratio = dt / period
    if ratio < 1.0 - _MULTIPLE or abs(ratio - round(ratio)) > _MULTIPLE * ratio:
        what = f"the sampling interval {dt:.6g} s is not a multiple of the model's own period {period:.6g} s{several}"
        return (f"{what}: its samples fall at changing times within the interval; use a multiple",)
    return ()


def _steps_vary(model: Model) -> bool:
    return not isinstance(model, DescribedModel) or model.description.interfaces["cs"].variable_step
