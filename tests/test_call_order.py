"""The order in which an FMU is called: the standard's own, and the other legal one where the first is refused."""

# ruff: noqa: ANN401  what crosses the C interface has no type worth a name

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drivers import each_driver
from tests.foreign_fmus import build_shy
from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.hybrid_fmus import ERROR, OK, FakeC, open_fake
from tests.test_session_events import Lag
from workbench.errors import SimulationError
from workbench.jobs.options import Workers
from workbench.model.base import Model
from workbench.model.load import load
from workbench.response.nfr.request import nfr
from workbench.response.simulate.request import simulate
from workbench.session.fmu import FmuSession
from workbench.signals.kinds import Constant
from workbench.system.connect import connect

__all__ = ["each_driver"]


class Ordered(FakeC):
    """Writes down what is called before continuous time begins."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.calls: list[str] = []

    def _note(self, name: str, status: int) -> int:
        if self.mode != "continuous" or name == "fmi2EnterContinuousTimeMode":
            self.calls.append(name)
        return status

    def fmi2SetupExperiment(self, c: Any, u: int, tolerance: float, start: float, *rest: Any) -> int:
        return self._note("fmi2SetupExperiment", super().fmi2SetupExperiment(c, u, tolerance, start, *rest))

    def fmi2SetReal(self, c: Any, vr: Any, n: int, values: Any) -> int:
        return self._note("fmi2SetReal", super().fmi2SetReal(c, vr, n, values))

    def fmi2SetTime(self, c: Any, t: float) -> int:
        return self._note("fmi2SetTime", super().fmi2SetTime(c, t))

    def fmi2EnterInitializationMode(self, c: Any) -> int:
        return self._note("fmi2EnterInitializationMode", super().fmi2EnterInitializationMode(c))

    def fmi2ExitInitializationMode(self, c: Any) -> int:
        return self._note("fmi2ExitInitializationMode", super().fmi2ExitInitializationMode(c))

    def fmi2NewDiscreteStates(self, c: Any, info: Any) -> int:
        return self._note("fmi2NewDiscreteStates", super().fmi2NewDiscreteStates(c, info))

    def fmi2EnterContinuousTimeMode(self, c: Any) -> int:
        return self._note("fmi2EnterContinuousTimeMode", super().fmi2EnterContinuousTimeMode(c))


class TimeFirst(FakeC):
    """Refuses the first event iteration until it is told the time in event mode, which FMI 2.0 allows."""

    told = False

    def fmi2SetTime(self, _c: Any, t: float) -> int:
        self.told = self.told or self.mode == "event"
        self.m.t = t
        return OK

    def fmi2NewDiscreteStates(self, c: Any, info: Any) -> int:
        return super().fmi2NewDiscreteStates(c, info) if self.told else ERROR


class Refusing(FakeC):
    """Refuses every event iteration."""

    def fmi2NewDiscreteStates(self, _c: Any, _info: Any) -> int:
        return ERROR


def swing(t: float) -> float:
    """x of `Lag` from rest under u = 1."""
    w = math.sqrt(100.0 - 0.01)
    return 0.01 * (1.0 - math.exp(-0.1 * t) * (math.cos(w * t) + 0.1 / w * math.sin(w * t)))


def run(session: FmuSession) -> float:
    with session:
        session.advance(0.7, signals={"u": Constant(1.0)})
        return session.values(["x"])["x"]


def test_the_first_calls_are_those_of_the_standard() -> None:
    with open_fake(Lag, c=Ordered, bias={"u": 0.5}) as session:
        c: Any = session.instance.c  # type: ignore[attr-defined]
        # FMI 2.0.4, 3.2.3: inputs are set in initialisation; the time is told in continuous time alone.
        assert c.calls == [
            "fmi2SetupExperiment",
            "fmi2EnterInitializationMode",
            "fmi2SetReal",
            "fmi2ExitInitializationMode",
            "fmi2NewDiscreteStates",
            "fmi2EnterContinuousTimeMode",
        ]


def test_an_fmu_that_refuses_the_time_in_event_mode_runs() -> None:
    session = open_fake(Lag)  # FakeC does so
    assert not session.setup.manners.note
    assert run(session) == pytest.approx(swing(0.7), abs=1e-8)


def test_an_fmu_that_wants_the_time_first_gets_it() -> None:
    session = open_fake(Lag, c=TimeFirst)
    assert "the time set again before its first event iteration" in session.setup.manners.note
    assert "fmi2NewDiscreteStates returned error" in session.setup.manners.note
    assert run(session) == pytest.approx(swing(0.7), abs=1e-8)


def test_what_begins_late_is_told_the_time_where_it_does_not_mind() -> None:
    """Exports that initialise at 0 whatever start time they are told would keep relations of 0 else."""
    session = open_fake(Lag, c=TimeFirst, start_time=3.0)
    assert not session.setup.manners.note
    session.close()
    session = open_fake(Lag, start_time=3.0)  # FakeC refuses it
    assert not session.setup.manners.note
    with session:
        session.advance(3.7, signals={"u": Constant(1.0)})
        assert session.values(["x"])["x"] == pytest.approx(swing(0.7), abs=1e-8)


@needs_gemseo
def test_an_export_that_begins_at_0_is_set_right_or_told() -> None:
    """OpenModelica's: y = min(t, 1), and m s'' + d s' + c s = f, whose first step goes from 0 to 5.001 s."""
    with load(gemseo_fmu("ramp"), "me") as model:
        assert set(simulate(model, start_time=5.0, stop=6.0).signals["out"]) == {1.0}
    with load(gemseo_fmu("ramp"), "cs") as model:  # without states nothing is integrated
        assert _told(model, start_time=5.0, stop=5.01) == []
    with load(gemseo_fmu("Mass_Damper"), "cs") as model:
        assert _told(model, stop=0.01) == []
        (note,) = _told(model, start_time=5.0, stop=5.01)
        assert note.startswith("the FMU ignores the start time 5 s and begins at 0: its first step goes from 0 to")
    with load(gemseo_fmu("MassSpringSystem"), "cs") as model:  # of a newer OpenModelica
        assert _told(model, start_time=5.0, stop=5.01) == []


def _told(model: Model, *, stop: float, start_time: float | None = None) -> list[str]:
    """Notes on a run, but those on what it was not given: a step, a signal."""
    notes = simulate(model, start_time=start_time, stop=stop, verify_step=False).notes
    return [note for note in notes if not note.startswith(("communication step: ", "no input is forced"))]


def test_an_fmu_that_refuses_both_orders_is_refused_once() -> None:
    with pytest.raises(SimulationError, match=r"Lag: fmi2NewDiscreteStates returned error \(at t = 0 s\)"):
        open_fake(Lag, c=Refusing)


def level(t: float, *, jump: bool) -> float:
    """x of the shy FMU from rest under u = 2; it jumps to 0 at 1 s."""
    return 2.0 * (1.0 - math.exp(-(t - 1.0 if jump and t >= 1.0 else t)))


@pytest.mark.parametrize(("name", "words"), [("instantiate", "cannot be instantiated"), ("update", "rejects it")])
def test_event_mode_that_is_declared_and_refused_is_left_out(tmp_path: Path, name: str, words: str) -> None:
    points = np.linspace(0.03, 1.5, 50)
    with load(build_shy(tmp_path, name), step=0.01) as model:
        result = simulate(model, stop=1.5, inputs={"u": Constant(2.0)}, points=points, in_process=True)
        (remark,) = model.remarks()
        assert remark in result.notes
        assert "declares event mode" in remark
        assert words in remark
        truth = [level(t, jump=False) for t in result.time]
        np.testing.assert_allclose(result.signals["y"], truth, rtol=1e-12)
        model.open_session().close()
        assert model.remarks() == (remark,)


def test_event_mode_that_works_is_used(tmp_path: Path) -> None:
    with load(build_shy(tmp_path, "works"), step=0.01) as model:
        result = simulate(model, stop=1.5, inputs={"u": Constant(2.0)}, points=np.linspace(0.03, 1.5, 50))
        assert model.remarks() == ()
    later = result.time > 1.0
    np.testing.assert_allclose(result.signals["y"][later], [level(t, jump=True) for t in result.time[later]], rtol=1e-9)


@pytest.mark.parametrize("step", [0.01, 0.03], ids=["its event at the end of a step", "inside one"])
def test_a_next_event_time_that_is_not_a_number_is_refused(tmp_path: Path, step: float) -> None:
    words = r"the next event time that fmi3UpdateDiscreteStates gave is not a number"
    with load(build_shy(tmp_path, "lost"), step=step) as model, pytest.raises(SimulationError, match=words) as caught:
        simulate(model, stop=1.5, points=np.linspace(0.03, 1.5, 50), in_process=True)
    assert caught.value.time == pytest.approx(1.0, abs=step)  # inside a step the oracle says when that began


def test_a_master_refuses_it_too_where_others_step_over_the_event(tmp_path: Path) -> None:
    parts = {"lag": load("fmu:FirstOrderLag", "cs"), "lost": load(build_shy(tmp_path, "lost"))}
    wires = [("lag.y", "lost.u")]
    words = r"lost \(Shy\): the next event time that fmi3UpdateDiscreteStates gave is not a number"
    with (
        connect(parts, wires, inputs={"u": "lag.u"}, outputs={"y": "lost.y"}, step=0.03) as system,
        pytest.raises(SimulationError, match=words) as caught,
    ):
        simulate(system, stop=1.5, points=np.linspace(0.03, 1.5, 50), in_process=True)
    assert caught.value.time == pytest.approx(1.0, abs=0.03)


def test_a_sweep_tells_the_order_too(tmp_path: Path) -> None:
    with load(build_shy(tmp_path, "instantiate")) as model:
        response = nfr(model, "u", "y", [0.5], 1.0, workers=Workers(in_process=True))
    assert response.gain[0][0] == pytest.approx(1.0 / math.hypot(1.0, math.pi), rel=1e-3)
