"""What a trim says: an equilibrium, a family, none, or that it cannot be told."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from tests.trim_cases import Case, cases, judged
from tests.trim_models import Equations, Function, Plant, Values
from workbench.core.values.arrays import Floats
from workbench.point.trim import convergence, null_space
from workbench.point.trim.balance import ContinuousBalance
from workbench.point.trim.convergence import EquilibriumTest
from workbench.point.trim.problem import TrimSets, pose
from workbench.point.trim.request import trim
from workbench.point.trim.result import TrimResult
from workbench.point.trim.scaled import ScaledEquations


def scalar(f: Function, start: float, *, interface: str = "me") -> TrimResult:
    return trim(Plant(Equations(x={"x": start}, f=f), interface=interface, step=0.02))


@pytest.mark.parametrize("large", [null_space.LARGE, 1], ids=["as they are", "as large ones"])
@pytest.mark.parametrize("case", cases(45, 1), ids=lambda c: c.name)
def test_random_trims_with_a_known_answer(case: Case, large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Large ones are judged by the factors of a regular Jacobian, small ones by its singular values."""
    monkeypatch.setattr(null_space, "LARGE", large)
    assert not judged(case)


@pytest.mark.parametrize(
    ("f", "n", "rests"),
    [
        (lambda d: d + 0.1 * d**3, 150, True),
        (lambda d: d - 0.3 * np.sin(d), 150, True),
        (lambda d: np.tanh(d) + 2.0, 40, False),  # d = arctanh(−2) is none
        (lambda d: np.minimum(d * d, 1e99) + 1e-3, 40, False),
    ],
    ids=["bent", "wavy", "saturated", "above zero"],
)
def test_a_rod_with_a_bent_law_rests_where_its_law_does(f: Callable[[Floats], Floats], n: int, rests: bool) -> None:
    """x' = A f(x − r) with the second difference A: regular, so that f(x − r) = 0 for all or for none."""
    rest = np.linspace(0.5, 1.0, n)
    a = np.diag(-2.0 * np.ones(n)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)
    names = [f"x{i}" for i in range(n)]

    def rates(v: Values) -> list[float]:
        return list(a @ f(np.array([v[name] for name in names]) - rest))

    start = dict.fromkeys(names, 0.7)
    result = trim(Plant(Equations(x=start, f=rates, nominal=dict.fromkeys(names, 1.0))))
    assert result.converged == rests
    if rests:
        assert list(result.operating_point.x.values()) == pytest.approx(rest.tolist(), abs=1e-7)


@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize(
    "f",
    [
        lambda v: [math.exp(-v["x"])],
        lambda v: [1.0 / (1.0 + v["x"] ** 2)],
        lambda v: [1.0 - math.tanh(v["x"])],
    ],
    ids=["e^-x", "1/(1+x²)", "1 − tanh x"],
)
def test_a_run_away_is_not_an_equilibrium(f: Function, interface: str) -> None:
    result = scalar(f, 0.5, interface=interface)
    assert not result.converged
    assert result.message.startswith("no equilibrium found; the search diverged: x → ")


@pytest.mark.parametrize("start", [1.0, 1e-2, 1e-6])
def test_a_cubic_rests_at_its_flat_root(start: float) -> None:
    result = scalar(lambda v: [-(v["x"] ** 3)], start)
    assert result.converged
    assert abs(result.operating_point.x["x"]) < 1e-6 * start
    assert not result.null_directions


@pytest.mark.parametrize("power", [4, 5, 6])
@pytest.mark.parametrize("away", [1e-6, 1e-5, 1e-4])
def test_a_flat_root_is_reached_from_within_the_width_of_the_differences(power: int, away: float) -> None:
    result = scalar(lambda v: [-((v["x"] - 0.3) ** power)], 0.3 + away)
    assert result.converged
    assert result.operating_point.x["x"] == pytest.approx(0.3, abs=1e-2 * away)


@pytest.mark.parametrize("gap", [1e-12, 1e-24])
def test_a_flat_bottom_that_just_misses_zero_has_no_root(gap: float) -> None:
    assert not scalar(lambda v: [(v["x"] - 0.3) ** 4 + gap], 0.3 + 1e-6).converged


