"""Experiments on models: every sample against a closed form or the model's equations written a second time."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import workbench as wb
from tests.hybrid_fmus import Hybrid, open_fake
from workbench.cli.app import run
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.data.excite import recording as sampling_module
from workbench.data.excite.request import Excite, excite
from workbench.data.excite.result import ExciteResult
from workbench.data.excite.signals import MultisineDesign, PrbsDesign
from workbench.data.experiment.experiment import read_experiment
from workbench.errors import InputError, SimulationError
from workbench.fmi.variable import Variable
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.model import Model
from workbench.model.load import load
from workbench.session import Session
from workbench.signals.kinds import Signal

PRBS = PrbsDesign(rate=7.0)


def record(name: str, interface: str = "me", **options: object) -> ExciteResult:
    with load(name, interface, tolerance=1e-9) as model:
        return excite(model, model.inputs[0].name, "y", **options)  # type: ignore[arg-type]


def simulated(a: Floats, b: Floats, c: Floats, d: float, u: Floats, dt: float) -> Floats:
    """y[k] of dx/dt = a x + b u with u held, from rest: the matrix exponential of the augmented system."""
    n = len(a)
    step = expm(np.block([[a, b[:, None]], [np.zeros((1, n + 1))]]) * dt)
    x, y = np.zeros(n), []
    for value in u:
        y.append(c @ x + d * value)
        x = step[:n, :n] @ x + step[:n, n] * value
    return np.array(y)


def elevator(side_stick: Floats) -> Floats:
    """The law of modelica_src/ElevatorLaw in flight with flap 0, from rest."""
    stick = np.interp(np.clip(side_stick, -1.0, 1.0), [-1.0, -0.5, 0.5, 1.0], [-1.0, -0.48, 0.48, 1.0])
    demand = 2.0 + np.where(stick >= 0.0, 6.9, 5.8) * stick
    deflection, y = 2.0, []
    for wanted in demand:
        deflection += float(np.clip(wanted - deflection, -30.0 * 0.022, 30.0 * 0.022))
        y.append(deflection)
    return np.array(y)


def both(result: ExciteResult) -> tuple[Floats, Floats]:
    """Return inputs and outputs of both parts, one after the other."""
    assert result.validation is not None
    parts = (result.identification, result.validation)
    return np.concatenate([p.u[:, 0] for p in parts]), np.concatenate([p.y[:, 0] for p in parts])


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_lag_is_recorded_as_it_responds_to_held_inputs(interface: str) -> None:
    result = record("fmu:FirstOrderLag", interface, samples=200, validation_samples=100, dt=0.05, signal=PRBS)
    u, y = both(result)
    exact = simulated(np.array([[-1.0]]), np.ones(1), np.ones(1), 0.0, u, 0.05)
    np.testing.assert_allclose(y, exact, atol=1e-6)
    assert (result.identification.n_samples, result.design.dt, result.y0) == (200, 0.05, {"y": 0.0})
    assert result.identification.time[0] == 0.0
    assert result.validation is not None
    assert result.validation.time[0] == 10.0


def test_the_output_already_contains_the_input_of_its_sample() -> None:
    """The saturation's dynamics have a direct path; small amplitudes do not reach the limit."""
    result = record("fmu:Saturation", samples=300, dt=0.1, signal=PrbsDesign(amplitude=0.1, rate=3.0))
    u, y = both(result)
    a = np.array([[-0.51, -0.42], [0.5, 0.0]])
    exact = simulated(a, np.array([1.0, 0.0]), np.array([0.6407, 0.6794]), 0.43, u, 0.1)
    np.testing.assert_allclose(y, exact, atol=1e-6)
    assert y[0] == pytest.approx(0.43 * u[0])


