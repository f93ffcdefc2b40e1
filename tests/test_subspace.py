"""Subspace identification: exact without noise, consistent with it, and clear about what it cannot do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.random_systems import Plant, pole_error, random_plant
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.subspace.estimate import estimate
from workbench.identification.subspace.order import _inflation
from workbench.identification.subspace.projections import METHODS

SECOND = Plant(
    np.array([[0.9, 0.3], [-0.3, 0.7]]), np.array([[1.0], [0.5]]), np.array([[1.0, -0.4]]), np.array([[0.2]])
)  # fmt: skip


def record(plant: Plant, samples: int, noise: float = 0.0, seed: int = 0) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, plant.B.shape[1]))
    y = plant.output(u, rng.standard_normal(len(plant.A)))
    return u, y + noise * y.std(axis=0) * rng.standard_normal(y.shape)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("order", [1, 2, 5, 8])
def test_random_systems_are_recovered_without_noise(method: str, order: int) -> None:
    for seed in range(3):
        rng = np.random.default_rng(100 * seed + order)
        plant = random_plant(rng, order, 1 + seed, 3 - seed)
        u, y = record(plant, 500, seed=seed)
        for found in (estimate(u, y, 0.1, order=order, method=method), estimate(u, y, 0.1, method=method)):
            assert found.order == order
            assert pole_error(found.model.poles, plant.poles) < 1e-6
            assert np.allclose(found.model.simulate(u, found.model.x0), y, atol=1e-7 * np.abs(y).max())
            assert np.allclose(found.model.D, plant.D, atol=1e-7)


@pytest.mark.parametrize("biased", [False, True])
@pytest.mark.parametrize(("method", "basis"), [("n4sid", "combined"), ("moesp", "combined"), ("cva", None)])
def test_every_basis_and_the_biased_variant_are_exact_without_noise(
    method: str, basis: str | None, *, biased: bool
) -> None:
    u, y = record(SECOND, 300)
    found = estimate(u, y, 0.1, order=2, method=method, basis=basis, biased=biased)
    assert found.basis == "combined"
    assert pole_error(found.model.poles, SECOND.poles) < 1e-9
    frequency = np.linspace(0.0, 5.0, 20)
    z = np.exp(2j * np.pi * 0.1 * frequency)
    true = [SECOND.C @ np.linalg.solve(p * np.eye(2) - SECOND.A, SECOND.B) + SECOND.D for p in z]
    assert np.allclose(found.model.response(frequency), true, atol=1e-8)


def test_moesp_with_the_combined_basis_is_cva() -> None:
    u, y = record(SECOND, 400, noise=0.1)
    one = estimate(u, y, 0.1, order=2, method="moesp", basis="combined", horizon=10)
    other = estimate(u, y, 0.1, order=2, method="cva", horizon=10)
    assert np.allclose(one.singular_values, other.singular_values)
    assert pole_error(one.model.poles, other.model.poles) < 1e-12


def test_units_do_not_matter() -> None:
    u, y = record(SECOND, 400, noise=0.1)
    plain = estimate(u, y, 0.1, order=2)
    scaled = estimate(1e-6 * u, 1e7 * y, 0.1, order=2)
    assert pole_error(plain.model.poles, scaled.model.poles) < 1e-9
    assert np.allclose(scaled.model.D, 1e13 * plain.model.D)
    assert np.allclose(scaled.model.covariance, 1e14 * plain.model.covariance)


def test_cosines_and_principal_angles_are_the_same_thing() -> None:
    u, y = record(SECOND, 400, noise=0.3)
    found = estimate(u, y, 0.1, order=2, method="cva", horizon=8)
    assert np.allclose(np.cos(np.radians(found.principal_angles_deg)), found.singular_values, atol=1e-12)
    assert np.all(np.diff(found.principal_angles_deg) >= 0.0)


def test_without_noise_the_angles_are_zero_to_rounding_and_no_further_ones_are_made_up() -> None:
    u, y = record(SECOND, 400)
    found = estimate(u, y, 0.1, method="cva")
    assert found.principal_angles_deg.shape == (2,)
    assert np.all(found.principal_angles_deg < 1e-9)
    assert "free of noise" in found.order_reason
    singular = estimate(u, y, 0.1, method="n4sid").singular_values
    assert singular[2] < 1e-12 * singular[1]


@pytest.mark.parametrize("method", METHODS)
def test_automatic_order_with_noise(method: str) -> None:
    for seed in range(3):
        u, y = record(SECOND, 1500, noise=0.1, seed=seed)
        found = estimate(u, y, 0.1, method=method)
        assert found.order == 2
        assert "order 1 would raise the error" in found.order_reason


def test_coloured_noise_is_not_taken_for_the_system() -> None:
    rng = np.random.default_rng(4)
    u, y = record(SECOND, 3000)
    drift = Plant(np.array([[0.9]]), np.eye(1), np.eye(1), np.zeros((1, 1))).output(rng.standard_normal((3000, 1)))
    found = estimate(u, y + 0.1 * y.std() * drift / drift.std(), 0.1, method="cva")
    assert found.order <= 3
    assert np.min(np.abs(found.model.poles[:, None] - SECOND.poles), axis=0).max() < 0.02


def test_the_error_falls_with_the_root_of_the_length() -> None:
    errors = []
    for samples in (500, 8000):
        single = [pole_error(estimate(*record(SECOND, samples, 0.2, s), 0.1, order=2).model.poles, SECOND.poles)
                  for s in range(8)]  # fmt: skip
        errors.append(np.sqrt(np.mean(np.square(single))))
    assert 2.0 < errors[0] / errors[1] < 8.0  # 4 expected


def test_gain_of_the_innovation_form() -> None:
    rng = np.random.default_rng(5)
    samples, K = 20_000, np.array([[0.4], [-0.2]])
    u, e = rng.standard_normal((samples, 1)), 0.5 * rng.standard_normal((samples, 1))
    both = Plant(SECOND.A, np.hstack([SECOND.B, K]), SECOND.C, np.hstack([SECOND.D, np.eye(1)]))
    y = both.output(np.hstack([u, e]))
    model = estimate(u, y, 0.1, order=2, method="cva").model
    true = np.linalg.eigvals(SECOND.A - K @ SECOND.C).astype(np.complex128)
    assert pole_error(np.linalg.eigvals(model.A - model.K @ model.C).astype(np.complex128), true) < 0.05
    assert model.covariance[0, 0] == pytest.approx(0.25, rel=0.03)
    left = y - model.predict(u, y)
    assert left.std() == pytest.approx(0.5, rel=0.02)


def test_an_unstable_system_and_a_stable_model_of_it_on_request() -> None:
    plant = Plant(np.array([[1.02, 0.0], [0.0, 0.5]]), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))
    u, y = record(plant, 300)
    found = estimate(u, y, 0.1, order=2)
    assert pole_error(found.model.poles, plant.poles) < 1e-6
    assert any("not stable" in n for n in found.notes)
    tamed = estimate(u, y, 0.1, order=2, stable=True)
    assert tamed.stabilised == 1
    assert tamed.model.is_stable
    assert np.max(np.abs(tamed.model.poles)) == pytest.approx(1.0 / 1.02)


def test_no_feedthrough_and_a_delay() -> None:
    plant = Plant(SECOND.A, SECOND.B, SECOND.C, np.zeros((1, 1)))
    u, y = record(plant, 400)
    assert not estimate(u, y, 0.1, order=2, feedthrough=False).model.D.any()
    late = np.vstack([np.zeros((3, 1)), u[:-3]])
    found = estimate(u, plant.output(late), 0.1, order=2, feedthrough=False, delay=3)
    assert found.order == 2
    assert found.model.order == 5
    assert np.allclose(found.model.simulate(u, found.model.x0), plant.output(late), atol=1e-8)
    assert pole_error(found.model.undelayed().poles, plant.poles) < 1e-9


def test_delays_differ_by_input() -> None:
    plant = random_plant(np.random.default_rng(3), 3, 2, 2)
    u, _ = record(plant, 500)
    late = np.stack([u[:, 0], np.append(np.zeros(2), u[:-2, 1])], axis=1)
    found = estimate(u, plant.output(late), 0.1, order=3, delay=(0, 2))
    assert np.allclose(found.model.simulate(u, found.model.x0), plant.output(late), atol=1e-7)
    assert np.allclose(found.model.undelayed().D, plant.D, atol=1e-8)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_gain_is_order_zero(noise: float) -> None:
    rng = np.random.default_rng(6)
    u = rng.standard_normal((300, 2))
    gain = np.array([[1.0, -2.0], [0.5, 3.0]])
    model = estimate(u, u @ gain.T + noise * rng.standard_normal((300, 2)), 0.1, order=0).model
    assert model.order == 0
    assert np.allclose(model.D, gain, atol=1e-9 + 0.3 * noise)
    assert model.poles.shape == model.zeros.shape == (0,)
    assert np.allclose(model.predict(u, u @ gain.T), u @ model.D.T + model.y0)
    assert np.allclose(model.response(np.array([1.0]))[0], model.D)


def test_a_poor_input_shortens_the_horizon_and_a_sine_is_refused() -> None:
    k = np.arange(600.0)
    lines = sum(np.sin(2 * np.pi * f * k + f) for f in (0.03, 0.07, 0.11, 0.17, 0.23, 0.31))
    assert isinstance(lines, np.ndarray)
    u = lines[:, None]
    found = estimate(u, SECOND.output(u), 0.1, order=2)
    assert any("excite 12 orders" in n for n in found.notes)
    assert pole_error(found.model.poles, SECOND.poles) < 1e-6
    sine = np.sin(0.3 * k)[:, None]
    with pytest.raises(InputError, match="excite 2 orders only"):
        estimate(sine, SECOND.output(sine), 0.1, order=3)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"method": "n4sdi"}, "did you mean n4sid"),
    ({"basis": "combind"}, "did you mean combined"),
    ({"method": "cva", "basis": "unscaled"}, "use moesp"),
    ({"order": "best"}, "neither a number nor 'auto'"),
    ({"order": -1}, "0 .a gain. or more"),
    ({"order": 60}, "too high: 200 samples"),
    ({"order": 5, "horizon": 4}, "too high: a horizon of 4"),
    ({"order": 4, "horizon": 4}, "a horizon of 4 with 1 output.s. allows 3"),
    ({"horizon": 1}, "horizon must be 2"),
    ({"horizon": 80}, "too few samples: 200"),
    ({"order": 3}, "the data determine only 2"),
    ({"delay": -1}, "negative"),
    ({"delay": (1, 2)}, "one for each of the 1 inputs"),
    ({"delay": 200}, "as long as the record"),
    ({"dt": 0.0}, "dt must be positive"),
    ({"max_order": 0}, "max_order"),
]


@pytest.mark.parametrize(("options", "message"), BAD)
def test_what_cannot_be_done_is_said_in_one_line(options: dict[str, Any], message: str) -> None:
    u, y = record(SECOND, 200)
    dt = options.pop("dt", 0.1)
    with pytest.raises(InputError, match=message) as caught:
        estimate(u, y, dt, **options)
    assert "\n" not in str(caught.value)


def test_bad_data_are_named() -> None:
    u, y = record(SECOND, 200)
    with pytest.raises(InputError, match="u has 200 samples, y 199"):
        estimate(u, y[:-1], 0.1)
    hole = y.copy()
    hole[17] = np.nan
    with pytest.raises(InputError, match="y: column 1 holds nan at sample 17"):
        estimate(u, hole, 0.1)
    with pytest.raises(InputError, match="u: column 1 is always zero"):
        estimate(0.0 * u, y, 0.1)
    with pytest.raises(InputError, match="too few samples"):
        estimate(u[:5], y[:5], 0.1)
    assert any("operating point" in n for n in estimate(u, y + 100.0, 0.1, order=2).notes)


def test_of_two_outputs_the_slower_error_tells_how_much_less_information_there_is() -> None:
    """Σ ρ² of white noise is 1, of a first order process with the pole a it is (1 + a²)/(1 − a²)."""
    e = np.random.default_rng(0).normal(size=(20_000, 2))
    e[:, 1] = lfilter([1.0], [1.0, -0.9], e[:, 1])
    assert _inflation(e[:, :1]) == pytest.approx(1.0, abs=0.1)
    assert _inflation(e) == pytest.approx(1.81 / 0.19, rel=0.15)
