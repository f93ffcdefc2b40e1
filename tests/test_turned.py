"""What an event turned back or stopped must not go on across: against closed forms, and no false alarm."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.drivers import each_driver  # noqa: F401  every test runs with each driver
from tests.hybrid_fmus import Hybrid, open_fake
from workbench.build.fmu import build_fmu
from workbench.build.toolchain import host_only
from workbench.errors import SimulationError

SOLVERS = ["vkm", "gear"]
GRAVITY = 9.81
TOLD = 1e-4  # of the instant: that of the last event, or an end that is extrapolated
(HOST,) = (p.name for p in host_only())


class Ball(Hybrid):
    """A ball falls from `height` on a floor at `floor`: `when h <= floor then reinit(v, -e*pre(v))`."""

    states: tuple[str, ...] = ("h", "v")
    nz = 1
    height, floor, restitution = 1.0, 0.0, 0.0
    tops = False

    def start(self) -> None:
        self.v["h"] = self.floor + self.height
        self.above = True

    def derivatives(self) -> list[float]:
        return [self.v["v"], -GRAVITY]

    def indicators(self) -> list[float]:
        return [self.v["h"] - self.floor, self.v["v"]] if self.tops else [self.v["h"] - self.floor]

    def event(self) -> tuple[bool, float]:
        was, self.above = self.above, self.v["h"] > self.floor
        if not was or self.above:
            return False, math.inf
        self.v["v"] *= -self.restitution
        return True, math.inf

    def output(self) -> None:
        self.v["y"] = self.v["h"]


def variant(model: type[Hybrid], **values: object) -> type[Hybrid]:
    return type(model.__name__, (model,), values)


def end_of_bounces(height: float, restitution: float) -> float:
    """When the bounces end [s]: the fall, then flights that shrink as a geometric series."""
    return math.sqrt(2.0 * height / GRAVITY) * (1.0 + 2.0 * restitution / (1.0 - restitution))


@pytest.mark.parametrize("restitution", [0.0, 1e-6, 1e-3, 0.01, 0.03, 0.05, 0.08, 0.15])
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_ball_that_hardly_rebounds_does_not_fall_through_its_floor(solver: str, restitution: float) -> None:
    with open_fake(variant(Ball, restitution=restitution), solver) as session, pytest.raises(SimulationError) as caught:
        session.advance(4.5, signals={})
    assert caught.value.time == pytest.approx(end_of_bounces(1.0, restitution), rel=TOLD)


@pytest.mark.parametrize(("height", "floor", "tops"), [(1.0, 5.0, False), (0.3, -2.0, True), (30.0, 0.0, True)])
@pytest.mark.parametrize("restitution", [0.0, 0.02, 0.06])
@pytest.mark.parametrize("solver", SOLVERS)
def test_wherever_the_floor_lies(solver: str, restitution: float, height: float, floor: float, tops: bool) -> None:
    model = variant(Ball, restitution=restitution, height=height, floor=floor, tops=tops, nz=2 if tops else 1)
    with open_fake(model, solver) as session, pytest.raises(SimulationError) as caught:
        session.advance(9.0, signals={})
    assert caught.value.time == pytest.approx(end_of_bounces(height, restitution), rel=TOLD)


def test_the_message_says_what_passed_and_what_to_do() -> None:
    with open_fake(Ball, "gear") as session, pytest.raises(SimulationError) as caught:
        session.advance(4.5, signals={})
    assert str(caught.value).startswith("the event here reverses or stops a variable at its threshold, but")
    assert "let the model rest there" in str(caught.value)


SOURCE = """
model Ball
  parameter Real e = 0.05;
  Real h(start = 1, fixed = true);
  Real v(start = 0, fixed = true);
  output Real y = h;
equation
  der(h) = v;
  der(v) = -9.81;
  when h <= 0 then
    reinit(v, -e*pre(v));
  end when;
