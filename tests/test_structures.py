"""Wiener, Hammerstein and Hammerstein–Wiener models: known systems, their errors, wrong data, the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

import workbench as wb
from workbench.cli.app import run
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.identification.prediction.start import plant_alone
from workbench.identification.structures.page import structure_page
from workbench.identification.structures.refine import PiecewiseLinearBlock, WienerHammersteinModel, line_of
from workbench.identification.structures.request import IdentifyCommand, IdentifyStructure
from workbench.identification.structures.run import _Scaled, _StructureSearch
from workbench.identification.structures.start import placed, rescaled
from workbench.identification.structures.table import StaticTable, free_directions, knots_for, weights

B, A = [0.0, 0.1, 0.05], [1.0, -1.6, 0.8]
POLE = 0.8 + 0.4j
F = np.linspace(0.003, 0.45, 30)


def block(f: Floats) -> Floats:
    z = np.exp(2j * np.pi * f)
    return np.asarray(np.polyval(B, z) / np.polyval(A, z))


def clipped(u: Floats) -> Floats:
    return np.clip(u, -0.8, 1.2)


def bent(x: Floats) -> Floats:
    return np.asarray(np.tanh(x) + 0.2 * x**2)


def recorded(kind: str, seed: int, *, samples: int = 2000, noise: float = 0.1, about: float = 0.0) -> wb.Experiment:
    """A record with AR(1) noise at the output, which is `about` off zero, as the input is."""
    random = np.random.default_rng(seed)
    u = random.normal(size=samples)
    v = u if kind == "wiener" else clipped(u)
    x = signal.lfilter(B, A, v)
    y = x if kind == "hammerstein" else bent(x)
    e = signal.lfilter([1.0], [1.0, -0.9], random.normal(size=samples)) * np.sqrt(1.0 - 0.81)
    return wb.make_experiment(
        0.1, u + about, y + noise * y.std() * e + about, input_names=["u"], output_names=["y"], name=f"{kind}.csv"
    )


@pytest.mark.parametrize("kind", ["hammerstein", "wiener", "hammerstein-wiener"])
def test_known_systems_are_followed_to_their_noise(kind: str) -> None:
    """Noise of 10 % leaves a fit of 90 % to what has it in; the linear model cannot."""
    found = wb.identify_structure(
        recorded(kind, 0, about=3.0), structure=kind, order=2, feedthrough=False, knots=12,
        validation=recorded(kind, 1, about=3.0),
    )  # fmt: skip
    assert found.fit_percent > 88.0
    assert found.linear_fit_percent < 80.0
    assert found.pays
    assert min(abs(found.linear.poles - POLE)) < 0.01
    assert (found.before is None, found.behind is None) == (kind == "wiener", kind == "hammerstein")


def test_without_noise_a_system_that_the_model_can_be_is_followed_exactly() -> None:
    """Its block is straight between the model's knots, and neither its input nor its output has the mean 0."""
    u = np.random.default_rng(5).normal(size=600)
    knots = u.mean() + u.std() * knots_for((u - u.mean()) / u.std(), 6)
    v = weights(u, knots) @ np.array([-0.8, -0.7, -0.4, 0.5, 1.1, 1.2])
    found = wb.identify_structure(
        wb.make_experiment(1.0, u + 3.0, signal.lfilter(B, A, v) + 5.0),
        structure="hammerstein", order=2, feedthrough=False, knots=6,
    )  # fmt: skip
    assert found.fit_percent > 99.99
    assert found.linear.poles == pytest.approx(np.array([POLE, POLE.conjugate()]), abs=1e-4)


def test_errors_of_a_hammerstein_model_hold_the_truth() -> None:
    """The block is straight between the knots that the estimate has, so that noise is all that errs."""
    inside, poles, response = [], [], []
    for seed in range(10):
        random = np.random.default_rng(seed)
        u = random.normal(size=1200)
        knots = u.mean() + u.std() * knots_for((u - u.mean()) / u.std(), 6)
        values = np.array([-0.8, -0.7, -0.4, 0.5, 1.1, 1.2])
        v = weights(u, knots) @ values
        y = signal.lfilter(B, A, v)
        y += 0.2 * y.std() * signal.lfilter([1.0], [1.0, -0.9], random.normal(size=len(u))) * np.sqrt(1.0 - 0.81)
        found = wb.identify_structure(
            wb.make_experiment(1.0, u, y), structure="hammerstein", order=2, feedthrough=False, knots=6
        )
        assert found.before is not None
        mean, slope = (w @ values for w in line_of(u, knots))
        true = (values - mean) / slope + u.mean()
        inside.append(np.abs(found.before.y - true) <= 1.96 * found.before.spread)
        spread = wb.model_spread(found.linear, frequencies=F)
        poles.append(min(spread.regions, key=lambda r: abs(r.pole - POLE)).contains(POLE))
        response.append(spread.holds_response((slope * block(F))[:, None, None]).mean())
    # Of 60 values, which go together within a record; two poles of ten outside have a chance of 9 %, three of 1 %.
    assert 0.85 <= np.mean(inside) <= 1.0
    assert np.mean(poles) >= 0.8
    assert np.mean(response) >= 0.8


