"""Trim of sampled models and of black boxes: fixed points of a period, of a step, and rest by running."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import workbench as wb
from tests.trim_models import Equations, Plant
from workbench.errors import SimulationError
from workbench.jobs.job import Job
from workbench.point.trim.problem import TrimSets
from workbench.point.trim.request import Trim, trim
from workbench.point.trim.run import _TrimRun
from workbench.session.settle import settle
from workbench.session.start_values import NotReachedError


def sampled() -> Plant:
    """A sampled low pass d ← 0.8 d + 0.2 u and a free counter-like state."""
    return Plant(
        Equations(
            u={"u": 2.0},
            memory={"d": 0.0, "c": 7.0},
            outputs=("y",),
            tick=lambda v: [0.8 * v["d"] + 0.2 * v["u"], v["c"]],
            g=lambda v: [3.0 * v["d"]],
            period=0.25,
        )
    )


def hybrid() -> Plant:
    """Plant x' = k − x under a sampled integrator k ← k + 0.3·(u − x): at rest x = k = u."""
    return Plant(
        Equations(
            x={"x": 0.0},
            u={"u": 1.5},
            memory={"k": 0.0},
            f=lambda v: [v["k"] - v["x"]],
            tick=lambda v: [v["k"] + 0.3 * (v["u"] - v["x"])],
            period=0.5,
        )
    )


def test_fixed_point_of_a_sampled_model_and_its_family() -> None:
    result = trim(sampled())
    assert result.converged
    assert result.method == "period map"
    assert result.operating_point.discrete == pytest.approx({"d": 2.0, "c": 7.0})
    assert result.operating_point.y == pytest.approx({"y": 6.0})
    assert result.operating_point.period == pytest.approx(0.25)
    assert [d.components for d in result.null_directions] == [{"c": 7.0}]


def test_input_for_an_output_of_a_sampled_model() -> None:
    result = trim(sampled(), free=["u"], fix={"y": 3.0})
    assert result.converged
    assert result.operating_point.u["u"] == pytest.approx(1.0)


def test_hybrid_model_brings_both_kinds_of_states_to_rest() -> None:
    result = trim(hybrid())
    assert result.converged
    assert result.operating_point.x["x"] == pytest.approx(1.5, abs=1e-6)
    assert result.operating_point.discrete["k"] == pytest.approx(1.5, abs=1e-6)
    assert result.operating_point.dx["x"] == pytest.approx(0.0, abs=1e-6)


def test_a_sampled_integrator_with_an_input_never_rests() -> None:
    plant = Plant(Equations(u={"u": 1.0}, memory={"d": 0.0}, tick=lambda v: [v["d"] + v["u"]], period=1.0))
    result = trim(plant)
    assert not result.converged
    assert "change of d is off by 1" in result.message


def test_states_that_come_back_once_only_are_no_rest() -> None:
    # The counter decides every fourth time: after one period all looks still.
    calls = {"n": 0}

    def tick(v: dict[str, float]) -> list[float]:
        calls["n"] += 1
        return [v["d"] + (1.0 if calls["n"] % 4 == 0 else 0.0)]

    plant = Plant(Equations(memory={"d": 0.0}, tick=tick, period=1.0))
    result = trim(plant)
    assert not result.converged


def test_a_rate_limiter_far_from_rest_is_run_there() -> None:
    plant = Plant(
        Equations(
            u={"u": 3.0},
            memory={"d": 0.0},
            tick=lambda v: [v["d"] + min(max(v["u"] - v["d"], -0.5), 0.5)],
            period=0.1,
        )
    )
    result = trim(plant)
    assert result.converged
    assert result.operating_point.discrete["d"] == pytest.approx(3.0)
    assert "running for 8 periods" in " ".join(result.notes)


# -- co-simulation ------------------------------------------------------------------------


def oscillator(damping: float, *, settable: bool = True) -> Plant:
    return Plant(
        Equations(
            x={"s": 0.5, "v": 0.0},
            u={"f": 100.0},
            outputs=("y",),
            f=lambda v: [v["v"], v["f"] - 1e4 * v["s"] - damping * v["v"]],
            g=lambda v: [2.0 * v["s"]],
            settable=settable,
        ),
        interface="cs",
    )


