"""Parameters from data: closed forms of a lag, planted values, what data cannot tell, bad input."""

from __future__ import annotations

import itertools
import json
import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import workbench as wb
from scripts.promises.calibrate import CASES, UNSEEN, PlantedCase
from scripts.promises.calibrate import played as computed
from tests.misbehaving_fmus import build_misbehaving
from workbench.cli.app import run
from workbench.core.values.arrays import Floats
from workbench.data.excite.signals import parse_design
from workbench.errors import InputError, SimulationError
from workbench.identification.calibrate.noise import LOSSES, ColouredNoise, Segments, estimated
from workbench.identification.calibrate.problem import CalibrationProblem, Gradient
from workbench.identification.calibrate.request import Calibrate
from workbench.identification.calibrate.run import run as calibrate_run
from workbench.identification.calibrate.runs import ModelRun, ModelRuns
from workbench.identification.calibrate.search import Estimate, search
from workbench.jobs.job import Job
from workbench.jobs.runner import InProcess, Lost, Reply
from workbench.jobs.worker_main import Task

DT, TAU = 0.1, 0.6
U = np.repeat(np.random.default_rng(2).uniform(-1.0, 1.0, 20), 10)
SIGMA = 0.02


def lag(tau: float, u: Floats = U, x0: float = 0.0) -> Floats:
    """x of τ dx/dt = u − x with u held over DT: the closed form."""
    a, x = math.exp(-DT / tau), [x0]
    for value in u[:-1]:
        x.append(a * x[-1] + (1.0 - a) * value)
    return np.array(x)


def record(y: Floats, u: Floats = U, **options: Any) -> wb.Experiment:  # noqa: ANN401
    return wb.make_experiment(DT, u, y, input_names=["u"], output_names=["y"], **options)


def noisy(seed: int = 3, sigma: float = SIGMA) -> Floats:
    return lag(TAU) + np.random.default_rng(seed).normal(0.0, sigma, len(U))


def calibrated(data: Any, free: Any = None, model: str = "fmu:FirstOrderLag", **options: Any) -> wb.CalibrateResult:  # noqa: ANN401
    loading = options.pop("loading", {})
    with wb.load(model, tolerance=1e-9, **loading) as opened:
        return wb.calibrate(opened, data, free=free or {"tau": (0.1, 10.0)}, in_process=True, **options)


def test_estimate_and_error_are_those_of_the_closed_form() -> None:
    y = noisy()
    found = calibrated(record(y), noise="white")
    least = least_squares(lambda q: y - lag(math.exp(q[0])), [0.0], x_scale="jac", xtol=1e-12, ftol=1e-12)
    tau = math.exp(least.x[0])
    p = found.of("tau")
    assert p.value == pytest.approx(tau, rel=1e-4 * SIGMA)
    size = math.sqrt(2.0 * least.cost / (len(y) - 1))
    assert p.std_error == pytest.approx(tau * size / float(np.linalg.norm(least.jac)), rel=1e-4)
    assert found.noise[0].sigma == pytest.approx(size, rel=1e-5)
    assert p.identifiable
    assert not p.at_bound
    assert p.curved is False
    assert found.not_identifiable == ()
    assert found.fit_percent["y"] == pytest.approx(
        100.0 * (1.0 - np.linalg.norm(y - lag(tau)) / np.linalg.norm(y - y.mean()))
    )
    assert found.runs < 40


def test_what_inputs_do_between_samples_is_told_where_it_matters() -> None:
    t = DT * np.arange(300)
    u = np.sin(0.9 * t) + np.sin(2.3 * t + 1.0)
    a, x = math.exp(-DT / TAU), [0.0]
    for now, then in itertools.pairwise(u):  # the closed form for straight lines
        x.append(a * x[-1] + (1.0 - a) * now + (1.0 - TAU / DT * (1.0 - a)) * (then - now))
    straight = np.array(x) + np.random.default_rng(8).normal(0.0, SIGMA, len(u))
    truly_held = lag(TAU, u) + np.random.default_rng(8).normal(0.0, SIGMA, len(u))
    for y, interpolate, taken, doubted in (
        (straight, "hold", "hold", True),
        (straight, "linear", "linear", False),
        (straight, "auto", "linear", False),
        (truly_held, "hold", "hold", False),
        (truly_held, "auto", "hold", False),
        (noisy(), "auto", "hold", False),
    ):
        found = calibrated(record(y, u if len(y) == len(u) else U), noise="white", interpolate=interpolate)
        assert found.between_samples == taken
        assert bool(found.doubt) == doubted
        assert not doubted or ("straight lines" in found.doubt and "tau by " in found.doubt)
        assert ("hang on what inputs do" in str(found)) == doubted
        changed = interpolate == "auto" and taken == "linear"
        assert any("explains the data better" in note for note in found.notes) == changed
        p = found.of("tau")
        assert ((p.low or 0.0) < TAU < (p.high or 0.0)) is not doubted


