"""Frequency response of the lag and of the two quantisers: chapter 4, examples 4-1 and 4-2 of the source report."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from scripts.reproduce.drawings import titled
from scripts.reproduce.measurement import Measurement, Picture, Reproduction
from scripts.reproduce.published_rule import largest_jump, published_response
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import decibels, degrees
from workbench.jobs.options import Workers
from workbench.point.lin.request import lin
from workbench.point.lin.result import LinResult
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult
from workbench.response.simulate.picture import time_history
from workbench.response.simulate.request import simulate
from workbench.show.bode import plain_decades
from workbench.show.figure import COLOURS, LEGEND, rows
from workbench.signals.kinds import Sine
from workbench.system.load import load

__all__ = ["EXPERIMENTS"]


HERE = Workers(in_process=True)
BAND = (0.1, 10.0)  # [Hz]
BIAS = 0.3  # added to the sine
TAU = 0.2  # [s], of the rule's own picture
CRITICAL = (15.39, 15.407, 15.42)  # [Hz]


# ── Example 4-1 ──────────────────────────────────────────────────────────────────────────────────────────────────


def _truth(linear: LinResult, frequency: Floats) -> Complex:
    return np.asarray(linear.response(frequency)[:, 0, 0], dtype=np.complex128)


def _errors(result: NfrResult, linear: LinResult) -> tuple[float, float]:
    """Return the largest errors of gain [%] and phase [deg]; NaN where a point failed."""
    quotient = result.response[0] / _truth(linear, result.frequency_hz)
    return 100.0 * float(np.max(np.abs(np.abs(quotient) - 1.0))), float(np.max(np.abs(degrees(quotient))))


def _lag() -> Measurement:
    with load("fmu:FirstOrderLag") as model:
        linear = lin(model).result
        found = {e: nfr(model, "u", "y", amplitudes=1.0, band=BAND, errcrit=e, workers=HERE) for e in (0.1, 0.001)}
        carried = nfr(model, "u", "y", found[0.1].frequency_hz[::-1], 1.0, carry=True, workers=HERE)
    with load("fmu:FirstOrderLag", bias={"u": BIAS}) as model:
        moved = nfr(model, "u", "y", [1.0], 1.0, workers=HERE)
    (gain, phase), (fine_gain, fine_phase) = (_errors(r, linear) for r in found.values())
    apart = degrees(carried.response / found[0.1].response)
    return Measurement(
        {
            "lag-gain-default": gain,
            "lag-phase-default": phase,
            "lag-gain-fine": fine_gain,
            "lag-phase-fine": fine_phase,
            "lag-mean": float(moved.offset[0, 0]) / BIAS,
            "lag-carried": float(np.max(np.abs(apart))),
        }
    )


def _lag_by_the_rule() -> Measurement:
    frequency = BAND[0] * 1.2 ** np.arange(0.0, 26.0)
    frequency = np.append(frequency[frequency < BAND[1]], BAND[1])
    with load("fmu:FirstOrderLag", start_values={"tau": TAU}) as model:
        truth = _truth(lin(model).result, frequency)
        found = {e: published_response(model, "u", "y", frequency, errcrit=e) for e in (0.1, 0.01, 0.001)}
        ours = nfr(model, "u", "y", frequency, 1.0, workers=HERE)
    error = {e: degrees(h / truth) for e, h in found.items()}
    where, height = largest_jump(frequency, error[0.1])
    return Measurement(
        {"lag-rule-jump": where, "lag-rule-fine": float(np.max(np.abs(error[0.001])))},
        {"lag-rule-jump": f"the phase jumps by {height:+.2f} deg; {np.abs(error[0.1]).max():.2f} deg off at most"},
        [
            Picture(
                (17, 18, 19),
                f"Example 4-1 with a time constant of {TAU:g} s (ours: it is not printed). The settling rule of the "
                "source report makes the phase jump; smaller errcrit mends it, removing the transient does so at once.",
                lambda: _draw_rule(frequency, truth, found, ours),
            )
        ],
    )


def _draw_rule(frequency: Floats, truth: Complex, found: dict[float, Complex], ours: NfrResult) -> Figure:
    figure, (gain, phase, error) = rows(3, title="Figures 18 and 19: transfer function, settling by the published rule")
    curves = {f"published rule, errcrit {e:g}": h for e, h in found.items()} | {"workbench nfr": ours.response[0]}
    gain.plot(frequency, decibels(truth), color="#222222", linewidth=1.8, label="theory")
    phase.plot(frequency, degrees(truth), color="#222222", linewidth=1.8)
    for number, (name, h) in enumerate(curves.items()):
        style: dict[str, Any] = {
            "color": COLOURS[number],
            "marker": "osD^"[number],
            "markersize": 3.5,
            "linewidth": 0.9,
        }
        gain.plot(frequency, decibels(h), label=name, **style)
        phase.plot(frequency, degrees(h), **style)
        error.plot(frequency, degrees(h / truth), **style)
    gain.set_ylabel("gain [dB]")
    phase.set_ylabel("phase [deg]")
    error.set(ylabel="error of the phase [deg]", xlabel="frequency [Hz]")
    plain_decades(error)
    gain.legend(**{**LEGEND, "loc": "lower left"})
    return figure


# ── Example 4-2 ──────────────────────────────────────────────────────────────────────────────────────────────────


def _quantisers() -> Measurement:
    with load("fmu:TwoRateQuantizer") as model:
        result = nfr(model, "u", "y", CRITICAL, 1.0, errcrit=0.08, workers=HERE)
    return Measurement(
        {
            "quantiser-averaged": result.averaged[0].astype(float),
            "quantiser-periods": float(result.periods[0, 1]),
            "quantiser-neighbours-gain": float(np.ptp(result.gain_db)),
            "quantiser-neighbours-phase": float(np.ptp(result.phase_deg)),
            "quantiser-offsets": result.offset[0],
        },
        pictures=[
            Picture((20, 21, 23), "Example 4-2, errcrit 0.08: the triangle is averaged over periods 11 to 20.", _sweep),
            Picture((22,), "Example 4-2 at 15.407 Hz, amplitude 1, from period 11 on.", _beating),
        ],
    )


def _sweep() -> Figure:
    frequency = np.sort(np.append(np.linspace(15.30, 15.48, 19), CRITICAL[1]))
    with load("fmu:TwoRateQuantizer") as model:
        result = nfr(model, "u", "y", frequency, 1.0, errcrit=0.08, workers=HERE)
        from workbench.response.nfr.picture import plot_nfr  # noqa: PLC0415 - for this picture only

        return titled(plot_nfr(result, offset=True), "Figures 21 and 23: two quantisers around 15.407 Hz")


def _beating() -> Figure:
    period = 1.0 / CRITICAL[1]
    with load("fmu:TwoRateQuantizer") as model:
        sine = Sine(amplitude=1.0, frequency=CRITICAL[1])
        done = simulate(model, stop=20 * period, inputs={"u": sine}, outputs=["u", "y"], interval=period / 200)
    figure = titled(time_history(done), "Figure 22: two quantisers at 15.407 Hz, amplitude 1")
    figure.axes[-1].set_xlim(10 * period, 20 * period)
    return figure


EXPERIMENTS = (
    Reproduction(
        "first-order lag",
        ("lag-gain-default", "lag-phase-default", "lag-gain-fine", "lag-phase-fine", "lag-mean", "lag-carried"),
        _lag,
    ),
    Reproduction("settling rule", ("lag-rule-jump", "lag-rule-fine"), _lag_by_the_rule),
    Reproduction(
        "two quantisers",
        (
            "quantiser-averaged",
            "quantiser-periods",
            "quantiser-neighbours-gain",
            "quantiser-neighbours-phase",
            "quantiser-offsets",
        ),
        _quantisers,
    ),
)