end Ball;
"""


def built_as(fmi: int, name: str, source: str, folder: Path) -> Path:
    """Return the FMU of a model for this machine."""
    (folder / f"{name}.mo").write_text(source)
    build_fmu([folder / f"{name}.mo"], out=folder / f"{name}.fmu", fmi=fmi, platforms=[HOST])
    return folder / f"{name}.fmu"


@pytest.fixture(scope="module", params=[2, 3])
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built_as(request.param, "Ball", SOURCE, tmp_path_factory.mktemp("ball"))


@pytest.mark.parametrize("restitution", [0.0, 0.001, 0.02, 0.05])
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_built_ball_does_not_either(built: Path, interface: str, restitution: float) -> None:
    end = end_of_bounces(1.0, restitution)
    with wb.load(built, interface=interface, start_values={"e": restitution}) as model:
        found = wb.simulate(model, stop=0.99 * end, interval=0.01)
        assert min(found.signals["y"]) > -1e-6
        with pytest.raises(SimulationError, match="let the model rest there") as caught:
            wb.simulate(model, stop=2.0, interval=0.01)
    told = re.search(r"t = ([0-9.]+)", str(caught.value))
    assert told is not None
    assert float(told[1]) == pytest.approx(end, rel=TOLD)


@pytest.mark.parametrize("keeps", [0.01, 0.3, 0.95])
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_built_ball_that_breaks_through_goes_on(built: Path, interface: str, keeps: float) -> None:
    fall = math.sqrt(2.0 / GRAVITY)
    with wb.load(built, interface=interface, start_values={"e": -keeps}) as model:
        y = wb.simulate(model, stop=fall + 1.0, interval=0.01).signals["y"][-1]
    assert y == pytest.approx(-keeps * GRAVITY * fall - 0.5 * GRAVITY, rel=1e-5)


# ---- models that do go through, or stay, as they should ----


@dataclass(frozen=True)
class Legitimate:
    """A model that must run, and the value of its output `y` at the end, where it is known."""

    model: type[Hybrid]
    stop: float
    truth: float = math.nan


class Falling(Ball):
    """An event at the threshold that does not turn the fall: it counts, slows it down or restarts another state."""

    states = ("h", "v", "i")
    outputs = ("y", "count")
    keeps = 1.0

    def derivatives(self) -> list[float]:
        return [self.v["v"], -GRAVITY, 1.0]

    def event(self) -> tuple[bool, float]:
        was, self.above = self.above, self.v["h"] > self.floor
        if not was or self.above:
            return False, math.inf
        self.v["count"] += 1.0
        self.v["v"] *= self.keeps
        self.v["i"] = 0.0
        return True, math.inf


def falling(random: np.random.Generator) -> Legitimate:
    height, keeps, after = random.uniform(0.1, 30.0), 10.0 ** random.uniform(-2.5, 0.0), random.uniform(0.1, 2.0)
    fall = math.sqrt(2.0 * height / GRAVITY)
    y = random.uniform(-5.0, 5.0)
    model = variant(Falling, height=height, keeps=keeps, floor=y)
    return Legitimate(model, fall + after, y - keeps * GRAVITY * fall * after - 0.5 * GRAVITY * after**2)


def bouncing(random: np.random.Generator) -> Legitimate:
    height, e = random.uniform(0.1, 30.0), random.uniform(0.02, 0.95)
    fall = math.sqrt(2.0 * height / GRAVITY)
    since = random.uniform(0.1, 0.9) * 2.0 * e * fall
    y = e * GRAVITY * fall * since - 0.5 * GRAVITY * since**2
    return Legitimate(variant(Ball, height=height, restitution=e), fall + since, y)


class Trapdoor(Ball):
    """The ball knows rest; at `opens` its floor opens."""

    opens = 2.0

    def start(self) -> None:
        super().start()
        self.resting = False

    def derivatives(self) -> list[float]:
        return [0.0, 0.0] if self.resting else [self.v["v"], -GRAVITY]

    def event(self) -> tuple[bool, float]:
        if self.t >= self.opens:
            self.resting = False
            return False, math.inf
        if self.v["h"] <= self.floor and not self.resting:
            self.resting = True
            self.v["v"] = 0.0
            return True, self.opens
        return False, self.opens


def trapdoor(random: np.random.Generator) -> Legitimate:
    height, after = random.uniform(0.1, 10.0), random.uniform(0.1, 1.0)
    opens = math.sqrt(2.0 * height / GRAVITY) + random.uniform(0.1, 1.0)
    model = variant(Trapdoor, height=height, opens=opens)
    return Legitimate(model, opens + after, -0.5 * GRAVITY * after**2)


class Thermostat(Hybrid):
    """dx/dt = (on − x)/lag, switched on below `low` and off above `high`; the indicators of both always there."""

    states = ("x",)
    nz = 2
    lag, low, high = 1.0, 0.3, 0.6

    def start(self) -> None:
        self.on = True

    def derivatives(self) -> list[float]:
        return [((1.0 if self.on else 0.0) - self.v["x"]) / self.lag]

    def indicators(self) -> list[float]:
        return [self.v["x"] - self.high, self.low - self.v["x"]]

    def event(self) -> tuple[bool, float]:
        if self.v["x"] > self.high:
            self.on = False
        elif self.v["x"] < self.low:
            self.on = True
        return False, math.inf

    def output(self) -> None:
        self.v["y"] = self.v["x"]


def thermostat(random: np.random.Generator) -> Legitimate:
    low, high = np.sort(random.uniform(0.1, 0.9, 2))
    high = max(high, low + 0.02)
    lag = 10.0 ** random.uniform(-1.0, 1.0)
    first, off = -lag * math.log1p(-high), lag * math.log(high / low)
    part = random.uniform(0.1, 0.9)
    model = variant(Thermostat, low=float(low), high=float(high), lag=lag)
    return Legitimate(model, first + part * off, high * math.exp(-part * off / lag))


class Sawtooth(Hybrid):
    """dx/dt = rate, back to 0 at 1: the restart leaves the far side at once."""

    states = ("x",)
    nz = 1
    rate = 1.0

    def derivatives(self) -> list[float]:
        return [self.rate]

    def indicators(self) -> list[float]:
        return [self.v["x"] - 1.0]

    def event(self) -> tuple[bool, float]:
        jumps = self.v["x"] > 1.0
        self.v["x"] = 0.0 if jumps else self.v["x"]
        return jumps, math.inf

    def output(self) -> None:
        self.v["y"] = self.v["x"]


def sawtooth(random: np.random.Generator) -> Legitimate:
    rate, teeth = 10.0 ** random.uniform(-1.0, 1.0), random.uniform(1.1, 4.9)
    return Legitimate(variant(Sawtooth, rate=rate), teeth / rate, teeth % 1.0)


class Table(Hybrid):
    """A ball on a table that moves as amplitude·sin(omega·t): the speed relative to it is turned."""

    states = ("h", "v")
    nz = 1
    e, amplitude, omega = 0.8, 0.1, 3.0

    def start(self) -> None:
        self.v["h"] = 1.0

    def derivatives(self) -> list[float]:
        return [self.v["v"], -GRAVITY]

    def indicators(self) -> list[float]:
        return [self.v["h"] - self.amplitude * math.sin(self.omega * self.t)]

    def event(self) -> tuple[bool, float]:
        speed = self.v["v"] - self.amplitude * self.omega * math.cos(self.omega * self.t)
        if self.indicators()[0] > 0.0 or speed > 0.0:
            return False, math.inf
        self.v["v"] -= (1.0 + self.e) * speed
        return True, math.inf

    def output(self) -> None:
        self.v["y"] = self.v["h"]


def table(random: np.random.Generator) -> Legitimate:
    e, amplitude, omega = random.uniform(0.3, 1.0), random.uniform(0.0, 0.2), random.uniform(1.0, 5.0)
    return Legitimate(variant(Table, e=e, amplitude=amplitude, omega=omega), 0.8)


class Impacts(Hybrid):
    """x'' = −x + force·cos(omega·t) with a wall at `wall`, and restitution e."""

    states = ("x", "w")
    nz = 1
    e, wall, force, omega = 0.8, 0.2, 1.0, 2.7

    def derivatives(self) -> list[float]:
        return [self.v["w"], self.force * math.cos(self.omega * self.t) - self.v["x"]]

    def indicators(self) -> list[float]:
        return [self.wall - self.v["x"]]

    def event(self) -> tuple[bool, float]:
        if self.v["x"] < self.wall or self.v["w"] <= 0.0:
            return False, math.inf
        self.v["w"] *= -self.e
        return True, math.inf

    def output(self) -> None:
        self.v["y"] = self.v["x"]


def impacts(random: np.random.Generator) -> Legitimate:
    values = {"e": random.uniform(0.6, 1.0), "wall": random.uniform(0.05, 0.5), "omega": random.uniform(2.0, 3.5)}
    return Legitimate(variant(Impacts, **values), 6.0)


class Reset(Hybrid):
    """dx/dt = i, di/dt = 1 − x: the integrator i is reset to a part of itself where x passes 1."""

    states = ("x", "i")
    nz = 1
    part = 0.5

    def derivatives(self) -> list[float]:
        return [self.v["i"], 1.0 - self.v["x"]]

    def start(self) -> None:
        self.below = True

    def indicators(self) -> list[float]:
        return [1.0 - self.v["x"]]

    def event(self) -> tuple[bool, float]:
        was, self.below = self.below, self.v["x"] < 1.0
        if was == self.below:
            return False, math.inf
        self.v["i"] *= self.part
        return True, math.inf

    def output(self) -> None:
        self.v["y"] = self.v["x"]


def reset(random: np.random.Generator) -> Legitimate:
    # x = 1 − cos t up to the first reset at t = π/2, then 1 + part·sin(t − π/2), reset again half a turn later.
    part, angle = random.uniform(0.01, 1.0), random.uniform(0.2, 2.9)
    return Legitimate(variant(Reset, part=part), math.pi / 2.0 + angle, 1.0 + part * math.sin(angle))


KINDS: list[Callable[[np.random.Generator], Legitimate]] = [
    falling, bouncing, trapdoor, thermostat, sawtooth, table, impacts, reset,
]  # fmt: skip
OF_EACH_KIND = 7


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("solver", SOLVERS)
def test_no_false_alarm(solver: str, kind: Callable[[np.random.Generator], Legitimate]) -> None:
    random = np.random.default_rng(20)
    for _ in range(OF_EACH_KIND):
        case = kind(random)
        with open_fake(case.model, solver) as session:
            y = session.advance(case.stop, signals={}, record=["y"]).values["y"][-1]
        assert math.isnan(case.truth) or y == pytest.approx(case.truth, rel=2e-6, abs=2e-6)


RESTING = """
model Pushed "stops at x = 1 at t = 1 where no force holds it, rests, and is pushed on"
  input Real push(start = 0);
  parameter Boolean itself = true;
  Real x(start = 0, fixed = true);
  Real v(start = 1, fixed = true);
  output Real y = x;
