"""Events in model exchange sessions, on hybrid models whose answers are known exactly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.drivers import each_driver  # noqa: F401  every test runs with each driver
from tests.hybrid_fmus import FakeC, Hybrid, LyingC, inside, open_fake
from workbench.errors import InputError, SimulationError
from workbench.signals.kinds import Constant, Prbs, Sine, Step, Table

SOLVERS = ["vkm", "gear"]
G = 9.81


class Ball(Hybrid):
    """Falls from 1 m; at the ground its speed is reversed and multiplied by 0.8."""

    states = ("h", "v")
    outputs = ("y",)
    nz = 1

    def start(self) -> None:
        self.v["h"] = 1.0

    def derivatives(self) -> list[float]:
        return [self.v["v"], -G]

    def indicators(self) -> list[float]:
        return [self.v["h"]]

    def event(self) -> tuple[bool, float]:
        if self.v["h"] <= 0.0 and self.v["v"] < 0.0:
            self.v["v"] *= -0.8
            return True, math.inf
        return False, math.inf

    def output(self) -> None:
        self.v["y"] = self.v["v"]


class Integrator(Hybrid):
    """dx/dt = u + k with an integer k that may change at events only; y = x."""

    states = ("x",)
    inputs = ("u",)
    integers: tuple[str, ...] = ("k",)

    def derivatives(self) -> list[float]:
        return [self.v["u"] + self.v["k"]]

    def output(self) -> None:
        self.v["y"] = self.v["x"]


class Sampler(Hybrid):
    """Every 0.1 s y takes the input's value."""

    inputs = ("u",)
    period = 0.1

    def start(self) -> None:
        self.n = 0

    def event(self) -> tuple[bool, float]:
        if self.t >= self.n * self.period - 1e-12:
            self.v["y"] = self.v["u"]
            self.n += 1
        return False, self.n * self.period


class Slider(Hybrid):
    """dx/dt = −sign(x): slides on 0, events without end."""

    states = ("x",)
    nz = 1

    def start(self) -> None:
        self.v["x"] = 0.5
        self.sign = 1.0

    def derivatives(self) -> list[float]:
        return [-self.sign]

    def indicators(self) -> list[float]:
        return [self.v["x"]]

    def event(self) -> tuple[bool, float]:
        self.sign = 1.0 if self.v["x"] > 0.0 else -1.0
        return False, math.inf


class Watched(Integrator):
    """The integrator with an event where x passes 0.1, shortly before the input jumps."""

    integers = ()
    nz = 1

    def derivatives(self) -> list[float]:
        return [self.v["u"]]

    def indicators(self) -> list[float]:
        return [self.v["x"] - 0.1]


class Stiff(Hybrid):
    """dx/dt = −1e9 (x − cos t)."""

    states = ("x",)

    def derivatives(self) -> list[float]:
        return [-1e9 * (self.v["x"] - math.cos(self.t))]


class Lag(Hybrid):
    """Oscillator with nominal 0, as some tools write it: x'' = u − 0.2 x' − 100 x."""

    states = ("x", "w")
    inputs = ("u",)
    nominal = 0.0

    def derivatives(self) -> list[float]:
        return [self.v["w"], self.v["u"] - 0.2 * self.v["w"] - 100.0 * self.v["x"]]

    def output(self) -> None:
        self.v["y"] = self.v["x"]


class Bursting(Hybrid):
    """x grows until the FMU refuses."""

    states = ("x",)

    def start(self) -> None:
        self.v["x"] = 1.0

    def derivatives(self) -> list[float]:
        return [self.v["x"] ** 2]


@pytest.mark.parametrize("solver", SOLVERS)
def test_ball_hits_the_ground_when_it_must(solver: str) -> None:
    with open_fake(Ball, solver, rtol=1e-10) as session:
        record = session.advance(1.0, signals={}, record=["h", "v"], points=np.array([0.2, 0.7, 1.0]))
    first = math.sqrt(2.0 / G)
    at = np.flatnonzero(np.diff(record.time) == 0.0)
    assert record.time[at[0]] == pytest.approx(first, rel=1e-9)
    speeds = record.values["v"][at[0] : at[0] + 2]
    assert speeds[1] == pytest.approx(-0.8 * speeds[0], rel=1e-12)
    since = 0.7 - first
    expected = 0.8 * G * first * since - 0.5 * G * since**2
    assert record.values["h"][record.time == 0.7][-1] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("stop", [5.0, 1000.0])
@pytest.mark.parametrize("solver", SOLVERS)
def test_zeno_behaviour_is_an_error_with_its_time(solver: str, stop: float) -> None:
    last = math.sqrt(2.0 / G) * (1.0 + 2.0 * 0.8 / 0.2)
    with open_fake(Ball, solver) as session, pytest.raises(SimulationError, match="Zeno") as caught:
        session.advance(stop, signals={})
    assert caught.value.time == pytest.approx(last, rel=1e-3)


