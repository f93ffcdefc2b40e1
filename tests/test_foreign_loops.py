"""The command `limit-cycle` on plants that are not ours, from system files: closed forms and textbook cycles."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from tests.gemseo import gemseo_fmu, needs_gemseo
from workbench.build.fmu import build_fmu
from workbench.build.toolchain import host_only
from workbench.cli.app import run
from workbench.limit_cycles.limit_cycle.free_run import oscillation_history
from workbench.signals.kinds import Table
from workbench.signals.text import parse_signal

STATIC = '"C[1]" = 0.0, "C[2]" = 0.0, D = 1.0'

VAN_DER_POL = f"""
[components]
damping = {{model = "fmu:AlgebraicExpression", set = {{c0 = 0, c1 = 0, c2 = 0, c3 = 0.3333333333333333, {STATIC}}}}}
plant = {{numerator = [0.2, 0.0], denominator = [1.0, -0.2, 1.0]}}
push = {{sum = "+-"}}
[connections]
"damping.u" = "plant.y"
"push.u2" = "damping.y"
"plant.u" = "push.y"
[inputs]
force = "push.u1"
[outputs]
x = "plant.y"
"""

RELAY = """
[components]
relay = "Relay.fmu"
plant = {numerator = [1.0], denominator = [1.0, 3.0, 3.0, 1.0]}
[connections]
"relay.u" = {from = "plant.y", gain = -1.0}
"plant.u" = "relay.y"
[outputs]
y = "plant.y"
"""

MODELICA = """
model Relay "Three-position relay"
  parameter Real level(nominal = 1) = 1 "Output beyond the dead zone";
  parameter Real deadZone(min = 0, nominal = 1) = 0 "Half width in which the output is 0";
  input Real u;
  output Real y;
equation
  y = if u > deadZone then level elseif u < -deadZone then -level else 0;
end Relay;
"""


def limit_cycle(folder: Path, system: str, *arguments: str) -> dict[str, Any]:
    path, out = folder / "system.toml", folder / "out.json"
    path.write_text(system, encoding="utf-8")
    assert run(["limit-cycle", str(path), *arguments, "--json", str(out)]) == 0
    found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return found


def by_method(found: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {c["method"]: c for c in found["limit_cycles"]}


def test_van_der_pol_and_its_growth_from_a_push(tmp_path: Path) -> None:
    """x'' − μ(1 − x²) x' + x = 0: period 2π(1 + μ²/16 − 5μ⁴/3072), maximum 2 + μ²/96 [Andersen & Geer 1982]."""
    found = limit_cycle(
        tmp_path, VAN_DER_POL, "--block", "damping", "--free-run", "120",
        "--input", "force=pulse:value=0.01,duration=0.5", "--plot", str(tmp_path / "cycle.png"),
    )  # fmt: skip
    mu = 0.2
    period = 2.0 * math.pi * (1.0 + mu**2 / 16.0 - 5.0 * mu**4 / 3072.0)
    for name, c in by_method(found).items():
        if name != "describing function":
            assert c["frequency_hz"] == pytest.approx(1.0 / period, rel=5e-6), name
            assert c["amplitude"] == pytest.approx(2.0 + mu**2 / 96.0, abs=1e-4), name
    free = found["free_run"]
    # A small motion grows with the real part of the open loop's poles.
    growth = math.log(free["amplitude"][4] / free["amplitude"][1]) / (free["time"][4] - free["time"][1])
    assert growth == pytest.approx(mu / 2.0, rel=0.02)
    assert free["frequency_hz"][-1] == pytest.approx(1.0 / period, rel=1e-4)
    assert free["amplitude"][-1] == pytest.approx(2.0 + mu**2 / 96.0, rel=2e-3)
    assert (tmp_path / "cycle.png").stat().st_size > 10_000


def test_a_relay_with_a_third_order_lag_and_the_fold_over_its_dead_zone(tmp_path: Path) -> None:
    """The describing function (4/πA)√(1 − (δ/A)²) must be 8, so that A = 1/2π; the cycle itself is known exactly."""
    (tmp_path / "Relay.mo").write_text(MODELICA, encoding="utf-8")
    build_fmu([tmp_path / "Relay.mo"], out=tmp_path / "Relay.fmu", platforms=[host_only()[0].name])
    found = limit_cycle(tmp_path, RELAY, "--block", "relay", "--method", "describing function", "--method", "shooting")
    methods = by_method(found)
    assert methods["describing function"]["amplitude"] == pytest.approx(0.5 / math.pi, rel=1e-6)
    # Tsypkin's exact frequency of this textbook loop; test_limit_cycle.py has the closed form.
    assert methods["shooting"]["frequency_hz"] == pytest.approx(0.271758, rel=1e-5)
    found = limit_cycle(
        tmp_path, RELAY, "--block", "relay", "--set", "relay.deadZone=0.076",
        "--vary", "relay.deadZone=0.075:0.1", "--method", "shooting",
    )  # fmt: skip
    branch = found["branches"][0]
    (fold,) = branch["folds"]
    on = minimize_scalar(
        lambda on: -exact_dead_zone(on)[0], bounds=(0.6, 1.2), method="bounded", options={"xatol": 1e-9}
    )
    dead_zone, frequency = exact_dead_zone(float(on.x))
    assert fold["value"] == pytest.approx(dead_zone, rel=1e-5)
    assert fold["frequency_hz"] == pytest.approx(frequency, rel=1e-4)
    assert [branch["points"][k]["value"] for k in (0, -1)] == pytest.approx([0.075, 0.075])


