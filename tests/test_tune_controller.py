"""The controller alone as an FMU beside the continuous one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import workbench as wb
from workbench.build.request import Build
from workbench.core.values.arrays import Floats
from workbench.jobs.job import Job
from workbench.study.tune.controller import sampled_controller
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