def test_what_was_found_stays_where_the_other_motion_cannot_be_run(monkeypatch: pytest.MonkeyPatch) -> None:
    t = DT * np.arange(300)
    u = np.sin(0.9 * t) + np.sin(2.3 * t + 1.0)
    a, x = math.exp(-DT / TAU), [0.0]
    for now, then in itertools.pairwise(u):
        x.append(a * x[-1] + (1.0 - a) * now + (1.0 - TAU / DT * (1.0 - a)) * (then - now))
    searched: list[str] = []

    def fails_then(problem: CalibrationProblem, request: Calibrate, reached: Callable[[Estimate], None]) -> Estimate:
        searched.append(request.interpolate)
        if len(searched) > 1:
            raise SimulationError("not so")
        return search(problem, request, reached)

    monkeypatch.setattr("workbench.identification.calibrate.run.search", fails_then)
    found = calibrated(record(np.array(x) + np.random.default_rng(8).normal(0.0, SIGMA, len(u)), u), noise="white")
    assert searched == ["hold", "linear"]
    assert found.between_samples == "hold"
    assert "fits better" in found.doubt
    assert not any("explains the data better" in note for note in found.notes)


def test_regions_hold_both_motions_of_the_inputs_where_the_data_do_not_tell() -> None:
    """A single step whose edge is a ramp over one sample: half a sample of delay, or another time constant."""
    u = np.where(np.arange(len(U)) >= 30, 1.0, 0.0)
    held, doubts = 0, 0
    for seed in range(20):
        a, x = math.exp(-DT / TAU), [0.0]
        for now, then in itertools.pairwise(u):
            x.append(a * x[-1] + (1.0 - a) * now + (1.0 - TAU / DT * (1.0 - a)) * (then - now))
        y = np.array(x) + np.random.default_rng(seed).normal(0.0, 0.05, len(u))
        found = calibrated(record(y, u), noise="white")
        p = found.of("tau")
        held += (p.low or 0.0) < TAU < (p.high or 0.0)
        doubts += "regions hold both" in found.doubt
    assert held >= 18
    assert doubts >= 5


def test_profile_is_that_of_the_closed_form() -> None:
    y = noisy(sigma=0.3)
    p = calibrated(record(y), noise="white", profile=True).of("tau")
    cost = [float(np.sum((y - lag(tau)) ** 2)) for tau in (p.value, p.low or 0.0, p.high or 0.0)]
    quantile = 1.9719565  # of Student's t with 199 degrees of freedom, 97.5 %
    for end in cost[1:]:
        assert (end - cost[0]) / (cost[0] / 199.0) == pytest.approx(quantile**2, rel=0.03)
    assert p.profile is not None
    assert np.all(np.diff(p.profile.values) > 0.0)


def test_whitening_is_the_inverse_root_of_the_covariance_also_over_gaps() -> None:
    colour = np.array([1.1, -0.4])
    companion = np.array([colour, [1.0, 0.0]])
    # Autocovariances of the AR(2) from the Yule-Walker equations, unit innovations.
    a1, a2 = colour
    g0 = (1.0 - a2) / ((1.0 + a2) * ((1.0 - a2) ** 2 - a1**2))
    gamma = [g0, a1 * g0 / (1.0 - a2)]
    for _ in range(10):
        gamma.append(a1 * gamma[-1] + a2 * gamma[-2])
    assert np.all(np.abs(np.linalg.eigvals(companion)) < 1.0)
    y = np.zeros(12)
    y[5] = np.nan
    data = wb.Experiment(np.arange(12.0), np.zeros((12, 0)), y[:, None], (), ("y",), (), (None,), "gaps")
    segments = Segments([data])
    W = ColouredNoise({"y": 2.0}, {"y": colour}).whitened([np.eye(12)[:, None, :]], segments)
    covariance = 4.0 * np.array([[gamma[abs(i - k)] for k in range(12)] for i in range(12)])
    covariance[:5, 6:] = covariance[6:, :5] = 0.0  # pieces are taken as independent
    kept = np.arange(12) != 5
    np.testing.assert_allclose((W @ covariance @ W.T), np.eye(11), atol=1e-12)
    assert W.shape == (11, 12)
    assert not W[:, ~kept].any()


