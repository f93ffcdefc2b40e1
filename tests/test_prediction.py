"""The refinement to the least prediction error: derivatives, coordinates, the Cramér-Rao bound, regions."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal

import workbench as wb
from tests.random_systems import random_plant
from workbench.cli.app import run
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.identified.recursion import march, march_one
from workbench.identification.prediction.innovations import Innovations, errors_of, jacobian, normal_equations
from workbench.identification.prediction.model_selection import SelectionOptions, _ModelSearch
from workbench.identification.prediction.refine import refine
from workbench.identification.prediction.start import _cut_off
from workbench.kernel.native_predictor import sensitivities

AR = 0.95
RESONANCE = ([0.0, 0.1, 0.05], [1.0, -1.6, 0.8])


def box_jenkins(seed: int = 0, *, shared: bool = False) -> Innovations:
    """Three plant states, two inputs and outputs; a disturbance of two states, or one that shares the plant's."""
    random = np.random.default_rng(seed)
    plant = random_plant(random, 3, 2, 2)
    d = 0 if shared else 2
    size = 3 + d
    A, B, C, K = np.zeros((size, size)), np.zeros((size, 2)), random.standard_normal((2, size)), np.zeros((size, 2))
    A[:3, :3], B[:3], C[:, :3] = plant.A, plant.B, plant.C
    if shared:
        K[:] = 0.05 * random.standard_normal((3, 2))
    else:
        A[3:, 3:] = np.diag([AR, 0.8])
        K[3:] = 0.1 * random.standard_normal((2, 2))
    return Innovations(
        A=A, B=B, C=C, D=plant.D, K=K, offset=np.array([0.1, -0.2]), x0=random.standard_normal(size), plant=3,
        shared=shared,
    )  # fmt: skip


def record(samples: int = 300) -> tuple[Floats, Floats]:
    random = np.random.default_rng(5)
    return random.standard_normal((samples, 2)), random.standard_normal((samples, 2))


def coloured(samples: int = 2000, *, seed: int = 1, size: float = 0.3) -> wb.Experiment:
    """A resonance of two states with an AR(1) disturbance at its output."""
    random = np.random.default_rng(seed)
    u = random.choice([-1.0, 1.0], samples)
    y = signal.lfilter(*RESONANCE, u)
    v = signal.lfilter([1.0], [1.0, -AR], random.standard_normal(samples + 200))[200:]
    return wb.make_experiment(0.1, u, y + size * y.std() * v / v.std(), input_names=["u"], output_names=["y"])


@pytest.mark.parametrize("shared", [False, True])
def test_errors_are_those_of_the_recursion_in_plain_python(shared: bool) -> None:
    model, (u, y) = box_jenkins(shared=shared), record()
    x, expected = model.x0, []
    for uk, yk in zip(u, y, strict=True):
        e = yk - model.C @ x - model.D @ uk - model.offset
        x = model.A @ x + model.B @ uk + model.K @ e
        expected.append(e)
    assert errors_of(model, (u, y)) == pytest.approx(np.array(expected), abs=1e-12)
    states, _ = march_one(
        u @ (model.B - model.K @ model.D).T + (y - model.offset) @ model.K.T, model.predictor, model.x0
    )
    assert errors_of(model, (u, y)) == pytest.approx(y - states @ model.C.T - u @ model.D.T - model.offset, abs=1e-10)


def test_the_kernels_sensitivities_are_those_of_the_march() -> None:
    model, (u, _) = box_jenkins(), record()
    p, n = model.C.shape
    found = sensitivities(model.predictor, model.C, u, np.zeros((p, 2, n)))
    driven = (model.C[None, :, None, :] * u[:, None, :, None]).reshape(len(u), p * 2, n)
    expected, _ = march(driven, model.predictor, np.zeros((p * 2, n)))
    assert found.reshape(len(u), p * 2, n) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("shared", [False, True])
def test_derivatives_are_exact(shared: bool) -> None:
    """Against central differences, whose own error is about 1e-9 of the values."""
    model, data = box_jenkins(shared=shared), record()
    entries = model.free()
    J = np.concatenate([part for part, _ in jacobian(model, data, entries, np.eye(len(entries)))])
    for k in range(len(entries)):
        step = 1e-6 * np.eye(len(entries))[k]
        change = errors_of(model.moved(entries, step), data) - errors_of(model.moved(entries, -step), data)
        assert -change / 2e-6 == pytest.approx(J[:, :, k], abs=1e-7 * (1.0 + np.abs(J[:, :, k]).max()))


def test_stretches_give_the_same_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    model, data = box_jenkins(), record(700)
    entries = model.free()
    whole = normal_equations(model, data, np.eye(2), entries, np.eye(len(entries)))
    monkeypatch.setattr("workbench.identification.prediction.innovations._BYTES", 1.0)  # 64 rows at a time
    parts = normal_equations(model, data, np.eye(2), entries, np.eye(len(entries)))
    assert parts[0] == pytest.approx(whole[0], rel=1e-10, abs=1e-8)
    assert parts[1] == pytest.approx(whole[1], rel=1e-9, abs=1e-8)