def exact_dead_zone(on: float) -> tuple[float, float]:
    """Return the dead zone at which the relay is on for `on` in each half period, and the cycle's frequency [Hz].

    With e = −y: x(h) = −x(0) gives x(0) in closed form; e(0) = e(on) is the dead zone [Tsypkin 1984, Section 4].
    """
    a, b, c = np.array([[-3.0, -3.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.eye(3)[0], np.eye(3)[2]
    pushed = np.linalg.solve(a, (expm(a * on) - np.eye(3)) @ b)

    def inputs(half: float) -> tuple[float, float]:
        start = -np.linalg.solve(np.eye(3) + expm(a * half), expm(a * (half - on)) @ pushed)
        return float(-c @ start), float(-c @ (expm(a * on) @ start + pushed))

    half = float(brentq(lambda h: inputs(h)[0] - inputs(h)[1], on + 0.05, 6.0))
    return inputs(half)[0], 0.5 / half


@needs_gemseo
def test_a_third_party_fmu_with_a_saturation_over_its_mass(tmp_path: Path) -> None:
    """Mass m, damper 10, spring 1e4 and a lag 5000/(0.01 s + 1): by Routh 1 + N·L crosses at ω² = (1e4 + 1e3)/m."""
    system = f"""
    [components]
    block = {{model = "fmu:Saturation", set = {{{STATIC}}}}}
    lag = {{numerator = [5000.0], denominator = [0.01, 1.0]}}
    body = "{gemseo_fmu("Mass_Damper")}"
    [connections]
    "lag.u" = {{from = "body.y", offset = 0.5, convert = false}}
    "block.u" = "lag.y"
    "body.f" = {{from = "block.y", gain = -1.0, convert = false}}
    [outputs]
    y = "body.y"
    """
    found = limit_cycle(
        tmp_path, system, "--block", "block", "--method", "describing function", "--method", "simulation"
    )
    (crossing,) = found["crossings"]
    assert crossing["frequency_hz"] == pytest.approx(math.sqrt(11000.0) / (2.0 * math.pi), rel=1e-4)
    assert found["simulated"]["steady"]
    assert found["simulated"]["frequency_hz"] == pytest.approx(crossing["frequency_hz"], rel=1e-3)


# -- histories and pulses ----------------------------------------------------------------------


def test_the_history_of_a_growing_chirp() -> None:
    """Phase 2π(f t + r t²/2), amplitude e^{gt}: each period's frequency and amplitude are those of its middle."""
    f, rate, growth = 2.0, 0.05, 0.1
    time = np.linspace(0.0, 20.0, 40_001)
    value = np.exp(growth * time) * np.sin(2.0 * math.pi * (f * time + 0.5 * rate * time**2))
    history = oscillation_history("x", "m", time, value, centre=0.0)
    assert history.frequency_hz == pytest.approx(f + rate * history.period_time, rel=2e-4)
    assert history.amplitude == pytest.approx(np.exp(growth * history.period_time), rel=5e-3)
    for span in history.spans:
        assert span.growth == pytest.approx(growth, rel=0.03)


def test_a_run_that_changes_its_frequency_says_when(tmp_path: Path) -> None:
    time = np.linspace(0.0, 40.0, 40_001)
    value = np.where(time < 25.0, np.sin(2.0 * math.pi * 3.4 * time), np.sin(2.0 * math.pi * 2.6 * time))
    history = oscillation_history("x", None, time, value)
    words = history.words()
    assert words.startswith("3.4 Hz at first, 2.6 Hz in the end, changing over at about 2")
    assert abs(float(words.split()[-2]) - 25.0) < 2.0
    history.plot(tmp_path / "history.png")
    history.to_csv(tmp_path / "history.csv")
    history.report(tmp_path / "history.html")
    lines = (tmp_path / "history.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == len(history.frequency_hz) + 1
    assert "3.4 Hz at first" in (tmp_path / "history.html").read_text(encoding="utf-8")


def test_nothing_that_moves_asks_for_an_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "system.toml"
    path.write_text(VAN_DER_POL, encoding="utf-8")
    quick = ["--method", "describing function"]
    assert run(["limit-cycle", str(path), "--block", "damping", *quick, "--free-run", "5"]) == 2
    assert "force an input to start the motion (inputs: force)" in capsys.readouterr().err
    assert run(["limit-cycle", str(path), "--block", "damping", *quick, "--input", "force=1"]) == 2
    assert "give its end" in capsys.readouterr().err


def test_pulse_and_gust() -> None:
    pulse, gust = parse_signal("pulse:duration=0.1,value=0.8,time=1"), parse_signal("gust:duration=2,value=3")
    assert isinstance(pulse, Table)
    assert [pulse(t) for t in (0.99, 1.0, 1.09, 1.1, 2.0)] == [0.0, 0.8, 0.8, 0.0, 0.0]
    assert (gust(0.0), gust(1.0), gust(2.5)) == (0.0, 3.0, 0.0)
    assert gust(0.5) == pytest.approx(1.5)