def test_colour_of_the_noise_is_found() -> None:
    e = np.random.default_rng(4).normal(0.0, 1.0, 20000)
    v = np.zeros_like(e)
    for k in range(2, len(e)):
        v[k] = 1.1 * v[k - 1] - 0.4 * v[k - 2] + e[k]
    data = wb.make_experiment(1.0, v, v, input_names=["u"], output_names=["y"])
    noise = estimated([v[:, None]], Segments([data]), fitted=0, colour=True, given={}, robust=False)
    np.testing.assert_allclose(noise.colour["y"], [1.1, -0.4], atol=0.02)
    assert noise.sigma["y"] == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("name", ["huber", "student"])
def test_losses_have_the_derivatives_that_they_state(name: str) -> None:
    loss = LOSSES[name]
    assert loss.rho is not None
    z = np.array([0.01, 0.5, 1.7, 2.5, 9.0, 40.0])
    h = 1e-6 * z
    rho = loss.rho
    np.testing.assert_allclose((rho(z + h)[0] - rho(z - h)[0]) / (2.0 * h), rho(z)[1], rtol=1e-6)
    np.testing.assert_allclose((rho(z + h)[1] - rho(z - h)[1]) / (2.0 * h), rho(z)[2], rtol=1e-6, atol=1e-12)
    e = np.sqrt(z)
    psi, slope = loss.psi(e)
    np.testing.assert_allclose(psi, e * rho(z)[1], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(slope, rho(z)[1] + 2.0 * z * rho(z)[2], rtol=1e-12, atol=1e-12)


def test_outliers_hardly_count_with_a_robust_loss() -> None:
    y = noisy()
    y[::17] += 2.0
    plain, robust = (calibrated(record(y), loss=loss, noise="white").of("tau") for loss in ("gauss", "student"))
    assert abs(robust.value - TAU) < 0.5 * abs(plain.value - TAU)
    assert robust.std_error is not None
    assert abs(robust.value - TAU) < 4.0 * robust.std_error


def test_given_noise_tells_whether_the_model_explains_the_data() -> None:
    chi = [calibrated(record(noisy()), weights={"y": sigma}).chi_squared for sigma in (SIGMA, 0.5 * SIGMA)]
    assert chi[0] is not None
    assert chi[1] is not None
    assert chi[0].degrees == len(U) - 1
    assert chi[0].p_value > 0.01
    assert chi[1].value == pytest.approx(4.0 * chi[0].value, rel=1e-6)
    assert chi[1].p_value < 1e-6


def test_several_files_missing_samples_sensors_and_delays(tmp_path: Path) -> None:
    """Two records with a shifted clock; one has gaps. The sensor shows 1.2·y + 0.3, 0.1 s late."""
    for number, u in enumerate((U, -U[::-1])):
        y = 0.3 + 1.2 * np.concatenate([[0.0], lag(TAU, u)[:-1]])
        y = y + 1e-4 * np.random.default_rng(number).standard_normal(len(u))
        keep = [k for k in range(len(u)) if number == 0 or k % 10 not in (3, 7)]  # the input stays there
        rows = [f"{100.0 + DT * k:.1f},{u[k]:.17g},{'' if k % 11 == 5 else f'{y[k]:.17g}'}" for k in keep]
        (tmp_path / f"rig{number}.csv").write_text("\n".join(["time [s],force,meter", *rows]), encoding="utf-8")
    found = calibrated(
        [tmp_path / "rig0.csv", tmp_path / "rig1.csv"], inputs={"u": "force"}, outputs={"y": "meter"}, biases=["y"],
        scales=["y"], delays={"y": 0.1}, noise="white",
    )  # fmt: skip
    truth = {"tau": TAU, "bias of y": 0.3, "scale of y": 1.2}
    for name, value in truth.items():
        p = found.of(name)
        assert p.std_error is not None
        assert abs(p.value - value) < 4.0 * p.std_error + 1e-6
    assert found.of("tau").std_error == pytest.approx(5e-5, rel=1.0)
    assert len(found.data) == 2
    assert np.isnan(found.data[0].measured).any()


def test_initial_values_free_or_at_rest() -> None:
    y = lag(TAU, x0=0.7) + np.random.default_rng(5).normal(0.0, 1e-3, len(U))
    free = calibrated(record(y), initial="free", noise="white")
    state = next(p for p in free.parameters if p.kind == "state")
    assert state.value == pytest.approx(0.7, abs=4e-3)
    assert free.of("tau").value == pytest.approx(TAU, rel=0.01)
    bounded = calibrated(record(y), states={"x": (0.0, 0.5)}, noise="white")
    held = next(p for p in bounded.parameters if p.kind == "state")
    assert held.at_bound
    assert held.value == pytest.approx(0.5, rel=1e-4)
    assert any("held by its limit" in note for note in bounded.notes)
    begins = lag(TAU, x0=float(U[0])) + np.random.default_rng(6).normal(0.0, 1e-3, len(U))
    rest = calibrated(record(begins), initial="rest", noise="white")
    assert rest.of("tau").value == pytest.approx(TAU, rel=0.01)
    assert rest.operating_point is not None
    assert rest.operating_point.x["x"] == pytest.approx(U[0])


@pytest.mark.parametrize("name", list(UNSEEN)[::4])  # `scripts/evidence.py calibrate` has all
def test_what_the_data_do_not_tell_is_named(name: str) -> None:
    case = UNSEEN[name]
    found = _of_case(case, computed(case))
    assert len(found.not_identifiable) == len(case.named)
    for words, line in zip(case.named, found.not_identifiable, strict=True):
        assert words in line


@pytest.mark.parametrize("name", ["elevator law", "two FMUs", "lag, cs"])
def test_planted_values_are_found_in_sampled_models_systems_and_co_simulation(name: str) -> None:
    case = CASES[name]
    found = _of_case(case, computed(case), noise=1e-4)
    for p in found.parameters:
        assert p.value == pytest.approx(case.truth[p.name], rel=1e-3)
    assert found.not_identifiable == ()


def _of_case(case: PlantedCase, y: Floats, noise: float = 0.05) -> wb.CalibrateResult:
    y = y + np.random.default_rng(1).normal(0.0, noise * float(np.std(y)), len(y))
    data = wb.make_experiment(case.dt, case.u, y, input_names=[case.input], output_names=[case.output])
    with case.opened() as model:
        return wb.calibrate(model, data, free={n: case.limits.get(n) for n in case.truth}, in_process=True)


def test_a_product_of_two_gains_is_all_that_is_seen() -> None:
    parts: Mapping[str, Any] = {"a": 2.0, "b": 3.0, "lag": wb.load("fmu:FirstOrderLag")}
    system = wb.connect(parts, [("a.y", "b.u"), ("b.y", "lag.u")], inputs={"u": "a.u"}, outputs={"y": "lag.y"})
    with system:
        free = {"a.gain": (0.1, 10.0), "b.gain": (0.1, 10.0), "lag.tau": (0.1, 10.0)}
        found = wb.calibrate(system, record(4.0 * noisy()), free=free, in_process=True)
    assert len(found.not_identifiable) == 1
    assert "only a.gain·b.gain is seen" in found.not_identifiable[0]
    assert "%)" not in found.not_identifiable[0]  # the region of a logarithm is a factor
    assert not found.of("a.gain").identifiable
    assert found.of("a.gain").value * found.of("b.gain").value == pytest.approx(4.0, rel=0.05)
    assert found.of("lag.tau").identifiable


def test_a_limit_that_is_hit_and_an_input_that_does_not_move() -> None:
    found = calibrated(record(noisy()), {"tau": (0.8, 10.0)})
    assert found.of("tau").at_bound
    assert found.of("tau").value == pytest.approx(0.8, rel=1e-3)
    assert found.of("tau").low is None
    still = calibrated(record(0.001 * noisy(), 0.0 * U))
    assert any("input 'u' does not move in the data" in note for note in still.notes)
    assert still.not_identifiable == ("tau: does not act on what was measured",)


def test_runs_that_fail_count_as_infinitely_bad() -> None:
    """Below a natural frequency of the step the explicit steps of this co-simulation grow beyond all bounds."""
    case = CASES["mass damper, cs"]
    pytest.importorskip("gemseo_fmu")
    found = _of_case(case, computed(case), noise=0.01)
    assert found.of("damper.d").value == pytest.approx(20.0, rel=0.05)


def test_the_next_experiment_narrows_the_region_as_predicted() -> None:
    """The region of both records together beside the prediction from the first; no other signal is better."""
    first = record(noisy())
    found = calibrated(first, noise="white", next_inputs={"u": 1.0})
    asked = found.next_experiment
    assert asked is not None
    design = parse_design("prbs", asked.signal.removeprefix("prbs "))
    values = design.sequences(1, dt=DT, samples=len(U), validation=0).identification.values[: len(U), 0]
    u = U.mean() + values
    second = record(lag(TAU, u) + np.random.default_rng(8).normal(0.0, SIGMA, len(u)), u)
    both = calibrated([first, second], noise="white").of("tau")
    before = found.of("tau").std_error
    assert before is not None
    assert both.std_error is not None
    assert both.std_error / before == pytest.approx(asked.narrower["tau"], rel=0.25)
    best = max(one.criterion or -math.inf for one in asked.tried)
    assert next(one.criterion for one in asked.tried if one.signal == asked.signal) == best
    slow = calibrated(first, noise="white", next_inputs={"u": 1.0}, next_rate={"u": 5.0}).next_experiment
    assert slow is not None
    assert "multisine" in slow.signal


def test_regions_by_drawn_records_are_those_of_the_covariance() -> None:
    plain, drawn = (calibrated(record(noisy()), noise="white", bootstrap=n).of("tau") for n in (0, 80))
    assert plain.std_error is not None
    assert drawn.std_error == pytest.approx(plain.std_error, rel=0.3)  # of 80: 1/√160 = 8 %
    assert drawn.low == pytest.approx(plain.low, abs=plain.std_error)
    assert drawn.high == pytest.approx(plain.high, abs=plain.std_error)


def test_a_store_keeps_the_runs(tmp_path: Path) -> None:
    first, again = (calibrated(record(noisy()), store=tmp_path) for _ in range(2))
    assert first.runs > 10
    assert again.runs == 0
    assert again.to_dict() == {**first.to_dict(), "runs": 0}
    other = calibrated(record(noisy(), -U), store=tmp_path)
    assert other.runs > 10


def test_a_search_that_is_stopped_tells_where_it_stood() -> None:
    job = Job(lambda what, done, _: job.stop() if done > 9 else None)  # in the search
    request = Calibrate(record(noisy()), free={"tau": (0.1, 10.0)}, in_process=True)
    with wb.load("fmu:FirstOrderLag", tolerance=1e-9) as lag, pytest.raises(KeyboardInterrupt):
        calibrate_run(lag, request, job)
    found = job.partial()
    assert isinstance(found, wb.CalibrateResult)
    assert found.reason == "it was stopped"
    assert not found.converged
    assert 0.1 < found.of("tau").value < 1.0
    assert np.isfinite(found.data[0].computed).all()


def test_runs_for_other_data_are_counted() -> None:
    alone, compared = (calibrated(record(noisy()), validation=more) for more in (None, record(noisy(4), -U)))
    assert compared.runs == alone.runs + 2


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"free": {"tua": (1, 2)}}, "free: FirstOrderLag has no parameter or variable 'tua'; did you mean tau?"),
        ({"free": {}}, "free: name a parameter to estimate"),
        ({"free": {"tau": (3, 1)}}, "tau: 3:1 is not of the form LO:HI with LO < HI"),
        ({"free": {"u": (1, 2)}}, "free: 'u' is an input"),
        ({"free": {"tau": "1kg:2kg"}}, "free: tau: 'kg' does not convert to its unit, s"),
        ({"outputs": {"z": "y"}}, "outputs: FirstOrderLag has no variable 'z'"),
        ({"outputs": {"y": "meter"}}, "there is no column 'meter' for y"),
        ({"inputs": {"v": "u"}}, "inputs: FirstOrderLag has no input 'v'"),
        ({"biases": ["x"]}, "'x' is not among the measured outputs"),
        ({"initial": "free", "states": {"x": (0, 1)}}, "leave one out"),
        ({"loss": "l1"}, "loss 'l1' is unknown"),
        ({"weights": {"z": 1.0}}, "weights: 'z' is not among the measured outputs"),
        ({"weights": {"y": 0.0}}, "weights: y = 0 is not a positive number"),
        ({"delays": {"y": -1.0}}, "delays: y = -1 is not a positive number"),
        ({"next_inputs": {"y": 1.0}}, "next_inputs: 'y' is not among the measured inputs"),
        ({"out": "nowhere/lag.toml"}, "out: the folder 'nowhere' does not exist"),
    ],
)
def test_bad_input_is_said_in_a_line(changes: dict[str, Any], words: str) -> None:
    asked = {"free": {"tau": (0.1, 10.0)}, **changes}
    with wb.load("fmu:FirstOrderLag") as model, pytest.raises(InputError) as told:
        wb.calibrate(model, record(noisy()), in_process=True, **asked)
    assert words in str(told.value)
    assert "\n" not in str(told.value)