@pytest.mark.parametrize(("shared", "freedom"), [(False, 3 * 4 + 4 + 2 * 4 + 2 + 5), (True, 3 * 6 + 4 + 2 + 3)])
def test_local_coordinates_are_all_that_changes_the_model(shared: bool, freedom: int) -> None:
    """n (m + p) + p m for the plant and 2 d p for the disturbance, or n (2 p + m) + p m; offset and initial state."""
    model, data = box_jenkins(shared=shared), record()
    entries = model.free()
    Q = model.coordinates(entries)
    assert Q.shape == (len(entries), freedom)
    J = np.concatenate([part for part, _ in jacobian(model, data, entries, np.eye(len(entries)))]).reshape(
        -1, len(entries)
    )
    assert np.linalg.matrix_rank(J, tol=1e-8 * np.linalg.norm(J, 2)) == np.linalg.matrix_rank(J @ Q) == freedom
    # Another basis is the same model.
    assert errors_of(model.balanced(), data) == pytest.approx(errors_of(model, data), abs=1e-9)


def test_the_refined_model_reaches_the_cramer_rao_bound_under_coloured_noise() -> None:
    """Of the resonance with AR(1) noise the bound comes from the true model; errors over it average to one."""
    frequencies = np.linspace(0.05, 4.9, 40)
    z = np.exp(2j * np.pi * 0.1 * frequencies)
    true = np.polyval(RESONANCE[0], z) / np.polyval(RESONANCE[1], z)
    ratios, subspace = [], []
    for seed in range(8):
        data = coloured(1000, seed=seed)
        found = wb.identify(data, order=2)
        assert found.refinement.taken
        error = found.model.response(frequencies)[:, 0, 0] - true
        bound = np.trace(wb.model_spread(found.model, frequencies=frequencies).shape[:, 0, 0], axis1=-2, axis2=-1)
        bound = bound / 5.991  # χ² of two degrees of freedom at 95 %
        ratios.append(np.sum(np.abs(error) ** 2) / np.sum(bound))
        plain = wb.identify(data, order=2, refine="never").model.response(frequencies)[:, 0, 0] - true
        subspace.append(np.sum(np.abs(plain) ** 2) / np.sum(bound))
    assert np.sqrt(np.median(ratios)) < 1.3
    assert np.mean(ratios) < 2.0  # of 8, whose spread is about 0.4
    assert np.median(subspace) > 4.0 * np.median(ratios)


def test_regions_hold_poles_and_response_and_are_read_back(tmp_path: Path) -> None:
    found = wb.identify(coloured(), order=2)
    known = found.uncertainty
    assert known is not None
    pole = complex(np.roots(RESONANCE[1])[0])
    assert known.holds(pole, pole)
    assert known.determined == 2
    z = np.exp(2j * np.pi * 0.1 * known.frequency_hz)
    truth = np.asarray(np.polyval(RESONANCE[0], z) / np.polyval(RESONANCE[1], z), dtype=np.complex128)
    inside = known.holds_response(truth[:, None, None])
    assert np.mean(inside) > 0.5
    again = wb.IdentifyResult.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.uncertainty is not None
    assert again.uncertainty.shape == pytest.approx(known.shape)
    assert again.model.noise is not None
    assert again.model.noise.poles == pytest.approx([AR], abs=0.03)
    assert again.refinement.to_dict() == found.refinement.to_dict()
    known.plot(tmp_path / "known.png")
    assert (tmp_path / "known.png").stat().st_size > 10_000


def test_a_disturbance_with_the_plants_poles_is_told_from_one_with_its_own() -> None:
    """Noise at the input of the plant passes its poles."""
    random = np.random.default_rng(2)
    u, w = random.standard_normal((2, 2000))
    y = signal.lfilter(*RESONANCE, u + 0.5 * w) + 0.02 * random.standard_normal(2000)
    found = wb.identify(wb.make_experiment(0.1, u, y), order=2)
    assert found.refinement.shared
    assert found.model.noise is None
    assert found.model.poles == pytest.approx(np.roots(RESONANCE[1]), abs=0.02)


def test_what_is_free_of_noise_is_left_as_it_is() -> None:
    u = np.random.default_rng(0).standard_normal(500)
    data = wb.make_experiment(0.1, u, signal.lfilter(*RESONANCE, u))
    found = wb.identify(data)
    assert not found.refinement.taken
    assert "free of noise" in found.refinement.words
    with pytest.raises(InputError, match="free of noise: there is nothing to refine"):
        wb.identify(data, refine="always")


