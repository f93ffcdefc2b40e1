"""Reading linear models for export: what is accepted, what is refused, what an FMU makes of names and scales."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

from workbench.build.causalise import causalise
from workbench.build.differentiate import tangent
from workbench.build.expressions import MATRIX, TANGENT, VARIABLE, ExpressionGraph, evaluate
from workbench.build.matrices import matrices_of, read_matrices
from workbench.build.request import export
from workbench.build.state_space import naming, state_space
from workbench.build.stiffness import is_stiff, is_stiff_matrix, jacobian
from workbench.build.structure import dependencies, of_variable
from workbench.build.time_scale import default_experiment, nominals
from workbench.errors import InputError


def model(**changes: object) -> dict[str, Any]:
    """A lag y = u/(s + 1) and what a test changes of it; None takes a key away."""
    whole = {
        "A": [[-1.0]], "B": [[1.0]], "C": [[1.0]], "D": [[0.0]], "dt": 0.0,
        "input_names": ["u"], "output_names": ["y"], **changes,
    }  # fmt: skip
    return {key: value for key, value in whole.items() if value is not None}


# -- what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"A": None}, "this is not a linear model: A missing (it has B, C, D, dt, input_names, output_names)"),
        ({"dt": None, "D": None}, "D, dt missing"),
        ({"A": 3.0}, "A must be a list of rows"),
        ({"A": [[1.0, 2.0]]}, "A has the shape 1 × 2, but needs 1 × 1: a row for each state, a column for each state"),
        ({"A": [[1.0, 2.0], [3.0]]}, "A must hold numbers only, in rows of equal length"),
        ({"A": [["x"]]}, "A must hold numbers only"),
        ({"B": [[1.0, 2.0]]}, "B has the shape 1 × 2, but needs 1 × 1: a row for each state, a column for each input"),
        ({"C": [[1.0], [2.0]]}, "C has the shape 2 × 1, but needs 1 × 1"),
        ({"D": [[float("nan")]]}, "D: row 1, column 1 is not a finite number"),
        ({"D": [[None]]}, "D: row 1, column 1 is not a finite number"),
        ({"dt": -1.0}, "dt must be a period in seconds, or 0 for a continuous model, not -1.0"),
        ({"dt": "fast"}, 'not "fast"'),
        ({"dt": True}, "not true"),
        ({"input_names": "u"}, "input_names must be a list of texts"),
        ({"input_names": [" "]}, "input_names: ' ' cannot be a variable's name"),
        ({"input_names": ["a\nb"]}, "input_names: 'a?b' cannot be a variable's name"),
        ({"input_names": ["y"]}, "input_names and output_names: 'y' appears twice"),
        ({"output_names": ["y", "y"]}, "output_names: 'y' appears twice"),
        ({"state_names": ["a", "b"]}, "A has 1 rows, state_names has 2"),
        ({"u0": [1.0, 2.0]}, "u0 has the shape 2, but needs 1 numbers: u"),
        ({"y0": {"y": None}}, "y0: the value of 'y' is not a finite number"),
        ({"x0": [float("inf")]}, "x0: the value of 'x[1]' is not a finite number"),
        ({"x0": {"x[1]": "a"}}, "x0: the value of 'x[1]' is not a finite number"),
        ({"units": ["m"]}, "units must give a unit to each name"),
        ({"output_units": ["m", "s"]}, "output_units must be a list of 1 units"),
        ({"input_units": [3]}, "units: the unit of 'u' must be a text"),
        ({"A": None, "points": []}, "it holds several models, one for each point: export one of them"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        matrices_of(model(**changes))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot be read"),
        ("no JSON", "is not JSON"),
        ("[1]", "a linear model is needed, not list"),
        ("{}", "A, B"),
    ],
)
def test_a_bad_file_is_named(tmp_path: Path, text: str | None, message: str) -> None:
    file = tmp_path / "model.json"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        read_matrices(file)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    ("out", "options", "message"),
    [
        ("model.zip", {}, "must end in .fmu"),
        ("nowhere/model.fmu", {}, "the folder '.*nowhere' does not exist"),
        ("model.fmu", {"fmi": 1}, "FMI 1 cannot be written; choose 2 or 3"),
        ("model.fmu", {"name": "a b"}, "'a b' cannot be the model's name"),
    ],
)
def test_where_an_fmu_cannot_go(tmp_path: Path, out: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        export(model(), tmp_path / out, **options)
    assert list(tmp_path.iterdir()) == []


# -- what is accepted --------------------------------------------------------------------------


def test_a_python_control_state_space() -> None:
    plant = control.ss([[0.5]], [[1.0]], [[2.0]], [[3.0]], 0.1, inputs=["u"], outputs=["y"], states=["a"])
    found = matrices_of(plant)
    assert [getattr(found, key).item() for key in "ABCD"] == [0.5, 1.0, 2.0, 3.0]
    assert found.dt == 0.1
    assert (found.state_names, found.input_names, found.output_names) == (("a",), ("u",), ("y",))
    assert matrices_of(control.ss([[-1.0]], [[1.0]], [[2.0]], [[3.0]])).dt == 0.0
    with pytest.raises(InputError, match="give it dt"):
        matrices_of(control.ss([[0.5]], [[1.0]], [[2.0]], [[3.0]], True))


def test_a_linearisation_tells_its_point_by_name() -> None:
    found = matrices_of(
        model(
            state_names=["p"], x0={"p": 5.0, "other": 1.0}, dx0={"p": 0.25}, u0={"u": 2.0, "other": 1.0}, y0={"y": 3.0},
            units={"p": "Pa", "u": None},
        )
    )  # fmt: skip
    assert [getattr(found, key).item() for key in ("x0", "dx0", "u0", "y0")] == [0.0, 0.25, 2.0, 3.0]
    assert found.state_points == (5.0,)
    assert found.units == {"p": "Pa"}


def test_what_is_left_out_is_told() -> None:
    between = {"C": [[[[1.0]], [[0.5]]]], "D": [[[[0.0]], [[0.0]]]], "sampled": False}
    assert matrices_of(model(dt=1.0, K=[[0.0]])).notes == ()
    notes = matrices_of(model(dt=1.0, K=[[0.1]], intersample=between)).notes
    assert [n.split(":")[0][:20] for n in notes] == [
        "the noise model is l",
        "outputs that move be",
        "inputs act at the sa",
    ]


def test_inner_model_of_a_larger_file() -> None:
    assert matrices_of({"model": model(), "fit": 1.0}).input_names == ("u",)


# -- what it becomes ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "expected", "convention"),
    [
        (("a.b", "x[1]", "s"), ["time", "a.b", "x[1]", "s", "der(s)"], "structured"),
        (("u", "s", "s"), ["time", "u", "s", "state.s", "der(state.s)"], "structured"),
        (("time", "der(s)", "s"), ["simulation.time", "time", "der(s)", "s", "rate.der(s)"], "flat"),
        (("side stick", "y", "s"), ["time", "side stick", "y", "s", "der(s)"], "flat"),
    ],
)
def test_names_survive_or_make_way_for_those_of_inputs_and_outputs(
    names: tuple[str, str, str], expected: list[str], convention: str
) -> None:
    matrices = matrices_of(model(input_names=[names[0]], output_names=[names[1]], state_names=[names[2]]))
    scalar = state_space(matrices, "M")
    assert [v.name for v in scalar.variables] == expected
    assert naming(scalar) == convention


@pytest.mark.parametrize(
    ("dt", "expected"),
    [(0.022, (11, 500)), (0.022000000000000002, (11, 500)), (1 / 30, (1, 30)), (2.0, (2, 1)), (1e-7, (1, 10**7))],
)
def test_the_period_is_a_quotient_of_whole_numbers(dt: float, expected: tuple[int, int]) -> None:
    assert state_space(matrices_of(model(dt=dt)), "M").clocks[0].period == expected


def test_a_period_that_cannot_be_counted_is_refused() -> None:
    with pytest.raises(InputError, match="too short a period to be counted exactly"):
        state_space(matrices_of(model(dt=1.2345678e-20)), "M")


def _full(n: int) -> dict[str, Any]:
    """n states, 2 inputs, 3 outputs, all entries different from 0 and different from each other."""
    entries = np.random.default_rng(3).uniform(0.5, 1.5, (n + 3, n + 2))
    names = {"input_names": ["u1", "u2"], "output_names": ["y1", "y2", "y3"]}
    blocks = {
        "A": entries[:n, :n] - 9.0 * n * np.eye(n),
        "B": entries[:n, n:],
        "C": entries[n:, :n],
        "D": entries[n:, n:],
    }
    return model(**blocks, **names)


@pytest.mark.parametrize("n", [5, 20])  # below and above the length where a row becomes a loop
def test_jacobian_and_stiffness_are_those_of_A(n: int) -> None:
    matrices = matrices_of(_full(n))
    scalar = state_space(matrices, "M")
    order = causalise(scalar)
    assert bool(scalar.graph.table) == (n == 20)
    np.testing.assert_array_equal(jacobian(scalar, order), matrices.A)
    assert is_stiff(scalar, order) == is_stiff_matrix(matrices.A)


def test_zeros_are_no_dependencies() -> None:
    whole = _full(40)
    whole["A"][0, [0, 20]] = 0.0  # a loop with a zero in it
    whole["A"][1, :30] = 0.0  # a sum of 10
    scalar = state_space(matrices_of(whole), "M")
    order = causalise(scalar)
    np.testing.assert_array_equal(jacobian(scalar, order), whole["A"])
    found = dependencies(scalar, order)
    states = scalar.states
    rates = [of_variable(scalar, found, scalar.derivatives[s]) for s in states[:2]]
    assert [len(set(r) & set(states)) for r in rates] == [38, 10]


def test_a_row_of_a_matrix_is_differentiated_and_substituted() -> None:
    graph = ExpressionGraph()
    row = graph.matrix_row(MATRIX, [2.0, 3.0, 5.0], 1)
    assert graph.variables(row) == {1, 2, 3}
    some = tangent(graph, row, {2})  # 3·d2
    assert evaluate(graph, some, lambda node: {TANGENT: 7.0}[node.operation]) == 21.0
    replaced = graph.substitute(row, {2: graph.number(10.0)})  # 2·v1 + 30 + 5·v3
    assert evaluate(graph, replaced, lambda node: {VARIABLE: float(node.reference)}[node.operation]) == 47.0


def test_the_default_experiment_follows_the_poles() -> None:
    slow_and_fast = {"A": [[-0.5, 0.0], [0.0, -50.0]], "B": [[1.0], [1.0]], "C": [[1.0, 1.0]]}
    continuous = default_experiment(matrices_of(model(**slow_and_fast)))
    assert (continuous.stop_time, continuous.interval) == (20.0, 0.005)  # 10·2 s; 2π/50 s/20 = 6.3 ms, rounded down
    sampled = default_experiment(matrices_of(model(A=[[float(np.exp(-0.1))]], dt=0.1)))
    assert (sampled.stop_time, sampled.interval) == (10.0, 0.1)
    integrator = default_experiment(matrices_of(model(A=[[0.0]])))
    assert (integrator.stop_time, integrator.interval) == (None, None)


def test_nominal_values_are_gains() -> None:
    # x1 = 3·u/(s + 2) at 1.1·2 rad/s; x2 is moved by nothing
    lag = {"A": [[-2.0, 0.0], [0.0, -2.0]], "B": [[3.0], [0.0]], "C": [[1.0, 0.0]]}
    assert nominals(matrices_of(model(**lag))) == [float(f"{3.0 / abs(2.0 + 2.2j):.2g}"), None]


def test_what_is_exported_is_what_lin_wrote(tmp_path: Path) -> None:
    file = tmp_path / "lin.json"
    file.write_text(json.dumps(model(model="Lag", poles=[[-1.0, 0.0]])), encoding="utf-8")
    assert read_matrices(file).A == [[-1.0]]