@pytest.mark.parametrize(("interface", "steady"), [("me", False), ("cs", False), ("cs", True)])
def test_a_sampled_law_sees_every_value_at_its_own_sample(
    monkeypatch: pytest.MonkeyPatch, interface: str, steady: bool
) -> None:
    """Whatever rounding does to the times of 1200 samples; also where co-simulation takes no short steps."""
    if steady:
        monkeypatch.setattr(sampling_module, "_steps_vary", lambda _: False)
    with load("fmu:ElevatorLaw", interface) as model:
        result = excite(
            model, "side_stick", "elevator", samples=800, validation_samples=400, signal=PrbsDesign(rate=30.0)
        )
    u, y = both(result)
    np.testing.assert_allclose(y, elevator(u), atol=1e-12)
    assert result.design.dt == 0.022
    assert result.notes == ("sampled every 0.022 s, the model's own period",)
    assert result.identification.units == {"side_stick": "1", "elevator": "deg"}


def test_an_interval_off_the_models_own_is_told() -> None:
    with load("fmu:ElevatorLaw") as model:
        result = excite(model, "side_stick", "elevator", samples=50, validation_samples=0, dt=0.03)
        double = excite(model, "side_stick", "elevator", samples=50, validation_samples=0, dt=0.044)
    assert "not a multiple of the model's own period 0.022 s" in result.notes[0]
    assert (double.notes, result.validation) == ((), None)


def test_two_rates_are_named() -> None:
    with load("fmu:TwoRateQuantizer") as model:
        result = excite(model, model.inputs[0].name, model.outputs[0].name, samples=5)
    assert result.design.dt == 1.0
    assert "0.00480769, 0.00763359 s" in result.notes[0]


def test_from_an_operating_point_around_its_input() -> None:
    point = OperatingPoint(x={"x": 3.0}, u={"u": 3.0}, y={"y": 3.0})
    result = record("fmu:FirstOrderLag", samples=100, dt=0.05, signal=PRBS, at=point)
    u, y = both(result)
    assert set(u) == {2.0, 4.0}
    assert (result.u0, result.y0, result.notes) == ({"u": 3.0}, {"y": 3.0}, ())
    exact = simulated(np.array([[-1.0]]), np.ones(1), np.ones(1), 0.0, u - 3.0, 0.05)
    np.testing.assert_allclose(y - 3.0, exact, atol=1e-6)


def test_a_point_that_is_not_met_is_refused_and_settling_leads_there() -> None:
    point = OperatingPoint(x={}, u={"u": 3.0}, y={"y": 3.0})
    with pytest.raises(InputError, match="y is 0, not 3"):
        record("fmu:FirstOrderLag", samples=40, dt=0.05, at=point)
    result = record("fmu:FirstOrderLag", samples=40, dt=0.05, at=point, settle=20.0)
    assert result.notes == ()
    assert result.y0["y"] == pytest.approx(3.0, abs=1e-6)
    assert result.identification.time[0] == 20.0
    short = record("fmu:FirstOrderLag", samples=40, dt=0.05, at=point, settle=1.0)
    assert "still moves" in short.notes[0]
    assert "y is 1.89636 after settling, but 3 at the operating point" in short.notes[1]  # 3 (1 - e^-1)


def test_offset_is_the_middle_and_bias_is_added_once() -> None:
    with load("fmu:FirstOrderLag", bias={"u": 2.0}) as model:
        around = excite(model, "u", "y", samples=40, dt=0.05)
        shifted = excite(model, "u", "y", samples=40, dt=0.05, signal=PrbsDesign(offset=1.0))
        led = excite(model, "u", "y", samples=40, dt=0.05, at=OperatingPoint(x={"x": 2.0}, u={"u": 2.0}))
        with pytest.raises(InputError, match="bias: u would be 2, but the operating point has 5 there"):
            excite(model, "u", "y", samples=40, dt=0.05, at=OperatingPoint(x={"x": 5.0}, u={"u": 5.0}))
    assert set(around.identification.u[:, 0]) == {1.0, 3.0}
    assert set(shifted.identification.u[:, 0]) == {2.0, 4.0}
    assert (shifted.u0["u"], set(led.identification.u[:, 0])) == (3.0, {1.0, 3.0})
    assert "let the model settle first" in shifted.notes[0]


