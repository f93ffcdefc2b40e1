"""Parameter-varying models against closed forms: spring p², rational pole, kink, poles that meet; and their FMU."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu

import workbench as wb
from workbench.build.parameter_varying import frozen, varying_state_space
from workbench.build.toolchain import host_only
from workbench.cli.app import run
from workbench.core.records.forms import OVER
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import Linear
from workbench.errors import InputError
from workbench.point.lin.interpolation import KINDS, Axis, coefficients, products
from workbench.point.lin.varying_error import ReferenceModel
from workbench.point.lin.varying_result import VaryingModel

LAG = "fmu:FirstOrderLag"
# place'' = force - d place' - k(p) place, with k = p² or p held between 0.1 and 1
SPRING = """
[components]
p = {gain = 1}
force = {sum = "+--"}
speed = {block = "integrator"}
place = {block = "integrator"}
damper = {block = "product"}
held = {block = "saturation", lower = 0.1, upper = 1}
spring = {block = "product", count = COUNT}
[connections]
"force.u2" = "damper.y"
"force.u3" = "spring.y"
"speed.u" = "force.y"
"place.u" = "speed.y"
"damper.u1" = "speed.y"
"held.u" = "p.y"
"spring.u1" = "place.y"
FACTORS
[inputs]
u = "force.u1"
p = "p.u"
d = "damper.u2"
[outputs]
y = "place.y"
"""
FORMS = {
    "square": ("3", '"spring.u2" = "p.y"\n"spring.u3" = "p.y"'),
    "kink": ("2", '"spring.u2" = "held.y"'),
}


def spring(folder: Path, form: str) -> str:
    path = folder / f"{form}.toml"
    count, factors = FORMS[form]
    path.write_text(SPRING.replace("COUNT", count).replace("FACTORS", factors), encoding="utf-8")
    return str(path)


def closed(stiffness: float, damping: float) -> Linear:
    A = np.array([[-damping, -stiffness], [1.0, 0.0]])
    return Linear(A, np.array([[1.0], [0.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1)))


def largest(varying: VaryingModel, truth: dict[tuple[float, ...], Linear]) -> Floats:
    """The largest errors of poles, responses and steps, shape (3,)."""
    rest, found = np.zeros(1), []
    for point, linear in truth.items():
        other = varying.at(dict(zip(varying.grid, point, strict=True)))
        found.append(ReferenceModel(linear, rest).errors(other, rest, rest).values[:3])
    return np.asarray(np.max(found, axis=0))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [2, 3, 4, 9])
def test_interpolation_is_exact_for_what_it_contains_and_stays_at_the_ends(kind: str, count: int) -> None:
    nodes = 2.0 - np.cos(np.pi * np.arange(count) / (count - 1))
    axes, degree = [Axis(nodes, kind), Axis(np.array([-1.0, 0.0, 3.0]), "spline")], min(count - 1, 3)

    def function(x: Floats, y: Floats) -> Floats:
        return np.asarray((x**degree - 2.0 * x) * (1.0 + y * y))

    grid = np.stack(np.meshgrid(*(axis.nodes for axis in axes), indexing="ij"), axis=-1).reshape(-1, 2)
    factors = coefficients(axes, function(*grid.T)[:, None])
    x, y = np.random.default_rng(1).uniform([[0.0], [-2.0]], [[4.0], [4.0]], (2, 50))
    expected = function(np.clip(x, 1.0, 3.0), np.clip(y, -1.0, 3.0))
    np.testing.assert_allclose((products(axes, np.stack([x, y], axis=1)) @ factors)[:, 0], expected, atol=1e-12)


def test_a_rational_pole_keeps_its_promise_at_a_thousand_points() -> None:
    with wb.load(LAG) as lag:
        varying = wb.lin_varying(lag, {"tau": (0.5, 2.0)}, error=1e-5)
    taus = np.random.default_rng(2).uniform(0.5, 2.0, 1000).tolist()
    one = np.ones((1, 1))
    truth: dict[tuple[float, ...], Linear] = {(tau,): Linear(-one / tau, one / tau, one, 0.0 * one) for tau in taus}
    found = largest(varying, truth)
    assert varying.complete
    assert varying.interpolation == "chebyshev"
    assert not varying.trimmed
    assert np.all(found <= varying.errors.values[:3])
    # 1/tau by Chebyshev points: the error falls by 3 (its pole is at 0: 5/3 + 4/3) with each.
    assert varying.errors.poles < 100.0 * 3.0 ** (1 - len(varying.grid["tau"]))


def test_a_spring_whose_equilibrium_moves(tmp_path: Path) -> None:
    with wb.load(spring(tmp_path, "square")) as model:
        varying = wb.lin_varying(model, {"p": (0.5, 2.0)}, u0={"u": 1.0, "d": 0.2}, inputs=["u"], error=1e-4)
    assert varying.trimmed
    assert varying.state_names == ("speed.x", "place.x")
    assert any(note.startswith("hidden coupling: the equilibrium of place.x moves") for note in varying.notes)
    points = np.random.default_rng(3).uniform(0.5, 2.0, 1000).tolist()
    found = largest(varying, {(p,): closed(p * p, 0.2) for p in points})
    assert np.all(found <= varying.errors.values[:3])
    for p in points[:100]:
        point = varying.at({"p": p}).operating_point
        assert point is not None
        assert point.x["place.x"] == pytest.approx(1.0 / p**2, abs=varying.errors.equilibrium * 3.75)
        assert point.u == pytest.approx({"u": 1.0})


def test_poles_that_meet_and_a_second_parameter(tmp_path: Path) -> None:
    """Critical damping is within the box: there the error of the poles is the root of that of the entries."""
    with wb.load(spring(tmp_path, "square")) as model:
        varying = wb.lin_varying(model, {"p": (0.5, 1.5), "d": (0.5, 4.0)}, inputs=["u"])
    assert varying.complete
    points = np.random.default_rng(4).uniform([0.5, 0.5], [1.5, 4.0], (1000, 2)).tolist()
    found = largest(varying, {(p, d): closed(p * p, d) for p, d in points})
    assert np.all(found <= varying.errors.values[:3])
    meeting = min(abs(h.values["d"] - 2.0 * h.values["p"]) for h in varying.held_out)
    assert meeting < 1e-6
    wrong = replace(varying, A=varying.A + np.array([[0.0, 1e-8], [0.0, 0.0]]))  # by 1e-8, and the poles by its root
    assert largest(wrong, {(1.0, 2.0): closed(1.0, 2.0)})[0] == pytest.approx(1e-4, rel=0.01)


def test_errors_stated_hold_over_a_kink(tmp_path: Path) -> None:
    with wb.load(spring(tmp_path, "kink")) as model:
        varying = wb.lin_varying(model, {"p": (0.5, 2.0)}, u0={"d": 0.5}, inputs=["u"], error=0.01)
    points = np.random.default_rng(5).uniform(0.5, 2.0, 1000).tolist()
    assert varying.complete
    assert np.all(largest(varying, {(p,): closed(min(p, 1.0), 0.5) for p in points}) <= varying.errors.values[:3])


def test_what_cannot_be_reached_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["lin", spring(tmp_path, "kink"), "--over", "p=0.5:2", "--inputs", "u", "--u0", "d=0.5", "--error", "1e-9"]
    assert run(line) == 1
    assert "the error asked for is not reached" in capsys.readouterr().out


def two_states(kind: str) -> VaryingModel:
    """A spring of k = p² and a damper of q, exact by polynomials of second degree."""
    p, q = np.array([1.0, 1.5, 2.0, 3.0] if kind == "spline" else [1.0, 2.0, 3.0]), np.array([0.2, 0.5, 0.8])
    points = [(a, b) for a in p for b in q]
    ones = np.ones((len(points), 1))
    return VaryingModel(
        model="Spring", interface="me", method="exact", interpolation=kind, asked_error=1.0, held_out=(),
        scheduling=(wb.SchedulingParameter("p", 1.0, 3.0, "m"), wb.SchedulingParameter("q", 0.2, 0.8)),
        grid={"p": tuple(p.tolist()), "q": tuple(q.tolist())}, errors=wb.VaryingErrors(0.1, 0.1, 0.1, 0.1),
        linear_models=9, trimmed=True, state_names=("v", "x"), input_names=("u",), output_names=("y",),
        A=np.array([closed(a * a, b).A for a, b in points]), B=np.array([closed(1.0, 1.0).B] * len(points)),
        C=np.array([closed(1.0, 1.0).C] * len(points)), D=np.zeros((len(points), 1, 1)),
        x0=np.array([(0.0, a) for a, _ in points]), u0=ones, y0=np.array([[a] for a, _ in points]),
    )  # fmt: skip


def test_json_brings_back_the_model(tmp_path: Path) -> None:
    varying = two_states("spline")
    (tmp_path / "lpv.json").write_text(json.dumps(varying.to_dict()), encoding="utf-8")
    again = VaryingModel.read(tmp_path / "lpv.json")
    one, other = varying.at({"p": 1.7, "q": 0.3}), again.at({"p": 1.7, "q": 0.3})
    np.testing.assert_array_equal(one.A, other.A)
    np.testing.assert_allclose(one.A, closed(1.7**2, 0.3).A, rtol=1e-12)
    assert one.operating_point == other.operating_point
    with pytest.raises(InputError, match="give p, q"):
        varying.at({"p": 1.0})


@pytest.mark.parametrize("kind", KINDS)
def test_the_fmu_moves_with_its_parameter(tmp_path: Path, kind: str) -> None:
    """From rest at u0 the spring follows: k(p) (x - x0(p)) = u - u0, whatever p does and did; beyond 3 it stays 3."""
    varying = two_states(kind)
    wb.export(varying, tmp_path / "plane.fmu", platforms=[p.name for p in host_only()])
    with wb.load(tmp_path / "plane.fmu", interface="me") as model:
        assert [(v.name, v.unit) for v in model.inputs] == [("u", None), ("p", "m"), ("q", None)]
        for p, q in ((1.3, 0.7), (2.9, 0.25), (5.0, 0.1)):
            linear = wb.lin(model, u0={"p": p, "q": q, "u": 1.0}, inputs=["u"])
            within = (min(p, 3.0), max(q, 0.2))
            np.testing.assert_allclose(linear.A, closed(within[0] ** 2, within[1]).A, rtol=1e-12)
    moves = np.array([(0, 1, 2, 0.8), (1, 1, 2, 0.8), (1, 1, 1.3, 0.8), (60, 1, 1.3, 0.8)], dtype=[
        ("time", float), ("u", float), ("p", float), ("q", float)
    ])  # fmt: skip
    rows = simulate_fmu(str(tmp_path / "plane.fmu"), stop_time=60.0, input=moves, output=["y"], output_interval=1.0)
    assert rows["y"][0] == pytest.approx(2.0)
    assert rows["y"][-1] == pytest.approx(1.3, abs=1e-4)


def test_a_state_with_its_parameter_in_the_description() -> None:
    varying = two_states("chebyshev")
    matrices = frozen(varying)
    model = varying_state_space(varying, matrices, "spring")
    start = {v.name: model.graph.value(v.start) or 0.0 for v in model.variables}
    assert [start[name] for name in ("p", "q", "u", "x")] == pytest.approx([2.0, 0.5, 1.0, 2.0])
    assert matrices.y0 == pytest.approx(0.0)
    with pytest.raises(InputError, match="u is a scheduling parameter, and an input"):
        varying_state_space(replace(varying, grid={"u": varying.grid["p"], "q": varying.grid["q"]}, scheduling=(
            wb.SchedulingParameter("u", 1.0, 3.0), varying.scheduling[1]
        )), matrices, "spring")  # fmt: skip


def test_ranges_and_values_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert OVER.read({"a": "1:3:5", "b": "1:3", "c": "1,2"}) == {
        "a": (1.0, 1.5, 2.0, 2.5, 3.0),
        "b": "1:3",
        "c": (1, 2),
    }
    line = ["lin", LAG, "--over", "tau=0.5:2", "--error", "0.01", "--json", str(tmp_path / "lpv.json")]
    assert run(line) == 0
    out = capsys.readouterr().out
    assert "Parameter-varying linear model of FirstOrderLag over tau" in out
    data = json.loads((tmp_path / "lpv.json").read_text(encoding="utf-8"))
    assert set(data["errors"]) == {"poles", "response", "step", "equilibrium"}
    assert data["scheduling"][0]["name"] == "tau"
    assert len(data["grid"]["tau"]) == len(data["A"])


@pytest.mark.parametrize(("options", "words"), [
    (["--over", "tau=2:1"], "not of the form LO:HI"),
    (["--over", "tau=1:2:1"], "LO:HI:N"),
    (["--over", "tau=0.5:2", "--over", "u=1,2"], "LO:HI of each parameter"),
    (["--over", "tau=0.5,2", "--error", "0.1"], "--error belongs to"),
    (["--over", "u=0:1", "--inputs", "u"], "cannot be an input of the linear model"),
    (["--over", "tua=0:1"], "tua"),
])  # fmt: skip
def test_refusals(options: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["lin", LAG, *options]) == 2
    assert words in capsys.readouterr().err
