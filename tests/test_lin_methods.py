"""Exact derivatives and differences: closed forms, call budgets, doubts, what may not change."""

from __future__ import annotations

import math
from pathlib import Path

import control
import numpy as np
import pytest

from tests.fmi1_fmus import build_fmi1
from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.lin_fmus import built, fmu, sparse_system
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.fmi.instance import Instance
from workbench.model import FmuModel, Variable
from workbench.model.load import load
from workbench.point.lin.request import lin
from workbench.point.lin.result import LinResult
from workbench.point.lin.state_space import LinearModel
from workbench.point.lin.task import HELD
from workbench.system.connect import connect

LATCH = """
model Latch
  input Real u(start = 0);
  output Real y;
  Real x(start = 0.9, fixed = true, nominal = 1);
  discrete Real z(start = 0, fixed = true);
equation
  der(x) = -x + u;
  when x > 1 then
    z = pre(z) + 5;
  end when;
  y = z + x + (if x > 1 then x - 1 else 0);
end Latch;
"""

SMOOTH = """
model Smooth
  input Real u(start = 2);
  input Real idle(start = 0);
  output Real y;
  output Real fixedOutput;
  Real a(start = 1e-4, fixed = true);
  Real b(start = 3e6, fixed = true, nominal = 1e6);
  Real unseen(start = 0, fixed = true);
equation
  der(a) = -1e4 * a * a + 1e-9 * b;
  der(b) = 1e9 * a - sqrt(b) * u;
  der(unseen) = u;
  y = a * b + u * u;
  fixedOutput = 3;
end Smooth;
"""


def test_fmi_1_does_not_name_its_states(tmp_path: Path) -> None:
    with load(build_fmi1(tmp_path, "FirstOrderLag", "me"), "me") as model:
        result = lin(model, x0={"state[1]": 0.5}, u0={"u": 2.0}).result
    assert result.state_names == ("state[1]",)
    assert result.operating_point.x == {"state[1]": 0.5}
    found = [m[0, 0] for m in (result.A, result.B, result.C, result.D)]
    assert found == pytest.approx([-1.0, 1.0, 1.0, 0.0], abs=1e-9)


@needs_gemseo
def test_mass_and_springs_by_difference_equal_their_equations() -> None:
    with load(gemseo_fmu("MassSpringSubSystem1"), "me") as model:
        result = lin(model, inputs=["x2"]).result
    assert (result.method, result.state_names) == ("difference", ("_D_outputAlias_v1", "_D_outputAlias_x1"))
    assert np.allclose(result.A, [[0, -2], [1, 0]], atol=1e-9)
    assert np.allclose(result.B, [[1], [0]], atol=1e-9)
    assert sorted(result.poles, key=lambda p: p.imag) == pytest.approx([-1j * 2**0.5, 1j * 2**0.5], abs=1e-9)
    assert not result.doubts


def test_seventy_one_states_take_few_calls() -> None:
    source, A, B, C = sparse_system(71)
    with load(built(source, "Sparse"), "me") as model:
        by_difference = lin(model, method="difference").result
        exact = lin(model, method="exact").result
    for result in (by_difference, exact):
        assert np.allclose(result.A, A, atol=1e-6)
        assert np.allclose(result.B, B, atol=1e-6)
        assert np.allclose(result.C, C, atol=1e-6)
        assert not result.D.any()
        assert not result.doubts
    assert by_difference.calls["derivatives"] <= 2 * 73 + 10
    assert exact.calls["derivatives"] + exact.calls["directional"] <= 2 * 73 + 10