def test_a_flat_root_is_called_degenerate() -> None:
    result = trim(Plant(Equations(x={"x": 1.0, "v": 0.5}, f=lambda v: [v["v"], -(v["x"] ** 3) - v["v"]])))
    assert result.converged
    assert abs(result.operating_point.x["x"]) < 1e-3
    assert any("degenerate" in note for note in result.notes)
    assert not result.null_directions


def test_a_parabola_that_just_misses_zero_has_no_root() -> None:
    assert not scalar(lambda v: [v["x"] ** 2 + 1e-9], 1.0).converged
    assert scalar(lambda v: [v["x"] ** 2 - 1e-9], 1.0).converged


def test_a_drift_is_found_under_stiff_terms() -> None:
    """x' = k (y − x), y' = k (x − y) + 1: the sum grows by 1 a second, however large k is."""
    plant = Plant(Equations(x={"x": 0.0, "y": 1.0}, f=lambda v: [1e9 * (v["y"] - v["x"]), 1e9 * (v["x"] - v["y"]) + 1]))
    assert not trim(plant).converged


def test_sizes_come_from_the_model_where_nothing_declares_them() -> None:
    """q' = 1e-9 − 1e-9 sinh(q / 1e-9) overflows at a nominal value of 1; at rest sinh(q / 1e-9) = 1."""
    result = scalar(lambda v: [1e-9 - 1e-9 * math.sinh(v["x"] / 1e-9)], 0.0)
    assert result.converged
    assert result.operating_point.x["x"] == pytest.approx(1e-9 * math.asinh(1.0), rel=1e-9)


def test_running_waits_for_small_states_that_declare_no_size() -> None:
    plant = Plant(
        Equations(x={"q": 0.0}, u={"u": 3e-9}, f=lambda v: [0.5 * (v["u"] - v["q"])], settable=False), interface="cs"
    )
    result = trim(plant, step=0.05)
    assert result.method == "running"
    assert result.converged
    assert result.operating_point.x["q"] == pytest.approx(3e-9, rel=1e-4)


@pytest.mark.parametrize("f", [lambda v: [math.exp(-v["x"])], lambda v: [1e-9]], ids=["e^-x", "drift"])
def test_running_does_not_take_a_run_away_for_rest(f: Function) -> None:
    plant = Plant(Equations(x={"x": 0.0}, f=f, settable=False), interface="cs")
    assert not trim(plant, step=0.05, longest=500.0).converged


@pytest.mark.parametrize("drift", [1e-12, 1e-9, 1e-8, -1e-3])
@pytest.mark.parametrize("nominal", [{}, {"x": 1.0}], ids=str)
def test_a_constant_drift_is_no_equilibrium(drift: float, nominal: dict[str, float]) -> None:
    result = trim(Plant(Equations(x={"x": 1.0}, f=lambda v: [drift], nominal=nominal)))
    assert not result.converged
    assert "der(x) does not react to any unknown" in result.message


def test_a_constant_drift_that_something_depends_on_is_no_equilibrium() -> None:
    result = trim(Plant(Equations(x={"x": 1.0, "y": 0.0}, f=lambda v: [v["x"] - 2.0 + 1e-3 * v["y"], 1e-9])))
    assert not result.converged
    assert "der(y)" in result.message


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_terms_that_cancel_but_for_rounding_are_zero(size: float) -> None:
    """x' = u − 0.1 size − 0.2 size at u = 0.3 size: 0.1 + 0.2 is not 0.3 in binary numbers."""
    plant = Plant(Equations(x={"x": 1.0}, u={"u": 0.3 * size}, f=lambda v: [v["u"] - 0.1 * size - 0.2 * size]))
    assert trim(plant).converged


def floated(speed: float) -> TrimResult:
    """A position p moves at `speed` and pushes a damped mass: x' = v, v' = p − x − 2 v."""
    equations = Equations(x={"p": 5.0, "x": 0.0, "v": 0.0}, f=lambda s: [speed, s["v"], s["p"] - s["x"] - 2.0 * s["v"]])
    return trim(Plant(equations), floating=["p"])


