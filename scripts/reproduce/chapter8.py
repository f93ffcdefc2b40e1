"""The aircraft, its describing function and its limit cycle by analysis: chapters 8.1 to 8.3 of the source report."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from scripts.reproduce.drawings import titled
from scripts.reproduce.measurement import Measurement, Picture, Reproduction
from scripts.reproduce.targets import read_targets
from workbench.core.values.poles import damped_frequency_hz
from workbench.fmi.variable import Value
from workbench.jobs.options import Workers
from workbench.limit_cycles.limit_cycle.request import limit_cycle
from workbench.limit_cycles.limit_cycle.result import LimitCycleResult
from workbench.loops.describing.describe import describing_function
from workbench.loops.nyquist.picture import plot_nyquist
from workbench.loops.nyquist.result import Crossing
from workbench.point.lin.request import lin
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Constant
from workbench.system.description import FmuComponent
from workbench.system.files.read import read_system
from workbench.system.load import load

__all__ = ["EXPERIMENTS"]

HERE = Workers(in_process=True)
BAND = (0.1, 6.0)  # [Hz], of figure 48
AMPLITUDE, HERTZ = 0.2, 2.6  # [rad/s], [Hz], where the describing function is measured
FULL = 10.0  # [rad], far beyond every limit
SETTLED = 4.0  # [s], of the actuators


def _aircraft() -> Measurement:
    with load("fmu:Aircraft", start_values={"outer_aileron_failed": True}) as aircraft:
        inputs = ["outer_aileron_moment", "inner_aileron"]
        linear = lin(aircraft, inputs=inputs, outputs=["outer_aileron_rate"]).result
        outputs = len(aircraft.outputs)
    poles = np.linalg.eigvals(linear.A)
    growing = poles[int(np.argmax(poles.real))]
    return Measurement(
        {
            "aircraft-states": float(len(linear.A)),
            "aircraft-zeros": [float(len(linear.part(j).invariant_zeros)) for j in (0, 1)],
            "aircraft-outputs": float(outputs),
            "unstable-pair": float(damped_frequency_hz(growing)),
            "aileron-limits": _limits({}),
            "elevator-limits": _limits(_elevator_settings()),
        },
        {"unstable-pair": f"it grows with {growing.real:.4f} 1/s"},
    )


def _elevator_settings() -> Mapping[str, Value]:
    """Return the parameters that the bundled system gives the elevator's actuator."""
    parts = read_system("system:failed_aileron_comfort").components
    actuator = next(part for part in parts if part.name == "actuator")
    return dict(actuator.set) if isinstance(actuator, FmuComponent) else {}


def _limits(settings: Mapping[str, Value]) -> list[float]:
    """Return largest deflections and rate of the limited actuator, commanded far beyond them [deg, deg/s]."""
    found = []
    with load("fmu:LimitedActuator", start_values=dict(settings)) as actuator:
        for command in (FULL, -FULL):
            signals = {"command": Constant(command)}
            found.append(simulate(actuator, stop=SETTLED, inputs=signals, outputs=["deflection"], interval=0.01))
    ends = [math.degrees(run.signals["deflection"][-1]) for run in found]
    rate = max(float(np.max(np.abs(np.gradient(run.signals["deflection"], run.time)))) for run in found)
    return [*ends, math.degrees(rate)]


def _describing() -> Measurement:
    with load("fmu:AileronDamper") as damper:
        found = describing_function(damper, [AMPLITUDE], [HERTZ], workers=HERE)
    return Measurement({"describing-function": float(abs(found.gain.ravel()[0])) / AMPLITUDE})


def _published(name: str) -> list[float]:
    value = read_targets()[name].value
    return list(np.atleast_1d(np.asarray(value, dtype=np.float64)))


def _crossings(result: LimitCycleResult) -> list[Crossing]:
    """Return the crossing next to each of the published ones."""
    frequencies = _published("nyquist-frequencies")
    return [min(result.crossings, key=lambda c: abs(c.frequency_hz - hertz)) for hertz in frequencies]


def _limit_cycle() -> Measurement:
    with load("system:failed_aileron") as system:
        result = limit_cycle(system, block="damper", band=BAND, outputs=["outer_aileron_rate"], workers=HERE)
    named = _crossings(result)
    rising = sorted(result.crossings, key=lambda c: c.gain)
    counts = [rising[0].unstable_below, *(c.unstable_above for c in rising)]
    first = next(c for c in result.limit_cycles if c.method == "describing function" and c.stable)
    return Measurement(
        {
            "nyquist-count": float(len(result.crossings)),
            "nyquist-frequencies": [c.frequency_hz for c in named],
            "nyquist-values": [c.real for c in named],
            "nyquist-stable": [float(bool(c.stable)) for c in named],
            "pole-counts": [float(n) for n in counts],
            "pole-switches": [c.gain for c in rising],
            "predicted-amplitude": first.fundamental,
            "predicted-frequency": first.frequency_hz,
        },
        {"predicted-amplitude": _by_method(result)},
        [
            Picture((46, 47, 48), "Linear part and damper: L(jω) and −1/N(A).", lambda: _nyquist(result)),
            Picture((48,), "Limit cycles by four methods.", lambda: titled(result.plot(), "Figure 48: limit cycles")),
        ],
    )


def _by_method(result: LimitCycleResult) -> str:
    stable = [c for c in result.limit_cycles if c.stable]
    found = (
        f"{c.method} {c.amplitude:.4f} rad/s (fundamental {c.fundamental:.4f}) at {c.frequency_hz:.4f} Hz"
        for c in stable
    )
    return "; ".join(found)


def _nyquist(result: LimitCycleResult) -> Figure:
    return titled(plot_nyquist(result.nyquist), "Figure 48: Nyquist plot of the linear part, 0.1 to 6 Hz")


EXPERIMENTS = (
    Reproduction(
        "aircraft",
        ("aircraft-states", "aircraft-zeros", "aircraft-outputs", "unstable-pair", "aileron-limits", "elevator-limits"),
        _aircraft,
    ),
    Reproduction("describing function", ("describing-function",), _describing),
    Reproduction(
        "limit cycle predicted",
        (
            "nyquist-count",
            "nyquist-frequencies",
            "nyquist-values",
            "nyquist-stable",
            "pole-counts",
            "pole-switches",
            "predicted-amplitude",
            "predicted-frequency",
        ),
        _limit_cycle,
        4.0,
    ),
)
