"""Time histories as results."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.hybrid_fmus import Hybrid, open_fake
from tests.mimic_fmus import build_mimic
from workbench.data.experiment.formats import read_columns
from workbench.errors import InputError
from workbench.fmi.variable import Variable
from workbench.model import Model
from workbench.model.load import load
from workbench.response.simulate.request import simulate
from workbench.response.simulate.result import SimulationResult
from workbench.session import Session
from workbench.signals.kinds import Constant, Signal, Step


class Integrator(Hybrid):
    states = ("x",)
    inputs = ("u",)

    def derivatives(self) -> list[float]:
        return [self.v["u"]]

    def output(self) -> None:
        self.v["y"] = self.v["x"]


class IntegratorModel(Model):
    def __init__(self) -> None:
        self.name, self.interface, self.solver, self.notes = "Integrator", "me", "vkm", ()
        self.inputs = (Variable(name="u", causality="input", unit="N"),)
        self.outputs = (Variable(name="y", causality="output"),)
        self.states = (Variable(name="x"),)
        self.parameters = ()

    def open_session(
        self, *, start_time: float | None = None, step: float | None = None, signals: Mapping[str, Signal] | None = None
    ) -> Session:
        return open_fake(Integrator, "vkm")

    def close(self) -> None: ...


def run() -> SimulationResult:
    return simulate(IntegratorModel(), stop=1.0, inputs={"u": Step(time=0.5, value=2.0)}, interval=0.25)


def test_the_result_holds_outputs_then_forced_inputs() -> None:
    result = run()
    assert result.time.tolist() == [0.0, 0.25, 0.5, 0.5, 0.75, 1.0]
    assert list(result.signals) == ["y", "u"]
    assert result.signals["y"] == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.5, 1.0])
    assert result.signals["u"].tolist() == [0.0, 0.0, 0.0, 2.0, 2.0, 2.0]
    assert result.units == {"y": None, "u": "N"}


def test_the_right_limit_at_the_end_is_there() -> None:
    result = simulate(IntegratorModel(), stop=1.0, inputs={"u": Step(time=1.0, value=2.0)}, interval=0.5)
    assert result.time.tolist() == [0.0, 0.5, 1.0, 1.0]
    assert result.signals["u"].tolist() == [0.0, 0.0, 0.0, 2.0]


def test_files_and_pictures(tmp_path: Path) -> None:
    result = run()
    result.to_csv(tmp_path / "out.csv")
    rows = list(csv.reader((tmp_path / "out.csv").read_text().splitlines()))
    assert rows[0] == ["time [s]", "y", "u [N]"]
    assert np.array(rows[1:], dtype=float)[:, 1].tolist() == result.signals["y"].tolist()
    assert json.loads(json.dumps(result.to_dict()))["signals"]["u"][-1] == 2.0
    figure = result.plot()
    assert [axes.get_ylabel() for axes in figure.axes] == ["y", "u [N]"]
    figure.savefig(tmp_path / "out.png")
    assert (tmp_path / "out.png").stat().st_size > 1000


@pytest.mark.parametrize("points", [[0.0, 0.2, 0.4], [0.2, 0.4]])
def test_the_start_may_be_one_of_the_points(points: list[float]) -> None:
    assert simulate(IntegratorModel(), stop=0.4, points=points).time.tolist() == [0.0, 0.2, 0.4]


@pytest.mark.parametrize("points", [None, [0.1, 0.4]])
def test_points_or_interval(points: list[float] | None) -> None:
    result = simulate(IntegratorModel(), stop=0.4, interval=None if points else 0.3, points=points)
    assert result.time == pytest.approx([0.0, 0.1, 0.4] if points else [0.0, 0.3, 0.4])


def test_points_and_interval_are_refused() -> None:
    with pytest.raises(InputError, match="points: are recorded instead of rows at an `interval`; give one of the two"):
        simulate(IntegratorModel(), stop=1.0, points=[0.5], interval=0.1)


@pytest.mark.parametrize("step", [0.01, 0.05])  # with communication points between, and without
def test_co_simulation_keeps_the_rows_that_were_asked_for_and_both_sides_of_a_jump(step: float) -> None:
    points = np.array([0.1, 0.15]) if step == 0.01 else [0.05, 0.1, 0.15]
    with load("fmu:Saturation", "cs", step=step) as model:
        result = simulate(model, stop=0.15, inputs={"u": Step(time=0.1, value=0.5)}, points=points, in_process=True)
    assert result.time.tolist() == [0.0, *points[:-1], *points[-2:]]
    assert result.signals["u"].tolist()[-3:] == [0.0, 0.5, 0.5]
    assert result.signals["y"][-3] == 0.0 < result.signals["y"][-2]


def test_points_lie_on_the_grid_of_a_constant_communication_step() -> None:
    model = IntegratorModel()
    model.grid = 0.03
    at = simulate(model, stop=30.0, inputs={"u": Constant(1.0)}).time
    steps = np.unique(np.round(at / 0.03, 9))
    assert np.array_equal(steps, np.round(steps))
    assert len(steps) == 501  # 500 points of 0.06 s


def test_wrong_input_is_refused() -> None:
    model = IntegratorModel()
    with pytest.raises(InputError, match="is an output; its inputs are: u"):
        simulate(model, stop=1.0, inputs={"y": Constant(1.0)})
    with pytest.raises(InputError, match="has no input 'v'; known: u"):
        simulate(model, stop=1.0, inputs={"v": Constant(1.0)})
    with pytest.raises(InputError, match="has no variable 'yy'; did you mean y"):
        simulate(model, stop=1.0, outputs=["yy"])
    with pytest.raises(InputError, match="stop: must be after the start"):
        simulate(model, stop=-1.0)
    with pytest.raises(InputError, match="interval must be positive"):
        simulate(model, stop=1.0, interval=0.0)


def test_local_variables_have_their_units() -> None:
    with load("fmu:Rudder") as model:
        result = simulate(model, stop=0.1, outputs=["spoolTarget", "del"])
    assert result.units == {"spoolTarget": "m", "del": "deg"}


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_an_output_that_stops_being_a_number_is_missing_and_the_others_go_on(tmp_path: Path, interface: str) -> None:
    model = wb.load(build_mimic(tmp_path, "undefined"), interface=interface)
    result = wb.simulate(model, stop=2.0)
    late = result.time >= 0.51
    assert np.isnan(result.signals["y"][late]).all()
    assert np.isfinite(result.signals["y"][result.time < 0.49]).all()
    # dx/dt = v, dv/dt = 100 (1 - x) - 4 v from rest: v = (100/w) exp(-2 t) sin(w t), w² = 100 - 4
    w = math.sqrt(96.0)
    v = 100.0 / w * np.exp(-2.0 * result.time) * np.sin(w * result.time)
    assert result.signals["v"] == pytest.approx(v, abs=0.2)
    said = [n for n in result.notes if n.startswith("y is not a finite number from t = 0.5")]
    assert len(said) == 1
    assert not any(np.diff(result.time) == 0.0)
    result.to_csv(tmp_path / "y.csv")
    again = SimulationResult.from_dict(json.loads(json.dumps(result.to_dict(), allow_nan=False)))
    assert np.array_equal(again.signals["y"], result.signals["y"], equal_nan=True)
    result.report(tmp_path / "y.html")
    with pytest.raises(wb.SimulationError, match="y is nan, not a finite number"):
        wb.simulate(model, stop=2.0, outputs=["y"])
    assert wb.nfr(model, "u", "v", amplitudes=[1.0], frequencies=[2.0]).gain.shape == (1, 1)


def test_columns_of_a_csv_have_units_and_are_read_back(tmp_path: Path) -> None:
    """The heading is "name [unit]", in which a file of data and a signal find the unit again."""
    with wb.load("fmu:Rudder") as rudder:
        run = wb.simulate(rudder, stop=0.05, inputs={"delC": "1"}, outputs=["del"])
        run.to_csv(tmp_path / "run.csv")
        response = wb.nfr(rudder, "delC", "del", [3.0], [1.0])
        response.to_csv(tmp_path / "response.csv")
    heading = (tmp_path / "run.csv").read_text().partition("\n")[0]
    assert heading == "time [s],del [deg],delC [deg]"
    table = read_columns(tmp_path / "run.csv")
    assert (table.names, table.units) == (("time", "del", "delC"), ("s", "deg", "deg"))
    heading = (tmp_path / "response.csv").read_text().partition("\n")[0]
    assert heading.startswith("amplitude [deg],frequency_hz,gain,gain_db,phase_deg,offset [deg],error,")


def test_samples_of_an_fmu_at_a_late_start() -> None:
    """sample(0, 0.022) ticks at multiples of 0.022 s, also where rounding is a part of that.

    The last one before the end of a run is not moved there.
    """
    period = Fraction(22, 1000)
    for start in (1e6, 1e8, 1e9):
        first, last = (math.floor(Fraction(t) / period) for t in (start, start + 0.5))
        with wb.load("fmu:ElevatorLaw", "me", start=start) as law:
            moved = {"side_stick": wb.Sine(frequency=0.7, start=start)}  # so that each sample changes the output
            time = wb.simulate(law, stop=start + 0.5, inputs=moved, outputs=["elevator"]).time
        assert time[1:][np.diff(time) == 0.0].tolist() == [float(k * period) for k in range(first + 1, last + 1)]
