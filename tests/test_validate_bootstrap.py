"""Confidence regions of poles: they hold the true ones, shrink with the record, and say what is not determined."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.bootstrap_coverage import DT, bootstrap_of, cases, noisy_record, random_system
from tests.random_systems import random_plant
from workbench.core.values.arrays import Complex, Floats
from workbench.data.experiment.experiment import make_experiment
from workbench.errors import InputError
from workbench.identification.subspace.estimate import estimate
from workbench.identification.validate.bootstrap import PoleBootstrap, bootstrap_poles, match, match_clouds
from workbench.identification.validate.estimator import same_settings
from workbench.identification.validate.regions import PoleRegion, pole_regions
from workbench.identification.validate.validate import validate


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_regions_hold_the_true_poles(order: int) -> None:
    """A reduced, fixed version of `bootstrap_coverage.py`, which measures the rate."""
    found = list(cases(order, 4, replicates=40, samples=500))
    assert sum(b.holds_all(s.poles) for s, b in found) >= 3


def cloud(rng: np.random.Generator, centre: complex, spread: float, count: int = 400) -> Complex:
    return np.asarray(centre + spread * (rng.normal(size=count) + 1j * rng.normal(size=count)), dtype=np.complex128)


def test_a_region_of_a_normal_cloud_has_the_radius_of_its_quantile() -> None:
    rng = np.random.default_rng(0)
    above = cloud(rng, 0.5 + 0.5j, 0.01, 20_000)
    regions = pole_regions(
        np.array([0.5 + 0.5j, 0.5 - 0.5j]), np.column_stack([above, above.conj()]), confidence=0.95, joint=False
    )
    assert regions[0].half_axes == pytest.approx((0.01 * np.sqrt(-2.0 * np.log(0.05)),) * 2, rel=0.03)
    assert abs(regions[0].bias) < 1e-3
    assert np.abs(regions[0].outline() - (0.5 + 0.5j)) == pytest.approx(regions[0].half_axes[0], rel=0.03)
    # A pair moves together: for both at once the region need not be wider.
    both = pole_regions(
        np.array([0.5 + 0.5j, 0.5 - 0.5j]), np.column_stack([above, above.conj()]), confidence=0.95, joint=True
    )
    assert both[0].half_axes == pytest.approx(regions[0].half_axes)


def test_joint_regions_of_independent_poles_are_wider() -> None:
    rng = np.random.default_rng(1)
    poles = np.array([0.9 + 0j, 0.3 + 0j, -0.5 + 0j])
    replicates = np.column_stack([cloud(rng, p, 0.01, 5000).real for p in poles.real]).astype(np.complex128)
    for joint, level in ((False, 0.95), (True, 0.95 ** (1.0 / 3.0))):
        regions = pole_regions(poles, replicates, confidence=0.95, joint=joint)
        normal = np.sort(np.abs(rng.normal(size=200_000)))[int(level * 200_000)]
        assert [r.half_axes[0] for r in regions] == pytest.approx([0.01 * normal] * 3, rel=0.05)
        assert all(r.on_axis and r.half_axes[1] == 0.0 for r in regions)
        assert regions[0].contains(0.9 + 0.9 * 0.01 * normal)
        assert not regions[0].contains(0.9 + 0.01j)


def test_bias_widens_the_region_towards_the_other_side() -> None:
    replicates = cloud(np.random.default_rng(2), 0.72, 0.005).real.astype(np.complex128)[:, None]
    region = pole_regions(np.array([0.7 + 0j]), replicates, confidence=0.95, joint=True)[0]
    assert region.bias.real == pytest.approx(0.02, abs=0.001)
    assert region.contains(0.68)


def test_a_pole_found_anywhere_is_not_determined() -> None:
    rng = np.random.default_rng(3)
    anywhere = np.asarray(rng.uniform(-1.0, 1.0, 300), dtype=np.complex128)
    known = cloud(rng, 0.8, 0.001, 300).real.astype(np.complex128)
    regions = pole_regions(
        np.array([0.8 + 0j, -0.4 + 0j]), np.column_stack([known, anywhere]), confidence=0.95, joint=True
    )
    assert [r.determined for r in regions] == [True, False]
    assert regions[1].contains(0.99j)
    assert not regions[1].contains(3.0 + 0j)
    alone = pole_regions(np.array([0.8 + 0j]), known[:, None], confidence=0.95, joint=True)
    assert regions[0].half_axes[0] == pytest.approx(2.0 * alone[0].half_axes[0])


def test_matching_finds_the_permutation() -> None:
    poles = np.array([0.9, 0.5 + 0.3j, 0.5 - 0.3j, -0.2])
    rng = np.random.default_rng(4)
    for _ in range(20):
        moved = poles + 0.02 * rng.normal(size=4)
        assert match(poles, rng.permutation(moved)) == pytest.approx(moved)


def test_a_stray_pole_does_not_take_a_known_ones_place() -> None:
    """By distance alone the stray 0.78 would be called 0.8 and the 0.81 beside it the stray one."""
    rng = np.random.default_rng(5)
    known = 0.8 + 0.001 * rng.normal(size=50)
    stray = rng.uniform(-1.0, 0.9, size=50)
    found = match_clouds(np.array([0.8 + 0j, -0.1 + 0j]), np.column_stack([known, stray]).astype(np.complex128))
    assert np.max(np.abs(found[:, 0] - 0.8)) < 0.01


def of_order(order: int, *, seed: int = 3, samples: int = 600, relative: float = 0.1) -> PoleBootstrap:
    rng = np.random.default_rng(seed)
    return bootstrap_of(
        noisy_record(random_system(2, rng), rng, samples, relative=relative), order, replicates=40, seed=1
    )


def test_all_poles_are_held_where_each_has_a_region_of_its_own() -> None:
    disc = 0.01 * np.eye(2)
    regions = tuple(
        PoleRegion(pole=p, spread=0.1, bias=0j, shape=disc, on_axis=False, determined=True) for p in (0.5j, -0.5j)
    )
    found = replace(of_order(2), regions=regions)
    assert found.holds_all(np.array([-0.05 - 0.5j, 0.05 + 0.5j]))
    assert not found.holds_all(np.array([0.5j, 0.05 + 0.5j]))
    assert not found.holds_all(np.array([0.9, -0.9]))
    assert not found.holds_all(np.array([0.5j]))


def test_regions_shrink_with_noise_and_length() -> None:
    usual, quiet, long = of_order(2), of_order(2, relative=0.01), of_order(2, samples=5400)
    size = [max(r.half_axes[0] for r in b.regions) for b in (usual, quiet, long)]
    assert size[1] == pytest.approx(0.1 * size[0], rel=0.5)
    assert size[2] == pytest.approx(size[0] / 3.0, rel=0.5)


def test_an_order_too_high_is_told() -> None:
    found = of_order(4, samples=2000)
    assert found.determined < 4
    assert any("is more than these data determine" in line for line in found.words)
    assert any("not determined by the data" in line for line in found.words)


def test_the_same_seed_gives_the_same_and_another_nearly_the_same() -> None:
    one, again = of_order(2), of_order(2)
    np.testing.assert_array_equal(one.replicates, again.replicates)
    assert one.block == 8  # 600^(1/3)


def test_same_settings_repeat_the_estimate() -> None:
    rng = np.random.default_rng(6)
    data = noisy_record(random_system(3, rng), rng, 800)
    for method, biased, delay in (("n4sid", False, 0), ("cva", False, 0), ("moesp", True, 0), ("n4sid", False, 1)):
        found = estimate(data.u, data.y, DT, order=3, method=method, biased=biased, delay=delay)
        again = same_settings(found)(data.u, data.y)
        assert match(found.model.poles, again) == pytest.approx(found.model.poles, abs=1e-9)


def test_known_delays_are_no_poles_to_be_confident_of() -> None:
    rng = np.random.default_rng(7)
    data = noisy_record(random_system(1, rng), rng, 500)
    late = make_experiment(DT, data.u, np.vstack([np.zeros((2, 1)), data.y[:-2]]))
    found = estimate(late.u, late.y, DT, order=1, delay=2)
    result = bootstrap_poles(found.model, late, same_settings(found), replicates=40)
    assert len(result.regions) == 1
    assert result.regions[0].determined


def test_operating_points_do_not_matter() -> None:
    rng = np.random.default_rng(8)
    data = noisy_record(random_system(2, rng), rng, 500)
    found = estimate(data.u, data.y, DT, order=2)
    there = data.with_data(u=data.u + 5.0, y=data.y - 7.0)
    moved = found.model.named(u0=np.array([5.0]), y0=found.model.y0 - 7.0)
    here = bootstrap_poles(found.model, data, same_settings(found), replicates=40)
    np.testing.assert_allclose(
        bootstrap_poles(moved, there, same_settings(found), replicates=40).replicates, here.replicates, rtol=1e-6
    )


def test_wrong_settings_are_refused_in_one_line() -> None:
    rng = np.random.default_rng(9)
    data = noisy_record(random_system(1, rng), rng, 200)
    model = estimate(data.u, data.y, DT, order=1).model

    def two_poles(_u: Floats, _y: Floats) -> Complex:
        return np.array([0.5 + 0j, 0.1 + 0j])

    cases_: list[tuple[dict[str, object], str]] = [
        ({"replicates": 10}, "replicates: 10 are too few"),
        ({"block": 0}, "block: 0 is not between 1 and half of the 200 samples"),
        ({"confidence": 95.0}, "confidence must lie between 0 and 1"),
        ({}, "only 0 of 200 bootstrap replicates gave a model of order 1"),
    ]
    for options, words in cases_:
        with pytest.raises(InputError, match=words):
            bootstrap_poles(model, data, two_poles, **options)  # type: ignore[arg-type]


def test_through_json_csv_and_pictures(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    data = noisy_record(random_system(2, rng), rng, 600)
    found = estimate(data.u, data.y, DT, order=4, stable=True)
    model = found.model.named(input_names=data.input_names, output_names=data.output_names)
    result = bootstrap_poles(model, data, same_settings(found), replicates=40)
    saved = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert len(saved["regions"]) == 4
    assert saved["replicates"] == 40
    result.to_csv(tmp_path / "poles.csv")
    table = np.loadtxt(tmp_path / "poles.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, ::2] + 1j * table[:, 1::2], result.replicates)
    result.plot(tmp_path / "poles.png")
    checked = validate(model, data, bootstrap=result)
    assert checked.to_dict()["pole_confidence"] == result.to_dict()
    assert any("95 % region" in line for line in checked.words)
    checked.plot_poles(tmp_path / "zeros.png")


def test_the_errors_that_are_drawn_have_the_size_of_the_true_ones_not_of_those_of_a_fit() -> None:
    """A fit of k numbers to N samples leaves (N − k)/N of the variance; k = n (2 p + m) + p m = 19 here."""
    random = np.random.default_rng(5)
    plant = random_plant(random, 6, 1, 1)
    u = random.standard_normal((100, 1))
    y = plant.output(u) + 0.3 * random.standard_normal((100, 1))
    made = estimate(u, y, DT, order=6, stable=True).model
    model = replace(made, K=np.zeros_like(made.K))
    steady = model.simulate(u, model.initial_state(u, y))
    drawn: list[Floats] = []

    def keep(_: Floats, again: Floats) -> Complex:
        drawn.append(again - (steady - model.y0))
        return model.poles

    bootstrap_poles(model, make_experiment(DT, u, y), keep, replicates=300, block=1)
    rest = y - steady
    assert np.mean(np.square(drawn)) / np.var(rest) == pytest.approx(100.0 / (100.0 - 19.0), rel=0.03)
