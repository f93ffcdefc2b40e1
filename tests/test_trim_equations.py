"""Trim of continuous models by equations: closed forms, sets, families, and what has no solution."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import workbench as wb
from tests.trim_models import Equations, Function, Plant
from workbench.point.trim.balance import ContinuousBalance
from workbench.point.trim.problem import TrimSets, pose
from workbench.point.trim.request import trim
from workbench.point.trim.result import TrimResult
from workbench.point.trim.scaled import ScaledEquations
from workbench.point.trim.solve import _FamilySearch


def told(result: TrimResult) -> list[str]:
    """Return the notes but for that on where a model of this process runs."""
    return [note for note in result.notes if "exists only in this process" not in note]


def lag() -> Plant:
    return Plant(
        Equations(x={"x": 0.0}, u={"u": 0.0}, outputs=("y",), f=lambda v: [v["u"] - v["x"]], g=lambda v: [v["x"]])
    )


def integrator() -> Plant:
    """x' = u, v' = x − v: any x is an equilibrium for u = 0, none is for another u."""
    ones = {"x": 1.0, "v": 1.0}
    return Plant(Equations(x={"x": 3.0, "v": 0.0}, u={"u": 0.0}, f=lambda v: [v["u"], v["x"] - v["v"]], nominal=ones))


def stiff() -> Plant:
    """States of 1e7 and 1e-4, rates of 1e4 and 1e-3 per second; p = 2e7, q = 3e-4 at rest."""
    return Plant(
        Equations(
            x={"p": 0.0, "q": 0.0},
            u={"u": 2e7},
            nominal={"p": 1e7, "q": 1e-4},
            f=lambda v: [1e4 * (v["u"] - v["p"]), 1e-3 * (1.5e-11 * v["p"] - v["q"])],
        )
    )


def test_each_state_at_rest_under_the_start_inputs() -> None:
    result = trim(lag(), u0={"u": 2.5})
    assert result.converged
    assert result.method == "equations"
    assert result.operating_point.x == pytest.approx({"x": 2.5}, abs=1e-12)
    assert result.operating_point.y == pytest.approx({"y": 2.5}, abs=1e-12)
    assert result.operating_point.dx["x"] == pytest.approx(0.0, abs=1e-12)
    assert not result.null_directions
    assert not told(result)


def test_scaling_takes_states_of_very_different_size() -> None:
    result = trim(stiff())
    assert result.converged
    assert result.operating_point.x["p"] == pytest.approx(2e7, rel=1e-12)
    assert result.operating_point.x["q"] == pytest.approx(3e-4, rel=1e-9)


def test_a_free_input_meets_a_fixed_output() -> None:
    result = trim(lag(), free=["u"], fix={"y": 3.0})
    assert result.converged
    assert result.operating_point.u["u"] == pytest.approx(3.0)
    assert result.unknowns == ("x", "u")


def test_a_fixed_state_needs_a_free_input() -> None:
    result = trim(lag(), free=["u"], fix={"x": -1.5})
    assert result.converged
    assert result.operating_point.u["u"] == pytest.approx(-1.5)
    assert result.operating_point.x["x"] == -1.5


def test_bounds_choose_between_two_equilibria_and_are_kept() -> None:
    square = Plant(Equations(x={"x": 1.0}, f=lambda v: [v["x"] ** 2 - 4.0]))
    assert trim(square).operating_point.x["x"] == pytest.approx(2.0)
    assert trim(square, x0={"x": -1.0}).operating_point.x["x"] == pytest.approx(-2.0)
    assert trim(square, bound={"x": (-5.0, -0.1)}).operating_point.x["x"] == pytest.approx(-2.0)
    refused = trim(square, bound={"x": (3.0, 5.0)})
    assert not refused.converged
    assert 3.0 <= refused.operating_point.x["x"] <= 5.0


def test_an_output_within_bounds_is_no_equation_but_is_kept() -> None:
    result = trim(lag(), free=["u"], bound={"y": (2.0, math.inf)})
    assert result.converged
    assert result.operating_point.y["y"] >= 2.0 - 1e-7
    assert "1 equation (der(x))" in told(result)[0]


# -- families -----------------------------------------------------------------------------


def test_an_integrator_at_rest_is_a_family_and_the_start_is_kept() -> None:
    result = trim(integrator())
    assert result.converged
    assert result.operating_point.x == pytest.approx({"x": 1.5, "v": 1.5})  # nearest to (3, 0) on x = v
    assert [d.components for d in result.null_directions] == [pytest.approx({"x": 1.0, "v": 1.0})]
    assert "1 direction is left open (x, v)" in result.message


def test_separate_families_are_told_apart_by_name() -> None:
    plant = Plant(
        Equations(x={"a": 1.0, "b": 2.0, "c": 0.0}, f=lambda v: [0.0, 0.0, 4.0 - v["c"]], nominal={"a": 5.0, "b": 7.0})
    )
    result = trim(plant)
    assert result.converged
    assert result.operating_point.x == pytest.approx({"a": 1.0, "b": 2.0, "c": 4.0})
    assert sorted((d.components for d in result.null_directions), key=list) == [{"a": 5.0}, {"b": 7.0}]


def test_a_curved_family_ends_at_the_point_nearest_to_the_start() -> None:
    circle = Plant(Equations(x={"x": 3.0, "y": 4.0}, f=lambda v: [v["x"] ** 2 + v["y"] ** 2 - 1.0, 0.0]))
    circle.equations.nominal.update({"x": 1.0, "y": 1.0})
    result = trim(Plant(circle.equations))
    assert result.converged
    assert result.operating_point.x == pytest.approx({"x": 0.6, "y": 0.8}, abs=1e-5)


def test_floating_states_are_made_slow_or_kept_near_the_start() -> None:
    # a' = b − 1, b' = 0·…: with a floating, b is open; slowest is b = 1, nearest is b = 5.
    plant = Plant(Equations(x={"a": 0.0, "b": 5.0}, f=lambda v: [v["b"] - 1.0, 0.0]))
    slowest = trim(plant, floating=["a"])
    assert slowest.converged
    assert slowest.operating_point.x == pytest.approx({"a": 0.0, "b": 1.0})
    nearest = trim(plant, floating=["a"], family="nearest")
    assert nearest.converged
    assert nearest.operating_point.x == pytest.approx({"a": 0.0, "b": 5.0})
    assert nearest.operating_point.dx["a"] == pytest.approx(4.0)
    assert [r.required for r in nearest.residuals] == [True, False]


def motor(interface: str = "me", *, shown: bool = False, spring: float = 0.0) -> Plant:
    """A shaft that turns: w' = 2 u - 4 w - spring * sin(angle), angle' = w."""
    return Plant(
        Equations(
            x={"angle": 0.3, "w": 0.0},
            u={"u": 6.0},
            outputs=("speed", "where") if shown else ("speed",),
            f=lambda v: [v["w"], 2.0 * v["u"] - 4.0 * v["w"] - spring * math.sin(v["angle"])],
            g=lambda v: [v["w"], v["angle"]] if shown else [v["w"]],
        ),
        interface=interface,
    )


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_state_that_nothing_depends_on_may_move_and_is_told(interface: str) -> None:
    result = trim(motor(interface))
    assert result.converged
    assert result.operating_point.x["w"] == pytest.approx(3.0, rel=1e-6)
    assert "angle moves, since nothing depends on it, as `floating` asks for" in told(result)
    assert [r.required for r in result.residuals] == [True, False]


def test_a_state_that_is_shown_moves_where_it_is_asked_for() -> None:
    result = trim(motor(shown=True))
    assert not result.converged
    assert "angle, on which only outputs depend, moves where `floating` names it" in told(result)
    assert trim(motor(shown=True), floating=["angle"]).operating_point.x["w"] == pytest.approx(3.0)


def test_a_state_that_something_depends_on_does_not_move() -> None:
    result = trim(motor(spring=1.0))
    assert not result.converged
    assert not any("--float" in note for note in result.notes)


# -- no solution --------------------------------------------------------------------------


def test_an_integrator_with_an_input_has_no_equilibrium_and_says_which() -> None:
    result = trim(integrator(), u0={"u": 1.0})
    assert not result.converged
    assert "der(x) is off by 1 m/s" in result.message
    assert "does not react to any unknown" in result.message
    left = {r.name: r for r in result.residuals}
    assert left["der(x)"].idle
    assert left["der(x)"].value == pytest.approx(1.0)
    assert not result.null_directions


def test_an_output_beyond_saturation_cannot_be_had() -> None:
    plant = lag()
    plant.equations.g = lambda v: [min(max(v["x"], -1.0), 1.0)]
    result = trim(plant, free=["u"], fix={"y": 2.0})
    assert not result.converged
    assert "y = 2" in result.message
    inside = trim(plant, free=["u"], fix={"y": 0.5})
    assert inside.converged


def test_too_many_equations_are_explained_by_name() -> None:
    result = trim(lag(), fix={"y": 3.0})
    assert not result.converged
    note, other = told(result)
    assert note.startswith("1 unknown (x), 2 equations (der(x), y = 3): over-determined by 1; free u")
    assert other == "without the fixed values there is an equilibrium, with y = 0"


def test_too_many_equations_that_agree_are_solved() -> None:
    result = trim(lag(), fix={"y": 3.0}, u0={"u": 3.0})
    assert result.converged
    assert result.operating_point.x["x"] == pytest.approx(3.0)
    (note,) = told(result)
    assert note.endswith("over-determined by 1; they hold together nevertheless")


def test_no_real_root_is_no_silent_solution() -> None:
    result = trim(Plant(Equations(x={"x": 1.0}, f=lambda v: [v["x"] ** 2 + 1.0])))
    assert not result.converged
    assert result.residuals[0].value >= 1.0 - 1e-9


def test_points_that_cannot_be_evaluated_are_stepped_around() -> None:
    root = Plant(Equations(x={"x": 4.0}, f=lambda v: [math.sqrt(v["x"]) - 0.1], domain=lambda v: v["x"] >= 0.0))
    result = trim(root)
    assert result.converged
    assert result.operating_point.x["x"] == pytest.approx(0.01)


def test_a_start_where_nothing_can_be_evaluated() -> None:
    plant = Plant(Equations(x={"x": -1.0}, f=lambda v: [v["x"]], domain=lambda v: v["x"] > 0.0))
    result = trim(plant)
    assert not result.converged
    assert "cannot be evaluated" in result.message


def test_a_flat_start_is_left_by_running_the_model() -> None:
    # The rate is limited far from rest: no slope leads from the start to x = 5.
    plant = Plant(Equations(x={"x": 0.0}, f=lambda v: [min(max(5.0 - v["x"], -1.0), 1.0)]))
    result = trim(plant)
    assert result.converged
    assert result.operating_point.x["x"] == pytest.approx(5.0)
    assert "running for 10 s" in told(result)[-1]


# -- derivatives --------------------------------------------------------------------------


def test_exact_derivatives_are_used_where_they_hold() -> None:
    plant = lag()
    plant.equations.jacobian = lambda x, u: np.array([[-1.0, 1.0], [1.0, 0.0]])
    exact, differences = trim(plant, u0={"u": 1.0}), trim(lag(), u0={"u": 1.0})
    assert exact.converged
    assert not told(exact)
    assert exact.evaluations < differences.evaluations


def test_wrong_directional_derivatives_are_noticed() -> None:
    plant = lag()
    plant.equations.jacobian = lambda x, u: np.array([[5.0, 1.0], [1.0, 0.0]])
    result = trim(plant, u0={"u": 1.0})
    assert result.converged
    assert "disagree with differences" in told(result)[0]


# -- input --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ({"free": ["nosuch"]}, "free: the model has no state, input or output 'nosuch'"),
        ({"fix": {"z": 1.0}}, "fix: the model has no state, input or output 'z'"),
        ({"floating": ["u"]}, "floating: 'u' of the model is an input; its states are"),
        ({"x0": {"y": 1.0}}, "x0: 'y'"),
        ({"fix": {"u": 1.0}, "free": ["u"]}, "'u' is in both fix and free"),
        ({"fix": {"x": 1.0}, "bound": {"x": (0.0, 1.0)}}, "'x' is in both fix and bound"),
        ({"bound": {"x": (1.0, 1.0)}}, "LO below HI"),
        ({"fix": {"x": math.nan}}, "fix: x: nan is not a number"),
        ({"family": "any"}, "family 'any' is unknown"),
        ({"tolerance": 0.0}, "tolerance: 0 is not a positive number"),
    ],
)
def test_bad_input_is_named(call: dict[str, object], words: str) -> None:
    with pytest.raises(wb.InputError, match=words):
        trim(lag(), **call)  # type: ignore[arg-type]


def test_an_integer_input_can_be_held_but_not_found() -> None:
    plant = Plant(Equations(x={"x": 0.0}, u={"n": 2.0}, whole=("n",), f=lambda v: [v["n"] - v["x"]]))
    assert trim(plant).operating_point.x["x"] == pytest.approx(2.0)
    with pytest.raises(wb.InputError, match="whole numbers"):
        trim(plant, free=["n"])


def test_without_states_the_point_is_what_the_inputs_make_it() -> None:
    plant = Plant(Equations(u={"u": 2.0}, outputs=("y",), g=lambda v: [v["u"] ** 2]))
    result = trim(plant)
    assert result.converged
    assert result.operating_point.y == {"y": 4.0}
    assert trim(plant, free=["u"], fix={"y": 9.0}).operating_point.u["u"] == pytest.approx(3.0)


def search_of(equations: Equations, **sets: Any) -> _FamilySearch:  # noqa: ANN401
    with Plant(equations).open_point() as point:
        problem = pose(ContinuousBalance(point), TrimSets(**sets))
    return _FamilySearch(ScaledEquations(problem, exact=False), 1e-9, np.array([k.start for k in problem.unknowns]))


@pytest.mark.parametrize(
    ("bound", "sum_", "step"),
    [
        ((-5.0, 0.0), 1.0, [0.0, 1.0]),
        ((0.0, 5.0), 1.0, [0.5, 0.5]),
        ((-5.0, 0.0), -1.0, [-0.5, -0.5]),
        ((0.0, 5.0), -1.0, [0.0, -1.0]),
    ],
)
def test_a_step_from_a_bound_is_the_least_that_stays_within(
    bound: tuple[float, float], sum_: float, step: list[float]
) -> None:
    """x + y = sum, from 0: both move alike, unless x would leave its bounds; then y moves alone."""
    equations = Equations(
        x={"x": 0.0, "y": 0.0}, f=lambda v: [v["x"] + v["y"] - sum_, 0.0], nominal={"x": 1.0, "y": 1.0}
    )
    search = search_of(equations, bound={"x": bound})
    assert search._step(np.zeros(2), slowest=False, home=False) == pytest.approx(step, abs=1e-9)


def test_a_step_is_halved_ten_times_to_where_the_model_can_be_evaluated() -> None:
    """1/1024 of it is within the end of the model's domain, 1/512 is not."""
    f: Function = lambda v: [1.0 - v["x"] if v["x"] < 0.0015 else math.nan]  # noqa: E731
    search = search_of(Equations(x={"x": 0.0}, f=f, nominal={"x": 1.0}))
    found = search._along(np.zeros(1), np.ones(1), slowest=False, home=False)
    assert found is not None
    assert found[0] == pytest.approx([1.0 / 1024.0])
    assert search._along(np.zeros(1), 2.0 * np.ones(1), slowest=False, home=False) is None


