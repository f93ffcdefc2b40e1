"""The identified model: what it says about itself, what it predicts, and its way to other forms."""

from __future__ import annotations

import json

import control
import numpy as np
import pytest
import scipy.linalg

from tests.random_systems import pole_error, random_plant
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.identified.recursion import march
from workbench.identification.subspace.estimate import estimate


def model_of(A: Floats, B: Floats, C: Floats, D: Floats, K: Floats | None = None, dt: float = 0.1) -> IdentifiedModel:
    (p, m), n = D.shape, len(A)
    return IdentifiedModel(
        A=A, B=B, C=C, D=D, K=np.zeros((n, p)) if K is None else K, x0=np.zeros(n), dt=dt, u0=np.zeros(m),
        y0=np.zeros(p), covariance=np.eye(p), input_names=tuple(f"in.{k}" for k in range(m)),
        output_names=tuple(f"out.{k}" for k in range(p)), input_units=(None,) * m, output_units=(None,) * p,
    )  # fmt: skip


def random_model(seed: int, order: int = 3, inputs: int = 2, outputs: int = 2) -> IdentifiedModel:
    rng = np.random.default_rng(seed)
    plant = random_plant(rng, order, inputs, outputs)
    return model_of(plant.A, plant.B, plant.C, plant.D, 0.1 * rng.standard_normal((order, outputs)))


def test_march_is_the_recursion() -> None:
    rng = np.random.default_rng(0)
    A, driven, start = 0.5 * rng.standard_normal((3, 3)), rng.standard_normal((53, 2, 3)), rng.standard_normal((2, 3))
    states, after = march(driven, A, start)
    state = start
    for k in range(53):
        assert np.allclose(states[k], state)
        state = state @ A + driven[k]
    assert np.allclose(after, state)


def test_simulation_and_prediction_follow_their_definitions() -> None:
    model = random_model(1).named(u0=np.array([1.0, -2.0]), y0=np.array([10.0, 20.0]))
    rng = np.random.default_rng(2)
    u, y, x = rng.standard_normal((40, 2)), rng.standard_normal((40, 2)), rng.standard_normal(3)
    du, state, seen = u - model.u0, x, x
    for k, (plain, one) in enumerate(zip(model.simulate(u, x), model.predict(u, y, x0=x), strict=True)):
        assert np.allclose(plain, model.y0 + model.C @ state + model.D @ du[k])
        output = model.y0 + model.C @ seen + model.D @ du[k]
        assert np.allclose(one, output)
        state = model.A @ state + model.B @ du[k]
        seen = model.A @ seen + model.B @ du[k] + model.K @ (y[k] - output)


def test_several_steps_ahead_lie_between_prediction_and_simulation() -> None:
    model = random_model(3)
    rng = np.random.default_rng(4)
    u, y, x = rng.standard_normal((30, 2)), rng.standard_normal((30, 2)), rng.standard_normal(3)
    assert np.allclose(model.predict(u, y, steps=31, x0=x), model.simulate(u, x))
    changed = y.copy()
    changed[20:] += 5.0
    same = model.predict(u, y, steps=4, x0=x) == model.predict(u, changed, steps=4, x0=x)
    assert np.all(same[:24])
    assert not np.any(same[24])


def test_initial_state_is_found() -> None:
    model = random_model(5)
    rng = np.random.default_rng(6)
    u, x = rng.standard_normal((60, 2)), rng.standard_normal(3)
    y = model.simulate(u, x)
    assert np.allclose(model.initial_state(u, y), x)
    assert np.allclose(model.initial_state(u, y, predicting=True), x)
    assert np.allclose(model.predict(u, y), y)


def test_numden_is_the_frequency_response() -> None:
    model = random_model(7, order=5)
    tf = model.numden()
    frequency = np.linspace(0.0, 5.0, 11)
    z = np.exp(2j * np.pi * frequency * model.dt)
    found = np.array([[np.polyval(n, z) for n in row] for row in tf.num]) / np.polyval(tf.den, z)
    assert np.allclose(np.moveaxis(found, -1, 0), model.response(frequency))
    assert pole_error(np.roots(tf.den), model.poles) < 1e-7


