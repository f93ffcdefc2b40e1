"""Confirm a limit cycle: simulate from a predicted state, and measure frequency and amplitudes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.limit_cycles.limit_cycle.result import SimulatedCycle
from workbench.model.described_model import DescribedModel
from workbench.response.simulate.zero_crossings import half_range, pass_rate, rising_passes

__all__ = ["CHUNK", "PER_PERIOD", "TOLERANCE", "VANISHED", "confirm"]

PER_PERIOD = 200
CHUNK = 20  # periods
_STEADY = 1e-4  # relative change of the fundamental from chunk to chunk
VANISHED = 1e-3  # of the predicted amplitude
TOLERANCE = 1e-8  # relative, of the integration


def confirm(
    model: DescribedModel,
    crossing: int | None,
    *,
    states: Mapping[str, float],
    inputs: Mapping[str, float],
    frequency: float,
    amplitude: float,
    watch: str,
    outputs: Sequence[str],
    time: float,
    periods: int,
) -> SimulatedCycle | str:
    """Simulate until the motion is steady; return what it is, or in words why there is none.

    Args:
        model: the system.
        crossing: number of the crossing that predicts the motion; None: none does.
        states: where it starts; those left out keep their start values.
        inputs: held values.
        frequency: predicted [Hz].
        amplitude: predicted, of `watch`.
        watch: variable whose fundamental counts.
        outputs: others to measure.
        time: session time at which it begins [s].
        periods: at most.
    """
    names, end = list(dict.fromkeys([watch, *outputs])), [v.name for v in model.states]
    recorded = list(dict.fromkeys([*names, *end]))
    steady, run, last, f = False, 0, 0.0, frequency
    at, values = np.zeros(0), dict.fromkeys(recorded, np.zeros(0))
    rows: Mapping[str, Floats] = values
    with model.open_at(time=time, values={**inputs, **states}, tolerance=TOLERANCE) as session:
        while run < periods and not steady:
            count = min(CHUNK, periods - run)
            begin = session.time
            points = begin + np.arange(1, count * PER_PERIOD + 1) / (f * PER_PERIOD)
            try:
                record = session.advance(float(points[-1]), signals={}, record=recorded, points=points)
            except SimulationError as error:
                return f"the simulation failed: {error}"
            run += count
            rows, last_rows = record.values, record.right_limits(points)
            at, values = last_rows.time, last_rows.values
            f = _frequency(at, values[watch], f)
            size = _fundamental(at, values[watch], f)
            steady, last = abs(size - last) < _STEADY * size, size
            if size < VANISHED * amplitude:
                return f"the motion dies out: {watch} has fallen to {size:.2g} after {run} periods"
    shown, units = {n: values[n] for n in names}, {v.name: v.unit for v in model.description.variables}
    return SimulatedCycle(
        crossing=crossing,
        frequency_hz=f,
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
        units={n: units.get(n) for n in names},
        predicted_frequency_hz=frequency,
        predicted_amplitude=amplitude,
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
    result = np.linalg.lstsq(columns, v, rcond=None)[0]
    return complex(result[1], -result[8])


def _fundamental(at: Floats, v: Floats, f: float) -> float:
    return abs(_phasor(at, v, f))
