"""A run from rest: frequency and amplitude of an oscillation from period to period."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.model.described_model import DescribedModel
from workbench.response.simulate.request import simulate
from workbench.response.simulate.zero_crossings import rising_passes
from workbench.show.result import Result
from workbench.signals.kinds import Signal

__all__ = ["FreeRun", "OscillationInterval", "free_run", "oscillation_history"]

_PER_PERIOD = 40  # rows in the shortest period expected
_MOST_POINTS = 2_000_000
_SPANS, _PERIODS = 13, 5  # at most so many spans, on average of at least so many periods
_SETTLED = 0.01  # relative scatter of the period that counts as one oscillation
_SMALL = 1e-9  # of the largest value: an oscillation smaller than that is rounding


@dataclass(frozen=True, kw_only=True)
class OscillationInterval(RecordPart):
    """The oscillation over a part of a run.

    Attributes:
        begin, end: [s].
        frequency_hz: periods over time [Hz]; None: fewer than two periods.
        scatter: largest relative deviation of a period from the mean; large where two oscillations beat.
        amplitude: largest half distance between neighbouring extremes.
        growth: growth of the amplitude, by a straight line through its logarithm [1/s].
    """

    begin: float
    end: float
    frequency_hz: float | None
    scatter: float
    amplitude: float
    growth: float


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeRun(Result):
    """A simulated signal and what it oscillates with, period by period.

    Attributes:
        signal: name of the signal.
        unit: None where the model declares none.
        time: shape (n,) [s].
        value: shape (n,).
        period_time: middle of each period, shape (k,) [s].
        frequency_hz: one over its length, from one rising pass of its centre to the next, shape (k,) [Hz].
        amplitude: half the peak-to-peak value in it, shape (k,).
        spans: the same over equal parts of the run.
    """

    _page = "workbench.limit_cycles.limit_cycle.page:free_run_page"
    _picture = "workbench.limit_cycles.limit_cycle.picture_free_run:plot_free_run"

    signal: str
    unit: str | None
    time: Floats = field(metadata=entry(key="record_time"))
    value: Floats
    period_time: Floats = field(metadata=entry(key="time"))
    frequency_hz: Floats
    amplitude: Floats
    spans: tuple[OscillationInterval, ...]

    def words(self) -> str:
        """Return the history in one line: the frequency first and last, and when it changed over."""
        if len(self.frequency_hz) < 4:
            return "hardly an oscillation"
        count = max(2, len(self.frequency_hz) // 10)
        first, last = (float(np.median(x)) for x in (self.frequency_hz[count : 3 * count], self.frequency_hz[-count:]))
        if abs(first - last) < _SETTLED * last:
            return f"{last:.4g} Hz throughout"
        return f"{first:.4g} Hz at first, {last:.4g} Hz in the end{self._when(first, last)}"

    def _when(self, first: float, last: float) -> str:
        """Return when the running median of seven periods passes the middle between two frequencies."""
        size = 7
        if len(self.frequency_hz) < 2 * size:
            return ""
        windows = np.lib.stride_tricks.sliding_window_view(self.frequency_hz, size)
        nearer = np.abs(np.median(windows, axis=1) - last) < abs(first - last) / 2.0
        late = np.flatnonzero(~nearer)
        at = self.period_time[int(late[-1]) + size // 2] if len(late) else self.time[0]
        return f", changing over at about {at:.3g} s"

    def derived(self) -> dict[str, Any]:
        """Return the whole in one line."""
        return {"words": self.words()}

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return {"time": "s", "amplitude": self.unit}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each period."""
        yield ("time", "frequency_hz", "amplitude")
        yield from np.column_stack([self.period_time, self.frequency_hz, self.amplitude]).tolist()


