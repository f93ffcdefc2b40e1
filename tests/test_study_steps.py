"""What a co-simulation's communication step leaves unknown of a signal, up to the verdict of a study."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import workbench as wb
from tests.lying_fmus import build_lying
from workbench.errors import InputError
from workbench.study.requirements import read_requirement
from workbench.study.requirements.base import Compliance, NotMeasured

TIME = np.linspace(0.0, 10.0, 1001)


def lag(change: float) -> dict[str, Any]:
    """The step response of a lag, and what half the communication step changes."""
    return {
        "command": "simulate",
        "time": TIME.tolist(),
        "signals": {"y": (1.0 - np.exp(-TIME)).tolist(), "u": [1.0] * len(TIME)},
        "units": {"y": None, "u": None},
        "step_change": {"y": [change] * len(TIME)},
    }


def find(kind: str, *results: dict[str, Any], **options: Any) -> Compliance:  # noqa: ANN401
    requirement = read_requirement({"name": "r", "analysis": "a", "kind": kind, **options}, "here")
    requirement.check("here", [result["command"] for result in results])
    return requirement.find(results)


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("final value", {"output": "y", "min": 0.99}),  # by 0.00995
        ("peak", {"output": "y", "max": 1.01}),
        ("overshoot", {"output": "y", "final": 1.0, "max": 1.0}),  # [%]
        ("settling time", {"output": "y", "final": 1.0, "max": 4.2}),  # 3.91 s, slope 0.02 1/s: 0.006 are 0.36 s
        ("rise time", {"output": "y", "final": 1.0, "max": 2.25}),  # 2.197 s
        ("value", {"path": "signals.y[-1]", "min": 0.99}),
        ("value", {"path": "signals.y[*]", "max": 1.01}),
    ],
)
def test_a_limit_within_what_the_step_changes_is_not_met(kind: str, options: dict[str, Any]) -> None:
    assert find(kind, lag(0.0), **options).passed
    assert find(kind, lag(1e-5), **options).passed
    with pytest.raises(NotMeasured, match=r"is known to ± .* only, which half the communication step changes"):
        find(kind, lag(0.006), **options)


def test_twice_the_change_is_the_error() -> None:
    margin = 1.0 - math.exp(-10.0) - 0.9
    assert find("final value", lag(0.49 * margin), output="y", min=0.9).where.endswith("by the communication step")
    with pytest.raises(NotMeasured):
        find("final value", lag(0.51 * margin), output="y", min=0.9)


def test_what_is_violated_stays_violated() -> None:
    assert find("final value", lag(0.4), output="y", min=1.1).verdict == "violated"


def test_numbers_that_agree_by_less_than_their_errors_are_not_known_to() -> None:
    asked: dict[str, Any] = {"path": "signals.y[-1]", "with": "b", "tolerance": 0.01}
    assert find("agreement", lag(0.002), lag(0.002), **asked).passed
    with pytest.raises(NotMeasured, match=r"known to ± 0.012 only"):
        find("agreement", lag(0.003), lag(0.003), **asked)


def test_forced_inputs_are_exact() -> None:
    assert find("value", lag(0.4), path="signals.u[-1]", min=0.9).passed
    with pytest.raises(InputError, match="nothing"):
        find("value", lag(0.4), path="signals.nothing[-1]", min=0.9)


def test_simulate_keeps_what_half_the_step_changes(tmp_path: Path) -> None:
    fmu = build_lying(tmp_path, "euler")
    whole = wb.simulate(wb.load(fmu, interface="cs"), stop=1.0, inputs={"u": wb.Constant(1.0)})
    half = wb.simulate(
        wb.load(fmu, interface="cs", step=0.005), stop=1.0, interval=0.01, inputs={"u": wb.Constant(1.0)}
    )
    last = np.append(whole.time[1:] > whole.time[:-1], True)
    for name, change in whole.step_change.items():
        assert change.shape == whole.time.shape
        at = np.searchsorted(half.time, whole.time[last] + 1e-9) - 1
        np.testing.assert_allclose(change[last], np.abs(whole.signals[name][last] - half.signals[name][at]), atol=1e-12)
    assert max(float(change.max()) for change in whole.step_change.values()) > 1e-4
    assert wb.simulate(wb.load(fmu, interface="cs"), stop=1.0, verify_step=False).step_change == {}
    assert wb.simulate(wb.load(fmu, interface="me"), stop=1.0).step_change == {}
    assert "step_change" not in next(iter(whole.rows()))


def test_a_study_does_not_pass_by_less_than_the_step_changes(tmp_path: Path) -> None:
    fmu = build_lying(tmp_path, "euler")
    run = wb.simulate(wb.load(fmu, interface="cs"), stop=1.0, inputs={"u": wb.Step(time=0.1, value=1.0)})
    final, change = float(run.signals["y"][-1]), float(run.step_change["y"][-1])
    assert change > 0.0
    (tmp_path / "s.toml").write_text(
        f"""
models.m = {{model = "{fmu.name}", interface = "cs"}}
analyses.a = {{command = "simulate", model = "m", stop = 1.0, input = "u=step:time=0.1,value=1", output = ["y"]}}
[[requirements]]
name = "near"
analysis = "a"
kind = "final value"
min = {final - 0.5 * change!r}
[[requirements]]
name = "far"
analysis = "a"
kind = "final value"
min = {final - 3.0 * change!r}
""",
        encoding="utf-8",
    )
    result = wb.run_study(tmp_path / "s.toml", store=None)
    assert [c.finding.verdict for c in result.checked] == ["failed", "passed"]
    assert "1 of 2 requirements is not met: near" in result.words
    result.to_junit(tmp_path / "s.xml")
    (failure,) = ET.parse(tmp_path / "s.xml").getroot().iter("failure")  # noqa: S314 - written above
    assert "half the communication step changes" in failure.attrib["message"]