@pytest.mark.parametrize("solver", SOLVERS)
def test_chattering_is_an_error(solver: str) -> None:
    with open_fake(Slider, solver) as session, pytest.raises(SimulationError, match="chattering"):
        session.advance(2.0, signals={})


class DryFriction(Hybrid):
    """m·dv/dt = −F·sgn v, whose relation has a hysteresis as in many exporters' FMUs: it sticks at v = 0."""

    states = ("v",)
    nz = 1
    hysteresis = 1e-13

    def start(self) -> None:
        self.v["v"], self.forward = 1e-4, True

    def derivatives(self) -> list[float]:
        return [-1.0 if self.forward else 1.0]

    def indicators(self) -> list[float]:
        return [self.v["v"] + (self.hysteresis if self.forward else -self.hysteresis)]

    def event(self) -> tuple[bool, float]:
        self.forward = self.indicators()[0] > 0.0
        return False, math.inf


@pytest.mark.parametrize("hysteresis", [1e-13, 1e-10])
@pytest.mark.parametrize("stop", [1.1e-4, 1.0])
@pytest.mark.parametrize("solver", SOLVERS)
def test_chattering_within_a_hysteresis_is_told_in_short_runs_too(solver: str, stop: float, hysteresis: float) -> None:
    model = type("DryFriction", (DryFriction,), {"hysteresis": hysteresis})
    with open_fake(model, solver) as session:
        with pytest.raises(SimulationError, match="chattering") as caught:
            session.advance(stop, signals={})
        assert caught.value.time == pytest.approx(1e-4, abs=1200 * 2.0 * hysteresis)
        assert len(inside(session).events) < 1200


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_jump_of_the_input_is_an_event_with_both_limits(solver: str) -> None:
    signals = {"u": Step(time=0.3, value=2.0)}
    with open_fake(Integrator, solver) as session:
        record = session.advance(1.0, signals=signals, record=["y"], points=np.array([0.3, 0.5, 1.0]))
        assert inside(session).events == [0.0, 0.3]
    assert record.time.tolist() == [0.0, 0.3, 0.3, 0.5, 1.0]
    assert record.inputs["u"].tolist() == [0.0, 0.0, 2.0, 2.0, 2.0]
    assert record.values["y"] == pytest.approx([0.0, 0.0, 0.0, 0.4, 1.4], abs=1e-12)


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_integer_input_changes_in_event_mode_only(solver: str) -> None:
    signals = {"k": Step(time=0.25, value=4.0), "u": Constant(1.0)}
    with open_fake(Integrator, solver) as session:
        record = session.advance(1.0, signals=signals, record=["y"], points=np.linspace(0.1, 1.0, 10))
    assert record.values["y"][-1] == pytest.approx(1.0 + 4.0 * 0.75, rel=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_prbs_is_integrated_exactly(solver: str) -> None:
    signal = Prbs(hold=0.03, order=5)
    with open_fake(Integrator, solver) as session:
        session.advance(0.9, signals={"u": signal}, record=["y"])
        expected = sum(signal(0.03 * (i + 0.5)) for i in range(30)) * 0.03
        assert session.values(["y"])["y"] == pytest.approx(expected, abs=1e-9)


def test_a_slope_jump_splits_the_integration() -> None:
    table = Table([0.0, 0.5, 1.0], [0.0, 1.0, 0.0])
    with open_fake(Integrator, "vkm") as session:
        session.advance(1.0, signals={"u": table})
        assert session.values(["x"])["x"] == pytest.approx(0.5, abs=1e-13)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_jump_after_a_state_event_is_not_seen_too_early(solver: str) -> None:
    signals = {"u": Step(time=0.2, initial=1.0, value=1000.0)}
    with open_fake(Watched, solver) as session:
        record = session.advance(0.3, signals=signals, record=["y"], points=np.array([0.15, 0.3]))
    assert np.unique(record.time) == pytest.approx([0.0, 0.1, 0.15, 0.2, 0.3], abs=1e-12)
    assert record.values["y"][record.time == 0.2] == pytest.approx([0.2, 0.2], abs=1e-12)
    assert record.values["y"][-1] == pytest.approx(100.2, rel=1e-12)


def test_time_events_are_hit_exactly_and_an_event_at_the_end_belongs_to_the_next_call() -> None:
    signal = Table([0.0, 1.0], [0.0, 1.0])
    with open_fake(Sampler, "none") as session:
        first = session.advance(0.2, signals={"u": signal}, record=["y"])
        second = session.advance(0.35, signals={"u": signal}, record=["y"])
    assert first.time.tolist() == [0.0, 0.1, 0.1, 0.2]
    assert first.values["y"] == pytest.approx([0.0, 0.0, 0.1, 0.1])
    assert second.time[:1] == pytest.approx([0.2])
    assert second.values["y"][0] == pytest.approx(0.2)
    assert second.values["y"][-1] == pytest.approx(0.3)


def test_two_advances_equal_one() -> None:
    signals = {"u": Sine(frequency=3.0)}
    with open_fake(Lag, "gear") as whole, open_fake(Lag, "gear") as parts:
        whole.advance(1.0, signals=signals)
        for until in (0.25, 0.5, 1.0):
            parts.advance(until, signals=signals)
        assert parts.values(["y"])["y"] == pytest.approx(whole.values(["y"])["y"], abs=1e-8)


@pytest.mark.parametrize("solver", SOLVERS)
def test_nominal_zero_and_small_states_are_integrated_accurately(solver: str) -> None:
    omega = 2.0 * math.pi * 2.0
    response = 1.0 / complex(100.0 - omega**2, 0.2 * omega)
    with open_fake(Lag, solver, rtol=1e-7) as session:
        session.advance(100.0, signals={"u": Sine(frequency=2.0, amplitude=1e-5)})
        expected = 1e-5 * (response * np.exp(1j * omega * 100.0)).imag
        assert session.values(["y"])["y"] == pytest.approx(expected, abs=3e-4 * abs(response) * 1e-5)


def test_explicit_solver_says_that_a_stiff_model_needs_gear() -> None:
    with open_fake(Stiff, "vkm") as session, pytest.raises(SimulationError, match="use solver gear"):
        session.advance(1.0, signals={})
    with open_fake(Stiff, "gear") as session:
        session.advance(1.0, signals={})
        assert session.values(["x"])["x"] == pytest.approx(math.cos(1.0), rel=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
def test_finite_escape_is_an_error_near_its_time(solver: str) -> None:
    with open_fake(Bursting, solver) as session, pytest.raises(SimulationError) as caught:
        session.advance(2.0, signals={})
    assert caught.value.time == pytest.approx(1.0, abs=1e-3)


class Drain(Hybrid):
    """dx/dt = −√x; refuses negative levels, as an FMU with a square root does."""

    states = ("x",)

    def start(self) -> None:
        self.v["x"] = 1.0

    def refuses(self) -> bool:
        return bool(self.v["x"] < 0.0)

    def derivatives(self) -> list[float]:
        return [-math.sqrt(self.v["x"])]


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_discarded_evaluation_shortens_the_step(solver: str) -> None:
    with open_fake(Drain, solver) as session:
        session.advance(1.99, signals={})
        assert session.values(["x"])["x"] == pytest.approx((1.0 - 0.5 * 1.99) ** 2, abs=1e-7)
        with pytest.raises(SimulationError) as caught:
            session.advance(3.0, signals={})
        assert caught.value.time == pytest.approx(2.0, abs=1e-2)


class Noisy(Integrator):
    def output(self) -> None:
        self.v["y"] = math.nan if self.t > 0.5 else self.v["x"]


def test_a_value_that_is_not_finite_names_variable_and_time() -> None:
    with open_fake(Noisy, "gear") as session, pytest.raises(SimulationError, match="y is nan") as caught:
        session.advance(1.0, signals={}, record=["y"], points=np.linspace(0.1, 1.0, 10))
    assert caught.value.time == pytest.approx(0.6)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("state", "c"), [(False, FakeC), (True, FakeC), (True, LyingC)])
def test_restore_brings_the_session_back(solver: str, state: bool, c: type[FakeC]) -> None:
    signals = {"u": Sine(frequency=1.5, amplitude=3.0)}
    with open_fake(Lag, solver, state=state, c=c) as session:
        assert session.setup.state_works() is (state and c is FakeC)
        session.advance(0.4, signals=signals)
        saved = session.snapshot()
        before = session.values(["x", "w"])
        runs = []
        for _ in range(2):
            session.advance(1.0, signals={"u": Constant(7.0)})
            session.restore(saved)
            assert session.time == 0.4
            assert session.values(["x", "w"]) == before
            session.advance(1.0, signals=signals)
            runs.append(session.values(["x", "w"]))
            session.restore(saved)
        assert runs[0] == runs[1]


def test_bias_is_added_to_forced_and_to_unforced_inputs() -> None:
    with open_fake(Integrator, "vkm", bias={"u": 2.0}) as session:
        session.advance(1.0, signals={})
        assert session.values(["x"])["x"] == pytest.approx(2.0)
        session.advance(2.0, signals={"u": Constant(1.0)})
        assert session.values(["x"])["x"] == pytest.approx(5.0)


def test_wrong_names_and_times_are_input_errors() -> None:
    with open_fake(Integrator, "vkm") as session:
        with pytest.raises(InputError, match="has no input 'uu'"):
            session.advance(1.0, signals={"uu": Constant(1.0)})
        with pytest.raises(InputError, match="has no variable 'yy'"):
            session.advance(1.0, signals={}, record=["yy"])
        with pytest.raises(InputError, match="points: times to record must rise"):
            session.advance(1.0, signals={}, points=np.array([0.5, 0.2]))
        with pytest.raises(InputError, match=r"points: times to record must rise and lie in \(0, 1\] s"):
            session.advance(1.0, signals={}, points=np.array([0.0, 0.5]))
        session.advance(1.0, signals={})
        with pytest.raises(InputError, match="cannot advance"):
            session.advance(0.5, signals={})
        session.close()
        session.close()