def test_a_multisine_is_recorded_when_the_response_is_periodic() -> None:
    design = MultisineDesign(band=(0.2, 5.0), periods=2)
    result = record("fmu:FirstOrderLag", samples=800, dt=0.05, signal=design)
    y = result.identification.y[:, 0]
    assert result.identification.time[0] == pytest.approx(20.0)
    np.testing.assert_allclose(y[:400], y[400:], atol=1e-6)
    ratio = np.fft.rfft(y[:400])[4:101] / np.fft.rfft(result.identification.u[:400, 0])[4:101]
    z = np.exp(2j * np.pi * np.arange(4, 101) / 400)
    np.testing.assert_allclose(ratio, (1.0 - np.exp(-0.05)) / (z - np.exp(-0.05)), atol=1e-5)
    assert result.design.crest_factor[0] < 1.6


def test_several_inputs_are_nearly_uncorrelated() -> None:
    with load("fmu:Rudder") as model:
        result = excite(
            model, ["delC", "mH"], ["del", "piston"], samples=500, dt=0.01, signal=PrbsDesign(amplitude=(1.0, 50.0))
        )
    assert result.identification.u.shape == (500, 2)
    assert result.identification.units == {"delC": "deg", "mH": "N.m", "del": "deg", "piston": "m"}
    assert result.design.cross_correlation is not None
    assert result.design.cross_correlation < 0.2
    assert result.design.amplitude == (1.0, 50.0)


def test_a_coarse_communication_step_is_told() -> None:
    """Explicit Euler inside an FMU whose step follows the interval."""
    result = python_model_result(interface="cs")
    assert any("with half the communication step" in note for note in result.notes)


# -- a model in this process -------------------------------------------------------------------


class Euler(Hybrid):
    """x' = −x + u, output x; fails beyond `fails`."""

    states, inputs = ("x",), ("u",)
    fails = np.inf

    def derivatives(self) -> list[float]:
        return [self.v["u"] - self.v["x"]]

    def output(self) -> None:
        self.v["y"] = self.v["x"] if self.t < self.fails else np.nan


class Failing(Euler):
    fails = 1.001


class PythonModel(Model):
    def __init__(self, make: Callable[[], Hybrid], interface: str) -> None:
        self.name, self.interface, self.solver, self.notes = "Python", interface, "vkm", ()
        self.inputs = (Variable(name="u", causality="input", unit="N"),)
        self.outputs = (Variable(name="y", causality="output"),)
        self.states = (Variable(name="x"),)
        self.parameters = ()
        self.make = make

    def open_session(
        self, *, start_time: float | None = None, step: float | None = None, signals: Mapping[str, Signal] | None = None
    ) -> Session:
        return open_fake(self.make, "vkm", interface=self.interface, step=step)

    def close(self) -> None: ...


def python_model_result(interface: str) -> ExciteResult:
    return excite(PythonModel(Euler, interface), "u", "y", samples=60, dt=0.2, signal=PrbsDesign(rate=1.0))


def test_a_model_in_python_is_excited_as_well() -> None:
    u, y = both(python_model_result("me"))
    np.testing.assert_allclose(y, simulated(-np.eye(1), np.ones(1), np.ones(1), 0.0, u, 0.2), atol=1e-6)


