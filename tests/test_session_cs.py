"""Co-simulation sessions on FMUs written in Python."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.drivers import each_driver  # noqa: F401  every test runs with each driver
from tests.hybrid_fmus import DISCARD, OK, FakeC, Hybrid, LyingC, inside, open_fake
from tests.lying_fmus import build_lying
from tests.mimic_fmus import build_mimic
from workbench.errors import InputError, SimulationError
from workbench.session.fmu import FmuSession
from workbench.signals.kinds import Constant, Sine, Step


class Euler(Hybrid):
    """dx/dt = u by explicit Euler; y = x + u feeds through."""

    states = ("x",)
    inputs = ("u",)

    def start(self) -> None:
        self.steps: list[float] = []

    def derivatives(self) -> list[float]:
        return [self.v["u"]]

    def output(self) -> None:
        self.v["y"] = self.v["x"] + self.v["u"]

    def step(self, h: float) -> int:
        self.steps.append(h)
        return super().step(h)


def steps_of(session: FmuSession) -> list[float]:
    model = inside(session)
    assert isinstance(model, Euler)
    return model.steps


class Constantly(Euler):
    variable_step = False


class Fragile(Euler):
    def step(self, h: float) -> int:
        return DISCARD if self.t > 0.45 else super().step(h)


class Diverging(Euler):
    def derivatives(self) -> list[float]:
        return [1e300 * (1.0 + abs(self.v["x"]))]

    def step(self, h: float) -> int:
        for _ in range(10):
            super().step(h / 10.0)
        return OK


@pytest.mark.parametrize(("step", "words"), [(None, "communication step: 0.002 s was derived"), (0.01, "")])
def test_the_step_that_nobody_names_is_told(tmp_path: Path, step: float | None, words: str) -> None:
    with wb.load(build_mimic(tmp_path, "no-experiment"), interface="cs", step=step) as model:
        notes = "; ".join(wb.simulate(model, stop=1.0).notes)
    assert words in notes
    assert ("was derived" in notes) == bool(words)


def test_a_row_at_the_present_time_makes_no_step() -> None:
    """It said 2e-303 s was the communication step; half of that, to verify a run, never ends."""
    with open_fake(Euler, "fmu", interface="cs") as session:
        session.advance(1.0, signals={"u": Constant(1.0)}, record=["x"])
        made = session.communication_step
        session.advance(1.0, signals={"u": Constant(1.0)}, record=["x"])
        assert session.communication_step == made == pytest.approx(1.0 / 500.0)


def test_steps_stay_within_the_communication_step_and_meet_points_and_breaks() -> None:
    with open_fake(Euler, "fmu", interface="cs", step=0.1) as session:
        session.advance(1.0, signals={"u": Step(time=0.33, value=1.0)}, points=np.array([0.25, 1.0]))
        steps = steps_of(session)
    assert max(steps) <= 0.1 + 1e-12
    ends = np.cumsum(steps)
    for point in (0.25, 0.33, 1.0):
        assert np.min(np.abs(ends - point)) < 1e-12


def test_every_communication_point_is_a_left_and_a_right_limit() -> None:
    signal = Sine(frequency=1.0)
    with open_fake(Euler, "fmu", interface="cs", step=0.05) as session:
        record = session.advance(0.1, signals={"u": signal}, record=["y", "x"])
    assert record.time == pytest.approx([0.0, 0.05, 0.05, 0.1])
    there = [signal(0.0), signal(0.05), signal(0.05), signal(0.1)]
    assert record.inputs["u"] == pytest.approx(there)
    assert record.values["y"] == pytest.approx(record.values["x"] + there)
    assert record.values["x"][-1] == pytest.approx(0.05 * (signal(0.025) + signal(0.075)))


def test_an_input_jumps_after_the_left_limit_of_its_break() -> None:
    with open_fake(Euler, "fmu", interface="cs", step=0.2) as session:
        record = session.advance(0.4, signals={"u": Step(time=0.2, value=1.0)}, record=["y"])
    assert record.time.tolist() == pytest.approx([0.0, 0.2, 0.2, 0.4])
    assert record.values["y"] == pytest.approx([0.0, 0.0, 1.0, 1.2])


@pytest.mark.parametrize("course", ["constant step", "held"])
def test_inputs_are_held_from_the_start_where_the_fmu_may_sample_there(course: str) -> None:
    signal = Sine(frequency=1.0)
    kind, hold = (Constantly, False) if course == "constant step" else (Euler, True)
    with open_fake(kind, "fmu", interface="cs", step=0.05, hold_inputs=hold) as session:
        record = session.advance(0.1, signals={"u": signal}, record=["y", "x"])
    held = [signal(0.0), signal(0.0), signal(0.05), signal(0.05)]
    assert record.inputs["u"] == pytest.approx(held)
    assert record.values["y"] == pytest.approx(record.values["x"] + held)
    assert np.trapezoid(record.inputs["u"], record.time) == pytest.approx(record.values["x"][-1])


def test_the_step_is_derived_from_the_signal_where_nobody_names_it() -> None:
    with open_fake(Euler, "fmu", interface="cs") as session:
        session.advance(1.0, signals={"u": Sine(frequency=2.0)})
        assert session.communication_step == pytest.approx(1.0 / 400.0)


def test_a_constant_step_is_kept_or_refused() -> None:
    with open_fake(Constantly, "fmu", interface="cs", step=0.1) as session:
        session.advance(1.0, signals={"u": Constant(1.0)}, points=np.array([0.3, 1.0]))
        assert steps_of(session) == pytest.approx([0.1] * 10)
        with pytest.raises(InputError, match="constant communication step"):
            session.advance(1.25, signals={})


def test_a_discarded_step_is_an_error_with_its_time() -> None:
    with open_fake(Fragile, "fmu", interface="cs", step=0.1) as session:
        with pytest.raises(SimulationError, match="fmi2DoStep returned discard") as caught:
            session.advance(1.0, signals={})
        assert caught.value.time == pytest.approx(0.5)


def test_divergence_is_an_error() -> None:
    with open_fake(Diverging, "fmu", interface="cs", step=0.1) as session, pytest.raises(SimulationError, match="inf"):
        session.advance(1.0, signals={}, record=["y"])


@pytest.mark.parametrize(("state", "c"), [(False, FakeC), (True, FakeC), (True, LyingC)])
def test_restore_repeats_to_the_last_bit(state: bool, c: type[FakeC]) -> None:
    signals = {"u": Sine(frequency=1.0, phase=30.0)}
    with open_fake(Euler, "fmu", interface="cs", step=0.01, state=state, c=c) as session:
        assert session.setup.state_works() is (state and c is FakeC)
        session.advance(0.3, signals=signals)
        saved = session.snapshot()
        whole = session.advance(0.7, signals=signals, record=["y"])
        session.restore(saved)
        again = session.advance(0.7, signals=signals, record=["y"])
    assert np.array_equal(whole.values["y"], again.values["y"])
    assert math.isclose(saved.time, 0.3)


@pytest.mark.parametrize(("lie", "acts"), [("ignored-slopes", False), ("honest", True)])
def test_slopes_that_have_no_effect_are_not_given(lie: str, acts: bool, tmp_path: Path) -> None:
    """Held at the start of a step the input would be half a step late, 0.05 of the answer here."""
    signals = {"u": Sine(frequency=1.0)}
    points = np.linspace(0.05, 2.0, 40)
    runs = []
    for step in (0.05, 0.05 / 64.0):
        with wb.load(build_lying(tmp_path, lie), "cs", step=step) as model, model.open_session() as session:
            rows = session.advance(2.0, signals=signals, record=["y"], points=points)
            runs.append(rows.values["y"][np.searchsorted(rows.time, points)])
            assert model.slopes is acts
            assert any("a probe sees no effect of their slopes" in note for note in model.remarks()) is not acts
    assert float(np.max(np.abs(runs[0] - runs[1]))) < 0.01 * float(np.ptp(runs[1]))


def test_signals_without_slopes_cost_no_probe() -> None:
    with wb.load("fmu:FirstOrderLag@2", "cs") as model, model.open_session() as session:
        session.advance(1.0, signals={"u": Step(time=0.5, value=1.0)}, record=["y"])
        assert model.slopes is None


def test_a_stop_time_of_the_fmus_own_is_moved_where_a_run_goes_on(tmp_path: Path) -> None:
    """20-sim: it refuses every step beyond its default experiment, 2 s, unless it is told a later stop time."""
    with wb.load(build_mimic(tmp_path, "finishes"), interface="cs") as model:
        short = wb.simulate(model, stop=1.5)
        found = wb.simulate(model, stop=4.0)
        response = wb.nfr(model, "u", "y", [0.5], 0.1)
    with wb.load(build_mimic(tmp_path, "finishes"), interface="cs") as model:
        linear = wb.lin(model).result
    with wb.load(build_mimic(tmp_path, "finishes"), interface="cs") as model:
        best = wb.bla(model, "u", "y", rms=[1.0], band=(0.1, 1.0), realisations=2)
    with wb.load(build_mimic(tmp_path, "finishes"), interface="cs") as model:
        data = wb.excite(model, "u", "y", prbs="amplitude=1", dt=0.1, samples=100).identification
    assert not any("goes no further" in n for n in short.notes)
    assert any("goes no further than 2 s" in n for n in found.notes)
    damped = math.sqrt(96.0)
    angle = damped * found.time
    truth = 1.0 - np.exp(-2.0 * found.time) * (np.cos(angle) + 2.0 / damped * np.sin(angle))
    assert found.signals["y"] == pytest.approx(truth, abs=1e-6)
    s = 1j * math.pi
    expected = 100.0 / (s * s + 4.0 * s + 100.0)
    assert response.response[0, 0] == pytest.approx(expected, rel=1e-3)
    assert linear.fundamental(np.array([0.5]))[0, 0, 0] == pytest.approx(expected, rel=1e-2)
    assert any("goes no further than 2 s" in n for n in best.notes)
    assert data.y.shape == (100, 1)
