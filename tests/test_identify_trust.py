"""What an identification hands out can be trusted or says that it cannot: order, simulation, closed loop."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import eigvalsh

import workbench as wb
from tests.random_systems import Plant
from workbench.cli.app import run
from workbench.core.values.arrays import Floats
from workbench.identification.subspace.estimate import estimate
from workbench.identification.subspace.matrices import fit_inputs
from workbench.identification.subspace.order import cost
from workbench.identification.subspace.projections import METHODS
from workbench.identification.subspace.result import SubspaceEstimate
from workbench.identification.validate.spread import around_both, enclosing

DT = 0.02
LAG = Plant(np.array([[0.8]]), np.array([[0.5]]), np.array([[1.0]]), np.array([[0.3]]))


def slow(samples: int, seed: int, top: float = 0.01) -> Floats:
    """Sines below one hundredth of the sampling rate, phases at random: little changes from sample to sample."""
    k = np.arange(1, int(top * samples) + 1)
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(k))
    lines = np.cos(2.0 * np.pi * np.arange(samples)[:, None] * k / samples + phase).sum(axis=1)
    return np.asarray(lines / np.max(np.abs(lines)))


def limited(seed: int) -> wb.Experiment:
    """A gain of 6 that falls to 5 for negative inputs: no dynamics at all, and no linear model is exact."""
    u = slow(3000, seed)
    return wb.make_experiment(DT, u, np.where(u > 0.0, 6.0, 5.0) * u, input_names=["u"], output_names=["y"])


def unstable(samples: int = 400) -> wb.Experiment:
    """y(k + 1) = 1.2 y(k) + u(k) held by u = r − 0.6 y, with noise: its simulation grows like 1.2^k."""
    random = np.random.default_rng(3)
    y, u = np.zeros(samples), np.zeros(samples)
    for k in range(samples):
        u[k] = random.choice([-1.0, 1.0]) - 0.6 * y[k]
        if k + 1 < samples:
            y[k + 1] = 1.2 * y[k] + u[k] + 0.1 * random.standard_normal()
    return wb.make_experiment(DT, u, y, input_names=["u"], output_names=["y"])


def left_over(found: SubspaceEstimate, u: Floats, y: Floats) -> float:
    """The logarithm of the mean square of what the model handed out leaves of a single output."""
    return float(np.log(np.mean((y - found.model.simulate(u, found.model.x0)[:, 0]) ** 2) / np.mean(y**2)))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("method", METHODS)
def test_a_slow_input_gives_a_model_that_can_be_simulated(method: str, seed: int) -> None:
    # Before, n4sid (then the default) found poles of 1.9 to 3.7 here, and a fit that was no number.
    result = wb.identify(limited(seed), method=method)
    # The best gain leaves less than 10 % of an output between 5 u and 6 u.
    assert result.fit_percent > 90.0
    assert result.failed == {}
    assert 5.0 <= float(result.model.response(np.array([0.1]))[0, 0, 0].real) <= 6.0


def test_first_order_of_a_slow_input_can_be_simulated_by_default_and_n4sid_says_what_it_lacks() -> None:
    for seed in range(3):
        data = limited(seed)
        result = wb.identify(data, order=1)
        assert result.fit_percent > 90.0
        told = wb.identify(data, order=1, method="n4sid").notes
        assert any("noise counts" in note and "use moesp" in note for note in told)


def test_a_gain_is_chosen_where_there_is_nothing_else() -> None:
    random = np.random.default_rng(0)
    u = random.standard_normal(1000)
    found = estimate(u, 2.0 * u + 0.2 * random.standard_normal(1000), DT)
    assert found.order == 0
    assert found.model.D.item() == pytest.approx(2.0, abs=0.03)  # 0.2/√1000 = 0.0063 is one standard deviation
    assert "orders 0 to" in found.order_reason


@pytest.mark.parametrize("options", [{}, {"biased": True}, {"stable": True}, {"method": "n4sid"}, {"method": "cva"}])
def test_the_order_is_judged_by_the_model_that_is_handed_out(options: dict[str, Any]) -> None:
    """Criterion = log det of the simulation error of the model of each order + n (p + m) log(N')/N'."""
    random = np.random.default_rng(1)
    u = random.standard_normal(2000)
    y = LAG.output(u[:, None])[:, 0]
    y = y + 0.1 * y.std() * random.standard_normal(2000)
    auto = estimate(u, y, DT, horizon=10, max_order=3, **options)
    each = [left_over(estimate(u, y, DT, horizon=10, order=n, **options), u, y) for n in range(4)]
    price = auto.order_criterion - each
    orders = np.flatnonzero(np.isfinite(price))
    assert orders.tolist() == [0, 1, 3]  # 2 cannot be the best any more
    # White noise: N' is N but for what chance adds to the sum of squared correlations.
    assert price[0] == pytest.approx(0.0, abs=1e-9)
    assert price[1] == pytest.approx(2.0 * np.log(2000) / 2000, rel=0.1)
    assert price[3] == pytest.approx(3.0 * price[1], rel=1e-6)
    assert auto.order == 1


@pytest.mark.parametrize("pole", [0.5, 0.9])
def test_coloured_noise_makes_an_order_dearer(pole: float) -> None:
    """Noise of one pole a has Σ ρ² = (1 + a²)/(1 − a²); N' is N over that (Bartlett 1946)."""
    random = np.random.default_rng(2)
    samples = 20_000
    u = random.standard_normal(samples)
    noise = signal.lfilter([1.0], [1.0, -pole], random.standard_normal(samples))
    y = LAG.output(u[:, None])[:, 0]
    y = y + 0.2 * y.std() * noise / noise.std()
    auto = estimate(u, y, DT, horizon=5, max_order=1)
    each = [left_over(estimate(u, y, DT, horizon=5, order=n), u, y) for n in range(2)]
    worth = samples * (1.0 - pole**2) / (1.0 + pole**2)
    assert auto.order_criterion[1] - each[1] == pytest.approx(2.0 * np.log(worth) / worth, rel=0.15)


def test_an_unstable_plant_is_never_silently_a_model_without_a_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "data.csv"
    unstable().to_csv(data)
    columns = ["identify", str(data), "--input", "u", "--output", "y"]
    assert run([*columns, "--json", str(tmp_path / "auto.json")]) == 0
    auto = json.loads((tmp_path / "auto.json").read_text(encoding="utf-8"))
    assert auto["fit_percent"] is not None
    capsys.readouterr()
    # One state by request: it is right about the pole, and says first that it has no simulation.
    assert run([*columns, "--order", "1", "--json", str(tmp_path / "one.json")]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "has no simulation on its data" in lines[1]
    assert any(line.startswith("failed: NO FIT on data.csv, y: the model is unstable") for line in lines)
    assert not any("nan" in line for line in lines)
    one = json.loads((tmp_path / "one.json").read_text(encoding="utf-8"))
    assert one["fit_percent"] is None
    assert [f["where"] for f in one["failed"]] == ["data.csv, y"]
    assert max(re for re, _ in one["poles"]) > 1.0


def test_an_output_that_rests_in_the_validation_is_said_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(0)
    u = random.standard_normal(300)
    names: dict[str, Any] = {"input_names": ["u"], "output_names": ["y"]}
    wb.make_experiment(DT, u, LAG.output(u[:, None]), **names).to_csv(tmp_path / "data.csv")
    wb.make_experiment(DT, u, np.ones(300), **names).to_csv(tmp_path / "rest.csv")
    columns = ["identify", str(tmp_path / "data.csv"), "--input", "u", "--output", "y"]
    assert run([*columns, "--validate", str(tmp_path / "rest.csv")]) == 1
    assert "NO FIT on rest.csv, y: the measured output is constant" in capsys.readouterr().out


def test_a_gain_by_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    limited(0).to_csv(tmp_path / "data.csv")
    command = [
        "identify",
        str(tmp_path / "data.csv"),
        "--input",
        "u",
        "--output",
        "y",
        "--order",
        "0",
        "--refine",
        "never",
    ]
    assert run([*command, "--json", str(tmp_path / "gain.json")]) == 0
    found = json.loads((tmp_path / "gain.json").read_text(encoding="utf-8"))
    u, y = limited(0).u[:, 0], limited(0).y[:, 0]
    slope = np.polyfit(u, y, 1)[0]  # the least-squares line
    assert (found["order"], found["A"], found["poles"]) == (0, [], [])
    assert found["D"][0][0] == pytest.approx(slope, rel=1e-9)


def regulated(seed: int, *, reacts_at_once: bool, gain: float = 0.8) -> wb.Experiment:
    """x(k + 1) = 0.9 x(k) + 0.3 u(k), y = x + white noise, held by u(k) = r(k) − gain · y(k) or y(k − 1)."""
    random = np.random.default_rng(seed)
    samples = 1500
    r, noise = random.choice([-1.0, 1.0], samples), 0.5 * random.standard_normal(samples)
    x, u, y = 0.0, np.zeros(samples), np.zeros(samples)
    for k in range(samples):
        y[k] = x + noise[k]
        u[k] = r[k] - gain * (y[k] if reacts_at_once else y[k - 1] if k else 0.0)
        x = 0.9 * x + 0.3 * u[k]
    return wb.make_experiment(DT, u, y, input_names=["u"], output_names=["y"])


def test_data_from_a_closed_loop_are_named_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    regulated(0, reacts_at_once=False).to_csv(tmp_path / "data.csv")
    command = ["identify", str(tmp_path / "data.csv"), "--input", "u", "--output", "y", "--order", "1"]
    assert run([*command, "--json", str(tmp_path / "loop.json")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("This is not a model of the plant: the data come from a closed loop.")
    assert any(
        line.startswith("failed: NOT A MODEL OF THE PLANT: the data come from a closed loop: u r") for line in lines
    )
    found = json.loads((tmp_path / "loop.json").read_text(encoding="utf-8"))
    assert found["closed_loop"] is True
    assert found["warnings"][0].startswith("NOT A MODEL OF THE PLANT")
    assert run([*command, "--json", "-"]) == 0
    assert "NOT A MODEL OF THE PLANT" in capsys.readouterr().err


@pytest.mark.parametrize("seed", range(5))
def test_a_controller_that_reacts_within_the_sample_is_never_called_open_loop(seed: int) -> None:
    """It cannot be told from a direct feedthrough: unknown, and found out where there is none."""
    data = regulated(seed, reacts_at_once=True)
    result = wb.identify(data, order=1)
    assert result.closed_loop is None
    assert any("closed loop is unknown" in note for note in result.notes)
    # The harm that a wrong "open loop" would hide: the plant's gain at rest is 3, and it has no feedthrough.
    assert abs(result.model.D.item()) > 0.1
    assert wb.identify(data, order=1, feedthrough=False).closed_loop is True


@pytest.mark.parametrize("direct", [0.0, 0.5])
def test_an_open_loop_is_not_suspected(direct: float) -> None:
    for seed in range(5):
        random = np.random.default_rng(seed)
        u = random.standard_normal((1500, 1))
        plant = Plant(np.array([[0.9]]), np.array([[0.3]]), np.array([[1.0]]), np.array([[direct]]))
        y = plant.output(u) + 0.5 * random.standard_normal((1500, 1))
        found = wb.identify(wb.make_experiment(DT, u, y), order=1).closed_loop
        assert found is (None if direct else False)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("u,y\nfoo,bar\n{rows}", ["--dt", "0.1"], "line 2: 'foo' is neither a number nor a known unit"),
        ("u,y\n", ["--dt", "0.1"], "no row of numbers"),
        ("u,y\n1,2\n", ["--dt", "0.1"], "1 sample is too few; at least two are needed"),
        ("u,y\n{still}", ["--dt", "0.1"], "input 'u' is constant (1): it excites nothing"),
        ("y,u\n{still}", ["--dt", "0.1"], "output 'y' is constant (1): there is nothing to identify"),
        ("u,y\n1,nan\n{rows}", ["--dt", "0.1"], "output 'y' is nan at sample 0"),
        ("u,y\n{rows}", ["--dt", "0.1", "--order", "-1"], "--order: '-1' is neither auto"),
        ("u,y\n{rows}", ["--dt", "0.1", "--order", "²"], "--order: '²' is neither auto"),
        ("u,y\n{rows}", ["--dt", "0.1", "--method", "n4sdi"], "did you mean n4sid"),
        ("u,y\n{rows}", ["--dt", "0.1", "--amplitude", "2"], "--amplitude: it selects one of nfr, which is missing"),
    ],
)
def test_wrong_input_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, options: list[str], message: str
) -> None:
    rows = "".join(f"{k % 3},{k % 7}\n" for k in range(60))
    still = "".join(f"1,{k % 7}\n" for k in range(60))
    (tmp_path / "x.csv").write_text(text.format(rows=rows, still=still), encoding="utf-8")
    assert run(["identify", str(tmp_path / "x.csv"), "--input", "u", "--output", "y", *options]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert message in lines[0]


@pytest.mark.parametrize("unit", ["m/s2", "N.m", "kg*m^2", "°C", "%", "rad/s", "1/s", "m·s⁻²", "[anything at all]", ""])
def test_a_line_of_units_is_read(tmp_path: Path, unit: str) -> None:
    (tmp_path / "x.csv").write_text(f"t;u;y\ns;{unit};V\n0;1;2\n1;2;3\n", encoding="utf-8")
    data = wb.read_experiment(tmp_path / "x.csv", inputs=["u"], outputs=["y"])
    assert data.units == {"u": unit.strip("[]") or None, "y": "V"}


def test_an_order_at_the_limit_is_a_doubt() -> None:
    """Three modes, and two orders allowed: the larger is taken, and may not be enough."""
    random = np.random.default_rng(5)
    u = random.standard_normal((1500, 1))
    plant = Plant(np.diag([0.9, 0.5, -0.6]), np.ones((3, 1)), np.array([[1.0, 1.0, 1.0]]), np.zeros((1, 1)))
    y = plant.output(u) + 0.01 * random.standard_normal((1500, 1))
    few, enough = (estimate(u, y, DT, max_order=most) for most in (2, 6))
    assert (few.order, enough.order) == (2, 3)
    assert "order 2 is the largest considered: allow more, or check the data" in few.notes
    assert not any("largest considered" in note for note in enough.notes)


def test_a_model_that_overflows_on_its_own_data_is_no_candidate(tmp_path: Path) -> None:
    """A step of 0.02 s in a record of 5 s: high orders fit rounding, and one of them grew beyond all numbers."""
    path = tmp_path / "step.csv"
    with wb.load("fmu:Rudder") as rudder:
        wb.simulate(rudder, stop=1.0, inputs={"delC": "step:time=0.1,value=2"}, outputs=["del"]).to_csv(path)
    assert run(["identify", str(path), "--input", "delC", "--output", "del", "--json", str(tmp_path / "x.json")]) == 0
    found = np.array(json.loads((tmp_path / "x.json").read_text())["A"])
    assert np.all(np.isfinite(found))
    assert np.abs(np.linalg.eigvals(found)).max() < 1.0 + 1e-6


def test_what_grows_beyond_all_numbers_fits_nothing() -> None:
    u = np.sin(np.arange(500.0))[:, None]
    found = fit_inputs(u, u, np.array([[10.0]]), np.array([[1.0]]), feedthrough=True)
    assert np.all(np.isnan(found.B))
    assert cost(np.full((500, 1), np.nan)) == np.inf


@pytest.mark.parametrize("seed", [1, 3])
def test_regions_allow_for_the_order_that_the_criterion_left_out(seed: int) -> None:
    """A lag and a second mode too weak for the Bayesian criterion: the lag's own regions hold a fifth of the truth."""
    random = np.random.default_rng(seed)
    u = random.standard_normal(600)
    y = signal.lfilter([0.0, 0.2], [1.0, -0.8], u) + 0.08 * signal.lfilter([0.0, 0.5], [1.0, 0.5], u)
    data = wb.make_experiment(1.0, u, y + 0.3 * random.standard_normal(600))
    found = wb.identify(data, max_order=4, detrend="none", refine="always", feedthrough=False)
    regions = found.uncertainty
    assert regions is not None
    z = np.exp(2j * np.pi * regions.frequency_hz)
    true = np.asarray(0.2 / (z - 0.8) + 0.04 / (z + 0.5), dtype=np.complex128)[:, None, None]
    alone = wb.model_spread(found.model)
    assert found.order == 1
    assert regions.rival_order is not None
    assert alone.rival_order is None
    assert alone.holds_response(true).mean() < 0.8
    assert regions.holds_response(true).mean() > 0.9
    assert any("explains significantly more" in line for line in regions.words)


def test_an_ellipse_around_both_holds_the_other() -> None:
    """Ends of the other ellipse in 36 directions, centres far away, too; and it touches the far end."""
    random = np.random.default_rng(0)
    turn = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)
    circle = np.vstack([np.cos(turn), np.sin(turn)])
    for _ in range(50):
        root = random.standard_normal((2, 2))
        shape, away = root @ root.T + 0.01 * np.eye(2), 3.0 * random.standard_normal(2)
        found = enclosing(np.array([[[complex(*away)]]]), shape[None, None, None])[0, 0, 0]
        ends = away[:, None] + np.linalg.cholesky(shape) @ circle
        assert np.max(np.sum(ends * np.linalg.solve(found, ends), axis=0)) <= 1.0 + 1e-9
        far = away * (1.0 + 1.0 / np.sqrt(away @ np.linalg.solve(shape, away)))
        assert far @ np.linalg.solve(found, far) == pytest.approx(1.0)


def test_an_ellipse_around_both_is_no_smaller_than_either() -> None:
    """Result minus each is positive semidefinite, its area the least: random ones, crossing ones, nearly a line."""
    random = np.random.default_rng(0)
    roots = random.standard_normal((200, 2, 2, 2)) * 10.0 ** random.uniform(-1.0, 1.0, (200, 2, 1, 1))
    one, other = np.moveaxis(roots @ np.swapaxes(roots, -1, -2), 1, 0)
    line = np.array([[1.0, 2.0], [2.0, 4.0 + 1e-9]])
    one, other = (
        np.concatenate([one, [np.diag([4.0, 1.0]), line]]),
        np.concatenate([other, [np.diag([1.0, 4.0]), line]]),
    )
    found = around_both(one, other)
    for held in (one, other):
        size = np.linalg.norm(held, axis=(-2, -1), keepdims=True)
        assert np.linalg.eigvalsh((found - held) / size).min() > -1e-9
    for k in range(200):
        longer = np.maximum(eigvalsh(other[k], one[k]), 1.0)  # half axes' squares where the one is a circle
        assert np.linalg.det(found[k]) == pytest.approx(np.linalg.det(one[k]) * longer.prod(), rel=1e-5)
    assert found[-2] == pytest.approx(np.diag([4.0, 4.0]))


def test_regions_with_another_order_hold_those_of_the_own() -> None:
    random = np.random.default_rng(0)
    u, noise = random.standard_normal((2, 600))
    data = wb.make_experiment(1.0, u, signal.lfilter([0.0, 0.2], [1.0, -0.8], u) + 0.3 * noise)
    low, high = (wb.identify(data, order=n, detrend="none", refine="always", feedthrough=False).model for n in (1, 2))
    for model, rival in ((low, high), (high, low)):
        own, widened = wb.model_spread(model), wb.model_spread(model, rival=rival)
        more = widened.shape - own.shape
        assert np.all(np.linalg.eigvalsh(more)[..., 0] >= -1e-9 * np.trace(own.shape, axis1=-2, axis2=-1))