def test_a_stable_model_is_refined_to_a_stable_one() -> None:
    """The pole of an integrator, estimated with noise, lies outside as often as inside."""
    for seed in range(4):
        random = np.random.default_rng(seed)
        u = random.choice([-1.0, 1.0], 400)
        y = np.cumsum(u) + 2.0 * random.standard_normal(400)
        found = wb.identify(wb.make_experiment(0.1, u, y), order=1, stable=True, detrend="none")
        assert found.model.is_stable


def test_the_command_says_what_it_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    coloured().to_csv(tmp_path / "data.csv")
    command = ["identify", str(tmp_path / "data.csv"), "--input", "u", "--output", "y"]
    assert run([*command, "--noise", "1", "--json", str(tmp_path / "found.json")]) == 0
    told = capsys.readouterr().out
    assert "Box-Jenkins (disturbance of order 1 with poles of its own)" in told
    assert "95 % region" in told
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert found["order"] == 2
    assert found["refinement"]["taken"] is True
    assert found["noise_model"]["A"][0][0] == pytest.approx(AR, abs=0.03)
    assert run([*command, "--noise", "x"]) == 2
    assert "neither auto nor shared nor a number" in capsys.readouterr().err
    assert run([*command, "--noise", "1", "--refine", "never"]) == 2
    assert "refine=never rules out" in capsys.readouterr().err


def test_a_step_is_taken_only_where_it_is_better() -> None:
    model, data = box_jenkins(), record()
    found = refine(model, data)
    assert found is not None
    start = errors_of(model, data)
    assert found.cost < np.linalg.slogdet(start.T @ start / len(start))[1]
    assert found.settled
    again = refine(found.model, data)
    assert again is not None
    assert again.steps <= 2
    assert again.cost == pytest.approx(found.cost, abs=1e-5)


def test_regions_are_there_where_fewer_numbers_predict_as_well() -> None:
    """The subspace model's predictor has n p numbers more, which follow the noise of the fit."""
    for seed in range(6):
        random = np.random.default_rng(seed)
        u = random.standard_normal(2000)
        y = signal.lfilter([1.0, 0.2], [1.0, 0.4, -0.45], u)
        y = y + 0.1 * y.std() * random.standard_normal(2000)
        found = wb.identify(wb.make_experiment(1.0, u, y), order=2)
        assert found.refinement.taken
        assert found.uncertainty is not None


def test_an_integrator_has_regions_or_a_word_says_why_not() -> None:
    """Its first state and the output's offset are nearly the same, which says nothing about the poles."""
    known = 0
    for seed in range(6):
        random = np.random.default_rng(seed)
        u = random.standard_normal(1000)
        y = signal.lfilter([0.0, 1.0, -0.2], [1.0, -1.7, 0.7], u)
        found = wb.identify(wb.make_experiment(1.0, u, y + 0.03 * y.std() * random.standard_normal(1000)), order=2)
        if found.uncertainty is None:
            assert "no regions of poles and response" in found.refinement.reason
            continue
        known += 1
        lag = min(found.uncertainty.regions, key=lambda r: abs(r.pole - 0.7))
        assert lag.determined
        assert 0.002 < lag.half_axes[0] < 0.05
    assert known >= 3


@pytest.mark.parametrize("order", [0, 3])
def test_the_disturbance_has_the_order_that_is_asked_for(order: int) -> None:
    """An AR(1) disturbance: the criterion would choose 1."""
    found = wb.identify(coloured(500), order=2, noise=order, refine="always").refinement
    assert found.noise_order == order
    assert {c.noise_order for c in found.tried} == {order}


@pytest.mark.parametrize(("closed_loop", "first", "found"), [(True, 0, 2), (False, 3, 2), (False, 1, 2), (False, 5, 5)])
def test_the_search_for_an_order_goes_on_while_it_is_better(
    closed_loop: bool, first: int, found: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a closed loop from 0 and past one order that is worse; else from what the subspaces show."""
    wish = SelectionOptions(order=None, noise=None, most=5, feedthrough=False, stable=False, closed_loop=closed_loop)
    search: Any = _ModelSearch(record(100), (), wish)
    search._known = {n: SimpleNamespace(criterion=c) for n, c in enumerate([4.0, 5.0, 1.0, 2.0, 3.0, 0.0])}
    monkeypatch.setattr(search, "_first", lambda: first)
    assert search.run() is search._known[found]


def test_a_finite_impulse_response_is_cut_off_at_its_own_length_exactly() -> None:
    """h₁ … h₃ are held by three states, as many as the Hankel matrix has: A shifts them."""
    h = np.array([1.0, -0.5, 0.25])
    found = _cut_off(h[:, None, None], 3)
    assert found is not None
    A, B, C = found
    response = [(C @ np.linalg.matrix_power(A, k) @ B).item() for k in range(6)]
    np.testing.assert_allclose(response, [*h, 0.0, 0.0, 0.0], atol=1e-12)
    assert _cut_off(h[:, None, None], 4) is None
