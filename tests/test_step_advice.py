"""How long a communication step may be, and how long it takes: against methods whose closed forms are known.

One step of size h of a method multiplies the distance of a linear mode from rest by R(λh); see tests/c/methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.lying_fmus import build_lying
from tests.stub_fmus import write_stub
from workbench.health.check.request import check
from workbench.health.check.result import HealthLine
from workbench.jobs.options import Workers

RATES = (1.0, 50.0)  # [1/s]
NATURAL, STOP = 0.005, 4.0
HERE = Workers(in_process=True)


def euler(z: float) -> float:
    return 1.0 + z


def heun(z: float) -> float:
    return 1.0 + z + z**2 / 2.0


def rk4(z: float) -> float:
    return heun(z) + z**3 / 6.0 + z**4 / 24.0


# Method → R(z), order, and where |R(z)| = 1 on the negative axis.
METHODS: dict[str, tuple[Callable[[float], float], int, float]] = {
    "euler": (euler, 1, 2.0),
    "heun": (heun, 2, 2.0),
    "rk4": (rk4, 4, 2.785293563),
}


def build(folder: Path, method: str) -> Path:
    """Write the FMU of a method of tests/c/methods."""
    names = (("x1", "local", ""), ("x2", "local", ""), ("u", "input", 'start="0"'), ("y", "output", ""))
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{k}" causality="{causality}"><Real {start} /></ScalarVariable>'
        for k, (name, causality, start) in enumerate(names)
    )
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{method}" guid="{{methods-{method}}}">
  <CoSimulation modelIdentifier="methods" canHandleVariableCommunicationStepSize="true" />
  <DefaultExperiment startTime="0" stopTime="{STOP}" stepSize="{NATURAL}" />
  <ModelVariables>{variables}</ModelVariables>
  <ModelStructure><Outputs><Unknown index="4" /></Outputs></ModelStructure>
</fmiModelDescription>
"""
    return write_stub(folder / f"{method}.fmu", "methods", text)


def line(path: str | Path, name: str, *, interface: str = "cs") -> HealthLine:
    return check(path, only=[name], interface=interface, workers=HERE).line(name, "cs")


def true_error(response: Callable[[float], float], h: float) -> float:
    """Return the largest error of y at two neighbouring points, over the range of y."""
    k = np.arange(1.0, math.floor(STOP / h) + 1.0)
    made = sum(response(-rate * h) ** k for rate in RATES)
    true = sum(np.exp(-rate * h * k) for rate in RATES)
    gaps = np.abs(made - true) / np.ptp(np.concatenate([made, true]))
    return float(np.minimum(gaps[1:], gaps[:-1]).max())


@pytest.mark.parametrize("method", METHODS)
def test_the_largest_steps_are_those_of_the_closed_form(tmp_path: Path, method: str) -> None:
    response, order, limit = METHODS[method]
    found = line(build(tmp_path, method), "largest-step").numbers
    assert found["order"] == pytest.approx(order, abs=0.2)
    largest = limit / max(RATES)
    assert found["stable"] == pytest.approx(largest, rel=0.02)
    assert found["stable"] < found["unstable"]
    assert abs(response(-max(RATES) * found["stable"])) <= 1.0  # it never promises too much
    assert true_error(response, found["one_percent"]) == pytest.approx(0.01, rel=0.1)


def test_a_pair_of_complex_poles(tmp_path: Path) -> None:
    """Euler's method for x'' + 0.8 x' + 40 x = u is stable up to 2 ζ/ω = 0.8/40 s."""
    found = line(build_lying(tmp_path, "euler"), "largest-step").numbers
    assert found["stable"] == pytest.approx(0.8 / 40.0, rel=0.03)


def test_what_cannot_be_known_is_not_told(tmp_path: Path) -> None:
    undamped = line(build(tmp_path, "undamped"), "largest-step")
    assert undamped.numbers["stable"] is None
    assert "which steps are stable is not known" in undamped.evidence
    resting = line(build(tmp_path, "resting"), "largest-step")
    assert (resting.verdict, resting.numbers) == ("not applicable", {})
    implicit = line(build(tmp_path, "implicit"), "largest-step").numbers  # stable at any step
    assert implicit["stable"] is implicit["unstable"] is None
    assert implicit["order"] == pytest.approx(1.0, abs=0.2)


def test_a_step_that_only_moving_inputs_show() -> None:
    """The Rudder steps inside: at rest any step is exact; delC at 2 Hz is 7.2 % off at 0.1 s, 0.24 % at 0.02 s."""

    def at(h: float, name: str) -> HealthLine:
        return check("fmu:Rudder", only=[name], interface="cs", step=h, workers=HERE).line(name, "cs")

    coarse, fine = at(0.1, "step"), at(0.02, "step")
    assert (coarse.verdict, fine.verdict) == ("watch", "good")
    assert coarse.numbers["error"] < 1e-6  # inputs at rest
    assert coarse.numbers["swing_error"] == pytest.approx(0.072, rel=0.3)
    assert fine.numbers["swing_error"] == pytest.approx(0.0024, rel=0.3)
    longest = at(0.1, "largest-step").numbers["one_percent"]
    assert at(longest, "step").numbers["swing_error"] == pytest.approx(0.01, rel=0.3)


def test_a_step_whose_effect_is_not_seen_is_unknown() -> None:
    resting = line("fmu:Hysteresis", "step")
    assert (resting.verdict, resting.numbers) == ("not applicable", {})
    assert resting.evidence.startswith("unknown at 0.002 s: nothing moves")


def test_steps_are_timed(tmp_path: Path) -> None:
    """One that sleeps 15 ms in each step of 5 ms is slower than real time, on any machine."""
    slow = line(build(tmp_path, "slow"), "real-time")
    assert (slow.verdict, slow.numbers["late"]) == ("watch", 1.0)
    assert slow.numbers["real_time_factor"] < NATURAL / 0.0149
    assert 0.0149 < slow.numbers["median"] <= slow.numbers["p999"] <= slow.numbers["worst"]
    for version in ("fmu:FirstOrderLag", "fmu:FirstOrderLag@3"):
        card = check(version, only=["real-time"], workers=HERE)
        found = card.line("real-time", "cs").numbers
        assert 0.0 < found["median"] <= found["p999"] <= found["worst"]
        (told,) = card.derived()["step_advice"]
        assert (told["step"], told["real_time_factor"]) == (found["step"], found["real_time_factor"])
