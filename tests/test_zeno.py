"""Events that follow each other faster and faster, against closed forms: no ball falls through its floor."""

from __future__ import annotations

import math

import numpy as np
import pytest

import workbench as wb
from tests.drivers import each_driver  # noqa: F401  every test runs with each driver
from tests.hybrid_fmus import Hybrid, inside, open_fake
from workbench.errors import SimulationError

SOLVERS = ["vkm", "gear"]


class Ball(Hybrid):
    """A ball on a floor; with `tops`, the top of each flight is an event, too; below the speed `rest` it rests."""

    states = ("h", "v")
    outputs = ("y",)
    nz = 1
    height, restitution, gravity = 1.0, 0.8, 9.81
    tops = False
    rest = 0.0

    def start(self) -> None:
        self.v["h"] = self.height
        self.at_rest = False

    def derivatives(self) -> list[float]:
        return [0.0, 0.0] if self.at_rest else [self.v["v"], -self.gravity]

    def indicators(self) -> list[float]:
        return [self.v["h"], self.v["v"]] if self.tops else [self.v["h"]]

    def event(self) -> tuple[bool, float]:
        if self.v["h"] > 0.0 or self.v["v"] >= 0.0 or self.at_rest:
            return False, math.inf
        self.v["v"] *= -self.restitution
        if self.v["v"] < self.rest:
            self.v["h"] = self.v["v"] = 0.0
            self.at_rest = True
        return True, math.inf

    def output(self) -> None:
        self.v["y"] = self.v["h"]


def ball(*, height: float = 1.0, restitution: float = 0.8, tops: bool = False, rest: float = 0.0) -> type[Ball]:
    values = {"height": height, "restitution": restitution, "tops": tops, "nz": 2 if tops else 1, "rest": rest}
    return type("Ball", (Ball,), values)


def end_of(model: type[Ball]) -> float:
    """When the bounces end: the fall, then flights that shrink as a geometric series."""
    e = model.restitution
    return math.sqrt(2.0 * model.height / model.gravity) * (1.0 + 2.0 * e / (1.0 - e))


CASES = [
    ball(),
    ball(tops=True),
    ball(restitution=0.23, height=0.2),
    ball(restitution=0.34, height=0.02),
    ball(restitution=0.9, height=30.0),
    ball(restitution=0.55, height=6.0, tops=True),
]


@pytest.mark.parametrize("model", CASES)
@pytest.mark.parametrize("solver", SOLVERS)
def test_the_end_of_infinitely_many_bounces_is_told(solver: str, model: type[Ball]) -> None:
    end = end_of(model)
    with open_fake(model, solver) as session, pytest.raises(SimulationError, match="Zeno") as caught:
        session.advance(1.1 * end, signals={})
    assert caught.value.time == pytest.approx(end, rel=1e-4)


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_bounce_is_found_when_it_must(solver: str) -> None:
    model = ball()
    with open_fake(model, solver) as session:
        record = session.advance(end_of(model) - 1e-4, signals={}, record=["h", "v"])
    speed = record.values["v"]
    hits = [k for k in np.flatnonzero(np.diff(record.time) == 0.0) if speed[k] < 0.0 < speed[k + 1]]
    fall = math.sqrt(2.0 / model.gravity)
    expected = fall * (1.0 + 2.0 * np.cumsum([0.0, *(0.8**k for k in range(1, len(hits)))]))
    assert len(hits) > 40
    assert record.time[hits] == pytest.approx(expected, rel=1e-5)
    assert min(record.values["h"]) > -1e-10


@pytest.mark.parametrize("tops", [False, True])
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_ball_that_knows_rest_is_left_there(solver: str, tops: bool) -> None:
    model = ball(rest=1e-4, tops=tops)
    with open_fake(model, solver) as session:
        record = session.advance(2.0 * end_of(model), signals={}, record=["h"])
    assert record.values["h"][-1] == 0.0


class Switching(Hybrid):
    """dx/dt = 1, and an event where x passes each of the places."""

    states = ("x",)
    nz = 1
    places: tuple[float, ...] = ()

    def start(self) -> None:
        self.waiting = [*self.places, math.inf]

    def derivatives(self) -> list[float]:
        return [1.0]

    def indicators(self) -> list[float]:
        return [max(self.v["x"] - self.waiting[0], -10.0)]

    def event(self) -> tuple[bool, float]:
        if self.v["x"] > self.waiting[0]:
            self.waiting.pop(0)
        return False, math.inf

    def output(self) -> None:
        self.v["y"] = self.v["x"]