def test_a_wiener_model_has_the_block_within_its_errors() -> None:
    """The scale is such that the regression of the block has slope 1, at the same weights for the true one."""
    data = recorded("wiener", 3, samples=3000)
    found = wb.identify_structure(data, structure="wiener", order=2, feedthrough=False, knots=14)
    assert found.behind is not None
    u = data.u[:, 0]
    x = found.linear.simulate(data.u, found.linear.x0)[:, 0]
    assert line_of(x, found.behind.x)[1] @ found.behind.y == pytest.approx(1.0, abs=1e-3)
    scale, level = np.polyfit(signal.lfilter(B, A, u), x, 1)
    true = bent((found.behind.x - level) / scale)
    assert np.mean(np.abs(found.behind.y - true) <= 2.0 * found.behind.error) >= 0.9


def test_the_gain_of_a_static_block_is_that_of_the_linear_approximation() -> None:
    data = recorded("hammerstein", 0, noise=0.01)
    found = wb.identify_structure(data, structure="hammerstein", order=2, knots=10)
    assert found.before is not None
    mean, slope = (w @ found.before.y for w in line_of(data.u[:, 0], found.before.x))
    assert mean == pytest.approx(data.u.mean(), abs=1e-9)
    assert slope == pytest.approx(1.0, abs=1e-9)


def test_a_linear_system_is_told_to_need_no_block() -> None:
    random = np.random.default_rng(0)
    u = random.normal(size=1000)
    y = signal.lfilter(B, A, u) + 0.02 * random.normal(size=1000)
    found = wb.identify_structure(wb.make_experiment(0.1, u, y), structure="hammerstein", order=2)
    assert not found.pays
    assert any("show no static block" in note for note in found.notes)


@pytest.mark.parametrize("kind", ["hammerstein", "wiener"])
def test_the_order_is_found_with_the_blocks(kind: str) -> None:
    found = wb.identify_structure(recorded(kind, 3, samples=1000), structure=kind)
    assert found.order == 2
    assert {t.order for t in found.tried if t.knots} >= {1, 2, 3, 4}


def test_without_noise_no_states_are_added_for_the_corners_of_the_block() -> None:
    random = np.random.default_rng(5)
    t = 0.05 * np.arange(1500)
    phases = random.uniform(0.0, 2.0 * np.pi, 40)
    u = sum(np.cos(2.0 * np.pi * k * t / 75.0 + p) for k, p in enumerate(phases, 4)) / 4.0
    slow = signal.cont2discrete(([0.21], [1.0, 0.51, 0.21]), 0.05)
    y = np.clip(signal.lfilter(np.ravel(slow[0]), slow[1], u), -0.4, 0.4)
    found = wb.identify_structure(wb.make_experiment(0.05, u, y), structure="wiener")
    assert found.order == 2
    assert found.fit_percent > 99.0
    assert np.abs(found.linear.poles[0]) == pytest.approx(np.abs(np.roots(slow[1])[0]), abs=2e-3)


def test_blocks_that_follow_worse_than_the_linear_model_alone_are_of_no_use() -> None:
    data = recorded("hammerstein", 0, samples=400)
    found = wb.identify_structure(data, structure="hammerstein", order=2, knots=6)
    assert found.pays
    assert not found.failed
    worse = replace(found, linear_fit_percent=found.fit_percent + 1.0)
    assert not worse.pays
    assert "the linear model alone follows better" in worse.failed["y"]
    assert not IdentifyCommand(structure="hammerstein").went_well(worse)
    assert [v.word for v in structure_page(worse).summary] == ["failed"]


