"""Co-simulation FMUs of FMI 3.0 that ask for inputs inside a step get them there: dx/dt = u − x under u = sin ωt."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.drivers import DRIVERS
from tests.fmi3_fmus import build_sized
from workbench.signals.kinds import Sine, Step

OMEGA, STEP = 3.0, 0.5
PART = STEP / 50.0  # the input is held over that time, at its value in the middle
BOUND = PART**2 * (OMEGA**2 / 24.0 + OMEGA / 12.0)  # |u″| δ²/24 + |u′| δ²/12, once damped with rate 1
SINE = {"u[1]": Sine(frequency=OMEGA / (2.0 * math.pi)), "u[2]": Step(time=1.0, value=1.0)}


def exact(t: np.ndarray) -> np.ndarray:
    return np.asarray((np.sin(OMEGA * t) - OMEGA * np.cos(OMEGA * t) + OMEGA * np.exp(-t)) / (1.0 + OMEGA**2))


def notes_of(file: Path, *, hold: bool = False) -> str:
    with wb.load(file, "cs", hold_inputs=hold) as model:
        return "; ".join(model.notes)


def run(file: Path, *, hold: bool = False) -> wb.SimulationResult:
    with wb.load(file, "cs", step=STEP, hold_inputs=hold) as model:
        return wb.simulate(model, stop=4.0, interval=STEP, inputs=SINE, verify_step=False)


def worst(found: wb.SimulationResult) -> float:
    return float(np.max(np.abs(found.signals["y[1]"] - exact(found.time))))


def test_inputs_are_right_inside_the_step(tmp_path: Path) -> None:
    found = run(build_sized(tmp_path, behaviour="sized-asks"))
    assert worst(found) < BOUND
    assert "inputs: held" not in notes_of(build_sized(tmp_path, behaviour="sized-asks"))
    assert found.signals["y[2]"][-1] == pytest.approx((1.0 - math.exp(-2.0 * 3.0)) / 2.0, rel=1e-9)


def test_a_row_at_the_end_of_a_step_has_the_inputs_that_the_fmu_saw_last(tmp_path: Path) -> None:
    file = build_sized(tmp_path, behaviour="sized-asks")
    with wb.load(file, "cs", step=STEP) as model, model.open_session() as session:
        rows = session.advance(2.0, signals=SINE, record=["y[1]"], points=np.arange(STEP, 2.1, STEP))
    left = np.flatnonzero(np.diff(rows.time) == 0.0)
    assert rows.inputs["u[1]"][left] == pytest.approx(np.sin(OMEGA * rows.time[left]), abs=1e-12)
    jump = int(next(i for i in left if rows.time[i] == 1.0))
    assert rows.inputs["u[2]"][[jump, jump + 1]].tolist() == [0.0, 1.0]


def test_where_they_may_not_be_set_they_are_held_at_the_value_of_the_middle(tmp_path: Path) -> None:
    middle = run(build_sized(tmp_path))
    assert BOUND < worst(middle) < STEP**2 * (OMEGA**2 / 24.0 + OMEGA / 12.0)
    assert "at their value in its middle" in notes_of(build_sized(tmp_path))
    assert worst(run(build_sized(tmp_path, behaviour="sized-asks", between=False))) == pytest.approx(worst(middle))


def test_where_they_should_be_held_they_are_as_at_the_start(tmp_path: Path) -> None:
    held = run(build_sized(tmp_path), hold=True)
    assert worst(held) > 0.1
    assert "half a step late" in notes_of(build_sized(tmp_path), hold=True)
    asks = build_sized(tmp_path, behaviour="sized-asks")
    assert worst(run(asks, hold=True)) == pytest.approx(worst(held))


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
def test_no_input_is_half_a_step_late(driver: str, version: int) -> None:
    def error(step: float) -> float:
        with wb.load(f"fmu:FirstOrderLag@{version}", "cs", step=step) as model:
            found = wb.simulate(model, stop=4.0, interval=0.1, inputs={"u": SINE["u[1]"]}, verify_step=False)
        return float(np.max(np.abs(found.signals["y"] - exact(found.time))))

    coarse, fine = error(0.1), error(0.05)
    assert coarse / fine == pytest.approx(4.0, rel=0.02)  # second order; 2 where they are late


def test_a_run_goes_on_from_a_snapshot_as_it_did(tmp_path: Path) -> None:
    file = build_sized(tmp_path, behaviour="sized-asks")
    with wb.load(file, "cs", step=STEP) as model, model.open_session() as session:
        session.advance(1.2, signals=SINE, record=["y[1]"])
        saved = session.snapshot()
        ends = []
        for _ in range(2):
            session.restore(saved)
            session.advance(3.0, signals=SINE, record=["y[1]"])
            ends.append(session.values(["y[1]"])["y[1]"])
    assert ends[0] == ends[1] == pytest.approx(float(exact(np.array(3.0))), abs=BOUND)


@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
def test_in_a_system_the_masters_inputs_stand_over_a_step(driver: str, tmp_path: Path) -> None:
    ends = []
    for behaviour in ("sized-asks", "sized"):
        asked = wb.load(build_sized(tmp_path, behaviour=behaviour), "cs")
        components = {"a": asked, "b": wb.load("fmu:FirstOrderLag@3", "cs")}
        inputs, outputs = {"u": "a.u[1]"}, {"y": "b.y"}
        joined = wb.connect(components, [("a.y[1]", "b.u")], inputs=inputs, outputs=outputs, step=0.1)
        with joined as system, system.open_session() as session:
            rows = session.advance(2.0, signals={"u": SINE["u[1]"]}, record=["y"], points=np.arange(0.1, 2.05, 0.1))
        ends.append(rows.values["y"])
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)  # who asks makes its step in parts
