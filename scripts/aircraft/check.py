"""Every figure of chapter 8, target and achieved, on the bundled FMUs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import workbench as wb
from scripts.aircraft.figures import crossings, edges, frequency, peak, switches, transfer, unstable

Floats = NDArray[np.float64]

SYSTEMS = Path(__file__).resolve().parents[2] / "systems"
GRAVITY = 9.80665
PULSE = wb.Table([0.0, 0.1, 0.1], [0.8, 0.8, 0.0])  # hinge moment [N·m]
INPUTS = ("inner_aileron", "outer_aileron_moment")
OUTPUTS = ("outer_aileron_position", "outer_aileron_rate")
RECORDED = (
    *OUTPUTS, "z_wing_tip", "z_wing_tip_acceleration", "z_front_fuselage", "z_front_fuselage_acceleration"
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure with its target: `low` ≤ achieved ≤ `high`; without them it is only told."""

    name: str
    target: str
    achieved: float
    low: float | None = None
    high: float | None = None

    @property
    def met(self) -> bool:
        """Whether it lies within its limits."""
        return (self.low is None or self.achieved >= self.low) and (self.high is None or self.achieved <= self.high)


def near(name: str, target: float, achieved: float, relative: float = 0.0, *, absolute: float = 0.0) -> Figure:
    """Return a figure that may differ by `relative` of its target, or by `absolute`."""
    width = absolute or abs(target) * relative
    said = f"{target:.7g} ± {absolute:g}" if absolute else f"{target:.7g} ± {100.0 * relative:g} %"
    return Figure(name, said, achieved, target - width, target + width)


def check() -> int:
    """Print all figures; return 1 where one is missed."""
    figures = [*linear_figures(), *cycle_figures(), *feedback_figures()]
    for figure in figures:
        verdict = "told" if figure.low is None and figure.high is None else "met" if figure.met else "MISSED"
        print(f"{verdict:7s}{figure.name:62s}{figure.target:24s}{figure.achieved:.6g}")
    missed = [figure.name for figure in figures if not figure.met]
    print(f"{len(figures)} figures, {len(missed)} missed" + (f": {', '.join(missed)}" if missed else ""))
    return 1 if missed else 0