def test_delays_and_units_stay() -> None:
    random = np.random.default_rng(0)
    u = random.normal(size=1500)
    y = 100.0 * np.append(np.zeros(3), signal.lfilter(B, A, clipped(u))[:-3]) + 0.1 * random.normal(size=1500)
    data = wb.make_experiment(0.1, u, y, input_units=["V"], output_units=["mm"])
    found = wb.identify_structure(data, structure="hammerstein", order=2, delay=3, knots=12)
    assert found.linear.delay == (3,)
    assert found.order == 2
    assert found.fit_percent > 95.0
    assert found.simulate(u)[60:] == pytest.approx(found.simulated[60:], abs=0.1)  # begins at rest
    assert found.linear.units == {"u": "V", "y": "mm"}


def test_tables() -> None:
    table = StaticTable(x=np.array([0.0, 1.0, 3.0]), y=np.array([0.0, 2.0, 2.0]), spread=np.zeros(3))
    assert table(np.array([-1.0, 0.5, 2.0, 4.0])) == pytest.approx([-2.0, 1.0, 2.0, 2.0])
    assert table.bend == pytest.approx(np.full(3, 2.0 * 1.5 / 12.0))
    assert knots_for(np.array([1.0, 2.0, 1.0, 4.0]), 5).tolist() == [1.0, 2.0, 4.0]
    u = np.linspace(-1.0, 2.0, 50)
    knots = knots_for(u, 5)
    mean, slope = line_of(u, knots)
    free = free_directions(mean, slope)
    assert mean @ knots == pytest.approx(u.mean())
    assert slope @ knots == pytest.approx(1.0)
    assert np.abs(np.array([mean, slope]) @ free).max() < 1e-12


def test_knots_reach_over_the_whole_range_of_a_signal() -> None:
    """Also where its levels are not evenly spaced."""
    u = np.array([0.0, 0.1, 0.4, 0.5, 2.0, 7.0])
    assert knots_for(u, 3)[[0, -1]] == pytest.approx([0.0, 7.0])


def test_a_linear_block_is_the_linear_model_by_the_sizes_of_input_and_output() -> None:
    u = np.random.default_rng(2).normal(size=300)
    data = wb.make_experiment(1.0, 4.0 * u, signal.lfilter([2.0, 1.0], [1.0, -0.5], 4.0 * u))
    model = wb.identify(data, order=1, feedthrough=True).model
    found = _StructureSearch(
        _Scaled.of(data, 0), model, IdentifyStructure(structure="wiener", order=1, feedthrough=True)
    ).linear
    z = np.exp(2j * np.pi * 0.1)
    response = (found.C @ found.B)[0, 0] / (z - found.A[0, 0]) + found.D[0, 0]
    assert response == pytest.approx((2.0 * z + 1.0) / (z - 0.5) * data.u.std() / data.y.std(), rel=1e-6)


def test_the_state_at_the_first_sample_is_found_behind_a_static_block() -> None:
    data = recorded("wiener", 4, samples=300)
    found = wb.identify_structure(data, structure="wiener", order=2, feedthrough=False, knots=5)
    assert found.behind is not None
    u = data.u[:, 0]
    size = np.ptp(found.behind.x)
    begin = found.linear.x0 + np.linalg.lstsq(found.linear.C, np.array([0.2 * size]), rcond=None)[0]
    y = found.behind(found.linear.simulate(data.u, begin)[:, 0])
    assert np.abs(found.simulate(u) - y).max() > 0.05 * np.ptp(y)
    assert np.abs(found.simulate(u, y) - y).max() < 1e-6 * np.ptp(y)


def test_scales_are_moved_without_a_change_of_the_output() -> None:
    u = np.random.default_rng(0).normal(size=200)
    linear = plant_alone((np.array([[0.5]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))), feedthrough=False)
    knots = np.linspace(-4.0, 4.0, 7)
    for values in (-3.0 * np.tanh(knots), np.cosh(knots)):
        chain = WienerHammersteinModel(None, linear, PiecewiseLinearBlock(knots, values, np.eye(7)))
        moved = rescaled(chain, u)
        assert moved.output(u) == pytest.approx(chain.output(u), rel=1e-9, abs=1e-9)
        assert moved.behind is not None
        assert np.all(np.diff(moved.behind.knots) > 0.0)
        assert moved.behind.free.shape == (7, 6)
    assert placed(WienerHammersteinModel(None, linear, None), u, 2.0 * u, 5).behind is not None


