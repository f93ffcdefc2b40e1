"""A block with a memory of its own in harmonic balance: driven by the very motion, and its harmonics measured."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.errors import SimulationError
from workbench.loops.describing.base import DescribedBlock
from workbench.model.described_model import DescribedModel
from workbench.response.periodic.fourier import measure_period
from workbench.session import Recorded, Session
from workbench.signals.kinds import Constant, Signal, Sine

__all__ = ["DrivenBlock"]

_ROWS, _ROWS_AT_JUMPS = 400, 160.0  # of a period at least, and over (highest harmonic)^(2/3)
_SETTLED = 1e-8  # relative change from period to period
_ACCURACY = 1e-6  # of an answer: rows, settling and integration together
_MOST = 200  # periods
_TOLERANCE = 1e-9
_SHORTEST = 1e-9  # period [s], of the session time if that is longer


class DrivenBlock(DescribedBlock):
    """What a model answers to a periodic input with harmonics, by simulation until it repeats itself.

    Unlike a describing function measured over a grid of sines, the harmonics of the motion act on the block here, and
    all harmonics of its answer are known. Each answer costs some simulated periods; the block goes on from the state of
    the answer before.

    Not for a block that never repeats itself under a periodic input (a drifting integrator, sampling at another rate):
    `settled` is False then, and the answer is that of the last period.

    Args:
        model: the block alone, with the inputs v0, v1, … whose sum drives it, and the output w.
        count: highest harmonic of the input.
        name: for tables.
        time: session time at which it begins [s].
        centre: input of the block at the operating point; the model adds it.
        rest: output there, from which outputs are counted.

    Attributes:
        settled: whether every answer repeated itself.

    Source: Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems, 2.4 (alternating frequency-time).
    """

    real = False
    frequency_dependent = True
    accuracy = _ACCURACY

    def __init__(
        self, model: DescribedModel, *, count: int, name: str, time: float, centre: float = 0.0, rest: float = 0.0
    ) -> None:
        self.name, self.centre, self._rest = name, centre, rest
        self.settled = True
        self._count, self._states = count, [v.name for v in model.states]
        self._session: Session = model.open_at(time=time, tolerance=_TOLERANCE)
        self._along: Mapping[str, Floats] = {}

    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        signals = self._signals(v, frequency)
        begin = self._session.time
        if 1.0 / frequency < _SHORTEST * max(1.0, abs(begin)):  # the search has gone astray: nothing follows so fast
            return np.zeros(count + 1, dtype=np.complex128)
        result: Complex | None = None
        # What `measure_period` leaves at jumps goes with (step)³·(harmonic)²; so many rows keep it below the accuracy.
        rows = max(_ROWS, math.ceil(_ROWS_AT_JUMPS * count ** (2.0 / 3.0)))
        for turn in range(_MOST):
            points = np.linspace(begin + turn / frequency, begin + (turn + 1) / frequency, rows + 1)[1:]
            record = self._period(signals, points)
            even = points if self._session.communication_step is None else None
            before, result = result, _coefficients(record, begin, frequency, count, even)
            result[0] -= self._rest
            self._along = {n: record.values[n] for n in self._states}
            if before is not None and np.abs(result - before).max() <= _SETTLED * np.abs(result).max():
                return result
        self.settled = False
        return result if result is not None else np.zeros(count + 1, dtype=np.complex128)

    def _signals(self, v: Complex, frequency: float) -> dict[str, Signal]:
        """Return one sine for each harmonic, its phase 0 now."""
        signals: dict[str, Signal] = {"v0": Constant(float(v[0].real))}
        for k in range(1, self._count + 1):
            size = complex(v[k]) if k < len(v) else 0j
            phase = float(np.degrees(np.angle(size))) + 90.0
            signals[f"v{k}"] = Sine(amplitude=abs(size), frequency=k * frequency, phase=phase, start=self._session.time)
        return signals

    def _period(self, signals: Mapping[str, Signal], points: Floats) -> Recorded:
        return self._session.advance(float(points[-1]), signals=signals, record=["w", *self._states], points=points)

    def states(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return the block's states at phase 0 of the last answer, and how far each moved in its last period."""
        last = {n: float(v[-1]) for n, v in self._along.items()}
        return last, {n: float(np.ptp(v)) for n, v in self._along.items()}

    def close(self) -> None:
        """Close the session."""
        self._session.close()


def _coefficients(record: Recorded, begin: float, frequency: float, count: int, points: Floats | None) -> Complex:
    """Return the coefficients of the output, shape (count + 1,); `points` see `measure_period`.

    Raises:
        SimulationError: a value is not finite.
    """
    period = measure_period(
        record, input="v1", output="w", begin=begin, frequency=frequency, orders=count, points=points
    )
    h = period.harmonics
    if not np.isfinite(h).all():
        raise SimulationError("the block's output is not finite", time=float(record.time[-1]))
    return np.append(h[0] + 0j, h[2::2] - 1j * h[1::2]).astype(np.complex128)