def test_data_that_do_not_fit_are_refused() -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        for data, words in (
            (record(noisy(), input_units=["m"], output_units=["kg"]), "is needed in"),
            (wb.make_experiment(DT, U, U, input_names=["a"], output_names=["b"]), "no column is an output of"),
        ):
            with pytest.raises(InputError, match=words):
                wb.calibrate(model, data, free={"tau": (0.1, 10.0)}, in_process=True)
        nothing = wb.Experiment(
            np.array([0.0, DT, 2.0 * DT]),
            np.zeros((3, 1)),
            np.full((3, 1), np.nan),
            ("u",),
            ("y",),
            (None,),
            (None,),
            "empty",
        )
        with pytest.raises(InputError, match="empty: output 'y' has no samples"):
            wb.calibrate(model, nothing, free={"tau": (0.1, 10.0)}, in_process=True)


def test_a_model_that_runs_nowhere_says_why() -> None:
    with wb.load("fmu:Duffing", start_values={"stiffness": -1.0, "cubic": -1.0}) as model:
        data = record(100.0 * noisy(), 1e3 * U)
        with pytest.raises(SimulationError, match="cannot be run at the start values"):
            wb.calibrate(model, data, free={"stiffness": (-2.0, -0.5)}, in_process=True)


def test_a_model_that_crashes_wherever_it_is_run_has_crashed(tmp_path: Path) -> None:
    fmu = build_misbehaving(tmp_path, "abort", "doStep")
    with wb.load(fmu, "cs") as model, pytest.raises(wb.CrashedError, match=r"start values, nor at .*SIGABRT"):
        wb.calibrate(model, record(noisy()), free={"x": (0.1, 1.0)})


