"""The controller alone as an FMU beside the continuous one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

import workbench as wb
from workbench.build.request import Build
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.study.tune.controller import sampled_controller, write_controller
from workbench.study.tune.request import Tune
from workbench.system.files.read import read_system

CONTROLLER = """
[components]
pid = {block = "pid", proportional = 2.0, integral = 3.0, derivative = 0.1, filter = 0.05, lower = -1.0, upper = 1.0}
shape = {block = "lead_lag", gain = 1.0, lead = 0.1, lag = 0.05}
[connections]
"shape.u" = {from = "pid.y", gain = 2.0}
[inputs]
e = "pid.u"
[outputs]
u = "shape.y"
"""


def test_the_controller_alone_is_sampled_and_near_the_continuous_one(tmp_path: Path) -> None:
    # Its output has limits: the integral must not wind up while it stands at one.
    file = tmp_path / "controller.toml"
    file.write_text(CONTROLLER, encoding="utf-8")
    (tmp_path / "Controller.mo").write_text(
        sampled_controller(read_system(file), ["pid.integral", "shape.lead"], 0.0025, "Controller"), encoding="utf-8"
    )
    fmu = tmp_path / "Controller.fmu"
    Build(out=fmu, platforms=("host",)).run([tmp_path / "Controller.mo"], Job())
    points: Floats = 0.01 * np.arange(1, 400, dtype=np.float64) + 0.005
    error = wb.Table([0.0, 1.0, 1.0001, 4.0], [1.0, 1.0, -0.3, -0.3], "linear")
    with wb.load(file) as continuous:
        exact = wb.simulate(continuous, stop=4.0, inputs={"e": error}, outputs=["u"], points=points)
    with wb.load(fmu) as sampled:
        found = wb.simulate(sampled, stop=4.0, inputs={"pid_in": error}, outputs=["shape_out"], points=points)
    rows = [np.searchsorted(run.time, points) for run in (exact, found)]
    difference = found["shape_out"][rows[1]] - exact["u"][rows[0]]
    away = (np.abs(points - 1.0) > 0.2) & (points > 0.2)  # steps of the error pass through the lead
    assert (
        np.abs(difference[away]).max() < 0.05
    )  # of a range of 4; it falls with the period; a windup makes it 2 and more


@pytest.mark.parametrize("fmi", [2, 3])
def test_in_fmpy_it_is_near_the_continuous_one(tmp_path: Path, fmi: int) -> None:
    """Sampled at 100 Hz, the error a triangle that holds the controller at its limits and brings it back."""
    file, fmu = tmp_path / "controller.toml", tmp_path / "Controller.fmu"
    file.write_text(CONTROLLER, encoding="utf-8")
    source = tmp_path / "Controller.mo"
    write_controller(read_system(file), ["pid.integral", "shape.lead"], 0.01, source)
    Build(out=fmu, fmi=fmi, platforms=("host",)).run([source], Job())
    assert fmpy.read_model_description(str(fmu)).fmiVersion.startswith(str(fmi))
    times, values = [0.0, 1.0, 3.0, 4.0], [0.0, 1.0, -1.0, 0.0]
    points: Floats = 0.01 * np.arange(1, 400, dtype=np.float64) + 0.005
    with wb.load(file) as continuous:
        exact = wb.simulate(continuous, stop=4.0, inputs={"e": wb.Table(times, values, "linear")}, outputs=["u"],
                            points=points)  # fmt: skip
    error = np.array(list(zip(times, values, strict=True)), dtype=[("time", float), ("pid_in", float)])
    found: Any = fmpy.simulate_fmu(
        str(fmu), stop_time=4.0, output_interval=0.005, input=error, output=["shape_out"], fmi_type="CoSimulation",
    )  # fmt: skip
    own = exact["u"][np.searchsorted(exact.time, points)]
    difference = np.interp(points, found["time"], found["shape_out"]) - own
    assert own.min() < -2.0
    assert own.max() > 2.0  # both limits are reached, and the lead goes beyond them
    assert np.abs(difference).max() < 0.05 * 4.0  # of the range; in proportion to the period
    assert np.sqrt(np.mean(difference**2)) < 0.02 * 4.0


def test_the_version_that_is_asked_is_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[Build] = []
    monkeypatch.setattr(Build, "run", lambda request, *_: built.append(request))
    file = tmp_path / "controller.toml"
    file.write_text(CONTROLLER, encoding="utf-8")
    for fmi in (2, 3):
        write_controller(read_system(file), ["pid.integral"], 0.01, tmp_path / "Controller.fmu", fmi)
    assert [request.fmi for request in built] == [2, 3]


@pytest.mark.parametrize(
    ("asked", "words"),
    [({"out": "c.mo", "sample": 0.01, "fmi": 3}, "only a controller in a file .fmu"),
     ({"out": "c.fmu", "sample": 0.01, "fmi": 1}, "1 is not 2 or 3")],
)  # fmt: skip
def test_versions_that_cannot_be_asked(asked: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Tune(free={"gain.gain": (0.1, 1.0)}, study=Path("wanted.toml"), **asked)


def controller_of(block: str, name: str, folder: Path) -> str:
    file = folder / "one.toml"
    file.write_text(f'components.c = {block}\ninputs.u = "c.u"\noutputs.y = "c.y"\n', encoding="utf-8")
    return sampled_controller(read_system(file), [f"c.{name}"], 0.01, "One")


@pytest.mark.parametrize(("block", "name"), [
    ('{block = "biquad"}', "gain"),
    ('{block = "lead_lag", gain = -1.0, lead = 0.1, lag = 0.02}', "lead"),
    ('{block = "pid", proportional = -0.5, integral = -2.0, derivative = -0.1}', "integral"),
])  # fmt: skip
def test_a_sign_does_not_follow_an_operator(block: str, name: str, tmp_path: Path) -> None:
    """Modelica's grammar: neither `a + -b` nor `a * -b` is an expression."""
    assert not re.search(r"[-+*/] -", controller_of(block, name, tmp_path))


def test_an_integrator_with_limits_is_not_sampled_without_them(tmp_path: Path) -> None:
    assert "when sample" in controller_of('{block = "integrator"}', "gain", tmp_path)
    with pytest.raises(InputError, match="an integrator with limits or a start"):
        controller_of('{block = "integrator", upper = 0.2}', "gain", tmp_path)