def test_zeros_of_a_single_channel_are_the_roots_of_the_numerator() -> None:
    model = random_model(8, order=4, inputs=1, outputs=1)
    assert pole_error(model.zeros, np.roots(model.numden().num[0, 0])) < 1e-7
    proper = model_of(model.A, model.B, model.C, np.zeros((1, 1)))
    assert proper.zeros.shape == (3,)
    assert random_model(8, order=4, inputs=1, outputs=3).zeros.shape == (0,)


def test_to_ss_has_names_without_dots() -> None:
    system = random_model(9).to_ss()
    assert isinstance(system, control.StateSpace)
    assert system.input_labels == ["in_0", "in_1"]
    assert system.dt == 0.1


def test_continuous_and_back() -> None:
    A = np.array([[-0.5, 2.0, 0.0], [-2.0, -0.5, 1.0], [0.0, 0.0, 0.0]])  # with an integrator
    B, C, D = np.array([[0.0], [1.0], [1.0]]), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 1))
    whole = scipy.linalg.expm(0.1 * np.block([[A, B], [np.zeros((1, 4))]]))
    found = model_of(whole[:3, :3], whole[:3, 3:], C, D).continuous()
    assert found.dt == 0.0
    assert np.allclose(found.A, A)
    assert np.allclose(found.B, B)
    with pytest.raises(InputError, match="continuous"):
        found.simulate(np.zeros((3, 1)))
    with pytest.raises(InputError, match="continuous already"):
        found.continuous()


@pytest.mark.parametrize(("pole", "message"), [(-0.5, "negative real axis"), (0.0, "pure delay")])
def test_poles_without_a_continuous_counterpart_are_refused(pole: float, message: str) -> None:
    one = np.ones((1, 1))
    with pytest.raises(InputError, match=message):
        model_of(np.array([[pole]]), one, one, one).continuous()


def test_a_delay_is_left_out_of_the_continuous_model_and_noted() -> None:
    rng = np.random.default_rng(10)
    u = rng.standard_normal((300, 1))
    late = np.vstack([np.zeros((2, 1)), u[:-2]])
    A = np.array([[np.exp(-0.3)]])
    plant = model_of(A, np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    found = estimate(u, plant.simulate(late), 0.1, order=1, feedthrough=False, delay=2).model
    continuous = found.continuous()
    assert continuous.poles == pytest.approx(np.array([-3.0]))
    assert any("delay of u1: 0.2 s" in n for n in continuous.notes)


def test_json_and_back() -> None:
    model = random_model(11).named(input_names=["a.b", "x[1]"], input_units=["deg", None], name="file.csv")
    back = IdentifiedModel.from_dict(json.loads(json.dumps(model.to_dict())))
    for name in ("A", "B", "C", "D", "K", "x0", "u0", "y0", "covariance"):
        assert np.array_equal(getattr(back, name), getattr(model, name))
    assert back.input_names == ("a.b", "x[1]")
    assert back.input_units == ("deg", None)
    assert (back.name, back.dt, back.delay) == ("file.csv", 0.1, ())
    json.dumps(estimate(*_record(), 0.1).to_dict(), allow_nan=False)


def _record() -> tuple[Floats, Floats]:
    rng = np.random.default_rng(12)
    u = rng.standard_normal((400, 2))
    y = random_model(12).simulate(u)
    return u, y + 0.05 * rng.standard_normal(y.shape)


def test_what_is_wrong_is_said() -> None:
    model = random_model(13)
    with pytest.raises(InputError, match=r"u must have shape \(N, 2\)"):
        model.simulate(np.zeros((4, 3)))
    with pytest.raises(InputError, match="u has 4 samples, y 5"):
        model.predict(np.zeros((4, 2)), np.zeros((5, 2)))
    with pytest.raises(InputError, match="steps"):
        model.predict(np.zeros((4, 2)), np.zeros((4, 2)), steps=0)
    with pytest.raises(InputError, match="input_names: 2 are needed"):
        model.named(input_names=["a"])
    with pytest.raises(InputError, match="is not an identified model: 'input_units' is missing"):
        IdentifiedModel.from_dict({"A": [[1.0]], "input_names": ["u"]})