@pytest.mark.parametrize("hidden", [[], [0], [31], [7, 8], [3, 17, 18, 30]])
def test_zeros_that_move_far_away_are_found_among_many_by_few_calls(hidden: list[int]) -> None:
    n = 32
    dead = "\n".join(f"  y[{k + 1}] = if x[{i + 1}] > 0.5 then x[{i + 1}] - 0.5 else 0;" for k, i in enumerate(hidden))
    source = f"""
    model Bands
      input Real u(start = 0);
      output Real sum;
      output Real y[{len(hidden) or 1}];
      Real x[{n}](each start = 0, each fixed = true, each nominal = 1);
    equation
      for i in 1:{n} loop
        der(x[i]) = -i * x[i] + u;
      end for;
      sum = u{"".join(f" + x[{i + 1}]" for i in range(n))};
      {dead or "y[1] = 0;"}
    end Bands;
    """
    with load(built(source, "Bands"), "me") as model:
        result = lin(model, method="exact").result
    expected = {(f"y[{k + 1}]", f"x[{i + 1}]") for k, i in enumerate(hidden)}
    assert {(d.row, d.column) for d in result.doubts} == expected
    assert all("rises by up to 10" in d.reason for d in result.doubts)
    # Each halving costs four at most, a column of its own six; one by one all columns would take 6·33.
    assert result.calls["derivatives"] <= 12 + len(hidden) * (4 * 2 * 3 + 4 * 6)
    assert np.array_equal(result.A, -np.diag(np.arange(1.0, n + 1.0)))


@pytest.mark.parametrize("method", ["difference", "exact"])
def test_scales_are_found_and_zeros_explained(method: str) -> None:
    a, b, u = 1e-4, 3e6, 2.0
    with load(built(SMOOTH, "Smooth"), "me") as model:
        result = lin(model, method=method).result
    A = np.array([[-2e4 * a, 1e-9, 0.0], [1e9, -u / (2 * b**0.5), 0], [0, 0, 0]])
    assert np.allclose(result.A, A, rtol=1e-6, atol=0.0)
    assert np.allclose(result.B, np.array([[0.0, 0], [-(b**0.5), 0], [1, 0]]), rtol=1e-6, atol=0.0)
    assert np.allclose(result.C, np.array([[b, a, 0.0], [0, 0, 0]]), rtol=1e-6, atol=0.0)
    assert np.allclose(result.D, np.array([[2 * u, 0.0], [0, 0]]), rtol=1e-6, atol=0.0)
    assert {(z.kind, z.name) for z in result.zeros} == {
        ("input", "idle"), ("output", "fixedOutput"), ("state", "unseen")
    }  # fmt: skip
    assert not result.doubts


