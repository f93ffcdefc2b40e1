"""Clocks of FMI 3.0 tick when the FMU says, in both interfaces, with either driver; closed forms are the truth."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.drivers import each_driver  # noqa: F401  every test runs with each driver
from tests.fmi3_fmus import build_ticking
from tests.mimic_fmus import build_mimic
from workbench.cli.app import run as command
from workbench.errors import InputError, SimulationError
from workbench.signals.kinds import Table
from workbench.system.master.model import MasterModel

RAMP = {"u": Table([0.0, 10.0], [0.0, 10.0])}
NAMES = ["held", "x", "evens", "downs", "down_at", "grows", "grown_at", "even", "counted", "growing", "every2"]
EVEN = 0.05 + 0.1 * np.arange(100)  # when the periodic clock ticks [s]
DOWN = EVEN[2::3] + 0.02  # the countdown: after every third tick
GROWN = np.cumsum(0.1 * 2.0 ** np.arange(8))  # the changing one: intervals 0.1, 0.2, 0.4 …


def expected(time: float) -> dict[str, float]:
    """Return what the model shows at a time that no tick is at, under u = time."""
    ticks, downs, grown = (t[t < time] for t in (EVEN, DOWN, GROWN))
    ends = np.append(ticks[1:], time)
    return {
        "held": ticks[-1],
        "x": float(np.sum(ticks * (ends - ticks))),
        "evens": len(ticks),
        "downs": len(downs),
        "down_at": downs[-1] if len(downs) else -1.0,
        "grows": len(grown),
        "grown_at": grown[-1] if len(grown) else -1.0,
        # Clocks themselves: ticks so far.
        "even": len(ticks),
        "counted": len(downs),
        "growing": len(grown),
        "every2": len(ticks) // 2,
    }


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_each_kind_ticks_when_the_fmu_says(interface: str, tmp_path: Path) -> None:
    file = build_ticking(tmp_path)
    times = [0.04, 0.26, 0.28, 0.71, 0.999, 1.6]
    with wb.load(file, interface, step=0.3 if interface == "cs" else None) as model, model.open_session() as session:
        for time in times:
            session.advance(time, signals=RAMP, record=NAMES)
            if time > 0.05:
                assert session.values(NAMES) == pytest.approx(expected(time), rel=1e-9), time


@pytest.mark.parametrize("state", [True, False])
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_snapshot_holds_when_the_next_ticks_are(interface: str, state: bool, tmp_path: Path) -> None:
    file = build_ticking(tmp_path, state=state)
    with wb.load(file, interface, step=0.1 if interface == "cs" else None) as model, model.open_session() as session:
        session.advance(0.36, signals=RAMP, record=NAMES)
        snapshot = session.snapshot()
        assert model.snapshot_method() == ("state" if state else "replay")
        for _ in range(2):
            session.advance(0.99, signals=RAMP, record=NAMES)
            assert session.values(NAMES) == pytest.approx(expected(0.99), rel=1e-9)
            session.restore(snapshot)
            assert session.values(NAMES) == pytest.approx(expected(0.36), rel=1e-9)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_periods_are_counted_from_the_start_of_the_run(interface: str, tmp_path: Path) -> None:
    with wb.load(build_ticking(tmp_path), interface, start=2.0, step=0.1 if interface == "cs" else None) as model:
        run = wb.simulate(model, stop=2.5, interval=0.01)
    first = {name: run.time[np.flatnonzero(run.signals[name] > 0)[0]] for name in ("evens", "grows", "downs")}
    # In co-simulation a row is recorded at the points asked for, not at the tick itself.
    assert first["evens"] == pytest.approx(2.05, abs=1e-9)
    assert first["grows"] == pytest.approx(2.1, abs=1e-9)
    assert first["downs"] == pytest.approx(2.27, abs=1e-9)


def test_clocks_of_a_system_in_model_exchange_tick(tmp_path: Path) -> None:
    file = build_ticking(tmp_path)
    components = {name: wb.load(file, "me") for name in ("first", "second")}
    inputs, outputs = {"u": "first.u"}, {"x": "second.x"}
    with wb.connect(components, [("first.x", "second.u")], inputs=inputs, outputs=outputs) as system:
        run = wb.simulate(system, stop=0.999, inputs=RAMP, outputs=["first.x", "second.x", "second.evens"])
    assert run.signals["first.x"][-1] == pytest.approx(expected(0.999)["x"], rel=1e-6)
    # The second samples the first one's ramp of pieces at the same ticks, before its slope changes there.
    seen = np.array([expected(t)["x"] if t > 0.05 else 0.0 for t in EVEN[EVEN < 0.999]])
    ends = np.append(EVEN[1 : len(seen)], 0.999)
    assert run.signals["second.x"][-1] == pytest.approx(np.sum(seen * (ends - EVEN[: len(seen)])), rel=1e-6)


@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("step", [None, 0.07], ids=["controlled", "fixed"])
def test_they_tick_beside_components_of_co_simulation(step: float | None, interface: str, tmp_path: Path) -> None:
    components = {"t": wb.load(build_ticking(tmp_path), interface), "a": wb.load("fmu:FirstOrderLag@3", "cs")}
    names = [f"t.{name}" for name in NAMES]
    inputs, outputs = {"u": "t.u"}, {"y": "a.y"}
    with wb.connect(components, [("t.x", "a.u")], inputs=inputs, outputs=outputs, step=step) as system:
        assert not any("t.even" in note for note in system.notes)  # a clock keeps no start value
        # A step that is tried once and then in two halves goes back to the ticks before it.
        assert isinstance(system, MasterModel)
        assert (step is None) == (not system.why_fixed_step())
        with system.open_session() as session:
            for time in (0.28, 0.714, 0.994) if step is None else (0.28, 0.7, 0.98):
                session.advance(time, signals=RAMP, record=names)
                assert session.values(names) == pytest.approx({n: expected(time)[n[2:]] for n in names}, rel=1e-6), time


@pytest.mark.parametrize("count", [20, 30])
def test_in_a_system_they_tick_at_points_that_are_off_by_rounding(count: int, tmp_path: Path) -> None:
    points = np.arange(1, count + 1) / count  # 0.15 = 3 · 0.05 is not 3/20; the kernel must find them the same
    with wb.connect({"t": wb.load(build_ticking(tmp_path), "cs")}, inputs={"u": "t.u"}, outputs={"x": "t.x"}) as system:
        run = wb.simulate(system, stop=1.0, inputs=RAMP, outputs=["t.evens", "t.x"], points=points * (1.0 - 1e-15))
    assert run.signals["t.evens"][-1] == expected(0.9999)["evens"]
    assert run.signals["t.x"][-1] == pytest.approx(expected(0.9999999999)["x"], rel=1e-6)


def test_a_component_with_a_constant_step_keeps_clocks_out(tmp_path: Path) -> None:
    file = build_ticking(tmp_path)
    components = {"t": wb.load(file, "cs"), "c": wb.load(build_mimic(tmp_path, "simulink"), "cs")}
    with pytest.raises(InputError, match=r"component t: clock even ticks at its own instants, but c wants a constant"):
        wb.connect(components, outputs={"x": "t.x"})


def test_where_nothing_lets_them_tick_it_is_said(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = build_ticking(tmp_path)
    with wb.load(file) as model, pytest.raises(InputError, match=r"'even' is a Clock; a signal cannot force it"):
        wb.simulate(model, stop=1.0, inputs={"even": 1.0})
    with pytest.raises(InputError, match=r"every2: this is a Clock, which cannot be set"):
        wb.load(file, start_values={"every2": 1})
    assert command(["info", str(file), "--no-probe", "--json", "-"]) == 0
    clocks = {c["name"]: c for c in json.loads(capfd.readouterr().out)["clocks"]}
    assert [c["driven"] for c in clocks.values()] == [True, True, True, False]
    assert (clocks["even"]["interval"], clocks["even"]["shift"], clocks["even"]["kind"]) == (0.1, 0.05, "constant")
    assert clocks["even"]["variables"] == ["held", "evens", "every2"]


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_an_interval_that_is_none_is_an_error(interface: str, tmp_path: Path) -> None:
    file = build_ticking(tmp_path, behaviour="ticking-backwards")
    with (
        wb.load(file, interface, step=0.1 if interface == "cs" else None) as model,
        model.open_session() as session,
        pytest.raises(SimulationError, match=r"an interval to the next tick that is negative or not finite"),
    ):
        session.advance(1.0, signals={}, record=NAMES)


def test_a_failed_step_leads_to_model_exchange_where_that_is_offered(tmp_path: Path) -> None:
    with (
        wb.load(build_ticking(tmp_path), "cs") as model,
        closing(model.new_instance()) as instance,
        pytest.raises(SimulationError, match=r"fmi3DoStep returned error \(with interface me the workbench"),
    ):
        instance.fail("fmi3DoStep", 3)


def test_scheduled_execution_is_named_and_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = build_ticking(tmp_path, scheduled=True)
    with pytest.raises(InputError, match=r"offers scheduled execution alone: .*export it for co-simulation"):
        wb.load(file)
    assert command(["info", str(file)]) == 0
    shown = capfd.readouterr().out
    assert "scheduled execution, not run here" in shown
    assert "does not run here: scheduled execution is for a scheduler" in shown