def test_step_map_finds_the_rest_of_an_undamped_model() -> None:
    result = trim(oscillator(0.0))
    assert result.converged
    assert result.method == "step map"
    assert result.operating_point.x == pytest.approx({"s": 0.01, "v": 0.0}, abs=1e-10)
    assert result.operating_point.y == pytest.approx({"y": 0.02}, abs=1e-10)


def test_running_finds_the_rest_of_a_damped_black_box_at_a_step_that_is_stable() -> None:
    result = trim(oscillator(10.0, settable=False), step=None)
    assert result.converged
    assert result.method == "running"
    assert result.operating_point.x == pytest.approx({"s": 0.01, "v": 0.0}, abs=1e-6)
    assert "communication step 0.000125 s" in " ".join(result.notes)  # explicit Euler is unstable at 1 ms


def test_without_states_and_outputs_there_is_nothing_to_bring_to_rest() -> None:
    result = trim(Plant(Equations(u={"u": 2.0}), interface="cs"))
    assert result.converged
    assert result.operating_point.u == {"u": 2.0}
    assert any("nothing to bring to rest" in note for note in result.notes)


def test_running_does_not_take_an_endless_swing_for_rest() -> None:
    result = trim(oscillator(1e-3, settable=False), step=1e-5, longest=0.5)
    assert not result.converged
    assert "movement of s" in result.message


def test_running_adjusts_a_free_input() -> None:
    plant = Plant(
        Equations(x={"x": 0.0}, u={"u": 1.0}, outputs=("y",), f=lambda v: [v["u"] - v["x"]], g=lambda v: [v["x"]],
                  settable=False),
        interface="cs",
    )  # fmt: skip
    result = trim(plant, free=["u"], fix={"y": 3.0}, step=0.05)
    assert result.converged
    assert result.operating_point.u["u"] == pytest.approx(3.0, rel=1e-5)
    assert result.operating_point.y["y"] == pytest.approx(3.0, rel=1e-5)
    assert not result.notes[-2:][0].startswith("2 unknowns")


def test_states_that_can_only_be_observed_cannot_be_fixed() -> None:
    with pytest.raises(wb.InputError, match="only be observed"):
        trim(oscillator(10.0, settable=False), fix={"s": 1.0})
    with pytest.raises(wb.InputError, match=r"x0: the model has no state or input 's'"):
        trim(oscillator(10.0, settable=False), x0={"s": 1.0})


def test_a_slow_drift_is_not_rest() -> None:
    plant = Plant(Equations(x={"x": 0.0}, f=lambda v: [1e-9]), interface="cs")
    with plant.open_at(step=0.1) as session:
        end = settle(session, ["x"], np.ones(1), first=1.0, longest=1000.0, tolerance=1e-6)
    assert not end.settled
    assert end.time <= 1000.0 + 1e-6


def test_an_exponential_is_followed_to_its_end() -> None:
    plant = Plant(Equations(x={"x": 1.0}, f=lambda v: [-v["x"] / 20.0]), interface="cs")
    with plant.open_at(step=0.05) as session:
        end = settle(session, ["x"], np.ones(1), first=1.0, longest=math.inf, tolerance=1e-6)
    assert end.settled
    assert abs(end.values[0]) < 2e-6


def test_a_slow_sampler_is_not_at_rest_between_its_samples() -> None:
    # One sample a second, 1 ms steps: what stands still for a while is watched longer.
    plant = Plant(
        Equations(u={"u": 2.0}, memory={"d": 0.0}, outputs=("y",), tick=lambda v: [0.5 * (v["d"] + v["u"])],
                  g=lambda v: [v["d"]], period=1.0),
        interface="cs",
    )  # fmt: skip
    result = trim(plant)
    assert result.converged
    assert result.method == "running"
    assert result.operating_point.y["y"] == pytest.approx(2.0, rel=1e-5)


# -- models that end their run, or put themselves elsewhere ----------------------------------


def ending() -> Plant:
    return Plant(Equations(outputs=("y",), g=lambda _: [1.0], ends=9.0), interface="cs")


