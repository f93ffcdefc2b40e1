"""Loops with a transport delay: their cycles, gains, linear models and operating points."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import workbench as wb
from workbench.cli.app import run
from workbench.limit_cycles.limit_cycle.result import LimitCycleResult
from workbench.model.described_model import DescribedModel

DELAY, HALF, GAIN = 0.3, 0.1, 8.0
LOOP = """
[components]
s = {{sum = "+-"}}
q = {{block = {block}}}
d = {{block = {delay}}}
p = {{block = "transfer_function", numerator = [{gain}], denominator = [1.0, 1.0]}}

[connections]
"q.u" = "s.y"
"d.u" = "q.y"
"p.u" = "d.y"
"s.u2" = "p.y"

[inputs]
r = "s.u1"

[outputs]
y = "p.y"
"""
RELAY = f'"relay", off_below = {-HALF}, on_above = {HALF}'
SATURATION = '"saturation", lower = -1.0, upper = 1.0'
HELD = '"zero_order_hold", period = 0.1'


def write(folder: Path, block: str, gain: float, delay: str = f'"delay", delay = {DELAY}') -> Path:
    path = folder / "loop.toml"
    path.write_text(LOOP.format(block=block, gain=gain, delay=delay), encoding="utf-8")
    return path


def cycles(model: DescribedModel) -> LimitCycleResult:
    at = wb.OperatingPoint(x={"p.x1": 0.0}, u={"r": 0.0})  # that of a relay is no rest, which takes long to find out
    return wb.limit_cycle(model, block="q", amplitudes=(0.15, 5.0), band=(0.1, 5.0), at=at, in_process=True)


def test_a_relay_behind_a_delay_has_its_exact_cycle(tmp_path: Path) -> None:
    with wb.load(write(tmp_path, RELAY, 1.0)) as model:
        found = {c.method: c for c in cycles(model).limit_cycles}
    # From the switching on the lag goes on for the delay, then turns; the rest is an exponential.
    peak = 1.0 - (1.0 - HALF) * math.exp(-DELAY)
    period = 2.0 * (DELAY + math.log((1.0 + peak) / (1.0 - HALF)))
    assert found["simulation"].frequency_hz == pytest.approx(1.0 / period, rel=1e-6)
    assert found["simulation"].amplitude == pytest.approx(peak, rel=1e-5)
    assert found["simulation"].stable
    assert found["harmonic balance"].frequency_hz == pytest.approx(1.0 / period, rel=1e-2)  # of 7 harmonics

    # The describing function: N = 4/(πA) (√(1 − (h/A)²) − j h/A) turns by −asin(h/A).
    def phase(w: float) -> float:
        size = 4.0 / math.pi / math.hypot(1.0, w)
        return math.pi - w * DELAY - math.atan(w) - math.asin(min(HALF / size, 1.0))

    w = brentq(phase, 1.0, 10.0)
    described = found["describing function"]
    assert described.frequency_hz == pytest.approx(w / (2.0 * math.pi), rel=1e-4)  # the Padé approximation
    assert described.amplitude == pytest.approx(4.0 / math.pi / math.hypot(1.0, w), rel=1e-4)


def test_a_saturation_behind_a_delay_has_the_cycle_of_its_equation(tmp_path: Path) -> None:
    with wb.load(write(tmp_path, SATURATION, GAIN)) as model:
        found = {c.method: c for c in cycles(model).limit_cycles}
    # dx/dt = −x + 8 sat(−x(t − 0.3)), by the trapezoidal rule in steps of a 1500th of the delay.
    h = DELAY / 1500
    x = np.full(200_000, 0.1)
    for k in range(1500, len(x) - 1):
        pushed = -GAIN * 0.5 * (np.clip(x[k - 1500], -1.0, 1.0) + np.clip(x[k - 1499], -1.0, 1.0))
        x[k + 1] = (x[k] * (1.0 - 0.5 * h) + h * pushed) / (1.0 + 0.5 * h)
    late = x[-60_000:]
    rising = np.flatnonzero((late[:-1] < 0.0) & (late[1:] >= 0.0))
    passes = rising - late[rising] / (late[rising + 1] - late[rising])
    frequency = (len(passes) - 1) / (h * (passes[-1] - passes[0]))
    assert found["simulation"].frequency_hz == pytest.approx(frequency, rel=1e-4)
    assert found["simulation"].amplitude == pytest.approx(0.5 * float(np.ptp(late)), rel=1e-4)
    assert found["harmonic balance"].frequency_hz == pytest.approx(frequency, rel=2e-4)
    assert found["harmonic balance"].stable


def test_the_gains_that_stabilise_a_loop_with_a_delay(tmp_path: Path) -> None:
    w = brentq(lambda w: w * DELAY + math.atan(w) - math.pi, 1.0, 10.0)
    with wb.load(write(tmp_path, SATURATION, GAIN)) as model:
        found = wb.feedback(model, source="p.y", target="r", in_process=True)
    # With u = g·y the loop has the gain 8 (1 − g), which may lie between −1 and that at −180°.
    low, high = 1.0 - math.hypot(1.0, w) / GAIN, 1.0 + 1.0 / GAIN
    (pair,) = found.stable_gains
    assert pair == pytest.approx((low, high), rel=1e-4)


@pytest.mark.parametrize(("command", "code"), [("limit-cycle", 2), ("feedback", 0)])
def test_a_sampled_rest_is_no_traceback(
    command: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(write(tmp_path, SATURATION, 1.0, HELD))
    how = {"limit-cycle": ["--block", "q", "--amplitude", "0.15:5"], "feedback": ["--from", "p.y", "--to", "r"]}
    assert run([command, path, *how[command]]) == code
    said = capsys.readouterr()
    assert "the rest of the loop is sampled (0.1 s)" in said.out + said.err
    assert "Traceback" not in said.out + said.err


def test_the_point_of_a_linear_model_is_one_of_the_system(tmp_path: Path) -> None:
    path = write(tmp_path, SATURATION, 1.0)
    with wb.load(path) as model:
        trimmed, linear = wb.trim(model, in_process=True), wb.lin(model, in_process=True)
        (tmp_path / "lin.json").write_text(json.dumps(linear.to_dict()), encoding="utf-8")
        again = wb.simulate(model, stop=0.1, at=tmp_path / "lin.json", in_process=True)
        compared = wb.compare(model, "r", "y", amplitude=0.01, frequencies=[0.2, 1.0], in_process=True)
    assert linear.operating_point.model_sha256 == trimmed.operating_point.model_sha256 != ""
    assert np.allclose(again["y"], 0.0, rtol=0.0, atol=1e-12)
    assert len(compared.verdicts) == 4
    assert all(v.agrees for v in compared.verdicts)