@pytest.mark.parametrize(("fmi", "trusted"), [(2, True), (3, True), (2, False)])
def test_a_when_does_not_fire_because_of_a_perturbation(
    fmi: int, trusted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not trusted:
        monkeypatch.setattr(FmuModel, "_state_works", lambda self: False)
    with load(built(LATCH, "Latch", fmi), "me") as model:
        result = lin(model, dx=0.5, inputs=["u"]).result
        with model.open_point() as point:
            first = point.at(point.x0, point.u0)
            beyond = point.at(np.array([1.2]), point.u0)
            again = point.at(point.x0, point.u0)
            assert beyond.latched
            assert beyond.y[0] == pytest.approx(1.4)
            assert (first.y[0], again.y[0]) == (0.9, 0.9)
            assert point.discrete()["z"] == 0.0
    # y(1.15) = 1.15 + 0.15 and y(0.65) = 0.65: the branch follows, the latch does not
    assert result.C[0, 0] == pytest.approx(1.3)
    assert any("discrete state" in d.reason for d in result.doubts)


def test_a_lying_directional_derivative_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    real = Instance.__subclasses__()
    kind = next(k for k in real if k.__name__ == "Instance2")
    true = kind.directional_derivative

    def lies(self: Instance, unknowns: list[Variable], knowns: list[Variable], seed: list[float]) -> Floats:
        found = true(self, unknowns, knowns, seed)
        if knowns[0].name == "current":
            found[[v.name for v in unknowns].index("der(spool)")] *= 1.5
        return found

    monkeypatch.setattr(kind, "directional_derivative", lies)
    with load("fmu:Rudder", "me") as model:
        result = lin(model, inputs=["delC"], method="exact", in_process=True).result
    assert [(d.row, d.column) for d in result.doubts] == [("spool", "current")]
    assert result.doubts[0].other == pytest.approx(result.doubts[0].value / 1.5, rel=1e-5)


def test_kinks_are_doubtful_and_smooth_curves_are_not() -> None:
    source = """
model Kink
  input Real u(start = 0);
  output Real corner;
  output Real parabola;
equation
  corner = abs(u);
  parabola = u * u;
end Kink;
"""
    with load(built(source, "Kink"), "me") as model:
        result = lin(model, method="difference").result
    assert [(d.row, d.column) for d in result.doubts if "kink" in d.reason] == [("corner", "u")]


def test_a_linear_model_is_a_state_space_with_names(tmp_path: object) -> None:
    with load("fmu:Rudder", "me") as model:
        system = lin(model, inputs=["delC"], outputs=["del", "piston"])
    assert isinstance(system, LinearModel)
    assert system.state_labels[0] == "p1"
    assert (system.input_labels, system.output_labels) == (["delC"], ["del", "piston"])
    assert np.allclose(system.result.C[1], np.eye(8)[4])
    assert system.result.units["del"] == "deg"
    assert (system.noutputs, system.ninputs, system.nstates) == (2, 1, 8)
    back = LinResult.from_dict(system.to_dict())
    assert np.array_equal(back.A, system.A)
    assert back.operating_point == system.result.operating_point
    at = np.array([0.1, 5.0])
    assert np.allclose(system.result.response(at)[:, 0, 0], system(2j * np.pi * at)[0, 0])
    assert len(system.plot().axes) == 3


def test_inputs_of_the_call_are_left_alone() -> None:
    x0, u0, dx = {"p1": 1e7}, {"delC": 1.0}, {"p1": 1e3}
    with load("fmu:Rudder", "me") as model:
        result = lin(model, x0=x0, u0=u0, dx=dx, inputs=["delC"]).result
    assert (x0, u0, dx) == ({"p1": 1e7}, {"delC": 1.0}, {"p1": 1e3})
    assert result.operating_point.x["p1"] == 1e7
    assert result.operating_point.u["delC"] == 1.0
    assert result.why == "auto: widths are given"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "exactly"}, "did you mean exact"),
        ({"x0": {"p9": 1.0}}, "no variable 'p9'"),
        ({"u0": {"del": 1.0}}, "u0: 'del' of Rudder is an output; its inputs are: delC"),
        ({"dx": [1.0]}, "1 widths for 8 variables; give one for all"),
        ({"du": -1.0}, "must be positive"),
        ({"method": "exact", "du": 1.0}, "has no widths"),
        ({"method": "kalman-bertram"}, "no time events"),
        ({"method": "response"}, "give period"),
        ({"method": "response", "dx": 1.0, "period": 0.01}, "only inputs"),
        ({"inputs": ["delc"]}, "did you mean delC"),
    ],
)
def test_what_does_not_apply_is_refused_in_one_line(options: dict[str, object], words: str) -> None:
    with load("fmu:Rudder", "me") as model, pytest.raises(InputError, match=words) as caught:
        lin(model, **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_co_simulation_shows_no_states() -> None:
    with load("fmu:Rudder", "cs") as model, pytest.raises(InputError, match="neither states nor derivatives"):
        lin(model, method="difference")


def test_rudder_agrees_with_the_published_bounds() -> None:
    """Trim at delC = 2, published widths and defaults, against a sine of amplitude 2 (chapter 7)."""
    from dataclasses import replace

    from workbench.point.trim.request import trim
    from workbench.response.nfr.request import nfr

    frequencies = np.array([0.5, 2.0, 3.7, 5.6, 8.5, 13.0, 20.0])
    with load(fmu("Rudder"), "me") as model:
        point = trim(model, u0={"delC": 2.0}, floating=["p1", "p2"]).operating_point
        usual = lin(model, at=point, inputs=["delC"]).result
        published = lin(model, at=point, inputs=["delC"], dx=[3e7, 3e7, 1e-4, *[0.01] * 5], du=1.0).result
        recipe = replace(model.recipe, start_values=dict(point.x), bias={"delC": 2.0}, tolerance=1e-8)
        with recipe.open() as moved:
            measured = nfr(moved, "delC", "del", frequencies, [2.0])
    for result in (usual, published):
        ratio = result.response(frequencies)[:, 0, 0] / measured.response[0]
        assert np.max(np.abs(20.0 * np.log10(np.abs(ratio)))) < 1.0
        assert np.max(np.abs(np.degrees(np.angle(ratio)))) < 8.0


@pytest.mark.parametrize(("x0", "told"), [(3e-6, True), (3e-7, False)])
def test_a_state_moves_where_its_derivative_is_seen_beside_the_scales(x0: float, told: bool) -> None:
    """dx/dt = −1e4 x, x of scale 0.01: derivatives below 1e-4 · 1e4 · 0.01 count as rest."""
    with connect({"p": control.ss(-1e4, 0.0, 1.0, 0.0)}, [], outputs={"y": "p.y"}) as model:
        (state,) = (v.name for v in model.states)
        notes = lin(model, x0={state: x0}, method="difference").result.notes
    assert any(note.startswith("the point is not at rest") for note in notes) is told


@pytest.mark.parametrize(("rate", "told"), [(3e-8, True), (3e-9, False)])
def test_a_state_that_nothing_changes_moves_where_its_derivative_is_seen_beside_its_scale(
    rate: float, told: bool
) -> None:
    """dx/dt = u at x = 1e4, u no input of the linear model: 1e-12 of 1e4 in a second count as rest."""
    with connect({"p": control.ss(0.0, 1.0, 1.0, 0.0)}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}) as model:
        (state,) = (v.name for v in model.states)
        notes = lin(model, inputs=[], x0={state: 1e4}, u0={"u": rate}, method="difference").result.notes
    assert any(note.startswith("the point is not at rest") for note in notes) is told