def test_a_run_whose_process_crashed_is_made_once_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """The runs before it may have used up what the process had; at these values the model runs."""
    known, lost, whole = InProcess.run, list[object](), calibrated(record(noisy()))

    def run(self: InProcess, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        for number, event in enumerate(known(self, task, jobs)):
            if isinstance(event.job, ModelRun) and number % 3 == 0 and not any(event.job is one for one in lost):
                lost.append(event.job)
                yield Lost(event.job, wb.CrashedError("the worker was killed (SIGKILL)"))
            else:
                yield event

    monkeypatch.setattr(InProcess, "run", run)
    found = calibrated(record(noisy()))
    assert lost
    assert found.failed_runs == 0
    assert found.values == whole.values


def test_what_dies_on_the_way_of_the_search_leaves_no_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that die at half of the values, wherever these are: the search ends beside the least misfit."""
    known = InProcess.run

    def run(self: InProcess, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        for event in known(self, task, jobs):
            tau = event.job.parameters.get("tau", 0.0) if isinstance(event.job, ModelRun) else 0.0
            if tau > 0.9 * TAU:
                yield Lost(event.job, wb.CrashedError("the worker was killed (SIGKILL)"))
            else:
                yield event

    monkeypatch.setattr(InProcess, "run", run)
    with pytest.raises(wb.CrashedError, match="SIGKILL"):
        calibrated(record(noisy()), {"tau": (0.1 * TAU, 10.0)}, loading={"start_values": {"tau": 0.5 * TAU}})


@pytest.mark.parametrize("sigma", [0.0, SIGMA])
def test_an_estimate_by_a_model_that_misses_something_is_not_good(sigma: float) -> None:
    """The record is that of a lag behind another one: every value is off by more than its region says."""
    y = lag(TAU, lag(0.2 * TAU)) + np.random.default_rng(4).normal(0.0, sigma, len(U))
    found = calibrated(record(y))
    told = str(found)
    assert found.misfit
    assert found.to_dict()["misfit"] == found.misfit
    assert "misses something" in told
    assert not calibrated(record(noisy())).misfit


def test_the_command_its_files_and_its_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.json"
    for number in (1, 2, 3):
        record(noisy(number)).to_csv(tmp_path / f"rig{number}.csv")
    files = [str(tmp_path / f"rig{number}.csv") for number in (1, 2)]
    line = ["calibrate", "fmu:FirstOrderLag", *files, "--free", "tau=100ms:10s", "--jobs", "1"]
    also = ["--validate", str(tmp_path / "rig3.csv"), "--plot", str(tmp_path / "rig.png"), "--csv", "-"]
    assert run([*line, *also, "--json", str(out), "--report", str(tmp_path / "rig.html")]) == 0
    assert "tau,s,1.0," in capsys.readouterr().out
    data = json.loads(out.read_text(encoding="utf-8"))
    wanted = {
        "parameters", "correlation", "not_identifiable", "fit_percent", "validation", "residuals", "runs", "reason",
        "operating_point",
    }  # fmt: skip
    assert wanted <= data.keys()
    assert {"name", "unit", "start", "value", "std_error", "low", "high", "at_bound", "identifiable"} <= data[
        "parameters"
    ][0].keys()
    assert data["set"]["tau"] == pytest.approx(TAU, rel=0.1)
    assert data["validation_fit_percent"]["y"] > 80.0
    again = wb.CalibrateResult.from_dict(data)
    assert again.parameters[0].value == data["parameters"][0]["value"]
    assert (tmp_path / "rig.png").stat().st_size > 10000
    for wrong, words in (([*line[:2], "--free", "tau"], "--data is missing"), (line[:4], "Missing option '--free'")):
        assert run(wrong) == 2
        assert words in capsys.readouterr().err


def test_frequency_responses_are_data_too(tmp_path: Path) -> None:
    """A table of 1/(τs + 1) with errors of 1 %, and sines at two amplitudes of a stiffening spring."""
    f = np.geomspace(0.02, 2.0, 15)
    value = 1.0 / (2j * np.pi * f * TAU + 1.0)
    scatter = np.random.default_rng(9).normal(0.0, 0.01 / 1.73, (2, len(f)))
    value = value * (1.0 + scatter[0] + 1j * scatter[1])
    rows = np.column_stack([f, np.abs(value), np.degrees(np.angle(value)), np.full(len(f), 0.01)])
    head = "frequency,gain y/u,phase y/u,error y/u"
    np.savetxt(tmp_path / "rig.csv", rows, delimiter=",", header=head, comments="")
    p = calibrated(tmp_path / "rig.csv").of("tau")
    s = 2.0 * np.pi * f * TAU
    information = np.sum((s / np.sqrt(1.0 + s**2) * 1.73 / 0.01) ** 2)  # of ln τ: d ln G/d ln τ = −jωτ/(1 + jωτ)
    assert p.std_error is not None
    assert p.std_error / TAU == pytest.approx(1.0 / math.sqrt(information), rel=0.4)
    assert abs(p.value - TAU) < 4.0 * p.std_error
    with wb.load("fmu:Duffing", tolerance=1e-9, start_values={"cubic": 0.7}) as model:
        sines = wb.nfr(model, "u", "y", [0.05, 0.1], [0.2, 0.5], in_process=True, drift_check=False)
    found = calibrated(sines, {"cubic": None}, model="fmu:Duffing")
    assert found.of("cubic").value == pytest.approx(0.7, rel=1e-3)
    assert [one.of_response for one in found.data] == [True, True]


@pytest.mark.parametrize("suffix", ["toml", "ssp"])
def test_the_estimate_is_a_system_that_runs_as_the_model_does(tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"calibrated.{suffix}"
    found = calibrated(record(noisy()), out=out)
    # A bundled FMU by its name: the file can be moved to another folder, or to another machine.
    assert suffix == "ssp" or 'model = "fmu:FirstOrderLag"' in out.read_text(encoding="utf-8")
    times = (DT * np.arange(len(U))).tolist()
    with wb.load(out) as model:
        again = wb.simulate(
            model, stop=times[-1], inputs={"u": wb.Table(times, U.tolist(), "hold")}, outputs=["y"], points=times[1:],
            in_process=True,
        )  # fmt: skip
    last = {round(t / DT): y for t, y in zip(again.time, again["y"], strict=True)}
    np.testing.assert_allclose([last[k] for k in range(len(U))], lag(found.of("tau").value), atol=1e-5)
    with wb.load("fmu:FirstOrderLag") as model, pytest.raises(InputError, match=r"out: x\.fmu is neither"):
        wb.calibrate(model, record(noisy()), free={"tau": None}, out="x.fmu", in_process=True)


def test_a_study_calibrates(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    assert run(["run", str(tmp_path / "study.toml"), "--no-store", "--jobs", "1"]) == 0


STUDY = """
name = "rig"

[models]
rig = {model = "fmu:FirstOrderLag", set = {tau = 0.6}}
lag = "fmu:FirstOrderLag"

[analyses.record]
command = "excite"
model = "rig"
input = "u"
output = "y"
prbs = {amplitude = 1}
step = 0.1
samples = 200

[analyses.parameters]
command = "calibrate"
model = "lag"
data = {from = "record", as = "csv"}
free = {tau = "0.1:10"}

[[requirements]]
name = "time constant"
analysis = "parameters"
kind = "value"
path = "set.tau"
min = 0.59
max = 0.61
"""


def test_regions_of_data_without_noise_hold_the_truth() -> None:
    """What a looser integration than that of the data leaves: 30 time constants, beside their closed-form lags."""
    held, told = 0, 0
    with wb.load("fmu:FirstOrderLag") as model:
        for seed in range(30):
            rng = np.random.default_rng(seed)
            tau = float(np.exp(rng.uniform(np.log(0.2), np.log(3.0))))
            u = np.repeat(rng.uniform(-1.0, 1.0, 15), 8)
            found = wb.calibrate(model, record(lag(tau, u), u), free={"tau": (0.05, 20.0)}, in_process=True)
            p = found.of("tau")
            assert p.low is not None
            assert p.high is not None
            assert p.value == pytest.approx(tau, rel=1e-4)
            held += p.low <= tau <= p.high
            told += any("the integration leaves more than the noise does" in note for note in found.notes)
    assert held == 30
    assert told > 0


@pytest.mark.parametrize("others", [1, 2])
def test_a_derivative_whose_runs_failed_is_not_no_effect(monkeypatch: pytest.MonkeyPatch, others: int) -> None:
    """Where no run beside the values comes to its end, they are not the estimate, nor what data cannot tell."""
    known = CalibrationProblem.gradient

    def gradient(self: CalibrationProblem, z: Floats, *, central: bool) -> Gradient:
        found = known(self, z, central=central)
        return replace(found, y=tuple(0.0 * one for one in found.y), failed=(0,))

    monkeypatch.setattr(CalibrationProblem, "gradient", gradient)
    if others == 1:
        with pytest.raises(SimulationError, match="runs beside the estimate failed: what tau does there is not known"):
            calibrated(record(noisy()))
        return
    found = calibrated(record(noisy()), free={"tau": (0.1, 10.0), "x": (-1.0, 1.0)})
    assert not found.converged
    assert found.reason == "runs beside the estimate failed: what tau does there is not known"


def test_runs_that_share_steps_are_not_believed_where_events_make_them_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    """A difference by a step of 3e-8 is noise where an event that falls elsewhere moves the outputs by 1e-7."""
    known, rng = ModelRuns.together, np.random.default_rng(4)

    def together(self: ModelRuns, points: Sequence[Floats]) -> list[list[Floats | None]] | None:
        found = known(self, points)
        return found and [[None if y is None else y + 1e-7 * rng.normal(size=y.shape) for y in one] for one in found]

    monkeypatch.setattr(ModelRuns, "together", together)
    found = calibrated(record(lag(TAU)), {"tau": (0.1, 10.0)})
    assert found.parameters[0].value == pytest.approx(TAU, rel=1e-6)
    assert found.parameters[0].identifiable


def test_a_search_on_its_way_is_not_explained_away_as_coloured_noise() -> None:
    """Data without noise: what a search has left is smooth, and its prediction by itself nearly exact."""
    found = calibrated(record(lag(TAU) + 1e-9 * np.random.default_rng(6).normal(size=len(U))), {"tau": (0.1, 10.0)})
    assert found.parameters[0].value == pytest.approx(TAU, rel=1e-7)
