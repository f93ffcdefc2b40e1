"""Every figure of chapter 8, target and achieved, on the bundled FMUs.

Measured by means of its own (eigenvalues, bisection, a plain scan), so that `dev.py reproduce 8`, which uses the
public analyses, has something to be compared with. The targets are the same: scripts/reproduce/targets.toml.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import workbench as wb
from scripts.aircraft.figures import crossings, edges, frequency, peak, switches, transfer, unstable
from scripts.reproduce.targets import PublishedTarget, read_targets
from workbench.core.values.arrays import Floats

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
    """A figure that was achieved, and its target; None: it is only told."""

    name: str
    achieved: float | Sequence[float]
    target: PublishedTarget | None = None

    @property
    def met(self) -> bool:
        """Whether it lies within its tolerance, or is what the target itself says is measured instead."""
        return self.target is None or self.target.expects(self.achieved)

    @property
    def verdict(self) -> str:
        """In a word."""
        if self.target is None or (self.met and not self.target.accepts(self.achieved)):
            return "told"
        return "met" if self.met else "MISSED"

    @property
    def asked(self) -> str:
        """Target and tolerance in words."""
        return "-" if self.target is None else f"{self.target.text} ({self.target.tolerance})"


def figure(name: str, achieved: float | Sequence[float]) -> Figure:
    """Return what was achieved beside the target of that name in scripts/reproduce/targets.toml."""
    target = read_targets()[name]
    return Figure(f"{name}: {target.what}", achieved, target)


def check() -> int:
    """Print all figures; return 1 where one is missed."""
    figures = [*linear_figures(), *cycle_figures(), *feedback_figures()]
    for found in figures:
        numbers = ", ".join(f"{x:.6g}" for x in np.atleast_1d(np.asarray(found.achieved)))
        print(f"{found.verdict:7s}{found.name}\n{'':11s}{found.asked}: {numbers}")
    missed = [found.name for found in figures if not found.met]
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
    found = sorted(crossings(transfer(A, moment, rate), 0.1, 6.0))
    yield figure("nyquist-count", len(found))
    yield figure("nyquist-frequencies", [hertz for hertz, _ in found])
    yield figure("nyquist-values", [value for _, value in found])
    first = max(np.linalg.eigvals(A), key=lambda value: value.real)
    yield figure("unstable-pair", abs(first.imag) / 2.0 / np.pi)
    yield Figure("unstable pair: growth [1/s]", float(first.real))
    changes = switches(A, moment, rate, 1.0, 1e5)
    yield figure("pole-counts", [unstable(A), *(above for _, _, above in changes)])
    yield figure("pole-switches", [k for k, _, _ in changes])
    yield from _gain_figures(A, inner, position, rate)


def _gain_figures(A: Floats, inner: Floats, position: Floats, rate: Floats) -> Iterator[Figure]:
    yield figure("position-gains", [edges(A, inner, position, -1.0, outside) for outside in (-1.6, 0.0)])
    yield figure("rate-crossings", len(crossings(transfer(A, inner, rate), 0.01, 1e4)))
    for sign, name in ((-1.0, "rate-gains-negative"), (1.0, "rate-gains-positive")):
        gains = sign * np.geomspace(1e-5, 100.0, 800)  # stable ones among them, in place of intervals
        yield figure(name, sum(unstable(A + g * np.outer(inner, rate)) == 0 for g in gains))


def cycle_figures() -> Iterator[Figure]:
    """Yield the simulated limit cycle: 260 s from a small pulse, the last 40 s."""
    with wb.load(str(SYSTEMS / "failed_aileron.toml")) as system:
        result = wb.simulate(system, stop=260.0, inputs={"pulse": PULSE}, outputs=RECORDED, interval=0.005)
    late = result.time > 220.0
    size = {name: peak(result.signals[name][late]) for name in RECORDED}
    yield figure("cycle-frequency", frequency(result.time[late], result.signals["outer_aileron_rate"][late]))
    yield figure("cycle-rate", size["outer_aileron_rate"])
    yield figure("cycle-position", float(np.degrees(size["outer_aileron_position"])))
    yield figure("cycle-wing-tip", size["z_wing_tip"])
    yield figure("cycle-wing-tip-acceleration", size["z_wing_tip_acceleration"] / GRAVITY)
    yield figure("cycle-cockpit", size["z_front_fuselage"])
    yield figure("cycle-cockpit-acceleration", size["z_front_fuselage_acceleration"] / GRAVITY)
    yield figure("cycle-start", [_between(result, 10.0, 20.0), _between(result, 50.0, 60.0)])


def _between(result: wb.SimulationResult, begin: float, end: float) -> float:
    shown = (result.time > begin) & (result.time < end)
    return frequency(result.time[shown], result.signals["outer_aileron_rate"][shown])


def feedback_figures() -> Iterator[Figure]:
    """Yield what the position feedback does from 140 s on."""
    names = (*OUTPUTS, "inner_aileron_position", "inner_aileron_rate")
    with wb.load(str(SYSTEMS / "failed_aileron_feedback.toml")) as system:
        result = wb.simulate(system, stop=260.0, inputs={"pulse": PULSE}, outputs=names, interval=0.005)
    time, rate = result.time, result.signals["outer_aileron_rate"]
    cycle = peak(rate[(time > 130.0) & (time < 140.0)])
    yield figure("feedback-left", peak(rate[time > 200.0]) / cycle)
    inner = {name: float(np.degrees(abs(result.signals[name]).max())) for name in names[2:]}
    yield figure("feedback-deflection", inner["inner_aileron_position"])
    yield figure("feedback-rate", inner["inner_aileron_rate"])
