"""Derivatives by parameters of runs that share their steps, against complex steps of closed forms: events, samples."""

from __future__ import annotations

import cmath
import itertools
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.calibrate_truth import complex_step
from tests.test_turned import built_as
from workbench.core.values.arrays import Floats
from workbench.identification.calibrate.data import measured
from workbench.identification.calibrate.noise import ColouredNoise
from workbench.identification.calibrate.quantities import quantities_of
from workbench.identification.calibrate.request import Calibrate
from workbench.identification.calibrate.run import CalibrationWork, place_of
from workbench.jobs.job import Job

STAIRS = np.repeat(np.random.default_rng(7).uniform(-1.0, 1.0, 12), 10)


def gradient(model: wb.DescribedModel, data: wb.Experiment, values: dict[str, float]) -> tuple[Floats, Floats, bool]:
    """Return outputs and their derivatives by the parameters themselves, and whether steps were shared."""
    request = Calibrate(data, free=dict.fromkeys(values), in_process=True)
    with ExitStack() as stack:
        found = measured(model, [data], request)
        quantities = quantities_of(model, found, request)
        place = place_of(model, request, Job(), len(quantities), stack)
        noise = ColouredNoise(dict.fromkeys(data.output_names, 1.0), {n: np.zeros(0) for n in data.output_names})
        problem, _ = CalibrationWork(model, request, place).problem(found, quantities, noise)
        z = np.array([q.coordinate(values[q.name]) for q in quantities])
        (y,) = problem.runs.outputs([z])[0]
        (slope,) = problem.gradient(z, central=True).y
        assert y is not None
        return y[:, 0], slope[:, 0] / quantities.slopes(z), place.joint is not None


@pytest.mark.parametrize(
    ("model", "input_", "output", "dt", "size", "values"),
    [
        ("fmu:FirstOrderLag", "u", "y", 0.1, 1.0, {"tau": 0.6}),
        ("fmu:Duffing", "u", "y", 0.1, 2.0, {"damping": 0.12, "stiffness": 1.3, "cubic": 0.7}),
        ("fmu:LimitedActuator", "command", "deflection", 0.05, 0.3, {"rateLimit": 0.5, "timeConstant": 0.02}),
        ("fmu:Hysteresis", "u", "y", 0.05, 3.0, {"k": 2.4, "omegaC": 8.0, "halfWidth": 0.4}),
        (
            "fmu:ElevatorLaw", "side_stick", "elevator", 0.022, 0.9,
            {"positiveByFlap[1]": 6.0, "negativeByFlap[1]": 6.6, "offsetByFlap[1]": 2.5, "rateMax": 25.0},
        ),
    ],
)  # fmt: skip
def test_gradients_are_those_of_complex_steps(
    model: str, input_: str, output: str, dt: float, size: float, values: dict[str, float]
) -> None:
    """To 1e-6. The actuator switches without an event (`min`): what is integrated to ε has slopes to √ε."""
    u = size * STAIRS
    y, J = complex_step(model, u, dt, values)
    tolerance = 1e-12 if model == "fmu:LimitedActuator" else 1e-9
    with wb.load(model, tolerance=tolerance, start_values=values) as opened:
        data = wb.make_experiment(dt, u, y, input_names=[input_], output_names=[output])
        computed, found, shared = gradient(opened, data, values)
    assert shared
    np.testing.assert_allclose(computed, y, atol=1e-6 * np.max(np.abs(y)))
    for k in range(len(values)):
        assert np.linalg.norm(found[:, k] - J[:, k]) <= 1e-6 * np.linalg.norm(J[:, k])


BALL = """
model Bounce
  parameter Real e = 0.8;
  parameter Real g = 9.81;
  input Real u(start = 0);
  Real h(start = 1, fixed = true);
  Real v(start = 0, fixed = true);
  output Real y = h;
equation
  der(h) = v;
  der(v) = -g;
  when h <= 0 then
    reinit(v, -e*pre(v));
  end when;
end Bounce;
"""


def bounce(t: float, e: complex, g: complex) -> complex:
    """Height at a time: falls, and flights that last e times the one before."""
    hit, speed = cmath.sqrt(2.0 / g), cmath.sqrt(2.0 * g)
    if t < hit.real:
        return 1.0 - 0.5 * g * t**2
    for _ in itertools.count():
        speed *= e
        flight = 2.0 * speed / g
        if t < (hit + flight).real:
            return speed * (t - hit) - 0.5 * g * (t - hit) ** 2
        hit += flight
    raise AssertionError


def test_gradients_through_jumps_of_the_state(tmp_path: Path) -> None:
    t = 0.01 * np.arange(150)
    h = 1e-30
    y = np.array([bounce(x, 0.7, 9.5).real for x in t])
    J = np.array([[bounce(x, 0.7 + 1j * h, 9.5).imag / h, bounce(x, 0.7, 9.5 + 1j * h).imag / h] for x in t])
    with wb.load(built_as(2, "Bounce", BALL, tmp_path), tolerance=1e-10) as model:
        data = wb.make_experiment(0.01, 0.0 * t, y, input_names=["u"], output_names=["y"])
        computed, found, shared = gradient(model, data, {"e": 0.7, "g": 9.5})
    assert shared
    np.testing.assert_allclose(computed, y, atol=1e-8)
    assert np.all(np.linalg.norm(found - J, axis=0) <= 1e-6 * np.linalg.norm(J, axis=0))