@pytest.mark.parametrize(
    "places",
    [
        np.arange(1, 100) * 0.01,  # even
        np.cumsum(np.tile([0.3e-3, 0.7e-3], 50)),  # pulses
        np.concatenate([1.0 - 0.9 ** np.arange(1, 40), 1.0 + np.arange(1, 20) * 1e-2]),  # shrinks, then goes on
        np.array([0.5, 0.8, 0.9, 0.95, 0.97, 0.9701, 0.9702, 1.2, 1.9]),  # a sudden pair
    ],
)
@pytest.mark.parametrize("solver", SOLVERS)
def test_switching_that_only_is_quick_is_let_be(solver: str, places: np.ndarray) -> None:
    model = type("Switching", (Switching,), {"places": tuple(places)})
    with open_fake(model, solver) as session:
        record = session.advance(2.0, signals={}, record=["x"])
    events = np.count_nonzero(np.diff(record.time) == 0.0)
    assert events == np.count_nonzero(places < 2.0)
    assert record.values["x"][-1] == pytest.approx(2.0, rel=1e-9)


class Shifted(Ball):
    """A ball whose relation h > 0 has a hysteresis, as in FMUs of many tools: an event shifts its zero."""

    hysteresis = 1e-13

    def start(self) -> None:
        super().start()
        self.above = True

    def indicators(self) -> list[float]:
        return [self.v["h"] + (self.hysteresis if self.above else -self.hysteresis)]

    def event(self) -> tuple[bool, float]:
        was, self.above = self.above, self.indicators()[0] > 0.0
        if was and not self.above:
            self.v["v"] *= -self.restitution
        return was and not self.above, math.inf


@pytest.mark.parametrize(
    ("restitution", "gravity", "height"),
    [
        (0.0675597889, 16.4835426, 2.84697907e-3),
        (0.101982736, 12.3828226, 7.29988325e-3),
        (0.0469882, 2.85958, 2.248e-3),
    ],
)
@pytest.mark.parametrize("solver", SOLVERS)
def test_no_ball_falls_through_where_rebounds_are_lower_than_the_hysteresis(
    solver: str, restitution: float, gravity: float, height: float
) -> None:
    values = {"height": height, "restitution": restitution, "gravity": gravity}
    model = type("Shifted", (Shifted,), values)
    with open_fake(model, solver) as session, pytest.raises(SimulationError, match=r"Zeno|reverses or stops") as caught:
        session.advance(1.5 * end_of(model), signals={})
    assert caught.value.time == pytest.approx(end_of(model), rel=1e-3)


class Clock(Hybrid):
    """Counts `ticks` time events, a millisecond apart, then none."""

    states = ("x",)
    ticks = 100

    def start(self) -> None:
        self.counted = 0

    def derivatives(self) -> list[float]:
        return [0.0]

    def event(self) -> tuple[bool, float]:
        if self.counted < self.ticks and self.t >= 1e-3 * (self.counted + 1):
            self.counted += 1
        return False, 1e-3 * (self.counted + 1) if self.counted < self.ticks else math.inf

    def output(self) -> None:
        self.v["y"] = float(self.counted)


@pytest.mark.parametrize("solver", SOLVERS)
def test_samples_are_progress_in_a_long_run(solver: str) -> None:
    with open_fake(Clock, solver) as session:
        assert session.advance(3e5, signals={}, record=["y"]).values["y"][-1] == Clock.ticks


@pytest.mark.parametrize("solver", SOLVERS)
def test_many_switches_of_one_kind_go_at_the_same_instant(solver: str) -> None:
    model = type("Switching", (Switching,), {"places": tuple(1.0 + 1e-12 * np.arange(200))})
    with open_fake(model, solver) as session:
        assert session.advance(2.0, signals={}, record=["y"]).values["y"][-1] == pytest.approx(2.0, rel=1e-9)
        inner = inside(session)
        assert isinstance(inner, Switching)
        assert inner.waiting == [math.inf]


class Lag(Hybrid):
    """dx/dt = u − x, with a relation that never switches."""

    states = ("x",)
    inputs = ("u",)
    nz = 1

    def derivatives(self) -> list[float]:
        return [self.v["u"] - self.v["x"]]

    def indicators(self) -> list[float]:
        return [self.v["x"] + 10.0]

    def output(self) -> None:
        self.v["y"] = self.v["x"]


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_input_may_jump_faster_and_faster(solver: str) -> None:
    """The input is 1 and 0 by turns, in pieces of which each is half as long as the one before."""
    times = 1.0 - 0.5 ** np.arange(40)
    values = (np.arange(40) + 1) % 2
    truth = 0.0
    for value, piece in zip(values, np.diff([*times, 2.0]), strict=True):
        truth = value + (truth - value) * math.exp(-piece)
    signal = wb.Table(times=tuple(times), values=tuple(values.astype(float)), interpolate="hold")
    with open_fake(Lag, solver) as session:
        assert session.advance(2.0, signals={"u": signal}, record=["y"]).values["y"][-1] == pytest.approx(
            truth, rel=1e-4
        )