def test_a_floating_state_may_creep_but_not_carry_the_others_along() -> None:
    """Behind p = speed · t, x follows as p − 2 speed and v = speed: v is off its rest by that much."""
    assert floated(0.01).converged
    carried = floated(7.0)
    assert not carried.converged
    assert any("v by 7 times its size" in note for note in carried.notes)


def test_the_least_floating_derivatives_are_measured_alike_everywhere() -> None:
    """a' = −a³, b' = 1 + b with a = b + 3 at rest: the least a'² + b'², each over its slope at the start."""
    equations = Equations(
        x={"a": 5.0, "b": 2.0, "x": 0.0},
        f=lambda s: [-(s["a"] ** 3) / 75.0, 1.0 + s["b"], s["a"] - s["b"] - 3.0 - s["x"]],
        nominal={"a": 1.0, "b": 1.0, "x": 1.0},
    )
    result = trim(Plant(equations), floating=["a", "b"], fix={"x": 0.0})
    # With b = a − 3: d/da [(a³/75)² + (a − 2)²] = 6 a⁵/75² + 2 (a − 2) = 0.
    a = result.operating_point.x["a"]
    assert 6.0 * a**5 / 75.0**2 + 2.0 * (a - 2.0) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("start", [(1.0, 0.0, 0.0, 1.0), *itertools.product((0.0, 1.0, -0.7), repeat=4)][::5], ids=str)
def test_two_masses_between_springs_rest_in_the_middle_alone(start: tuple[float, ...]) -> None:
    """v1' = x2 − 2 x1, v2' = x1 − 2 x2, x1' = v1, x2' = v2; condition number 3: x = 0 is the only equilibrium.

    Where a state starts at its rest, 0, nothing tells its size, least of all the rounding errors of a step.
    """
    names = ("v1", "v2", "x1", "x2")
    equations = Equations(
        x=dict(zip(names, start, strict=True)),
        f=lambda s: [s["x2"] - 2.0 * s["x1"], s["x1"] - 2.0 * s["x2"], s["v1"], s["v2"]],
    )
    result = trim(Plant(equations))
    assert result.message == "equilibrium found"
    assert result.operating_point.x == pytest.approx(dict.fromkeys(names, 0.0), abs=1e-12)


def test_a_root_at_zero_is_not_measured_by_its_rounding() -> None:
    """x' = A (x − r), A of whole numbers and regular, half of r is 0: one equilibrium, no direction is open."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        n = int(rng.integers(2, 6))
        a = rng.integers(-3, 4, (n, n)) - 16.0 * np.eye(n)  # rows are dominated by their diagonal: regular
        rest = np.where(rng.random(n) < 0.5, 0.0, rng.integers(-2, 3, n))
        start = np.where(rng.random(n) < 0.6, 0.0, rng.integers(-2, 3, n) / 4.0)
        result = linear(a, rest, start)
        assert result.message == "equilibrium found"
        assert list(result.operating_point.x.values()) == pytest.approx(rest.tolist(), abs=1e-9)


def linear(a: Floats, rest: Floats, start: Floats) -> TrimResult:
    names = [f"x{i}" for i in range(len(rest))]

    def f(v: Values) -> list[float]:
        return list(a @ (np.array([v[n] for n in names]) - rest))

    return trim(Plant(Equations(x=dict(zip(names, start.tolist(), strict=True)), f=f)))


def test_a_residual_ends_at_the_edge_of_a_dead_zone_on_the_way_and_not_where_it_fades() -> None:
    """The zone lies on one side of the origin: x ≤ 3, reached from 3.2; 1 − tanh x is below rounding at 25."""

    def ends_at_an_edge(f: Function, begin: float, end: float) -> bool:
        with Plant(Equations(x={"x": begin}, f=f, nominal={"x": 1.0})).open_point() as point:
            scaled = ScaledEquations(pose(ContinuousBalance(point), TrimSets()), exact=False)
            judge = EquilibriumTest(scaled, np.array([begin]), 1e-9)
            return judge._edge(np.array([begin]), np.array([end]), convergence._Combinations(1), 1e-15)

    assert ends_at_an_edge(lambda v: [-max(v["x"] - 3.0, 0.0)], 3.2, 2.8)
    assert not ends_at_an_edge(lambda v: [1.0 - math.tanh(v["x"])], 0.5, 25.0)