def test_what_was_recorded_before_a_failure_is_kept() -> None:
    told: list[tuple[object, int, int]] = []
    job = Job(lambda what, done, total: told.append((what, done, total)))
    with pytest.raises(SimulationError, match=r"not a finite number"):
        Excite("u", "y", samples=300, dt=0.005, workers=Workers()).run(PythonModel(Failing, "me"), job)
    assert told[-1] == ("200 of 600 samples", 200, 600)
    result = job.partial()
    assert isinstance(result, ExciteResult)
    assert result.identification.n_samples == 200
    assert (result.validation, result.notes) == (None, ("ended early: 200 of 600 samples were recorded",))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"inputs": "uu"}, "inputs: FirstOrderLag has no input 'uu'; did you mean u"),
        ({"outputs": "yy"}, "outputs: FirstOrderLag has no variable 'yy'"),
        ({"outputs": "u"}, "both an input and an output"),
        ({"outputs": []}, "name an input to force and an output to record"),
        ({"dt": None}, "has no sampling period of its own"),
        ({"dt": -1.0}, "dt: -1 is not a positive number [s]"),
        ({"samples": 1}, "samples: 1 is too small; take at least 2"),
        ({"validation_samples": 1}, "validation samples: 1 is too few"),
        ({"settle": -1.0}, "settle: -1 is too small; take at least 0 [s]"),
        ({"at": OperatingPoint(x={"xx": 1.0}, u={})}, "FirstOrderLag has no state 'xx'"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(options: dict[str, object], words: str) -> None:
    usual: dict[str, object] = {"inputs": "u", "outputs": "y", "samples": 20, "dt": 0.1}
    with load("fmu:FirstOrderLag") as model, pytest.raises(InputError) as caught:
        excite(model, **{**usual, **options})  # type: ignore[arg-type]
    assert words in str(caught.value)


# -- results and the command ------------------------------------------------------------------------


def test_the_command_writes_both_parts_the_facts_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(tmp_path / name) for name in ("data.csv", "r.json", "r.png")]
    arguments = ["excite", "fmu:ElevatorLaw", "--input", "side_stick", "--output", "elevator", "--samples", "150"]
    more = ["--prbs", "rate=30", "--csv", files[0], "--json", files[1], "--plot", files[2]]
    assert run([*arguments, *more]) == 0
    captured = capsys.readouterr()
    assert "PRBS of order 8 at 30 Hz" in captured.out
    assert "note: sampled every 0.022 s, the model's own period" in captured.err
    written = json.loads(Path(files[1]).read_text(encoding="utf-8"))
    assert written["files"] == [files[0], str(tmp_path / "data_validation.csv")]
    assert written["design"]["clock"] == 30.0
    for path, part in zip(written["files"], (written, written["validation"]), strict=True):
        data = read_experiment(path)
        assert (data.n_samples, data.units) == (150, {"side_stick": "1", "elevator": "deg"})
        assert data.y[:, 0].tolist() == part["y"]["elevator"]
        assert data.u[:, 0].tolist() == part["u"]["side_stick"]
        assert data.time.tolist() == part["time"]
    np.testing.assert_allclose(
        read_experiment(files[0]).y[:, 0], elevator(read_experiment(files[0]).u[:, 0]), atol=1e-12
    )
    assert Path(files[2]).stat().st_size > 20_000


def test_csv_on_standard_output_is_the_identification_part_alone(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["excite", "fmu:FirstOrderLag", "--inputs", "u", "--outputs", "y", "--step", "0.1", "--samples", "32"]
    assert run([*arguments, "--multisine", "band=0.5:4", "--csv", "-", "--in-process"]) == 0
    captured = capsys.readouterr()
    assert "the validation data are not written" in captured.err
    rows = list(csv.reader(captured.out.splitlines()))
    assert rows[0] == ["time [s]", "u [1]", "y [1]"]
    assert len(rows) == 33


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ([], "a signal is needed: --prbs"),
        (["--prbs", "rate=1", "--multisine", "band=1:2"], "only one of them"),
        (["--prbs", "rat=1"], "did you mean rate"),
        (["--prbs", "rate=1", "--at", "none.json"], "none.json: cannot be read"),
        (["--prbs", "rate=1", "--csv", "nowhere/x.csv"], "does not exist"),
    ],
)
def test_bad_input_to_the_command_is_one_line(more: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["excite", "fmu:FirstOrderLag", "--input", "u", "--output", "y", "--step", "0.1", *more]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert words in captured.err


def test_a_signal_over_time_is_no_design() -> None:
    with (
        wb.load("fmu:FirstOrderLag") as lag,
        pytest.raises(wb.InputError, match="a Step is no design of an experiment"),
    ):
        wb.excite(lag, "u", "y", signal=wb.Step(time=0.1, value=1.0), dt=0.1, samples=64)  # type: ignore[arg-type]


def test_values_where_names_are_wanted_are_not_dropped() -> None:
    with wb.load("fmu:FirstOrderLag") as lag:
        with pytest.raises(wb.InputError, match="has values; names alone are wanted"):
            wb.trim(lag, free={"u": 2.0})  # type: ignore[arg-type]
        with pytest.raises(wb.InputError, match="has values; names alone are wanted"):
            wb.lin(lag, inputs={"u": 2.0})  # type: ignore[arg-type]