equation
  der(x) = v;
  der(v) = push + (if itself and time > 3 then 1 else 0);
  when x > 1 then
    reinit(v, 0);
  end when;
end Pushed;
"""


@pytest.fixture(scope="module", params=[2, 3])
def pushed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built_as(request.param, "Pushed", RESTING, tmp_path_factory.mktemp("pushed"))


@pytest.mark.parametrize("interval", [0.01, 0.3, 0.7])
@pytest.mark.parametrize("itself", [True, False])
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_later_event_ends_the_watch(pushed: Path, interface: str, itself: bool, interval: float) -> None:
    """From t = 3 on it is moved by 1, by itself or by its input: y = 1 + (t − 3)²/2 [Newton], at t = 5 it is 3.

    An input jumps for Co-Simulation where a step begins, at most one interval late.
    """
    signals: dict[str, wb.Signal] = {} if itself else {"push": wb.Step(time=3.0, value=1.0)}
    with wb.load(pushed, interface=interface, start_values={"itself": itself}) as model:
        found = wb.simulate(model, stop=5.0, interval=interval, inputs=signals)
    late = 0.0 if itself or interface == "me" else interval
    assert 1.0 + 0.5 * (2.0 - late) ** 2 - 1e-3 <= found.signals["y"][-1] <= 3.0 + 1e-3
    rest = found.signals["y"][(found.time > 1.0 + interval) & (found.time < 3.0)]
    np.testing.assert_allclose(rest, 1.0, atol=1e-6)