def test_what_cannot_show_a_block_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(0)
    binary = np.where(random.random(400) < 0.5, -1.0, 1.0)
    data = wb.make_experiment(0.1, binary, signal.lfilter(B, A, binary))
    with pytest.raises(InputError, match="2 levels, which show 2 points"):
        wb.identify_structure(data, structure="hammerstein")
    two = wb.make_experiment(0.1, random.normal(size=(400, 2)), random.normal(size=400))
    with pytest.raises(InputError, match="one input and one output, not 2 and 1"):
        wb.identify_structure(two, structure="wiener")
    recorded("hammerstein", 0, samples=400).to_csv(tmp_path / "data.csv")
    command = ["identify", str(tmp_path / "data.csv"), "--input", "u", "--output", "y"]
    for more, said in (
        (["--knots", "5"], "--knots belongs to --structure"),
        (["--structure", "wiener", "--knots", "2"], "with fewer a block is linear"),
        (["--structure", "wiener", "--closed-loop", "direct"], "--closed-loop is not for --structure wiener"),
        (["--structure", "wiener", "--lags", "5"], "--lags is not for --structure wiener"),
        (["--structure", "weiner"], "did you mean wiener"),
    ):
        assert run([*command, *more]) == 2
        assert said in capsys.readouterr().err


def test_the_command_writes_what_reads_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded("hammerstein", 0, samples=800).to_csv(tmp_path / "data.csv")
    files = [f"--{kind}={tmp_path / name}" for kind, name in (("json", "s.json"), ("csv", "s.csv"), ("plot", "s.png"))]
    command = ["identify", str(tmp_path / "data.csv"), "--input", "u", "--output", "y", "--structure", "hammerstein"]
    assert run([*command, "--order", "2", "--knots", "6", *files]) == 0
    assert "Hammerstein model of order 2: fit" in capsys.readouterr().out
    found = wb.StructureResult.read(tmp_path / "s.json")
    assert found.before is not None
    assert len(found.before.x) == 6
    assert found.simulate(found.data.u[:, 0], found.data.y[:, 0]) == pytest.approx(found.simulated, abs=1e-6)
    assert (tmp_path / "s.png").stat().st_size > 10_000


@pytest.mark.parametrize("kind", ["hammerstein", "wiener"])
@pytest.mark.parametrize("suffix", [".toml", ".ssp"])
def test_an_exported_system_runs_as_the_blocks_do(kind: str, suffix: str, tmp_path: Path) -> None:
    """Also where the operating point is not 0; between the samples the output stands."""
    data = recorded(kind, 0, samples=300, about=3.0)
    data = wb.make_experiment(
        data.dt, data.u, data.y, input_names=["u"], output_names=["y"], input_units=["deg"], output_units=["rad/s"],
    )  # fmt: skip
    found = wb.identify_structure(data, structure=kind, order=2, knots=6, delay=1)
    v = data.u[:, 0] if found.before is None else found.before(data.u[:, 0])
    w = found.linear.simulate(v[:, None], found.linear.x0)[:, 0]
    expected = w if found.behind is None else found.behind(w)
    assert isinstance(wb.export(found, tmp_path / f"found{suffix}"), wb.SystemFile)
    held = wb.Table(data.time.tolist(), data.u[:, 0].tolist(), "hold")
    with wb.load(tmp_path / f"found{suffix}") as system:
        between = data.time[:-1] + 0.5 * data.dt
        run = wb.simulate(system, stop=data.time[-1], inputs={"u": held}, points=between)
        units = [(v.name, v.unit) for v in (*system.inputs, *system.outputs)]
    assert units == [("u", "deg"), ("y", "rad/s")]
    simulated = run["y"][np.searchsorted(run.time, between - 1e-9)]
    assert np.abs(simulated - expected[:-1]).max() < 1e-9 * np.ptp(expected)


def test_an_export_that_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = wb.identify_structure(recorded("wiener", 0, samples=300), structure="wiener", order=2, knots=6)
    (tmp_path / "w.json").write_text(json.dumps(found.to_dict()), encoding="utf-8")
    command = ["build", str(tmp_path / "w.json"), "--out"]
    assert run([*command, str(tmp_path / "w.toml")]) == 0
    assert "the linear block starts at the state of the first sample" in capsys.readouterr().err
    for out, more, said in (
        ("w.fmu", [], "whose static blocks an FMU of a linear model cannot hold; write it as a system:"),
        ("w.toml", ["--step", "0.1"], "step is for FMUs; leave it out"),
        (".no/w.toml", [], "does not exist"),
    ):
        assert run([*command, str(tmp_path / out), *more]) == 2
        assert said in capsys.readouterr().err
