"""The rudder linearised, identified and measured: chapter 7 of the source report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scripts.reproduce.drawings import draw_steps, titled
from scripts.reproduce.identification import SEEDS, rudder
from scripts.reproduce.measurement import Measurement, Picture, Reproduction
from workbench.core.values.decibels import difference
from workbench.data.excite.request import excite
from workbench.data.excite.result import ExciteResult
from workbench.data.excite.signals import PrbsDesign
from workbench.data.experiment.experiment import make_experiment
from workbench.identification.identify.request import identify
from workbench.identification.identify.result import IdentifyResult
from workbench.identification.validate.overlay import Overlay, overlay
from workbench.jobs.options import Workers
from workbench.point.lin.request import lin
from workbench.point.lin.result import LinResult
from workbench.point.lin.step_check import StepCheck, step_check
from workbench.point.trim.request import trim
from workbench.point.trim.result import TrimResult
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult
from workbench.system.load import load

__all__ = ["EXPERIMENTS"]

HERE = Workers(in_process=True)
INPUT, OUTPUT = "delC", "del"
HEIGHT = 2.0  # of everything in this chapter [deg]
FLOATING = ["p1", "p2"]
WIDTHS = [3e7, 3e7, 1e-4, 0.01, 0.01, 0.01, 0.01, 0.01]  # total, of the states
LAG_STEP = 0.1  # [s], a tenth of the time constant of example 4-1
NOISE = 0.1  # added to its output, of which the largest is 1
WIDTH = 1.0  # of the command [deg]


@dataclass(frozen=True)
class _LinearRudder:
    """The rudder at its operating point.

    Attributes:
        rest: of the trim.
        published: linear model with the published widths.
        default: with our own.
        nearby: at rest without command, where identification and measurement take place.
        steps: from 2 to 4 degrees, with the published widths and with ours.
        measured: response to sines about rest.
    """

    rest: TrimResult
    published: LinResult
    default: LinResult
    nearby: LinResult
    steps: tuple[StepCheck, StepCheck]
    measured: NfrResult


def _linear(frequency: NDArray[np.float64]) -> _LinearRudder:
    with load("fmu:Rudder", "me", tolerance=1e-8) as model:
        rest = trim(model, fix={INPUT: HEIGHT}, floating=FLOATING)
        published = lin(model, at=rest.operating_point, inputs=[INPUT], outputs=[OUTPUT], dx=WIDTHS, du=WIDTH).result
        default = lin(model, at=rest.operating_point, inputs=[INPUT], outputs=[OUTPUT]).result
        nearby = lin(model, inputs=[INPUT], outputs=[OUTPUT]).result
        steps = tuple(
            step_check(model, m, input=INPUT, output=OUTPUT, height=HEIGHT, stop=1.0) for m in (published, default)
        )
        measured = nfr(model, INPUT, OUTPUT, frequency, HEIGHT, workers=HERE)
    return _LinearRudder(rest, published, default, nearby, (steps[0], steps[1]), measured)


def _worst(model: LinResult, measured: NfrResult) -> tuple[float, float]:
    """Return the largest differences in gain [dB] and phase [deg] between a linear model and what was measured."""
    gain, phase = difference(model.response(measured.frequency_hz)[:, 0, 0], measured.response[0])
    return float(np.max(np.abs(gain))), float(np.max(np.abs(phase)))


def _linearised() -> Measurement:
    done = _linear(np.array([0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0]))
    (gain, phase), (default_gain, default_phase) = (_worst(m, done.measured) for m in (done.published, done.default))
    return Measurement(
        {
            "rudder-trim-open": float(len(done.rest.null_directions)),
            "rudder-trim-deflection": done.rest.operating_point.y[OUTPUT] / HEIGHT,
            "rudder-lin-gain": gain,
            "rudder-lin-phase": phase,
            "rudder-default-gain": default_gain,
            "rudder-default-phase": default_phase,
            "rudder-step": done.steps[0].error,
            "rudder-step-default": done.steps[1].error,
        },
        {"rudder-trim-open": done.rest.message},
        [Picture((40,), "Step from 2 to 4 degrees, linear models at 2 degrees.", lambda: _draw_step(done))],
    )


def _draw_step(done: _LinearRudder) -> Figure:
    published, default = done.steps
    curves = [
        ("rudder", published.nonlinear),
        ("linear, published widths", published.linear),
        ("linear, default widths", default.linear),
    ]
    title = "Figure 40: step from 2 to 4 deg, rudder and linear models"
    return draw_steps(published.time, curves, title=title, ylabel=f"{OUTPUT} [deg]")


def _identified() -> Measurement:
    done = _linear(np.geomspace(0.5, 45.0, 25))
    data = [rudder(seed) for seed in SEEDS]
    found = [identify(d.identification, order=6, validation=d.validation, refine="never") for d in data]
    laid = [overlay(f.model, lin=done.nearby, nfr=done.measured) for f in found]
    near, far = ([o.difference().worst(limit) for o in laid] for limit in (30.0, 45.0))
    return Measurement(
        {
            "rudder-fit": [f.fit_percent for f in found],
            "rudder-identified-gain-30": [w[0] for w in near],
            "rudder-identified-phase-30": [w[1] for w in near],
            "rudder-identified-gain-45": [w[0] for w in far],
            "rudder-identified-phase-45": [w[1] for w in far],
        },
        pictures=_pictures(done, data[0], found[0], laid[0]),
    )


def _lag_identified() -> Measurement:
    """Identify a system whose answer is known in closed form, beside those of which it is not."""
    design = PrbsDesign(amplitude=1.0, seed=SEEDS[0])
    with load("fmu:FirstOrderLag", "me", tolerance=1e-10) as model:
        data = excite(model, ["u"], ["y"], signal=design, dt=LAG_STEP, samples=1000)
    found = identify(data.identification, order=1, validation=data.validation, refine="never")
    rng = np.random.default_rng(SEEDS[0])
    noisy = make_experiment(
        LAG_STEP, data.identification.u, data.identification.y + NOISE * rng.standard_normal((1000, 1))
    )
    pole, gain = float(found.model.poles[0].real), float(found.model.response(0.0).ravel()[0].real)
    return Measurement(
        {
            "lag-identified": [pole, gain],
            "lag-identified-fit": found.fit_percent,
            "lag-identified-order": float(identify(noisy, refine="never").order),
        }
    )


def _pictures(done: _LinearRudder, data: ExciteResult, found: IdentifyResult, laid: Overlay) -> list[Picture]:
    def steps() -> Figure:
        default = done.steps[1]
        curves = [
            ("rudder", default.nonlinear),
            ("lin", default.linear),
            ("identified", done.rest.operating_point.y[OUTPUT] + _step_of(found, default.time, data)),
        ]
        title = "Figure 43: step from 2 to 4 deg, rudder, linearised and identified"
        return draw_steps(default.time, curves, title=title, ylabel=f"{OUTPUT} [deg]")

    return [
        Picture(
            (41,), "Validation on other data.", lambda: titled(found.plot(), "Figure 41: rudder, validation output")
        ),
        Picture(
            (42,),
            "Linearised, identified and measured response, amplitude 2 degrees.",
            lambda: titled(laid.plot(), "Figure 42: rudder, Bode plots of the three methods"),
        ),
        Picture((43,), "Steps of 2 degrees by the three methods, from 2 degrees.", steps),
    ]


def _step_of(found: IdentifyResult, time: NDArray[np.float64], data: ExciteResult) -> NDArray[np.float64]:
    """Return the identified model's response to the step at given times, held between its samples."""
    dt = data.identification.dt
    count = int(np.ceil(time[-1] / dt)) + 1
    model = found.model
    state, values = np.zeros(model.order), []
    for _ in range(count):
        values.append(float((model.C @ state + HEIGHT * model.D[:, 0])[0]))
        state = model.A @ state + HEIGHT * model.B[:, 0]
    held = np.minimum((time / dt + 1e-9).astype(int), count - 1)
    outputs: NDArray[np.float64] = np.array(values, dtype=np.float64)[held]
    return outputs


EXPERIMENTS = (
    Reproduction("lag identified", ("lag-identified", "lag-identified-fit", "lag-identified-order"), _lag_identified),
    Reproduction(
        "rudder linearised",
        (
            "rudder-trim-open",
            "rudder-trim-deflection",
            "rudder-lin-gain",
            "rudder-lin-phase",
            "rudder-default-gain",
            "rudder-default-phase",
            "rudder-step",
            "rudder-step-default",
        ),
        _linearised,
    ),
    Reproduction(
        "rudder identified",
        (
            "rudder-fit",
            "rudder-identified-gain-30",
            "rudder-identified-phase-30",
            "rudder-identified-gain-45",
            "rudder-identified-phase-45",
        ),
        _identified,
        3.0,
    ),
)
