"""Linear models of the elevator law by the perturbation sets of figure 31, simulated beside the law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import degrees
from workbench.model import Model
from workbench.point.lin.request import lin
from workbench.point.lin.result import LinResult
from workbench.point.trim.request import trim
from workbench.point.trim.result import TrimResult
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Sine
from workbench.system.load import load

__all__ = [
    "AMPLITUDE",
    "ELEVATOR",
    "FREQUENCIES",
    "LAW",
    "OURS",
    "PUBLISHED",
    "STICK",
    "LinearTrial",
    "Wave",
    "WidthComparison",
    "study"
]  # fmt: skip

Widths = tuple[tuple[float, ...], tuple[float, ...]]

LAW = "fmu:ElevatorLaw"
STICK, ELEVATOR = "side_stick", "elevator"
AMPLITUDE = 1.0  # the whole stick, its normal range
FREQUENCIES = (5.0, 0.5, 0.05)  # [Hz]
_PERIODS = 11  # of 5 Hz, 0.5 Hz or 0.05 Hz are a whole number of samples of 0.022 s
_SETTLED = 2  # so many times 11 periods before

# Total widths: of the four states, of the five inputs.
PUBLISHED: Mapping[str, Widths] = {
    "30a": ((1, 1, 1, 1), (1, 1, 1, 1, 1)),
    "30b": ((100, 100, 100, 1), (100, 100, 100, 100, 1)),
    "30c": ((100, 100, 100, 10), (100, 100, 100, 100, 1)),
    "30d": ((100, 100, 100, 10), (100, 100, 100, 100, 1.5)),
}
# Two sets of ours: so narrow that nothing is limited, and one fitted to 5 Hz.
OURS: Mapping[str, Widths] = {
    "narrow": ((0.1, 0.1, 0.1, 0.1), (0.1, 0.1, 0.1, 0.1, 0.1)),
    "fitted": ((100, 100, 100, 15), (100, 100, 100, 100, 1.65)),
}


@dataclass(frozen=True, eq=False)
class Wave:
    """What a sine of the stick makes of the elevator.

    Attributes:
        time: of the samples, shape (n,) [s].
        values: elevator from each sample to the next, shape (n,) [deg].
        fundamental: complex, elevator over stick [deg].
    """

    time: Floats
    values: Floats
    fundamental: complex

    @classmethod
    def of(cls, time: Floats, values: Floats, frequency: float) -> Wave:
        """Return the wave; `time` spans whole periods."""
        turning = np.exp(-2j * np.pi * frequency * time)
        return cls(time, values, complex(2j * np.mean(values * turning)) / AMPLITUDE)


@dataclass(frozen=True, eq=False)
class LinearTrial:
    """One linear model beside the law, at one frequency.

    Attributes:
        name: of the set of widths.
        frequency: [Hz].
        linear, law: what either does.
    """

    name: str
    frequency: float
    linear: Wave
    law: Wave

    @property
    def phase_shift(self) -> float:
        """Phase of the linear model less that of the law [deg]."""
        return float(degrees(self.linear.fundamental / self.law.fundamental))

    @property
    def gain_ratio(self) -> float:
        """Gain of the linear model over that of the law."""
        return abs(self.linear.fundamental / self.law.fundamental)

    @property
    def error(self) -> float:
        """Root mean square of the difference, over that of the law's motion."""
        motion = self.law.values - np.mean(self.law.values)
        return float(np.sqrt(np.mean((self.linear.values - self.law.values) ** 2) / np.mean(motion**2)))


@dataclass(frozen=True, eq=False)
class WidthComparison:
    """All of it.

    Attributes:
        trim: the operating point, one of a family.
        models: set of widths → linear model.
        trials: by set and frequency.
    """

    trim: TrimResult
    models: Mapping[str, LinResult]
    trials: Mapping[tuple[str, float], LinearTrial]


def study() -> WidthComparison:
    """Trim, linearise with every set, simulate the linear models and the law."""
    with load(LAW, "me") as law:
        rest = trim(law)
        sets = {**PUBLISHED, **OURS}
        models = {n: lin(law, at=rest.operating_point, dx=list(dx), du=list(du)).result for n, (dx, du) in sets.items()}
    with load(LAW, "me", start_values=dict(rest.operating_point.discrete)) as law:
        waves = {f: _law(law, f, models["narrow"].dt) for f in FREQUENCIES}
    trials = {
        (name, f): LinearTrial(name, f, _linear(model, f), waves[f])
        for name, model in models.items()
        for f in FREQUENCIES
    }
    return WidthComparison(rest, models, trials)


def _samples(frequency: float, period: float) -> tuple[Floats, int]:
    """Return the sample instants from rest on, and how many of the last are kept."""
    kept = round(_PERIODS / frequency / period)
    time: Floats = period * np.arange(float((_SETTLED + 1) * kept))
    return time, kept


def _law(model: Model, frequency: float, period: float) -> Wave:
    time, kept = _samples(frequency, period)
    stick = Sine(amplitude=AMPLITUDE, frequency=frequency)
    middle = time + 0.5 * period  # where the law holds what it set at the sample
    done = simulate(model, stop=middle[-1], inputs={STICK: stick}, outputs=[ELEVATOR], points=middle)
    values = done.signals[ELEVATOR][np.searchsorted(done.time, middle - 1e-9)]
    return Wave.of(time[-kept:], values[-kept:], frequency)


def _linear(model: LinResult, frequency: float) -> Wave:
    time, kept = _samples(frequency, model.dt)
    j = model.input_names.index(STICK)
    state, values = np.zeros(len(model.A)), []
    for u in AMPLITUDE * np.sin(2.0 * np.pi * frequency * time):
        values.append(float((model.C @ state)[0] + model.D[0, j] * u))
        state = model.A @ state + model.B[:, j] * u
    return Wave.of(time[-kept:], model.operating_point.y[ELEVATOR] + np.array(values)[-kept:], frequency)
