"""The elementary models of chapter 3: FMUs that do what the equations say; test_lin_chapter3 has their slopes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from scripts.reproduce.targets import read_targets
from workbench.model.load import load
from workbench.response.simulate.request import simulate
from workbench.session.point import ModelPoint
from workbench.signals.kinds import Constant, Step

Vector = npt.NDArray[np.float64]

SOURCES = Path(__file__).resolve().parents[1] / "modelica_src"

A = np.array([[-0.51, -0.42], [0.5, 0.0]])
B = np.array([1.0, 0.0])
C = np.array([0.6407, 0.6794])
D = 0.43


# ── The blocks ───────────────────────────────────────────────────────────────────────────────────────────────────


def saturation(v: float, *, lower: float = -1.0, upper: float = 1.0) -> float:
    return min(max(v, lower), upper)


def polynomial(v: float) -> float:
    return 0.1 * v**3 + v**2 + v + 3.0


def dead_band(v: float, *, half: float = 0.25) -> float:
    return math.copysign(max(abs(v) - half, 0.0), v)


def quantiser(v: float, *, resolution: float = 0.5) -> float:
    return resolution * math.floor(v / resolution + 0.5)


def scheduled(v: float) -> float:
    gain = {-2.0: 0.0, -1.0: 1.0, 0.0: 0.0, 1.0: 3.0}
    at = max((b for b in gain if b <= v), default=-2.0)
    return gain[at] * v


BLOCKS: Mapping[str, Callable[[float], float]] = {
    "Saturation": saturation,
    "AlgebraicExpression": polynomial,
    "DeadBand": dead_band,
    "Quantizer": quantiser,
    "GainScheduler": scheduled,
}
OWN_DYNAMICS = ("Hysteresis", "SmallNonlinear")
MODELS = (*BLOCKS, *OWN_DYNAMICS)


def numbers(name: str) -> list[float]:
    value = read_targets()[name].value
    assert value is not None
    return value if isinstance(value, list) else [value]


AT_TWO_SLOPE, AT_GAIN_SLOPE = numbers("example-2-2-slopes")[0], numbers("example-2-2b-slopes")[0]


# ── The FMUs ─────────────────────────────────────────────────────────────────────────────────────────────────────

STOP, SWITCH, FIRST, SECOND = 8.0, 2.0, 3.0, -4.0
# Points that no event falls on: there left and right limit differ and either is right.
GRID = np.arange(0.0371, STOP, 0.0371)


@pytest.fixture(scope="module")
def fmus() -> Path:
    """The committed FMUs; `dev.py build --check` compares their bytes with a rebuild."""
    return SOURCES.parent / "fmus"


def run(folder: Path, model: str, *, fmi: int, interface: str) -> dict[str, Vector]:
    """Every state, local and output of a model on the grid, under the two steps."""
    step = Step(time=SWITCH, value=SECOND, initial=FIRST)
    solver = "vkm" if interface == "me" else "auto"
    with load(folder / f"fmi{fmi}" / f"{model}.fmu", interface, solver, tolerance=1e-10) as opened:
        names = [v.name for v in opened.description.variables if v.causality in {"output", "local"}]
        result = simulate(
            opened, stop=float(GRID[-1]), inputs={"u": step}, outputs=names, points=GRID, verify_step=False
        )
    rows = np.searchsorted(result.time, GRID, side="right") - 1
    return {name: result.signals[name][rows] for name in names}


def forced_states() -> Vector:
    """Closed form of the common dynamics under the two steps, shape (n, 2)."""

    def after(t: float, x: Vector, u: float) -> Vector:
        rest: Vector = -np.linalg.solve(A, B * u)
        moved: Vector = rest + expm(A * t) @ (x - rest)
        return moved

    at_switch = after(SWITCH, np.zeros(2), FIRST)
    return np.array(
        [after(t, np.zeros(2), FIRST) if t < SWITCH else after(t - SWITCH, at_switch, SECOND) for t in GRID]
    )


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("model", MODELS)
def test_fmus_are_valid_and_named_as_promised(fmus: Path, model: str, fmi: int) -> None:
    file = fmus / f"fmi{fmi}" / f"{model}.fmu"
    assert validate_fmu(str(file)) == []
    with load(file) as opened:
        assert [v.name for v in opened.inputs] == ["u"]
        assert [v.name for v in opened.outputs] == ["y"]
        assert [v.name for v in opened.states] == (["x[1]"] if model == "Hysteresis" else ["x[1]", "x[2]"])
        assert {v.variability for v in opened.parameters} == {"tunable"}


@cache
def small_nonlinear_states(u: float) -> Vector:
    """States of SmallNonlinear under a constant input on the grid, event by event, shape (n, 2).

    Once the first state is above 1, both are polynomials of time between the 15 000 switchings that follow.
    """
    step, level, t = 0.1, 0, 0.0
    x = np.zeros(2)
    rows: list[Vector] = []

    def edge() -> float:
        return step * (level + 0.5 - 1e-9)

    def rates(_t: float, x: Vector) -> list[float]:
        return [saturation(x[0]) + step * level + u, x[0]]

    def switching(_t: float, x: Vector) -> float:
        return float(x[1] - edge())

    def saturating(_t: float, x: Vector) -> float:
        return float(x[0] - 1.0)

    for crossed in (switching, saturating):
        crossed.terminal, crossed.direction = True, 1.0  # type: ignore[attr-defined]
    while x[0] < 1.0:
        piece = solve_ivp(
            rates, (t, GRID[-1]), x, method="DOP853", rtol=1e-12, atol=1e-13, events=(switching, saturating),
            dense_output=True, max_step=0.05,
        )  # fmt: skip
        rows += [piece.sol(g) for g in GRID[len(rows) :] if g <= piece.t[-1]]
        t, x = piece.t[-1], piece.y[:, -1]
        if len(piece.t_events[1]):
            x[0] = 1.0
        else:
            level += 1
    while len(rows) < len(GRID):
        rate, speed, place = 1.0 + step * level + u, float(x[0]), float(x[1])
        missing = edge() - place
        end = t + 2.0 * missing / (speed + math.sqrt(speed**2 + 2.0 * rate * missing))
        while len(rows) < len(GRID) and GRID[len(rows)] <= end:
            after = GRID[len(rows)] - t
            rows.append(np.array([speed + rate * after, place + speed * after + 0.5 * rate * after**2]))
        x, t, level = np.array([speed + rate * (end - t), edge()]), end, level + 1
    return np.array(rows)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_small_nonlinear_follows_its_equations_from_event_to_event(fmus: Path, interface: str) -> None:
    expected = small_nonlinear_states(0.5)
    with load(
        fmus / "fmi2" / "SmallNonlinear.fmu", interface, "vkm" if interface == "me" else "auto", tolerance=1e-10
    ) as m:
        inputs = {"u": Constant(0.5)}
        names = ["x[1]", "x[2]"]
        result = simulate(m, stop=float(GRID[-1]), inputs=inputs, outputs=names, points=GRID, verify_step=False)
    rows = np.searchsorted(result.time, GRID, side="right") - 1
    found = np.column_stack([result.signals[n][rows] for n in names])
    assert np.abs(found - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("model", BLOCKS)
def test_states_follow_the_closed_form_and_the_output_the_block(
    fmus: Path, model: str, interface: str, fmi: int
) -> None:
    found = run(fmus, model, fmi=fmi, interface=interface)
    states = np.column_stack([found["x[1]"], found["x[2]"]])
    assert np.abs(states - forced_states()).max() < 1e-7
    forcing = np.where(GRID < SWITCH, FIRST, SECOND)
    assert found["v"] == pytest.approx(states @ C + D * forcing, abs=1e-12)
    assert found["y"] == pytest.approx([BLOCKS[model](v) for v in found["v"]], abs=1e-12)
    assert found["v"].min() < -2
    assert found["v"].max() > 2  # every piece of every block was met


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_hysteresis_holds_within_its_play_and_follows_at_its_edge(fmus: Path, interface: str, fmi: int) -> None:
    found = run(fmus, "Hysteresis", fmi=fmi, interface=interface)
    up = GRID < SWITCH
    reached = (FIRST - 0.5) * -np.expm1(-10 * GRID)
    assert found["x[1]"][up] == pytest.approx(reached[up], abs=1e-7)
    at_switch = (FIRST - 0.5) * -math.expm1(-10 * SWITCH)
    down = SECOND + 0.5 + (at_switch - SECOND - 0.5) * np.exp(-10 * (GRID - SWITCH))
    assert found["x[1]"][~up] == pytest.approx(down[~up], abs=1e-7)
    assert found["y"] == pytest.approx(2 * found["x[1]"])
    with load(fmus / "fmi3" / "Hysteresis.fmu", start_values={"x[1]": 1.3}) as model:
        inside = simulate(model, stop=1.0, inputs={"u": Step(time=0.5, value=1.7, initial=0.9)}, outputs=["x[1]"])
    assert set(inside.signals["x[1]"]) == {1.3}


def test_a_parameter_of_a_block_can_be_set(fmus: Path) -> None:
    with (
        load(fmus / "fmi2" / "DeadBand.fmu", start_values={"upper": 0.1, "u": 1.0}) as model,
        model.open_session() as session,
    ):
        assert session.values(["y"])["y"] == pytest.approx(0.33)


def differences(point: ModelPoint, x0: Vector, u0: float, widths: Vector) -> Vector:
    """Central differences of (dx/dt, y) by (x, u) with total widths, shape (n + 1, n + 1)."""
    base, n = np.append(x0, u0), len(x0)
    point.move(x0, np.array([u0]))
    columns = []
    for offset in np.diag(widths / 2):
        ends = [point.at((base + s * offset)[:n], (base + s * offset)[n:]) for s in (1.0, -1.0)]
        columns.append(np.append(ends[0].dx - ends[1].dx, ends[0].y - ends[1].y))
    result: Vector = np.array(columns).T / widths
    return result


@pytest.mark.parametrize(
    ("x2", "quantised", "y"), [(-0.5, -0.5, -0.1), (0.26, 0.3, 0.26), (0.35, 0.4, 0.35), (3.0, 3.0, 1)]
)
def test_small_system_quantises_and_limits_its_second_state(fmus: Path, x2: float, quantised: float, y: float) -> None:
    starts = {"x[1]": -7.0, "x[2]": x2}
    with load(fmus / "fmi2" / "SmallNonlinear.fmu", start_values=starts) as model, model.open_session() as session:
        found = session.values(["saturated", "quantised", "y", "der(x[1])", "der(x[2])"])
    assert list(found.values()) == pytest.approx([-1.0, quantised, y, quantised - 1.0, -7.0])


@pytest.mark.parametrize(("x0", "width", "share"), [(1.5, 2.0, 1.0), (-0.8, 0.6, 1.0), (0.0, 4.0, 0.75), (0.0, 1.0, 0)])
def test_hysteresis_is_a_lag_of_its_cut_off_where_it_follows(fmus: Path, x0: float, width: float, share: float) -> None:
    """Beyond the play all of it, across the play 1 − 2·halfWidth/width, within it nothing."""
    with load(fmus / "fmi3" / "Hysteresis.fmu", "me") as model, model.open_point() as point:
        found = differences(point, np.array([x0]), 0.0, np.array([width, width]))
    assert found == pytest.approx(np.array([[-10 * share, 10 * share], [2, 0]]), abs=1e-12)