def free_run(
    model: DescribedModel,
    signal: str,
    *,
    stop: float,
    inputs: Mapping[str, Signal],
    fastest: float,
    start_time: float = 0.0,
) -> FreeRun:
    """Simulate a system from its start under given inputs, and follow frequency and amplitude of a variable.

    Args:
        model: the system; it stays open.
        signal: full name of a variable.
        stop: end of the run [s].
        inputs: what starts the motion.
        fastest: highest frequency expected [Hz].
        start_time: [s].

    Raises:
        InputError: unknown name, a stop that is not after the start.
        SimulationError: the run failed.
    """
    interval = max(1.0 / (_PER_PERIOD * fastest), (stop - start_time) / _MOST_POINTS)
    run = simulate(model, stop=stop, inputs=inputs, outputs=[signal], start_time=start_time, interval=interval)
    value = np.asarray(run.signals[signal], dtype=np.float64)
    if not float(np.abs(value - value[0]).max()) > 0.0:
        known = ", ".join(v.name for v in model.inputs) or "none"
        raise InputError(f"{model.name}: {signal} stays at rest; force an input to start the motion (inputs: {known})")
    unit = next((v.unit for v in model.description.variables if v.name == signal), None)
    return oscillation_history(signal, unit, np.asarray(run.time), value, centre=_centre(value))


def _centre(value: Floats) -> float:
    """Return where a run began, or the middle of its second half where that never passes there.

    A run begins where it rests, unless its input acts at once or its states were set aside.
    """
    late = value[len(value) // 2 :]
    low, high = float(np.min(late)), float(np.max(late))
    return float(value[0]) if low < value[0] < high else 0.5 * (low + high)


def oscillation_history(
    signal: str, unit: str | None, time: Floats, value: Floats, *, centre: float | None = None
) -> FreeRun:
    """Return frequency and amplitude of an oscillating record, period by period.

    A period lasts from one rising pass of the centre to the next. Two oscillations of like size beat:
    then neither is read off single periods, and `OscillationInterval.scatter` is large.

    Args:
        signal: name.
        unit: unit of the values.
        time: shape (n,), not falling [s].
        value: shape (n,).
        centre: about which it oscillates, such as its value at rest; None: the mean of the second half.
    """
    x = value - (float(np.mean(value[len(value) // 2 :])) if centre is None else centre)
    passes = rising_passes(time, x, least=_SMALL * float(np.abs(x).max()))
    amplitude = [0.5 * float(np.ptp(value[a:b])) for a, b in zip(*_rows(time, passes), strict=True)]
    period = np.diff(passes)
    return FreeRun(
        signal=signal,
        unit=unit,
        time=time,
        value=value,
        period_time=0.5 * (passes[1:] + passes[:-1]) if len(passes) > 1 else np.zeros(0),
        frequency_hz=1.0 / period,
        amplitude=np.array(amplitude),
        spans=_spans(time, passes, np.array(amplitude)),
    )


def _rows(time: Floats, passes: Floats) -> tuple[list[int], list[int]]:
    """Return first and last row of each period."""
    at = np.searchsorted(time, passes).tolist()
    return [max(i - 1, 0) for i in at[:-1]], [i + 1 for i in at[1:]]


def _spans(time: Floats, passes: Floats, amplitude: Floats) -> tuple[OscillationInterval, ...]:
    count = int(np.clip(len(amplitude) // _PERIODS, 1, _SPANS))
    edges = np.linspace(time[0], time[-1], count + 1).tolist()
    return tuple(_span(a, b, passes, amplitude) for a, b in pairwise(edges))


def _span(begin: float, end: float, passes: Floats, amplitude: Floats) -> OscillationInterval:
    inside = np.flatnonzero((passes >= begin) & (passes <= end))
    if len(inside) < 3:
        return OscillationInterval(begin=begin, end=end, frequency_hz=None, scatter=0.0, amplitude=0.0, growth=0.0)
    at = passes[inside]
    size = amplitude[inside[:-1]]
    mean = float(at[-1] - at[0]) / (len(at) - 1)
    middle = 0.5 * (at[1:] + at[:-1])
    growth = np.polyfit(middle - middle[0], np.log(size), 1)[0] if len(size) > 2 and (size > 0.0).all() else 0.0
    return OscillationInterval(
        begin=begin,
        end=end,
        frequency_hz=1.0 / mean,
        scatter=float(np.abs(np.diff(at) / mean - 1.0).max()),
        amplitude=float(size.max()),
        growth=float(growth),
    )
