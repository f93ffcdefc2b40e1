"""Data advice: what was put in is found, and clean data raise no alarm."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal

from tests.identification_data import DT, data, prbs, response, white, with_noise
from workbench.core.values.arrays import Floats
from workbench.data.advice.advise import TOPICS, advise
from workbench.data.advice.delay import delays
from workbench.data.advice.linearity import _nonlinear_columns
from workbench.data.advice.record import _gains
from workbench.data.advice.result import VERDICTS
from workbench.data.advice.shared_estimates import DataStudy
from workbench.data.experiment.experiment import Experiment, make_experiment
from workbench.errors import InputError

N = 1500


def verdict(experiment: Experiment, topic: str) -> str:
    return advise(experiment).finding(topic).verdict


def sines(frequencies: list[float], n: int = N) -> Floats:
    parts = [np.sin(2.0 * np.pi * f * DT * np.arange(n) + f) for f in frequencies]
    return np.asarray(np.sum(parts, axis=0))


@pytest.mark.parametrize("level", [None, 40.0, 20.0])
@pytest.mark.parametrize("pole", [0.0, 0.9])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_clean_linear_data_raise_no_alarm(level: float | None, pole: float, seed: int) -> None:
    for u in (prbs(N, hold=2, seed=seed), white(N, seed)):
        y = response(u, delay=seed % 2)
        found = advise(
            data(u + 3.0, (y if level is None else with_noise(y, level + 0.5, pole=pole, seed=seed + 20)) - 7.0)
        )
        assert [str(f) for f in found.concerns if f.topic != "delay"] == []
        assert found.finding("delay").values["u → y"] in {1 + seed % 2, None}
        assert found.excited_orders is None


def test_every_topic_is_judged_by_a_known_verdict() -> None:
    found = advise(data(prbs(N), response(prbs(N))))
    assert tuple(f.topic for f in found.findings) == tuple(TOPICS)
    assert {f.verdict for f in found.findings} <= set(VERDICTS)
    assert all(f.evidence for f in found.findings)
    assert found.worst in {"good", "unknown"}


@pytest.mark.parametrize(
    ("frequencies", "orders"), [([3.3], 2), ([0.21], 2), ([3.0, 11.0], 4), ([1.0, 2.0, 4.0, 8.0], 8)]
)
def test_sines_excite_two_orders_each(frequencies: list[float], orders: int) -> None:
    u = sines(frequencies)
    found = advise(data(u + 4.0, response(u)))
    assert found.excited_orders == orders
    assert found.single_sine is (orders == 2)
    found.refuse(orders)
    with pytest.raises(InputError, match=f"excites {orders} orders, too few for a model of order {orders + 1}"):
        found.refuse(orders + 1)


def test_a_single_sine_with_noise_is_still_one() -> None:
    u = sines([3.3]) + 0.003 * white(N)
    found = advise(data(u, response(u)), order=3)
    assert found.excited_orders == 2
    assert found.finding("excitation").verdict == "poor"
    with pytest.raises(InputError, match="single sine"):
        found.refuse(3)


def test_a_multisine_is_not_refused_though_its_band_is_narrow() -> None:
    period = 500
    lines = np.arange(2, 40)
    u = sines((lines / (period * DT)).tolist(), 3 * period)
    found = advise(data(u, response(u)))
    assert found.excited_orders is None
    found.refuse(20)


def test_a_short_sequence_excites_as_many_orders_as_it_has_lines() -> None:
    u = np.tile(prbs(15, hold=1), 100)
    assert advise(data(u, response(u))).excited_orders == 14


def test_constant_dependent_and_stepping_inputs() -> None:
    constant = advise(data(np.ones(N), white(N)))
    assert constant.excited_orders == 0
    with pytest.raises(InputError, match="is constant"):
        constant.refuse(1)
    step = np.where(np.arange(N) < 400, 0.0, 1.0)
    assert verdict(data(step, response(step)), "excitation") == "watch"
    advise(data(step, response(step))).refuse(6)
    u = white(N)
    twice = make_experiment(DT, np.column_stack([u, -2.0 * np.roll(u, 2)]), response(u))
    assert advise(twice).excited_orders == 0
    assert "follows linearly" in advise(twice).finding("excitation").evidence


@pytest.mark.parametrize("shift", [-11, -10, 10, 11])
def test_an_input_up_to_ten_samples_before_or_behind_another_depends_on_it(shift: int) -> None:
    u = white(N)
    both = make_experiment(DT, np.column_stack([u, np.roll(u, shift)]), response(u))
    assert ("follows linearly" in advise(both).finding("excitation").evidence) == (abs(shift) <= 10)


@pytest.mark.parametrize("delay", [0, 1, 4, 17])
@pytest.mark.parametrize("level", [200.0, 40.0, 20.0])
def test_delays(delay: int, level: float) -> None:
    for hold in (1, 3):
        u = prbs(2500, hold=hold)
        y = with_noise(response(u, delay=delay), level, pole=0.8)
        assert delays(DataStudy(data(u, y), order=None, limits=None)) == {("u", "y"): 1 + delay}


def test_feedthrough_is_no_delay() -> None:
    u = prbs(N)
    assert advise(data(u, response(u, delay=4) + 0.2 * u)).finding("delay").values["u → y"] == 0


def test_delays_of_two_inputs_and_an_output_that_answers_to_one() -> None:
    u = np.column_stack([prbs(2000, seed=4), prbs(2000, seed=5)])
    y = np.column_stack([response(u[:, 0], delay=2) + response(u[:, 1], delay=5), response(u[:, 1])])
    y += 0.02 * np.column_stack([white(2000, 6), white(2000, 7)])
    values = advise(make_experiment(DT, u, y)).finding("delay").values
    assert values == {"u1 → y1": 3, "u1 → y2": None, "u2 → y1": 6, "u2 → y2": 1}


def test_a_delay_that_a_band_limited_input_hides_is_not_guessed() -> None:
    u = sines((np.arange(2, 40) / 5.0).tolist())
    found = advise(data(u, with_noise(response(u, delay=3), 20.0))).finding("delay")
    assert (found.verdict, found.values["u → y"]) == ("unknown", None)


def test_an_output_that_answers_to_nothing() -> None:
    assert verdict(data(prbs(N), white(N)), "delay") == "poor"
    assert verdict(data(prbs(N), white(N)), "noise") == "poor"


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_feedback_is_suspected_in_closed_loop_only(seed: int) -> None:
    n = 2500
    r, noise = prbs(n, seed=seed), 0.3 * white(n, seed + 10)
    closed, y = _loop(r, noise, 0.6)
    assert verdict(data(closed, y), "feedback") == "poor"
    opened, y = _loop(r, noise, 0.0)
    assert verdict(data(opened, y), "feedback") == "good"


def test_feedback_without_noise_cannot_be_judged() -> None:
    assert verdict(data(*_loop(prbs(N), np.zeros(N), 0.6)), "feedback") == "unknown"


def _loop(r: Floats, noise: Floats, gain: float) -> tuple[Floats, Floats]:
    """A lag with u[k] = r[k] − gain·y[k − 1]."""
    u, y, x = np.zeros(len(r)), np.zeros(len(r)), 0.0
    for k in range(len(r)):
        y[k] = x + noise[k]
        u[k] = r[k] - (gain * y[k - 1] if k else 0.0)
        x = 0.8 * x + 0.3 * u[k]
    return u, y


def test_a_clipped_output_is_found_while_the_input_moves() -> None:
    u = white(N)
    y = response(u)
    found = advise(data(u, np.clip(y, -1.2 * np.std(y), 1.2 * np.std(y)))).finding("saturation")
    assert found.verdict == "poor"
    assert "while the input moves on" in found.evidence
    assert len(found.marks["y"]) > 50
    assert "y low" in found.values
    assert "y high" in found.values


def test_a_settled_linear_response_is_no_saturation() -> None:
    u = prbs(4000, hold=400, seed=5)
    assert verdict(data(u, response(u)), "saturation") == "good"


def test_a_rest_with_a_resting_input_is_open_until_the_limits_are_known() -> None:
    u = prbs(3000, hold=30)
    rate, y = 0.05, np.zeros(3000)
    for k in range(1, 3000):
        y[k] = y[k - 1] + np.clip(u[k] - y[k - 1], -rate, rate)
    experiment = data(u, y)
    assert verdict(experiment, "saturation") == "watch"
    assert advise(experiment, limits={"y": (-1.0, 5.0)}).finding("saturation").verdict == "poor"
    with pytest.raises(InputError, match="not an output of the data"):
        advise(experiment, limits={"z": (0.0, 1.0)})


def test_a_clipped_input_is_found() -> None:
    u = np.clip(signal.lfilter([0.1], [1.0, -0.9], white(N)), -0.2, 0.2)
    found = advise(data(u, response(u))).finding("saturation")
    assert (found.verdict, "clipped" in found.evidence) == ("watch", True)


@pytest.mark.parametrize("level", [60.0, 25.0])
def test_nonlinear_distortion_is_told_from_noise(level: float) -> None:
    u = prbs(N)
    y = response(u) / np.std(response(u))
    for bent in (np.tanh(1.5 * y), y + 0.3 * y**2, np.sign(y) * np.maximum(np.abs(y) - 0.4, 0.0)):
        found = advise(data(u, with_noise(bent, level))).finding("linearity")
        assert found.verdict in {"watch", "poor"}
        assert "distortion" in found.evidence
    noisy = advise(data(u, with_noise(y, 5.0))).finding("linearity")
    assert "no nonlinear distortion" in noisy.evidence
    assert noisy.verdict == "watch"


def test_nonlinear_terms_are_bends_of_the_prediction_and_of_its_change_and_nothing_linear() -> None:
    random = np.random.default_rng(4)
    y, residual = random.standard_normal((200, 1)), 0.3 * random.standard_normal((198, 1))
    study: Any = SimpleNamespace(y=y, spread=np.array([2.0]))
    arx: Any = SimpleNamespace(lags=2, residual=residual)
    terms = _nonlinear_columns(study, arx, 0)

    def left(x: Floats) -> float:
        return float(np.linalg.norm(x - terms @ np.linalg.lstsq(terms, x, rcond=None)[0]) / np.linalg.norm(x))

    now, before = (y[2:] - residual)[:, 0], y[1:-1, 0]
    step = now - before
    for x in (now, step):
        assert max(left(x**2), left(x**3), left(np.abs(x)), left(x * np.abs(x))) < 1e-9
    assert max(left(before**2), left(before**3), left(now * step), left(np.sign(step))) < 1e-9
    assert min(left(now), left(step), left(before)) > 0.01


def test_a_response_counts_only_nearer_to_what_is_excited_than_to_what_is_not() -> None:
    """Of the response at k/32 of Nyquist, k = 0 … 32, the excitation is known at every second one, and ends at 10."""
    study: Any = SimpleNamespace(
        memory=1, u=np.array([[1.0], [-1.0]]), spread=np.ones(1), varying_inputs=[0], varying_outputs=[0],
        model=SimpleNamespace(impulse=lambda count: np.eye(count, 1)[:, :, None]), excited=np.arange(17) <= 5,
    )  # fmt: skip
    assert np.flatnonzero(_gains(study)[:, 0, 0]).tolist() == list(range(11))


def test_noise_is_measured_in_decibel() -> None:
    u = prbs(4000)
    for level in (30.0, 14.0, 6.0):
        found = advise(data(u, with_noise(response(u), level, pole=0.7))).finding("noise")
        assert found.values["y"] == pytest.approx(level, abs=1.0)
        assert found.verdict == {30.0: "good", 14.0: "watch", 6.0: "poor"}[level]


def test_outliers_and_drift_are_found_at_their_place() -> None:
    u = prbs(N)
    y = with_noise(response(u), 40.0)
    size = float(np.std(y))
    spoilt = y.copy()
    spoilt[700] += 5.0 * size
    outlier = advise(data(u, spoilt))
    assert outlier.finding("outliers").marks == {"y": (700,)}
    assert [f.topic for f in outlier.concerns] == ["outliers"]
    drifting = advise(data(u, y + np.linspace(0.0, size, N))).finding("trend")
    assert drifting.verdict == "watch"
    assert drifting.values["drift"]["y"] == pytest.approx(size, rel=0.3)


@pytest.mark.parametrize(("part", "told"), [(0.1, False), (0.2, False), (0.45, True)])
def test_a_drift_is_told_where_it_is_large_not_where_it_is_only_sure(part: float, told: bool) -> None:
    """With little noise all of these are known to a few hundredths; from 0.3 of a standard deviation on they matter."""
    u = prbs(N)
    y = with_noise(response(u), 60.0)
    size = float(np.std(y))
    found = advise(data(u, y + np.linspace(-0.5, 0.5, N) * part * size)).finding("trend")
    assert found.values["drift"]["y"] == pytest.approx(part * size, rel=0.05)
    assert ("drifts" in found.evidence) == told


def test_a_gain_of_a_two_level_input_has_no_dynamics_and_does_not_saturate() -> None:
    u = prbs(N)
    found = advise(data(u, 3.0 * u))
    assert found.finding("saturation").verdict == "good"
    assert "no dynamics" in found.finding("sampling").evidence


def test_sampling_too_fast_too_slow_and_beside_the_model() -> None:
    u = prbs(6000, hold=40)
    slow = np.asarray(signal.lfilter([0.005], [1.0, -0.995], u))
    assert "look like integrators" in advise(data(u, slow)).finding("sampling").evidence
    v = white(N)
    fast = np.asarray(signal.lfilter([0.9], [1.0, 0.1], v))
    assert "no dynamics" in advise(data(v, fast)).finding("sampling").evidence
    held = response(v)[np.arange(N) // 3 * 3]
    assert "every 3rd sample" in advise(data(v, held)).finding("sampling").evidence


def test_length_in_time_constants_and_parameters() -> None:
    u = prbs(400, hold=5)
    slow = np.asarray(signal.lfilter([0.01], [1.0, -0.99], u))  # time constant 1 s, record 4 s
    found = advise(data(u, with_noise(slow, 60.0))).finding("length")
    assert found.verdict == "poor"
    assert found.values["time_constant_s"] == pytest.approx(1.0, rel=0.3)
    many = advise(data(prbs(400), response(prbs(400))), order=30).finding("length")
    assert (many.verdict, many.values["parameters"]) == ("watch", 61)


def test_settling_does_not_spoil_the_other_questions() -> None:
    u, kick = prbs(N), np.zeros(N)
    kick[0] = 80.0
    found = advise(data(u, response(u) + response(kick)))
    assert [f.topic for f in found.concerns] == ["settling"]


def test_too_few_samples_and_unknown_topics_are_refused() -> None:
    with pytest.raises(InputError, match="too few to judge"):
        advise(data(prbs(30), prbs(30)))
    with pytest.raises(InputError, match="did you mean delay"):
        advise(data(prbs(100), prbs(100))).finding("delays")


def test_the_data_stay_as_they_are_and_results_are_written(tmp_path: Path) -> None:
    u = np.column_stack([prbs(600), prbs(600, seed=8)])
    experiment = make_experiment(DT, u, with_noise(response(u[:, 0]) + response(u[:, 1]), 10.0))
    before = experiment.u.copy(), experiment.y.copy()
    found = advise(experiment, order=4)
    np.testing.assert_array_equal(experiment.u, before[0])
    np.testing.assert_array_equal(experiment.y, before[1])
    found.plot(tmp_path / "advice.png")
    found.to_csv(tmp_path / "advice.csv")
    assert len((tmp_path / "advice.csv").read_text(encoding="utf-8").splitlines()) == 1 + len(TOPICS)
    as_dict = found.to_dict()
    assert as_dict["order"] == 4
    assert [f["topic"] for f in as_dict["findings"]] == list(TOPICS)


def test_every_topic_survives_odd_data() -> None:
    for u, y in (
        (np.ones(100), np.ones(100)),
        (prbs(100), np.ones(100)),
        (np.ones(100), white(100)),
        (prbs(45), response(prbs(45))),
        (1e-12 * white(300), 1e12 * white(300)),
        (np.arange(200.0), np.arange(200.0) ** 2),
        (np.eye(1, 300)[0], response(np.eye(1, 300)[0])),
        (prbs(300), np.cumsum(prbs(300))),
        (prbs(400), np.asarray(signal.lfilter([1.0], [1.0, -1.05], prbs(400)))),
    ):
        assert len(advise(data(u, y)).findings) == len(TOPICS)


def test_an_unstable_plant_in_a_loop_is_judged_without_a_warning() -> None:
    """The energy of its impulse response is beyond all numbers."""
    random, y = np.random.default_rng(2), np.zeros(3000)
    r, u = random.standard_normal((2, 3000))
    for k in range(2999):
        u[k] = r[k] - 0.7 * y[k]
        y[k + 1] = 1.5 * y[k] + u[k] + 0.01 * random.standard_normal()
    u[-1] = r[-1]
    study = DataStudy(data(u, y), order=None, limits=None)
    assert study.memory >= 1000
