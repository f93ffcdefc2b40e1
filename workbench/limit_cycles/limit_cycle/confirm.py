"""Confirm a limit cycle: simulate from a predicted state, and measure frequency and amplitudes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.model.described_model import DescribedModel
from workbench.response.simulate.zero_crossings import half_range, pass_rate, rising_passes

__all__ = ["Simulated", "confirm"]

_PER_PERIOD = 200
_CHUNK = 20  # periods
_STEADY = 1e-4  # relative change of the fundamental from chunk to chunk
_VANISHED = 1e-3  # of the predicted amplitude
_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class Simulated:
    """What a simulation showed.

    Attributes:
        frequency: of the block's input [Hz].
        amplitude: variable → half its peak-to-peak value over the last periods.
        fundamental: variable → amplitude of its fundamental.
        mean: variable → its mean.
        steady: whether the fundamental changed by less than 1e-4 over the last twenty periods.
        periods: how many were run.
        time: shape (n,), of the last periods [s].
        values: variable → shape (n,).
        states: state → its value at the end.
        sizes: state → how far it moved in the last periods.
        note: what was wrong; "": nothing.
    """

    frequency: float
    amplitude: Mapping[str, float]
    fundamental: Mapping[str, float]
    mean: Mapping[str, float]
    steady: bool
    periods: int
    time: Floats
    values: Mapping[str, Floats]
    states: Mapping[str, float] = field(default_factory=dict)
    sizes: Mapping[str, float] = field(default_factory=dict)
    note: str = ""


def confirm(
    model: DescribedModel,
    *,
    states: Mapping[str, float],
    inputs: Mapping[str, float],
    frequency: float,
    amplitude: float,
    watch: str,
    outputs: Sequence[str],
    time: float,
    periods: int,
    end: Sequence[str] = (),
) -> Simulated | str:
    """Simulate until the motion is steady; return what it is, or in words why there is none.

    Args:
        model: the system.
        states: where it starts; those left out keep their start values.
        inputs: held values.
        frequency: predicted [Hz].
        amplitude: predicted, of `watch`.
        watch: variable whose fundamental counts.
        outputs: others to measure.
        time: session time at which it begins [s].
        periods: at most.
        end: states whose values at the end are wanted.
    """
    names = list(dict.fromkeys([watch, *outputs]))
    end = list(dict.fromkeys(end))
    steady, run, last, f = False, 0, 0.0, frequency
    at, values = np.zeros(0), dict.fromkeys([*names, *end], np.zeros(0))
    rows: Mapping[str, Floats] = values
    with model.open_at(time=time, values={**inputs, **states}, tolerance=_TOLERANCE) as session:
        while run < periods and not steady:
            count = min(_CHUNK, periods - run)
            begin = session.time
            points = begin + np.arange(1, count * _PER_PERIOD + 1) / (f * _PER_PERIOD)
            try:
                record = session.advance(
                    float(points[-1]), signals={}, record=list(dict.fromkeys([*names, *end])), points=points
                )
            except SimulationError as error:
                return f"the simulation failed: {error}"
            run += count
            rows, last_rows = record.values, record.right_limits(points)
            at, values = last_rows.time, last_rows.values
            f = _frequency(at, values[watch], f)
            size = _fundamental(at, values[watch], f)
            steady, last = abs(size - last) < _STEADY * size, size
            if size < _VANISHED * amplitude:
                return f"the motion dies out: {watch} has fallen to {size:.2g} after {run} periods"
    note = "" if steady else f"not steady after {run} periods"
    shown = {n: values[n] for n in names}
    return Simulated(
        frequency=f,
        # Corners are at events, between the even rows.
        amplitude={n: max(half_range(v), 0.5 * float(np.ptp(rows[n]))) for n, v in shown.items()},
        fundamental={n: _fundamental(at, v, f) for n, v in shown.items()},
        mean={n: float(np.mean(v)) for n, v in shown.items()},
        steady=steady,
        periods=run,
        time=at,
        values=shown,
        states={n: float(values[n][-1]) for n in end},
        sizes={n: float(np.ptp(values[n])) for n in end},
        note=note,
    )


def _frequency(at: Floats, v: Floats, guess: float) -> float:
    """Return the frequency of a periodic record: rising passes of the mean, then the phase of both halves."""
    x = v - np.mean(v)
    passes = rising_passes(at, x)
    if len(passes) < 3:
        return guess
    f = pass_rate(passes, guess)
    for _ in range(3):
        half = int(len(at) / 2)
        early, late = (_phasor(at[s], v[s], f) for s in (slice(0, half), slice(half, None)))
        apart = float(np.mean(at[half:]) - np.mean(at[:half]))
        f += float(np.angle(late / early)) / (2.0 * np.pi * apart)
    return f


def _phasor(at: Floats, v: Floats, f: float) -> complex:
    """Return the fundamental by least squares with harmonics 0 … 7."""
    angle = 2.0 * np.pi * f * np.multiply.outer(at, np.arange(1, 8))
    columns = np.hstack([np.ones((len(at), 1)), np.cos(angle), np.sin(angle)])
    found = np.linalg.lstsq(columns, v, rcond=None)[0]
    return complex(found[1], -found[8])


def _fundamental(at: Floats, v: Floats, f: float) -> float:
    return abs(_phasor(at, v, f))
