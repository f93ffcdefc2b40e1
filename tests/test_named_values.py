"""Values by name: items of enumerations, true and false, as start values and in signals, and lists of signals."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

import workbench as wb
from tests.reference_fmus import build_reference
from workbench.cli.app import run
from workbench.errors import InputError
from workbench.requests.kept import origin_of
from workbench.signals.kinds import Constant, Signal, Step, Table
from workbench.signals.text import readable, signals_of

OPTION, TRUTH = "option_input", "boolean_input"


@pytest.fixture(scope="module", params=[2, 3])
def passing(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an FMU that passes its inputs on; its enumeration has the items first (1) and second (2)."""
    return build_reference(tmp_path_factory.mktemp("named"), "feedthrough", request.param)


def _names(path: Path) -> tuple[str, str]:
    """Return the names of the FMU's enumeration and of its Boolean, without their ends."""
    return ("Enumeration", "Boolean") if "3" in path.name else ("option", "boolean")


def _ends(path: Path, interface: str, option: str, truth: str) -> tuple[list[float], list[float]]:
    with wb.load(path, interface=interface) as model:
        names = _names(path)
        inputs = dict(zip((f"{n}_input" for n in names), (option, truth), strict=True))
        run = wb.simulate(model, stop=1.0, interval=0.25, inputs=inputs, outputs=[f"{n}_output" for n in names])
    first, second = (run.signals[f"{n}_output"][[0, -1]].tolist() for n in names)
    return first, second


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_values_by_name_force_inputs(passing: Path, interface: str, tmp_path: Path) -> None:
    assert _ends(passing, interface, "second", "True") == ([2.0, 2.0], [1.0, 1.0])
    steps = "step:time=0.5,initial=second,value=first", "step:time=0.5,value=true"
    assert _ends(passing, interface, *steps) == ([2.0, 1.0], [0.0, 1.0])
    file = tmp_path / "both.csv"
    option, truth = _names(passing)
    file.write_text(f"time,{option}_input,{truth}_input\n0,first,true\n0.5,second,false\n")
    assert _ends(passing, interface, str(file), str(file)) == ([1.0, 2.0], [1.0, 0.0])


def test_between_two_items_lies_none(tmp_path: Path) -> None:
    for forced in ("table:0=first,0.8=second", "table:0=1,0.8=2"):
        with wb.load(build_reference(tmp_path, "feedthrough", 2), interface="cs") as model:
            run = wb.simulate(model, stop=1.0, interval=0.1, inputs={OPTION: forced}, outputs=["option_output"])
        assert set(run.signals["option_output"][run.time < 0.79].tolist()) == {1.0}


@pytest.mark.parametrize(
    ("name", "given", "words"),
    [
        (OPTION, "thrid", r"option_input: 'thrid' is neither a signal nor a value .*known: first, second"),
        (OPTION, "secnd", r"did you mean second"),
        (OPTION, 7, r"its enumeration has no item 7; known: first, second"),
        (OPTION, "step:time=1,value=second", r"no item 0 \(initial, of the step\); known: first, second"),
        (OPTION, "step:time=1,initial=first,value=secnd", r"value needs a number.*did you mean second"),
        (OPTION, "table:0=first,1=secnd", r"table: .*did you mean second"),
        (TRUTH, "maybe", r"'maybe' is neither a signal nor a value .*known: false, true"),
        ("real_continuous_input", "high", r"'high' is not a signal; write a number"),
        ("option", "second", r"no input 'option'; did you mean .*option_input"),
    ],
)
def test_a_wrong_name_lists_those_that_exist(tmp_path: Path, name: str, given: str | float, words: str) -> None:
    with (
        wb.load(build_reference(tmp_path, "feedthrough", 2)) as model,
        pytest.raises(InputError, match=words) as caught,
    ):
        wb.simulate(model, stop=0.1, inputs={name: given})
    assert "\n" not in str(caught.value)