@pytest.mark.parametrize("begins", [0.0, 4.0])
def test_a_run_that_the_model_ends_is_named_in_one_line(begins: float) -> None:
    words = rf"ended its run \(at t = 9 s\) before it came to rest; longest below {9.0 - begins:g} s"
    with pytest.raises(SimulationError, match=words):
        trim(ending(), step=0.2, time=begins)


def test_a_fixed_point_whose_run_the_model_ends_is_not_said_to_move() -> None:
    """d = d holds at once; 9 s is less than is watched, so that nobody knows whether it stays."""
    result = trim(
        Plant(Equations(outputs=("y",), memory={"d": 1.0}, tick=lambda v: [v["d"]], g=lambda v: [v["d"]],
                        period=1.0, ends=9.0))
    )  # fmt: skip
    assert not result.converged
    assert "a run from there does not confirm it" in result.message
    assert "a run cannot show whether the model stays there: the FMU ended its run (at t = 9 s)" in result.notes


def test_a_model_at_rest_is_seen_at_rest_before_it_ends_its_run() -> None:
    result = trim(ending(), step=0.02, longest=8.0)
    assert result.converged
    assert result.operating_point.y == {"y": 1.0}


def test_no_run_to_its_end_leaves_no_point() -> None:
    """x' = x² goes from 1 to infinity within a second: there is no number to report."""
    plant = Plant(Equations(x={"x": 1.0}, f=lambda v: [v["x"] ** 2], settable=False), interface="cs")
    with pytest.raises(SimulationError, match="no equilibrium found by running: "):
        trim(plant)


def logarithm(nominal: float) -> Plant:
    """x' = −ln x, of which no session starts at x ≤ 0; at rest x = 1."""
    equations = Equations(
        x={"x": 5.0}, f=lambda v: [-math.log(v["x"])], takes=lambda v: v["x"] > 0.0, nominal={"x": nominal}
    )
    return Plant(equations, interface="cs", step=0.02)


def test_a_point_that_the_model_does_not_take_is_no_error_of_the_user() -> None:
    """Newton's method goes from 5 to 5 − 5 ln 5 = −3."""
    result = trim(logarithm(1.0), step=0.02)
    assert result.converged
    assert result.operating_point.x["x"] == pytest.approx(1.0, abs=1e-6)


def test_a_start_that_the_model_does_not_take_is_the_users() -> None:
    """States are seen to be settable at −1 + 0.125 · 16."""
    with pytest.raises(NotReachedError, match=r"cannot be started at \{'x': -1\.0"):
        trim(logarithm(16.0), step=0.02, x0={"x": -1.0})


@pytest.mark.parametrize(("moved", "value", "names"), [(0.8e-5, 0.0, ""), (1.5e-5, 0.0, "w"), (1.5e-3, 200.0, "")])
def test_what_moves_by_more_than_1e_5_of_its_size_in_the_periods_after_the_first_is_named(
    moved: float, value: float, names: str
) -> None:
    """The size of what declares none is its value, and 1 at least."""
    balance: Any = SimpleNamespace(states=(), outputs=(), drift=lambda *_, periods: {"w": (moved, value)})
    none = np.zeros(0)
    verdict = SimpleNamespace(scales=none)
    nothing: Any = SimpleNamespace(
        unknowns=(), equations=(), at=lambda _: (), values=none, nominal=none, verdict=verdict
    )
    lag = Plant(Equations(x={"x": 0.0}, f=lambda v: [-v["x"]]))
    said = _TrimRun(lag, TrimSets(), 0.0, Trim(), Job())._restless(balance, nothing, nothing)
    assert said == (f"after 20 periods {names} moved although the states had returned" if names else "")


@pytest.mark.parametrize(("time", "moved"), [(0.5, False), (0.3, True)])
def test_a_point_that_is_moved_to_the_next_basic_period_is_told(time: float, moved: bool) -> None:
    result = trim(sampled(), time=time)
    assert result.operating_point.time == pytest.approx(0.5)
    note = "the point is at 0.5 s, where a basic period of 0.25 s begins, not at 0.3 s"
    assert (note in result.notes) == moved
