"""The aircraft of chapter 8, its damper, comfort control and actuator: published figures, closed forms, on the FMUs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

import workbench as wb
from scripts.aircraft.data import POINTS
from scripts.aircraft.problem import prior_aircraft
from scripts.reproduce.targets import read_targets
from tests.random_systems import pole_error
from workbench.core.values.arrays import Floats
from workbench.model import Model

SURFACES = ("elevator", "inner_aileron", "outer_aileron")
MOVED = {"elevator": 0.3, "inner_aileron": -0.2, "outer_aileron": 0.1, "outer_aileron_moment": 50.0, "gust": 5.0}


@pytest.fixture(scope="module")
def aircraft() -> Iterator[Model]:
    with wb.load("fmu:Aircraft") as model:
        yield model


@pytest.fixture(scope="module")
def failed() -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """A, the columns of moment and of the sound aileron, the rows of its position and rate."""
    inputs = ["outer_aileron_moment", "inner_aileron"]
    outputs = ["outer_aileron_position", "outer_aileron_rate"]
    with wb.load("fmu:Aircraft", start_values={"outer_aileron_failed": True}) as model:
        linear = wb.lin(model, inputs=inputs, outputs=outputs)
    A, B, C = (np.asarray(m) for m in (linear.A, linear.B, linear.C))
    return A, B[:, 1], B[:, 0], C[0], C[1]


# -- the model -------------------------------------------------------------------------------------


def test_names_and_units(aircraft: Model) -> None:
    assert [v.name for v in aircraft.inputs] == list(MOVED)
    wanted = [f"{name}{suffix}" for suffix in ("", "_rate", "_acceleration") for name in POINTS]
    wanted += [f"{name}_{kind}" for kind in ("position", "rate") for name in SURFACES]
    assert [v.name for v in aircraft.outputs] == wanted
    units = {v.name: v.unit for v in aircraft.outputs}
    assert units["z_wing_tip_acceleration"] == "m/s2"
    assert units["theta_center_of_gravity_rate"] == "rad/s"
    assert units["outer_aileron_position"] == "rad"


def test_71_states_at_rest_without_inputs(aircraft: Model) -> None:
    model = wb.lin(aircraft, inputs=list(MOVED))
    assert model.A.shape == (71, 71)
    assert np.linalg.eigvals(model.A).real.max() < 0.0  # with its actuators the aircraft is stable
    result = wb.simulate(aircraft, stop=1.0, outputs=["z_wing_tip"])
    assert not result.signals["z_wing_tip"].any()


def test_rates_and_accelerations_are_the_derivatives_of_the_positions(aircraft: Model) -> None:
    model = wb.lin(aircraft, inputs=list(MOVED), outputs=[v.name for v in aircraft.outputs])
    A, B, C, D = (np.asarray(m) for m in (model.A, model.B, model.C, model.D))
    for first, second in pairwise((slice(0, 11), slice(11, 22), slice(22, 33))):
        assert np.allclose(C[first] @ A, C[second], rtol=1e-9, atol=1e-9 * abs(C[second]).max())
        assert np.allclose(C[first] @ B, D[second], rtol=1e-9, atol=1e-9 * abs(D[second]).max(initial=1e-12))


def test_aerodynamics_scale_with_pressure_and_speed() -> None:
    matrices = {}
    for airspeed, density in ((250.0, 0.41), (250.0, 0.82), (500.0 / 3.0, 0.41), (250.0, 1e-3)):
        values: dict[str, float] = {"airspeed": airspeed, "air_density": density}
        with wb.load("fmu:Aircraft", start_values=values) as model:
            matrices[airspeed, density] = np.asarray(wb.lin(model, inputs=["elevator"]).A)
    base, dense, slow, thin = matrices.values()
    rates, positions, late = slice(33, 66), slice(0, 33), slice(66, 71)
    share = (0.82 - 0.41) / (0.41 - 1e-3)
    for columns in (positions, rates, late):  # forces are linear in the density
        assert np.allclose(
            dense[rates, columns] - base[rates, columns], share * (base - thin)[rates, columns], atol=1e-7
        )
    assert np.allclose(slow[late, late], base[late, late] * (2.0 / 3.0))  # lags go with the speed
    assert np.allclose(slow[late, rates], base[late, rates])
    damping = (base - thin)[rates, rates]  # and damping with pressure over speed
    thin_slow = base[rates, rates] - slow[rates, rates]
    assert np.allclose(thin_slow, damping * (0.41 / (0.41 - 1e-3)) / 3.0, atol=1e-7)


def test_a_gust_is_what_sinking_is_but_for_the_slow_return_of_height(aircraft: Model) -> None:
    """Rising with the air gives no force of the air; what is left is the damper of 2 · 1.5 · 2π · 0.08 Hz on heave."""
    heave, rates, late = 34, slice(33, 66), slice(66, 71)
    craft = prior_aircraft()[1]  # masses and shapes are not fitted
    shape = craft.shape[POINTS.index("z_center_of_gravity"), 1]
    model = wb.lin(aircraft, inputs=["gust"])
    rising = np.asarray(model.A)[:, heave] / shape
    left = rising + np.asarray(model.B)[:, 0]
    wanted = np.zeros(33)
    wanted[1] = -2.0 * 1.5 * 2.0 * math.pi * 0.08 / shape
    assert np.allclose(craft.mass() @ left[rates], wanted, atol=1e-6 * abs(wanted[1]))
    assert abs(left[late]).max() < 1e-6 * abs(rising[late]).max()
    assert abs(craft.mass() @ rising[rates] - wanted).max() > 0.1 * abs(wanted[1])  # the air's share is not small


def test_failure_frees_the_outer_aileron_only(failed: tuple[Floats, ...], aircraft: Model) -> None:
    nominal = wb.lin(aircraft, inputs=["outer_aileron_moment"])
    change = np.asarray(nominal.A) - failed[0]
    assert not np.delete(change, [32, 65], axis=1).any()
    assert np.linalg.matrix_rank(change) == 1
    with wb.load("fmu:Aircraft", start_values={"outer_aileron_failed": True}) as model:
        linear = wb.lin(model, inputs=["outer_aileron"])
    assert not np.asarray(linear.B).any()


def test_equivalent_damper_of_a_crossing_leaves_an_undamped_pole(failed: tuple[Floats, ...]) -> None:
    A, _, moment, _, rate = failed
    published = read_targets()["nyquist-frequencies"].value
    assert isinstance(published, list)
    for hertz in published:
        damper = -1.0 / (rate @ np.linalg.solve(2j * math.pi * hertz * np.eye(len(A)) - A, moment)).real
        values = np.linalg.eigvals(A - damper * np.outer(moment, rate))
        assert min(abs(values - 2j * math.pi * hertz)) < 0.01


# -- the small models ------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [-0.3, 0.0, 0.2])
def test_damper_is_quadratic_and_odd(rate: float) -> None:
    with wb.load("fmu:AileronDamper") as damper:
        result = wb.simulate(damper, stop=0.1, inputs={"rate": wb.Constant(rate)})
    assert result.signals["moment"][-1] == pytest.approx(7000.0 * rate * abs(rate))


def test_comfort_control_is_a_low_pass_of_second_order() -> None:
    with wb.load("fmu:ComfortControl") as control:
        model = wb.lin(control)
    omega = 2.0 * math.pi * 2.0
    assert np.asarray(model.D).item() == 0.0  # no algebraic loop through the acceleration
    assert pole_error(np.linalg.eigvals(model.A), np.roots([1.0, 1.4 * omega, omega**2])) < 1e-9 * omega
    assert (-model.C @ np.linalg.solve(model.A, model.B)).item() == pytest.approx(-4e-4)


def test_actuator_keeps_deflection_and_rate() -> None:
    with wb.load("fmu:LimitedActuator") as actuator:
        result = wb.simulate(actuator, stop=2.0, inputs={"command": wb.Constant(1.0)}, interval=0.01)
    deflection = result.signals["deflection"]
    assert deflection.max() == pytest.approx(math.radians(25.0), rel=1e-4)
    ramp = (result.time > 0.1) & (result.time < 0.5)
    assert np.gradient(deflection, result.time)[ramp] == pytest.approx(math.radians(40.0), rel=1e-4)
