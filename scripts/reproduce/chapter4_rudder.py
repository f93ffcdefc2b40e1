"""Frequency response of the rudder actuator: chapter 4, example 4-3 of the source report."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from scripts.reproduce.drawings import titled
from scripts.reproduce.measurement import Measurement, Picture, Reproduction
from workbench.core.values.decibels import degrees
from workbench.jobs.options import Workers
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult
from workbench.response.simulate.picture import time_history
from workbench.response.simulate.request import simulate
from workbench.response.simulate.result import SimulationResult
from workbench.signals.kinds import Sine
from workbench.system.load import load

__all__ = ["EXPERIMENTS"]

HERE = Workers(in_process=True)
INPUT, OUTPUT = "delC", "del"
HERTZ = 10.0  # of the published point; its amplitude is 1 degree
WAYS = [(fmu, interface) for fmu in ("fmu:Rudder", "fmu:Rudder@3") for interface in ("me", "cs")]


def _at_ten_hertz() -> Measurement:
    found = []
    for fmu, interface in WAYS:
        with load(fmu, interface) as model:
            result = nfr(model, INPUT, OUTPUT, [HERTZ], 1.0, workers=HERE)
        found.append((result.gain_db[0, 0], result.phase_deg[0, 0]))
    gain, phase = np.array(found).T
    run = _simulated()
    late = run.time > 10.0 / HERTZ
    return Measurement(
        {
            "rudder-10hz-gain": gain,
            "rudder-10hz-ratio": float(np.ptp(run.signals[OUTPUT][late]) / np.ptp(run.signals[INPUT][late])),
            "rudder-10hz-phase": phase,
            "rudder-interfaces-gain": float(np.ptp(gain)),
            "rudder-interfaces-phase": float(np.ptp(phase)),
        },
        pictures=[Picture((26,), "The rudder under a sine of 10 Hz and 1 degree.", lambda: _draw_run(run))],
    )


def _simulated() -> SimulationResult:
    """Run the rudder for two seconds at the published point."""
    with load("fmu:Rudder") as model:
        sine = Sine(amplitude=1.0, frequency=HERTZ)
        return simulate(model, stop=2.0, inputs={INPUT: sine}, outputs=[INPUT, OUTPUT], interval=0.001)


def _draw_run(run: SimulationResult) -> Figure:
    figure = titled(time_history(run), "Figure 26: rudder, sine of 10 Hz and 1 deg")
    figure.axes[-1].set_xlim(0.0, 1.0)
    return figure


def _sweeps() -> Measurement:
    grid = np.geomspace(0.5, 20.0, 10)
    with load("fmu:Rudder", solver="gear") as model:
        rough = nfr(model, INPUT, OUTPUT, grid, 1.0, workers=HERE)
        smooth = nfr(model, INPUT, OUTPUT, grid, 1.0, errcrit=0.01, workers=HERE)
        finest = nfr(model, INPUT, OUTPUT, grid, 1.0, errcrit=0.001, workers=HERE)
        carried = nfr(model, INPUT, OUTPUT, grid[::-1], 1.0, carry=True, workers=HERE)
        sizes = nfr(model, INPUT, OUTPUT, [HERTZ], [0.5, 2.0, 8.0], workers=HERE)
    with load("fmu:Rudder", solver="vkm") as model:
        explicit = nfr(model, INPUT, OUTPUT, grid, 1.0, workers=HERE)
    gear_gain, gear_phase = _apart(explicit, rough)
    carried_gain, carried_phase = _apart(carried, rough)
    smooth_gain, smooth_phase = _apart(smooth, rough)
    return Measurement(
        {
            "rudder-errcrit-gain": smooth_gain,
            "rudder-errcrit-gain-fine": _apart(finest, smooth)[0],
            "rudder-errcrit-phase-fine": _apart(finest, smooth)[1],
            "rudder-amplitude": np.diff(sizes.gain_db[:, 0]),
            "rudder-gear-gain": gear_gain,
            "rudder-gear-phase": gear_phase,
            "rudder-carried-gain": carried_gain,
            "rudder-carried-phase": carried_phase,
        },
        {"rudder-errcrit-gain": f"the phase changes by {smooth_phase:.3g} deg at most"},
        [Picture((24, 25), "The rudder at several amplitudes, errcrit 0.1.", _bode)],
    )


def _apart(one: NfrResult, other: NfrResult) -> tuple[float, float]:
    """Return the largest differences of gain [dB] and phase [deg]; NaN where a point failed."""
    phase = degrees(one.response / other.response)
    return float(np.max(np.abs(one.gain_db - other.gain_db))), float(np.max(np.abs(phase)))


def _bode() -> Figure:
    with load("fmu:Rudder") as model:
        result = nfr(model, INPUT, OUTPUT, band=(0.5, 30.0), amplitudes=[0.25, 1.0, 4.0], workers=HERE)
    return titled(result.plot(), "Figure 25: rudder, nonlinear frequency response")


EXPERIMENTS = (
    Reproduction(
        "rudder at 10 Hz",
        (
            "rudder-10hz-gain",
            "rudder-10hz-ratio",
            "rudder-10hz-phase",
            "rudder-interfaces-gain",
            "rudder-interfaces-phase",
        ),
        _at_ten_hertz,
    ),
    Reproduction(
        "rudder's frequency response",
        (
            "rudder-errcrit-gain",
            "rudder-errcrit-gain-fine",
            "rudder-errcrit-phase-fine",
            "rudder-amplitude",
            "rudder-gear-gain",
            "rudder-gear-phase",
            "rudder-carried-gain",
            "rudder-carried-phase",
        ),
        _sweeps,
        2.0,
    ),
)