def test_a_wrong_name_in_a_file_is_told(tmp_path: Path) -> None:
    file = tmp_path / "u.csv"
    file.write_text("time,u\n0,first\n1,secnd\n")
    with (
        wb.load(build_reference(tmp_path, "feedthrough", 2)) as model,
        pytest.raises(
            InputError, match=r"u\.csv: line 3: 'secnd' is not a value that the input can have; did you mean second"
        ),
    ):
        wb.simulate(model, stop=0.1, inputs={OPTION: str(file)})


def test_start_values_by_name(tmp_path: Path) -> None:
    path = build_reference(tmp_path, "feedthrough", 2)
    with wb.load(path, start_values={OPTION: "second", TRUTH: "true"}) as model:
        run = wb.simulate(model, stop=0.1, outputs=["option_output", "boolean_output"])
    assert [run.signals[n][-1] for n in run.signals] == [2.0, 1.0]
    with pytest.raises(InputError, match=r"'maybe' is not a value that a Boolean can have; known: false, true"):
        wb.load(path, start_values={TRUTH: "maybe"})


def test_names_reach_the_inputs_of_a_system(tmp_path: Path) -> None:
    path = build_reference(tmp_path, "feedthrough", 2)
    with wb.connect({"a": str(path)}, inputs={"mode": f"a.{OPTION}"}, outputs={"y": "a.option_output"}) as system:
        run = wb.simulate(system, stop=0.1, inputs={"mode": "second"})
    assert run.signals["y"][-1] == 2.0


def test_the_command_takes_names_and_writes_them_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = build_reference(tmp_path, "feedthrough", 2)
    with wb.load(path) as model:
        origin = origin_of(wb.simulate(model, stop=0.1, inputs={OPTION: "second"}))
    assert origin is not None
    assert f"{OPTION}=second" in origin.line
    out = tmp_path / "run.json"
    assert run([*shlex.split(origin.line)[1:], "--json", str(out)]) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["signals"]["option_output"][-1] == 2.0


# -- lists of signals --------------------------------------------------------------------------


def test_commas_of_a_signal_do_not_split_a_list() -> None:
    wanted = {"u[1]": Constant(1.0), "u[2]": Step(time=1.0, value=2.0), "u[3]": Constant(3.0)}
    assert signals_of({"u": "[1,step:time=1,value=2,3]"}) == wanted
    table: dict[str, Signal] = {"u[1]": Table([0.0, 1.0], [1.0, 2.0], "hold"), "u[2]": Step(time=1.0, value=2.0)}
    assert signals_of({"u": "[table:0=1,1=2,hold=1, step:value=2, time=1]"}) == table
    nested = signals_of({"u": "[[1,step:time=1,value=2],[3,4]]"})
    assert nested["u[1,2]"] == Step(time=1.0, value=2.0)
    assert list(nested) == ["u[1,1]", "u[1,2]", "u[2,1]", "u[2,2]"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1,step:time=1,vlaue=2,3]", r"input u\[2\]: step: unknown option 'vlaue'; did you mean value"),
        ("[value=2,1]", r"input u\[1\]: 'value=2' is not a signal"),
        ("[1,value=2]", r"input u\[2\]: 'value=2' is not a signal"),
        ("[step:time=1,2]", r"input u\[1\]: step: value is missing"),
    ],
)
def test_wrong_lists_are_told_by_their_element(text: str, words: str) -> None:
    for read in (signals_of, readable):
        with pytest.raises(InputError, match=words):
            read({"u": text})


def test_words_wait_for_the_model_and_the_rest_does_not() -> None:
    assert readable({"u": "[1,Off]", "v": "step:time=1,value=On"}) == {
        "u[1]": Constant(1.0),
        "u[2]": "Off",
        "v": "step:time=1,value=On",
    }
    for wrong in ("sin:amplitude=1", "step:tiem=1,value=On", "no.csv", "sine:amplitude=On,frequency=1"):
        with pytest.raises(InputError):
            readable({"u": wrong})
