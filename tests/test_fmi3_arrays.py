"""FMI 3.0: sizes that are parameters, arrays as wholes, enumerations by name, adjoint derivatives, terminals.

The truth is x[i] = u[i] / a[i] (1 − exp(−a[i] t)), and the matrices of that.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from tests.fmi3_fmus import TERMINALS, build_sized
from workbench.cli.app import run as command
from workbench.errors import InputError
from workbench.fmi.terminals import terminals_in
from workbench.signals.kinds import Constant, Table
from workbench.signals.text import signals_of


@pytest.fixture(scope="module")
def sized(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_sized(tmp_path_factory.mktemp("sized"))


def final(run: wb.SimulationResult, name: str, n: int) -> np.ndarray[Any, Any]:
    return np.array([run.signals[f"{name}[{i + 1}]"][-1] for i in range(n)])


@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_structural_parameter_sizes_arrays_and_states(sized: Path, n: int, interface: str) -> None:
    a = np.linspace(0.5, 2.0, n)
    u = np.arange(1.0, n + 1.0)
    with wb.load(sized, interface, start_values={"n": n, "a": a}, step=0.1 if interface == "cs" else None) as model:
        assert [v.name for v in model.states] == [f"x[{i + 1}]" for i in range(n)]
        run = wb.simulate(model, stop=2.0, inputs={"u": u}, outputs=["y", "sum"])
    x = u / a * (1.0 - np.exp(-a * 2.0))
    assert list(run.signals) == [*(f"y[{i + 1}]" for i in range(n)), "sum", *(f"u[{i + 1}]" for i in range(n))]
    assert final(run, "y", n) == pytest.approx(x, rel=1e-5)
    assert run.signals["sum"][-1] == pytest.approx(x.sum(), rel=1e-5)


def test_on_the_command_line(sized: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["--set", "n=3", "--set", "a=[1,2,4]", "--set", "mode=sport", "--input", "u=[1,step:time=0,2]"]
    assert command(["simulate", str(sized), "--stop", "1", *line]) == 2
    assert "input u[2]: step: value is missing" in capsys.readouterr().err
    line[-1] = "u=[1,2,4]"
    asked = tmp_path / "run.json"
    assert command(["simulate", str(sized), "--stop", "1", *line, "--output", "y", "--json", str(asked)]) == 0
    found = json.loads(asked.read_text())
    a = np.array([1.0, 2.0, 4.0])
    assert [found["signals"][f"y[{i}]"][-1] for i in (1, 2, 3)] == pytest.approx((1.0 - np.exp(-a)).tolist(), rel=1e-5)
    read = wb.SimulationResult.read(asked)
    assert read.signals["y[3]"][-1] == found["signals"]["y[3]"][-1]
    capsys.readouterr()
    assert command(["lin", str(sized), *line[:4], "--inputs", "u", "--outputs", "y", "--json", "-"]) == 0
    lin = json.loads(capsys.readouterr().out)
    assert lin["A"] == np.diag(-a).tolist()
    assert (lin["B"], lin["C"]) == (np.eye(3).tolist(), np.eye(3).tolist())


WRONG: Mapping[str, tuple[Mapping[str, Any], str]] = {
    "no whole number": ({"n": 2.5}, r"n: a structural parameter takes a whole number, not '2\.5'"),
    "too many": ({"a": [1, 2, 3]}, r"a: this is an array of 2 elements, not 3"),
    "two dimensions": ({"a": [[1, 2]]}, r"a: this is an array of 2 elements, not 1 × 2"),
    "one number": ({"a": 3}, r"a: this is an array of 2 elements; write a=\[…\], or a\[1\]=3"),
    "twice": ({"a": [1, 2], "a[2]": 3}, r"a\[2\] is set twice: by itself, and with the whole array"),
    "an element": ({"a": [1, "fast"]}, r"a\[2\]: 'fast' is not a value that a Float64 can have"),
    "no such element": ({"a[3]": 1}, r"no variable 'a\[3\]'; did you mean a\["),
    "no such item": ({"mode": "spott"}, r"mode: its enumeration has no item 'spott'; did you mean sport"),
    "no such number": ({"mode": 7}, r"mode: its enumeration has no item '7'"),
    "binary": ({"blob": "00"}, r"blob: this is a Binary, which cannot be set; leave it out"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_set_is_refused_in_one_line(sized: Path, name: str) -> None:
    values, words = WRONG[name]
    with pytest.raises(InputError, match=words) as told:
        wb.load(sized, start_values=values)
    assert "\n" not in str(told.value)


def test_enumerations_and_strings_are_set(sized: Path) -> None:
    gains: tuple[tuple[str | int, float], ...] = (("eco", 1.0), ("sport", 3.0), (1, 1.0), ("2", 3.0))
    for mode, gain in gains:
        with wb.load(sized, start_values={"mode": mode, "label": "fast, [blue]"}) as model:
            assert model.start_values["label"] == "fast, [blue]"
            run = wb.simulate(model, stop=1.0, inputs={"u": [1.0, 1.0]}, outputs=["sum", "y[1]", "y[2]"])
        total = run.signals["y[1]"][-1] + run.signals["y[2]"][-1]
        assert run.signals["sum"][-1] == pytest.approx(gain * total, rel=1e-12)


def test_an_array_is_forced_from_the_columns_of_a_file(sized: Path, tmp_path: Path) -> None:
    file = tmp_path / "u.csv"
    file.write_text("time [s];u[1] [K];u[2] [K];other\n0;0;1;x\n10;10;1;y\n")
    with wb.load(sized) as model:
        run = wb.simulate(model, stop=2.0, inputs={"u": str(file)})
    t, a = 2.0, 2.0
    ramp = t - (1.0 - np.exp(-t))  # of dx/dt = t − x
    assert final(run, "y", 2) == pytest.approx([ramp, (1.0 - np.exp(-a * t)) / a], rel=1e-5)


def test_signals_of_whole_arrays() -> None:
    found = signals_of({"u": [1, "sine:frequency=2"], "A": "[[1,2],[3,4]]", "v": np.array([5.0])})
    assert list(found) == ["u[1]", "u[2]", "A[1,1]", "A[1,2]", "A[2,1]", "A[2,2]", "v[1]"]
    assert found["A[2,1]"] == Constant(3.0)
    with pytest.raises(InputError, match=r"input u\[1\]: is forced twice, by itself and with the whole array"):
        signals_of({"u": [1.0], "u[1]": 2.0})


@pytest.mark.parametrize(
    ("forced", "left"),
    [({"u": [1.0, 2.0]}, "u[3]"), ({"u[2]": 1.0}, "u[1], u[3]"), ({"u": [1.0, 2.0, 3.0]}, ""), ({}, "")],
)
def test_elements_that_a_list_does_not_reach_are_told(sized: Path, forced: dict[str, Any], left: str) -> None:
    with wb.load(sized, start_values={"n": 3}) as model:
        notes = wb.simulate(model, stop=0.1, inputs=forced).notes
    told = [note for note in notes if note.startswith("u: of 3 elements")]
    assert told == ([f"u: of 3 elements these are not forced, and keep their start values: {left}"] if left else [])


def test_the_column_of_an_input_is_found_by_its_name(tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text("time,first,second\n0,1,2\n1,3,4\n")
    assert signals_of({"second": str(file)}) == {"second": Table([0.0, 1.0], [2.0, 4.0])}
    with pytest.raises(InputError, match=r"input secnd: .*none of its 3 columns is called secnd; did you mean second"):
        signals_of({"secnd": str(file)})
    file.write_text("0,1,2\n1,3,4\n")
    with pytest.raises(InputError, match=r"none of its 3 columns is called u; give it a line of headings"):
        signals_of({"u": str(file)})
    file.write_text("time,u [m],u\n0,1,2\n1,3,4\n")
    with pytest.raises(InputError, match=r"2 of its columns are called u; rename or remove the others"):
        signals_of({"u": str(file)})
    file.write_text("t,x\n0,1\n1,3\n")
    assert signals_of({"u": str(file)}) == {"u": Table([0.0, 1.0], [1.0, 3.0])}


def test_where_one_number_is_needed_an_array_is_refused(sized: Path) -> None:
    with wb.load(sized) as model, pytest.raises(InputError, match=r"input: 'u' of Sized is an array; name an element"):
        wb.nfr(model, "u", "sum", frequencies=[1.0], amplitudes=[1.0])


EXACT = np.array([[-1.0, 0.0, 1.0, 0.0], [0.0, -2.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0]])
WAYS: Mapping[str, tuple[dict[str, Any], dict[str, int]]] = {
    # With one output and two inputs, backwards takes three calls and forwards four.
    "backwards, and one forwards to compare": ({}, {"adjoint": 3, "directional": 1}),
    "forwards": ({"adjoint": False}, {"directional": 4}),
    "backwards alone": ({"forward": False}, {"adjoint": 3}),
    "wrong backwards": ({"behaviour": "sized-lies"}, {"adjoint": 3, "directional": 5}),
}


@pytest.mark.parametrize("way", WAYS)
def test_adjoint_derivatives_are_used_where_they_are_cheaper_and_true(way: str, tmp_path: Path) -> None:
    how, calls = WAYS[way]
    file = build_sized(tmp_path, shown=False, **how)
    with wb.load(file) as model, model.open_point() as point:
        assert point.jacobian().tolist() == EXACT.tolist()
        assert dict(point.calls) == calls


def test_wrong_adjoint_derivatives_that_are_all_there_is_are_reported(tmp_path: Path) -> None:
    file = build_sized(tmp_path, shown=False, forward=False, behaviour="sized-lies")
    with wb.load(file) as model:
        found = wb.lin(model, method="exact")
    assert any("disagree with differences" in note for note in found.result.notes)


# -- terminals ----------------------------------------------------------------------------------

SYSTEM = """
[components]
a = {model = "sized.fmu"}
b = {model = "sized.fmu", set = {a = [3, 4], mode = "sport"}}
[connections]
"%s" = "%s"
[inputs]
first = "a.u[1]"
second = "a.u[2]"
[outputs]
one = "b.y[1]"
two = "b.y[2]"
"""


def system(folder: Path, destination: str = "b.drive", source: str = "a.shown", *, terminals: str = TERMINALS) -> Path:
    build_sized(folder, terminals=terminals)
    file = folder / "system.toml"
    file.write_text(SYSTEM % (destination, source))
    return file


def cascade(a: float, b: float, t: float) -> float:
    """Return 1/(s (s + a) (s + b)) in the time domain."""
    return 1.0 / (a * b) + math.exp(-a * t) / (a * (a - b)) + math.exp(-b * t) / (b * (b - a))


@pytest.mark.parametrize("ends", [("b.drive", "a.shown"), ("a.shown", "b.drive")])
def test_terminals_are_connected_member_by_member_whichever_is_named_first(
    ends: tuple[str, str], tmp_path: Path
) -> None:
    with wb.load(system(tmp_path, *ends)) as model:
        run = wb.simulate(model, stop=2.0, inputs={"first": 1.0, "second": 2.0})
    assert run.signals["one"][-1] == pytest.approx(cascade(1.0, 3.0, 2.0), rel=1e-5)
    assert run.signals["two"][-1] == pytest.approx(2.0 * cascade(2.0, 4.0, 2.0), rel=1e-5)


def test_flows_into_both_sum_to_zero(tmp_path: Path) -> None:
    flows = TERMINALS.replace('variableKind="signal"', 'variableKind="inflow"')
    with wb.load(system(tmp_path, terminals=flows)) as model:
        run = wb.simulate(model, stop=2.0, inputs={"first": 1.0})
    assert run.signals["one"][-1] == pytest.approx(-cascade(1.0, 3.0, 2.0), rel=1e-5)


REFUSED = {
    "both inputs": ("b.drive", "a.drive", TERMINALS, r"a\.u\[1\] and b\.u\[1\] are both inputs; of two members one"),
    "no terminal": (
        "b.drive",
        "a.sum",
        TERMINALS,
        r"'sum' is not a terminal of 'a', and a terminal takes another; known",
    ),
    "a plug": (
        "b.drive",
        "a.shown",
        TERMINALS.replace('"bus"', '"plug"'),
        r"members that only one of them has: total; connect members one by one",
    ),
    "other rule": ("b.drive", "a.shown", TERMINALS.replace('"bus"', '"org.x"'), r"matching rule 'org\.x' is its exp"),
    "no variable": (
        "b.drive",
        "a.shown",
        TERMINALS.replace('"y[2]"', '"z"'),
        r"'second' names the variable 'z'",
    ),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_terminals_behind_a_document_type_are_left_out(tmp_path: Path, encoding: str) -> None:
    """Entities are expanded in the values of attributes, whatever the parser is told."""
    text = (
        f'<?xml version="1.0" encoding="{encoding}"?><!DOCTYPE f [<!ENTITY e "bomb">]>'
        '<f><Terminals><Terminal name="&e;"/></Terminals></f>'
    )
    (tmp_path / "terminalsAndIcons").mkdir()
    (tmp_path / "terminalsAndIcons/terminalsAndIcons.xml").write_bytes(text.encode(encoding))
    found, (remark,) = terminals_in(tmp_path)
    assert not found
    assert "declares a document type" in remark


@pytest.mark.parametrize("name", REFUSED)
def test_terminals_that_do_not_match_are_refused_in_one_line(name: str, tmp_path: Path) -> None:
    destination, source, terminals, words = REFUSED[name]
    file = system(tmp_path, destination, source, terminals=terminals)
    with pytest.raises(InputError, match=words) as told:
        wb.load(file)
    assert f"connection {source} → {destination}" in str(told.value)
    assert "\n" not in str(told.value)


def test_a_sequence_is_matched_by_order(tmp_path: Path) -> None:
    members = TERMINALS.replace('"bus"', '"sequence"').replace('memberName="first"', 'memberName="x"')
    members = "\n".join(line for line in members.splitlines() if "total" not in line)
    with wb.load(system(tmp_path, terminals=members)) as model:
        run = wb.simulate(model, stop=2.0, inputs={"first": 1.0, "second": 2.0})
    assert run.signals["two"][-1] == pytest.approx(2.0 * cascade(2.0, 4.0, 2.0), rel=1e-5)


def test_sizes_are_set_with_the_component(tmp_path: Path) -> None:
    file = system(tmp_path)
    with pytest.raises(InputError, match=r"b\.n: a structural parameter is set with its component"):
        wb.load(file, start_values={"b.n": 3})
    with wb.load(file, start_values={"b.mode": "eco", "b.a": [1, 2]}) as model:
        assert (model.start_values["b.mode"], model.start_values["b.a[2]"]) == (1, 2.0)
    file.write_text(file.read_text().replace("a = [3, 4]", "n = 3, a = [3, 4, 5]"))
    with wb.load(file) as model:
        assert len(model.states) == 5
        assert wb.simulate(model, stop=1.0, in_process=True).time[-1] == 1.0


# -- info ------------------------------------------------------------------------------------------


def test_info_shows_them_all(sized: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["info", str(sized), "--no-probe", "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [v["name"] for v in found["structural_parameters"]] == ["n"]
    assert found["enumerations"] == {"mode": {"eco": 1, "sport": 2}}
    assert found["display_units"]["u[1]"] == {"name": "degC", "factor": 1.0, "offset": -273.15}
    assert [t["name"] for t in found["terminals"]] == ["drive", "shown"]
    assert found["terminals"][0]["members"][2] == {"name": "total", "variable": "sum", "kind": "signal"}
    assert command(["info", str(sized), "--no-probe", "--full"]) == 0
    shown = capsys.readouterr().out
    for words in ("degC = K − 273.15", "deg = 57.29577951 · rad", "eco (1), sport (2)", "first = u[1]", "Structural"):
        assert words in shown


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_elements_of_one_input_come_from_several_sides(sized: Path, interface: str) -> None:
    """u[1] by a connection, u[2] from outside: a write to one of them puts the other back to nothing old."""
    a, w = np.array([0.5, 2.0]), 2.0 * np.pi
    part = wb.FmuComponent(name="s", file=str(sized), interface=interface, set={"a": a.tolist()})
    inputs, outputs = {"c": "g.u", "b": "s.u[2]"}, {"y1": "s.y[1]", "y2": "s.y[2]"}
    step = 0.005 if interface == "cs" else None
    wires = [("g.y", "s.u[1]")]
    with wb.connect({"s": part, "g": 3.0}, wires, inputs, outputs, step=step, tolerance=1e-8) as model:
        given = {"c": wb.Constant(1.0), "b": wb.Sine(amplitude=1.0, frequency=1.0)}
        run = wb.simulate(model, stop=1.3, inputs=given)
        found = wb.lin(model).result if interface == "me" else None
    t = 1.3
    second = (w * np.exp(-2.0 * t) + 2.0 * np.sin(w * t) - w * np.cos(w * t)) / (4.0 + w**2)
    assert run.signals["y1"][-1] == pytest.approx(6.0 * (1.0 - np.exp(-0.5 * t)), abs=1e-3)
    assert run.signals["y2"][-1] == pytest.approx(second, abs=1e-3)
    if found is not None:
        np.testing.assert_allclose(found.B, [[3.0, 0.0], [0.0, 1.0]], atol=1e-6)