def test_each_state_may_be_an_output() -> None:
    with load("fmu:Rudder", "me") as model:
        names = [v.name for v in model.states]
        result = lin(model, outputs=[*names[::-1], "del"]).result
    assert np.array_equal(result.C[:-1], np.eye(len(names))[::-1])
    assert not result.D[:-1].any()


def test_states_that_cannot_be_set_are_no_refusal(tmp_path: Path) -> None:
    """FMI 1.0 shows states without start values: what samples is held then, and said."""
    with load(build_fmi1(tmp_path, "Hybrid", "me")) as model:
        found, asked = lin(model).result, lin(model, method="difference").result
    assert found.method == "difference"
    assert "cannot be set; what is discrete is held" in found.why
    for notes in (found.notes, asked.notes):
        assert HELD in notes  # and no method is named that cannot be had


def test_what_includes_the_discrete_states_is_named_where_it_can_be_had() -> None:
    with load("fmu:ElevatorLaw", "me") as model:
        assert f"{HELD}; kalman-bertram includes them" in lin(model, method="difference").result.notes
        assert not any(note.startswith(HELD) for note in lin(model).result.notes)


def test_the_picture_of_a_linear_model_shows_what_is_large_and_moves() -> None:
    """1/(s + 1)³ beside a slow pole of next to no part and a fast one: 80 dB deep, and until the step rests."""
    main = control.tf([1.0], [1.0, 3.0, 3.0, 1.0])
    slow, fast = control.tf([1e-5], [1.0, 0.01]), control.tf([1.0], [1e-4, 1.0])
    with connect({"g": control.ss((main + slow) * fast)}, [], inputs={"u": "g.u"}, outputs={"y": "g.y"}) as system:
        result = lin(system).result
    gain, _, step = (ax for ax in result.plot().axes if ax.lines)
    low, high = gain.get_ylim()
    assert high - low < 90.0
    # |1/(jω + 1)³| is 80 dB below the gain at 0 where ω is 10^(80/60).
    assert gain.get_xlim()[1] == pytest.approx(10.0 ** (80.0 / 60.0) / (2.0 * math.pi), rel=0.1)
    # 1 − e^{−t}(1 + t + t²/2) is within 1 % of its end at 8.4 s; the slow pole's 5 time constants are 500 s.
    assert 8.0 < float(np.asarray(step.lines[0].get_xdata(), dtype=np.float64)[-1]) < 15.0
