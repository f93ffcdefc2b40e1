"""Measure how often the error that a frequency response states covers the truth.

Each plant has one to five modes with damping ratios of 2e-4 … 2e-2 (logarithmic), the first at 1 Hz, the others at
0.3 … 3 Hz, and is forced within ±4 damping ratios of the first resonance. Its response is known in closed form. It is
integrated as any model is. The nonlinear ones start from rest, under amplitudes at which their multipliers change as
the transient decays, and are integrated side by side, each period as the workbench sees that of a co-simulation FMU;
the truth is the period to which they come in the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import control
import numpy as np
from numpy.typing import NDArray

import workbench as wb
from scripts.promises.trial import Trial, kept, lines
from workbench.model import Model
from workbench.response.nfr.job import PointsJob
from workbench.response.nfr.point import PointTask
from workbench.response.nfr.prior_knowledge import surroundings
from workbench.response.nfr.settling import Settling, SettlingOutcome
from workbench.response.periodic.fourier import ORDERS, Period, fundamental


@dataclass(frozen=True)
class Mode:
    """One mode, gain / (1 − (f/f0)² + 2jζ f/f0)."""

    frequency: float
    damping: float
    gain: float


@dataclass(frozen=True)
class Plant:
    """Modes in parallel, and where they are forced [Hz]."""

    modes: tuple[Mode, ...]
    forced_at: float

    @classmethod
    def random(cls, random: np.random.Generator) -> Plant:
        """Return a plant forced near its first resonance."""
        damping = 10.0 ** random.uniform(np.log10(2e-4), np.log10(2e-2), random.integers(1, 6))
        frequency = [1.0, *(10.0 ** random.uniform(-0.5, 0.5, len(damping) - 1))]
        gain = random.uniform(0.2, 2.0, len(damping)) * random.choice([-1.0, 1.0], len(damping))
        modes = tuple(map(Mode, frequency, damping.tolist(), gain.tolist()))
        return cls(modes, 1.0 + modes[0].damping * random.uniform(-4.0, 4.0))

    @property
    def truth(self) -> complex:
        """The response."""
        ratios = [(m, self.forced_at / m.frequency) for m in self.modes]
        return sum(m.gain / (1.0 - r * r + 2j * m.damping * r) for m, r in ratios)

    def model(self, *, tolerance: float, solver: str = "gear") -> Model:
        """Return it as a model with input u and output y."""
        n = len(self.modes)
        a, b, c = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 1)), np.zeros((1, 2 * n))
        for i, m in enumerate(self.modes):
            w = 2.0 * np.pi * m.frequency
            a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[0.0, w], [-w, -2.0 * m.damping * w]]
            b[2 * i + 1, 0], c[0, 2 * i] = w, m.gain
        plant = control.ss(a, b, c, 0.0)
        return wb.connect(
            {"p": plant}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}, tolerance=tolerance, solver=solver
        )


Many = NDArray[np.float64]
Slope = Callable[[Many, Many], Many]  # states, shape (n, count), and input, shape (count,), to the states' slopes
_W0 = 2.0 * np.pi  # of the oscillators [rad/s]
_ROWS, _PERIODIC = 200, 1e-11


@dataclass(frozen=True)
class Kind:
    """Nonlinear models of one kind, side by side: output is the last state, the input a sine from 0."""

    name: str
    slope: Slope
    states: int
    frequency: Many
    amplitude: Many


def kinds(count: int, random: np.random.Generator) -> Iterator[Kind]:
    """Yield random models of each kind."""

    def spread(low: float, high: float) -> Many:
        return 10.0 ** random.uniform(low, high, count)

    def oscillators(name: str, force: Callable[[Many, Many], Many], amplitude: Many) -> Kind:
        damping = spread(-2.3, -0.5)

        def slope(x: Many, u: Many) -> Many:
            return np.stack([_W0**2 * (u - x[1]) - 2.0 * damping * _W0 * x[0] - force(x[1], x[0]), x[0]])

        return Kind(name, slope, 2, spread(-0.7, 0.5), amplitude)

    k = random.uniform(0.2, 3.0, count)
    yield oscillators("hardening spring", lambda x, _: _W0**2 * k * x**3, spread(-1.5, 0.5))
    s = random.uniform(0.2, 1.0, count)
    yield oscillators("softening spring", lambda x, _: -(_W0**2) * s * x**3, spread(-1.5, -0.7))
    q = random.uniform(0.1, 3.0, count)
    yield oscillators("quadratic drag", lambda _, v: q * v * np.abs(v), spread(-1.0, 0.7))
    rate, lag = spread(-0.5, 1.0), spread(-1.5, 0.3)
    yield Kind(
        "limited rate and lag",
        lambda x, u: np.stack([rate * np.tanh(4.0 * (u - x[0]) / rate), (x[0] - x[1]) / lag]),
        2,
        spread(-0.7, 0.7),
        spread(-0.5, 1.0),
    )
    c, b = random.uniform(0.0, 2.0, count), random.uniform(-0.15, 0.15, count)
    yield Kind("cubic lag", lambda x, u: u[None] - x - b * x**2 - c * x**3, 1, spread(-1.0, 0.7), spread(-0.5, 0.5))


def periods_of(kind: Kind, count: int) -> Iterator[tuple[Many, Many]]:
    """Yield of each period the harmonics, shape (1 + 2·orders, models), and the largest outputs, by Runge-Kutta."""
    x = np.zeros((kind.states, kind.frequency.size))
    angles = 2.0 * np.pi * np.arange(2 * _ROWS + 1) / (2 * _ROWS)
    h, n = 1.0 / (kind.frequency * _ROWS), np.arange(1, ORDERS + 1)[:, None]
    weights = np.full(_ROWS + 1, 2.0 / _ROWS)
    weights[[0, -1]] /= 2.0
    sines, cosines = (weights * shape(n * angles[None, ::2]) for shape in (np.sin, np.cos))
    u = kind.amplitude * np.sin(angles)[:, None]
    for _ in range(count):
        y = [x[-1]]
        for row in range(_ROWS):
            u0, u1, u2 = u[2 * row : 2 * row + 3]
            a = kind.slope(x, u0)
            b = kind.slope(x + 0.5 * h * a, u1)
            c = kind.slope(x + 0.5 * h * b, u1)
            x = x + h / 6.0 * (a + 2.0 * (b + c) + kind.slope(x + h * c, u2))
            y.append(x[-1])
        seen = np.array(y)
        mean = 0.5 * weights @ seen
        found = np.empty((1 + 2 * ORDERS, mean.size))
        found[0], found[1::2], found[2::2] = mean, sines @ (seen - mean), cosines @ (seen - mean)
        yield found, np.abs(seen).max(axis=0)


def nonlinear_trials(kind: Kind, max_periods: int, until: int = 300) -> Iterator[Trial]:
    """Measure models without any help but their periods; those without a periodic response are left out."""
    with np.errstate(all="ignore"):  # some grow without bound
        every = list(periods_of(kind, until))
    for i, amplitude in enumerate(kind.amplitude):
        before, truth = (fundamental(harmonics[:, i]) for harmonics, _ in every[-2:])
        if not abs(truth - before) <= _PERIODIC * abs(truth):
            continue
        settling = Settling(0.1, max_periods)
        for harmonics, size in every:
            found = settling.add(Period(harmonics[:, i].copy(), complex(amplitude), float(size[i])))
            if found is not None:
                settled = found.outcome in (SettlingOutcome.RESOLVED, SettlingOutcome.SETTLED)
                true = abs(found.value * amplitude / truth - 1.0)
                yield Trial("settled" if settled else "averaged", found.error, true, len(settling.periods))
                break


def measure(
    plant: Plant, *, tolerance: float, max_periods: int, blind: bool, solver: str = "gear", method: str = "auto"
) -> Trial:
    """Return the trial of a plant; `blind`: without its linear model."""
    with plant.model(tolerance=tolerance, solver=solver) as model:
        task = PointTask(
            input="u",
            output="y",
            frequency=plant.forced_at,
            amplitude=1.0,
            errcrit=0.1,
            max_periods=max_periods,
            method=method,
            linear=None if blind else surroundings(model, "u", "y").linear,
        )
        job = PointsJob(tasks=(task,), carry=False, step=None)
        point = next(job.run(model))
    response = complex("nan") if point.response is None else point.response
    stated = float("nan") if point.error is None else point.error
    return Trial(point.status, stated, abs(response - plant.truth) / abs(plant.truth), point.periods)


def trials(count: int, seed: int, **how: object) -> Iterator[Trial]:
    """Measure random plants."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        yield measure(Plant.random(random), **how)  # type: ignore[arg-type]


def run(
    *, cases: int = 200, seed: int = 1, tolerance: float = 1e-8, max_periods: int = 20, solver: str = "gear",
    blind: bool = False, method: str = "auto", nonlinear: bool = False,
) -> int:  # fmt: skip
    """Return 1 if settled points fall short.

    Args:
        cases: plants, or nonlinear models of each kind.
        seed: of the first.
        tolerance: of the integration.
        max_periods: waited for at most.
        solver: that integrates.
        blind: without the linear model of the plant.
        method: auto, or settle: waited for, not solved for.
        nonlinear: models of five kinds, without any help but their periods.
    """
    if nonlinear:
        short = 0
        for kind in kinds(cases, np.random.default_rng(seed)):
            found = list(nonlinear_trials(kind, max_periods))
            print("\n".join([f"{kind.name}:", *lines(found)]))
            short += not kept(found)
        return min(short, 1)
    how = {"tolerance": tolerance, "max_periods": max_periods, "blind": blind, "solver": solver, "method": method}
    found = list(trials(cases, seed, **how))
    print("\n".join(lines(found)))
    return int(not kept(found))
