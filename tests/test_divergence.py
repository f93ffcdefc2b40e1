"""Growth without bound: finite escape, exponential, none; closed forms, and simulations that end in it."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest

import workbench as wb
from workbench.limit_cycles.feed_forward.trial import settling
from workbench.response.simulate.divergence import _points, divergence

Grow = Callable[[np.ndarray], np.ndarray | float]


def towards(end: float, *, halvings: int = 40) -> np.ndarray:
    """Times that come ever nearer to `end`."""
    return end - end * 2.0 ** (-np.arange(0.25, halvings, 0.25))


def closing(
    grow: Grow, start: float, *, solver: str = "vkm", tolerance: float = 1e-6, a: float = 0.0
) -> wb.DescribedModel:
    """dx/dt = a x + grow(x), from `start`."""
    integrator = wb.LinearComponent(
        name="x", A=np.array([[a]]), B=np.ones((1, 1)), C=np.ones((1, 1)), D=np.zeros((1, 1)), dt=0.0,
        input_names=("u",), output_names=("y",), state_names=("x",), x0=np.array([start]),
    )  # fmt: skip
    wires = [("x.y", "f.u"), ("f.y", "x.u")]
    return wb.connect({"x": integrator, "f": grow}, wires, outputs={"y": "x.y"}, solver=solver, tolerance=tolerance)


def square(u: np.ndarray) -> float:
    return float(u[0] * u[0])


@pytest.mark.parametrize("p", [0.5, 1.0, 2.0, 5.0])
def test_a_pole_in_time_is_found(p: float) -> None:
    t = towards(3.0)
    found = divergence(t, (3.0 - t) ** -p)
    assert found is not None
    assert found.kind == "finite escape"
    assert found.escape_time == pytest.approx(3.0, abs=1e-9)
    # Logarithms are interpolated between points that are a quarter of a halving apart.
    assert found.exponent == pytest.approx(p, rel=0.05)
    assert found.doubling_times[-1] < found.doubling_times[0]


def test_sign_and_oscillation_do_not_matter() -> None:
    t = towards(3.0)
    found = divergence(t, -np.cos(40.0 * t) / (3.0 - t))
    assert found is not None
    assert found.kind == "finite escape"
    assert found.escape_time == pytest.approx(3.0, abs=1e-6)


def test_exponential_growth_is_told_from_it() -> None:
    t = np.linspace(0.0, 100.0, 5000)
    found = divergence(t, np.exp(0.5 * t))
    assert found is not None
    assert (found.kind, found.escape_time) == ("exponential", None)
    assert found.doubling_times[-1] == pytest.approx(math.log(2.0) / 0.5, rel=1e-3)
    assert "doubling every 1.39 s" in found.words


def test_growth_between_the_two_claims_no_time() -> None:
    t = np.linspace(0.0, 20.0, 20000)
    found = divergence(t, np.exp(t * t))  # ever faster, but finite at every time
    assert found is not None
    assert (found.kind, found.escape_time) == ("growing", None)


@pytest.mark.parametrize(
    "values",
    [
        np.sin,
        lambda t: t,
        lambda t: t**3,
        lambda t: 1.0 - np.exp(-t),
        lambda t: np.where(t < 50.0, np.exp(0.5 * t), np.exp(25.0)),  # it stopped growing
        np.zeros_like,
        lambda t: np.full_like(t, np.nan),
        lambda t: np.exp(0.1 * t),  # a factor of 22000: an unstable start, no catastrophe
    ],
)
def test_what_does_not_diverge(values: Callable[[np.ndarray], np.ndarray]) -> None:
    t = np.linspace(0.0, 100.0, 3000)
    assert divergence(t, values(t)) is None


@pytest.mark.parametrize("x0", [0.01, 0.5, 4.0])
@pytest.mark.parametrize(("solver", "error"), [("vkm", 1e-5), ("gear", 1e-4)])
def test_x_squared_escapes_at_its_time(x0: float, solver: str, error: float) -> None:
    # dx/dt = x²: x = 1/(1/x0 − t). The solver's tolerance of 1e-6 shifts the time by more than that.
    with closing(square, x0, solver=solver) as model, pytest.raises(wb.DivergenceError) as caught:
        wb.simulate(model, stop=2.0 / x0)
    found = caught.value.divergence
    assert (found.variable, found.kind) == ("y", "finite escape")
    assert found.escape_time == pytest.approx(1.0 / x0, rel=error)
    assert found.exponent == pytest.approx(1.0, rel=0.01)
    assert caught.value.time == pytest.approx(1.0 / x0, rel=error)
    assert "escapes to infinity in finite time" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_finer_tolerance_finds_the_time_more_exactly() -> None:
    with closing(square, 0.5, tolerance=1e-11) as model, pytest.raises(wb.DivergenceError) as caught:
        wb.simulate(model, stop=10.0)
    assert caught.value.divergence.escape_time == pytest.approx(2.0, rel=1e-8)


def test_the_rows_before_an_escape_resolve_it() -> None:
    """x = 1/(2 − t), whatever the interval; points asked for one by one are those and no others."""
    with closing(square, 0.5, tolerance=1e-9) as model:
        with pytest.raises(wb.DivergenceError) as caught:
            wb.simulate(model, stop=60.0)
        before = caught.value.before
        assert isinstance(before, wb.SimulationResult)
        y, near = before.signals["y"], before.time < 2.0 - 1e-5
        np.testing.assert_allclose(y[near], 1.0 / (2.0 - before.time[near]), rtol=1e-3)
        assert np.max(y[1:] / y[:-1]) < 1.5
        assert y[-1] > 1e6
        with pytest.raises(wb.DivergenceError) as caught:
            wb.simulate(model, stop=60.0, points=[1.0, 1.5, 60.0])
        before = caught.value.before
        assert isinstance(before, wb.SimulationResult)
        assert before.time[:3].tolist() == [0.0, 1.0, 1.5]
        assert len(before.time) < 10


def test_the_bernoulli_equation_escapes_from_above_its_threshold_only() -> None:
    # dx/dt = −x + x²: from x0 > 1 the escape is at ln(x0/(x0 − 1)), from below 1 it decays.
    with closing(square, 1.5, a=-1.0) as model, pytest.raises(wb.DivergenceError) as caught:
        wb.simulate(model, stop=10.0)
    assert caught.value.divergence.escape_time == pytest.approx(math.log(3.0), rel=1e-4)
    with closing(square, 0.9, a=-1.0) as model:
        assert wb.simulate(model, stop=10.0).signals["y"][-1] < 1e-2


def test_exponential_overflow_is_no_escape() -> None:
    with closing(lambda u: 0.0 * u, 1.0, a=1.0) as model, pytest.raises(wb.DivergenceError) as caught:
        wb.simulate(model, stop=2000.0)
    assert caught.value.divergence.kind == "exponential"
    assert caught.value.time == pytest.approx(math.log(1.7e308), rel=0.01)


def test_a_bounded_run_of_an_unstable_system_is_left_alone() -> None:
    with closing(lambda u: 0.0 * u, 1e-6, a=1.0) as model:
        result = wb.simulate(model, stop=10.0)
        assert result.signals["y"][-1] == pytest.approx(1e-6 * math.exp(10.0), rel=1e-4)
        assert not any("grows" in note for note in result.notes)
        # Longer, it says so.
        (note,) = (n for n in wb.simulate(model, stop=40.0).notes if "this process" not in n)
        assert note.startswith("y grows exponentially, doubling every 0.693 s, to 2.35e+11")


def test_another_failure_keeps_its_words() -> None:
    def root(u: np.ndarray) -> float:
        return float("nan") if u[0] <= 0.5 else -1.0

    with closing(root, 1.0) as model, pytest.raises(wb.SimulationError) as caught:
        wb.simulate(model, stop=10.0)
    assert not isinstance(caught.value, wb.DivergenceError)


def test_the_error_survives_another_process() -> None:
    with closing(square, 0.5) as model, pytest.raises(wb.DivergenceError) as caught:
        wb.simulate(model, stop=10.0)
    again = pickle.loads(pickle.dumps(caught.value))  # noqa: S301 - our own bytes
    assert (str(again), again.time, again.divergence) == (str(caught.value), caught.value.time, caught.value.divergence)
    assert again.divergence.to_dict()["kind"] == "finite escape"


def test_settling() -> None:
    t = np.linspace(0.0, 100.0, 100_001)
    x = np.exp(-0.1 * t) * np.cos(20.0 * t)
    # The envelope passes 0.1 at ln 10/0.1; the last peak before is at most half a period earlier.
    assert settling(t, x, 0.0, 0.1) == pytest.approx(10.0 * math.log(10.0), abs=math.pi / 20.0)
    assert settling(t, x, 0.0, 2.0) == 0.0
    assert settling(t, np.cos(t), 0.0, 0.5) is None


@pytest.mark.parametrize("stop", [0.3, 0.5, 2.0])
def test_a_step_response_is_no_growth(stop: float) -> None:
    with wb.load("fmu:Rudder") as rudder:
        found = wb.simulate(rudder, stop=stop, inputs={"delC": wb.Step(time=0.1, value=1.0)}, outputs=["del"])
    assert found.notes == ()


@pytest.mark.parametrize("power", [1, 2, 3, 6])
@pytest.mark.parametrize("noise", [0.0, 1e-17])
def test_a_rise_from_nothing_is_no_growth(power: int, noise: float) -> None:
    time = np.linspace(0.0, 1.0, 501)
    assert divergence(time, noise + np.clip(time - 0.2, 0.0, None) ** power) is None
    assert divergence(time, noise + np.clip(np.minimum(time, 0.21) - 0.2, 0.0, None) ** power) is None
    assert divergence(time, noise * (1.0 + time) + np.where(time > 0.5, 1.0, 0.0)) is None


@pytest.mark.parametrize(("start", "end"), [(0.0, 2.0), (5.0, 6.0), (1e9, 1e9 + 1e-4), (1e9, 1e9 + 1e-5)])
def test_points_before_a_failure_lie_in_the_run_and_come_near_its_end(start: float, end: float) -> None:
    class Session:
        communication_step = None

    chunks = _points(start, end, cast("Any", Session()))
    every = np.concatenate(chunks)
    assert all(len(chunk) for chunk in chunks)
    assert np.all(np.diff(every) > 0.0)
    assert start < every[0] < every[-1] < end
    assert end - every[-1] <= max((end - start) / 8.0, 128.0 * np.spacing(end))