def linear_model() -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return A, columns of inner aileron and hinge moment, rows of position and rate, of the failed aircraft."""
    with wb.load("fmu:Aircraft", start_values={"outer_aileron_failed": True}) as aircraft:
        model = wb.lin(aircraft, inputs=INPUTS, outputs=OUTPUTS)
    A, B, C = (np.asarray(m) for m in (model.A, model.B, model.C))
    return A, B[:, 0], B[:, 1], C[0], C[1]


def linear_figures() -> Iterator[Figure]:
    """Yield what follows from the linear model."""
    A, inner, moment, position, rate = linear_model()
    found = crossings(transfer(A, moment, rate), 0.1, 6.0)
    yield near("Nyquist crossings, 0.1 to 6 Hz", 3, len(found), absolute=0.5)
    wanted = ((2.64, -0.000775), (2.74, -0.014), (3.31, -0.0025))
    for (hertz, value), (at, achieved) in zip(wanted, sorted(found), strict=False):
        yield near(f"crossing at {hertz} Hz: frequency [Hz]", hertz, at, absolute=0.01)
        yield near(f"crossing at {hertz} Hz: value", value, achieved, 0.01)
    yield near("unstable poles of the free aileron", 2, unstable(A), absolute=0.5)
    first = max(np.linalg.eigvals(A), key=lambda value: value.real)
    yield Figure("unstable pair: frequency [Hz]", "3.40 … 3.46", abs(first.imag) / 2.0 / np.pi, 3.40, 3.46)
    yield Figure("unstable pair: growth [1/s]", "-", float(first.real))
    changes = switches(A, moment, rate, 1.0, 1e5)
    yield near("switches of the pole count", 3, len(changes), absolute=0.5)
    for (k, below, above), (at, was, then) in zip(((71.4, 2, 4), (400.0, 4, 2), (1290.0, 2, 0)), changes, strict=False):
        yield near(f"equivalent damping of {below} → {above} poles [N·m·s/rad]", k, at, 0.01)
        yield near(f"{below} poles below, {above} above", 10 * below + above, 10 * was + then, absolute=0.5)
    yield from _gain_figures(A, inner, position, rate)


def _gain_figures(A: Floats, inner: Floats, position: Floats, rate: Floats) -> Iterator[Figure]:
    for edge, outside in ((-1.3125, -1.6), (-0.3185, 0.0)):
        yield near("edge of the stable position gains", edge, edges(A, inner, position, -1.0, outside), 0.005)
    loop = crossings(transfer(A, inner, rate), 0.01, 1e4)
    yield near("rate loop: crossings of the negative real axis", 5, len(loop), absolute=0.5)
    for sign in (-1.0, 1.0):
        gains = sign * np.geomspace(1e-5, 100.0, 800)
        stable = sum(unstable(A + g * np.outer(inner, rate)) == 0 for g in gains)
        side = "negative" if sign < 0 else "positive"
        yield near(f"rate loop: stabilising gains among 800 {side} ones", 0, stable, absolute=0.5)


def cycle_figures() -> Iterator[Figure]:
    """Yield the simulated limit cycle: 260 s from a small pulse, the last 40 s."""
    with wb.load(str(SYSTEMS / "failed_aileron.toml")) as system:
        result = wb.simulate(system, stop=260.0, inputs={"pulse": PULSE}, outputs=RECORDED, interval=0.005)
    late = result.time > 220.0
    time = result.time[late]
    columns = {name: result.signals[name][late] for name in RECORDED}
    yield near("limit cycle: frequency [Hz]", 2.64, frequency(time, columns["outer_aileron_rate"]), 0.005)
    yield near("rate of the outer aileron [rad/s]", 0.217, peak(columns["outer_aileron_rate"]), 0.025)
    yield near(
        "position of the outer aileron [deg]", 0.75, float(np.degrees(peak(columns["outer_aileron_position"]))), 0.04
    )
    yield near("wing tip [m]", 0.13, peak(columns["z_wing_tip"]), 0.05)
    yield near("wing tip [g]", 3.5, peak(columns["z_wing_tip_acceleration"]) / GRAVITY, 0.05)
    yield near("front fuselage [m]", 0.02, peak(columns["z_front_fuselage"]), 0.06)
    yield near("front fuselage [g]", 0.6, peak(columns["z_front_fuselage_acceleration"]) / GRAVITY, 0.06)
    early = (result.time > 40.0) & (result.time < 60.0)
    before = frequency(result.time[early], result.signals["outer_aileron_rate"][early])
    yield Figure("frequency from 40 to 60 s, before the cycle [Hz]", "3.45 (until 75 s)", before)


def feedback_figures() -> Iterator[Figure]:
    """Yield what the position feedback does from 140 s on."""
    names = (*OUTPUTS, "inner_aileron_position", "inner_aileron_rate")
    with wb.load(str(SYSTEMS / "failed_aileron_feedback.toml")) as system:
        result = wb.simulate(system, stop=260.0, inputs={"pulse": PULSE}, outputs=names, interval=0.005)
    time, rate = result.time, result.signals["outer_aileron_rate"]
    cycle = peak(rate[(time > 130.0) & (time < 140.0)])
    left = peak(rate[time > 200.0]) / cycle
    yield Figure("gain −1: rate left 60 s after closing, of the cycle's", "below 0.01", left, None, 0.01)
    inner = {name: float(np.degrees(abs(result.signals[name]).max())) for name in names[2:]}
    yield Figure("inner aileron: largest deflection [deg]", "below 25", inner["inner_aileron_position"], None, 25.0)
    yield Figure("inner aileron: largest rate [deg/s]", "below 40", inner["inner_aileron_rate"], None, 40.0)