def test_more_unknowns_than_equations_need_not_leave_anything_open() -> None:
    """x' = x² + (u − 1)² vanishes at one point only, u − x on a line."""
    alone = Equations(x={"x": 0.0}, u={"u": 1.0}, f=lambda v: [v["x"] ** 2 + (v["u"] - 1.0) ** 2])
    result = trim(Plant(alone), free=["u"])
    assert (result.converged, result.null_directions) == (True, ())
    assert (
        "1 equation (der(x)): no direction is left open here all the same: the solution is isolated" in result.notes[0]
    )
    line = trim(lag(), free=["u"])
    assert len(line.null_directions) == 1
    assert told(line)[0].endswith(
        "under-determined by 1; fix one more value; otherwise one of many solutions is chosen"
    )
    none = trim(Plant(Equations(x={"x": 0.0}, u={"u": 0.0}, f=lambda v: [1.0 + v["x"] ** 2 + v["u"] ** 2])), free=["u"])
    assert not none.converged
    assert told(none)[0].endswith("under-determined by 1")


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_where_it_rests_without_the_fixed_values_is_told(interface: str) -> None:
    with wb.load("fmu:FirstOrderLag", interface=interface) as lag:
        result = wb.trim(lag, fix={"y": 2.0}, u0={"u": 1.0})
        assert not result.converged
        assert "without the fixed values there is an equilibrium, with y = 1" in result.notes
        assert not any("without the fixed" in note for note in wb.trim(lag, fix={"y": 1.0}, u0={"u": 1.0}).notes)


def test_the_position_of_a_servo_is_left_open_by_one_metre_whatever_is_free() -> None:
    """A valve, a cylinder and a mass under a load force: no equation depends on the position."""

    def servo(v: dict[str, float]) -> list[float]:
        q = 1e-3 * v["xv"] * math.sqrt(max(1.0 - v["pL"] / 21e6, 0.0))
        slope = (2e-3 * v["pL"] - 2e3 * v["v"] - v["F"]) / 200.0
        return [v["v"], 4e12 * (q - 2e-3 * v["v"] - 2e-12 * v["pL"]), slope, (v["u"] - v["xv"]) / 4e-3]

    zeros = dict.fromkeys(("x", "pL", "v", "xv"), 0.0)
    for force, free, floating in ((0.0, [], []), (1e4, ["u"], []), (1e4, ["u"], ["x"])):
        plant = Plant(Equations(x=zeros, u={"u": 0.0, "F": force}, f=servo))
        result = trim(plant, free=free, floating=floating)
        assert result.converged
        assert {"x": 1.0} in [d.components for d in result.null_directions]
        count = len(result.null_directions)
        assert f"under-determined by {count}; fix" in told(result)[0]
