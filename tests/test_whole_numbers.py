"""Whole numbers that their type cannot hold are refused: in C they would wrap around, in silence."""

from __future__ import annotations

from pathlib import Path

import pytest

import workbench as wb
from tests.reference_fmus import build_reference
from workbench.errors import InputError
from workbench.fmi.variable import WHOLE_RANGES, Value, Variable
from workbench.session import forcing
from workbench.session.forcing import convert


@pytest.fixture(scope="module")
def feedthrough(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_reference(tmp_path_factory.mktemp("whole"), "feedthrough", 3)


@pytest.mark.parametrize("kind", ["Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32"])
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_the_ends_pass_and_one_beyond_is_refused(kind: str, interface: str, feedthrough: Path) -> None:
    least, largest = WHOLE_RANGES[kind]
    with wb.load(feedthrough, interface=interface) as model:
        for value in (least, largest):
            given = {f"{kind}_input": wb.Step(time=0.5, value=float(value), initial=0.0)}
            found = wb.simulate(model, stop=1.0, inputs=given, outputs=[f"{kind}_output"], in_process=True)
            assert found.signals[f"{kind}_output"][-1] == value
        for beyond in (least - 1, largest + 1):
            for signal in (float(beyond), wb.Step(time=0.5, value=float(beyond), initial=0.0)):
                with pytest.raises(InputError, match=rf"{kind}_input: {beyond} is beyond what an? {kind} can hold"):
                    wb.simulate(model, stop=1.0, inputs={f"{kind}_input": signal}, in_process=True)
    with pytest.raises(InputError, match=f"'{largest + 1}' is not a value that an? {kind} can have"):
        wb.load(feedthrough, interface=interface, start_values={f"{kind}_input": largest + 1})


@pytest.mark.parametrize(("name", "value"), [("Int32_input", 1.5), ("Int32_input", -0.2), ("Boolean_input", 2.0)])
def test_a_constant_between_the_values_of_a_type_is_refused(name: str, value: float, feedthrough: Path) -> None:
    """As --set refuses it; a sine into the same input is rounded."""
    kind = name.removesuffix("_input")
    with wb.load(feedthrough) as model:
        with pytest.raises(InputError, match=rf"{name}: {value:g} is not a value that an? {kind} can have"):
            wb.simulate(model, stop=1.0, inputs={name: wb.Constant(value)}, in_process=True)
        wb.simulate(model, stop=1.0, inputs={name: wb.Sine(amplitude=1.0, frequency=1.0)}, in_process=True)


@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("kind", ["Int64", "UInt64"])
def test_a_signal_beyond_its_digits_is_refused_and_such_a_result_is_told(
    kind: str, interface: str, feedthrough: Path
) -> None:
    """A start value arrives with all its digits; results are floating point, and say where these are rounded."""
    name, beyond = f"{kind}_input", 2**53 + 1
    with wb.load(feedthrough, interface=interface) as model:
        for signal in (beyond + 1, str(beyond + 1), wb.Step(time=0.5, value=float(beyond + 1), initial=0.0)):
            with pytest.raises(InputError, match=rf"{name}: signals are exact to ±2\^53, and {beyond + 1} is beyond"):
                wb.simulate(model, stop=1.0, inputs={name: signal}, in_process=True)
        exact = wb.simulate(model, stop=1.0, inputs={name: 2**53 - 1}, outputs=[f"{kind}_output"], in_process=True)
        assert exact[f"{kind}_output"][-1] == 2**53 - 1
        assert not any("rounded" in note for note in exact.notes)
    with wb.load(feedthrough, interface=interface, start_values={name: str(beyond)}) as model:
        assert model.start_values[name] == beyond
        found = wb.simulate(model, stop=1.0, outputs=[f"{kind}_output"], in_process=True)
        assert f"{kind}_output: may be rounded, since results are exact below 2^53" in found.notes


def test_a_start_value_has_all_its_digits_in_a_system(feedthrough: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The FMU of the tests keeps numbers as doubles, so what it is given is looked at."""
    whole, written = 2**62 + 1, []

    def told(variable: Variable, value: float) -> Value:
        written.append((variable.name, convert(variable, value)))
        return convert(variable, value)

    monkeypatch.setattr(forcing, "convert", told)
    starts = {"f.Int64_input": whole}
    with (
        wb.connect({"f": feedthrough}, outputs=["f.Int64_output"], start_values=starts) as system,
        system.open_session(),
    ):
        assert ("Int64_input", whole) in written


_LONG = [
    ("Int64", 2**63 - 1),
    ("Int64", 2**53 + 1),
    ("Int64", -(2**53) - 1),
    ("UInt64", 2**64 - 1),
    ("UInt64", 2**63 + 1),
]


@pytest.mark.parametrize(("kind", "value"), _LONG)
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_more_digits_than_a_float_has(kind: str, value: int, interface: str, feedthrough: Path) -> None:
    """A start value arrives digit by digit; a signal, which would round it, is refused and says so."""
    name = f"{kind}_input"
    for given in (value, str(value)):
        with wb.load(feedthrough, interface=interface, start_values={name: given}) as model:
            assert wb.simulate(model, stop=1.0, outputs=[f"{kind}_output"], in_process=True).signals[f"{kind}_output"][
                -1
            ] == float(value)
            with model.open_session() as session:
                session.advance(0.5, signals={})
                output = [v for v in model.description.variables if v.name == f"{kind}_output"]
                assert session.instance.access(output).read() == [value]
    with wb.load(feedthrough, interface=interface) as model:
        words = rf"{name}: signals are exact to ±2\^53, and {value} is beyond; a start value"
        for signal in (value, str(value), f"step:time=0.5,value={value}", f"table:0=0,1={value}"):
            with pytest.raises(InputError, match=words):
                wb.simulate(model, stop=1.0, inputs={name: signal}, in_process=True)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_start_values_of_a_system_keep_their_digits(interface: str, feedthrough: Path, tmp_path: Path) -> None:
    ends = '[inputs]\nu = "a.UInt64_input"\n[outputs]\ny = "a.UInt64_output"\n'
    text = f'[components]\na = {{model = "{feedthrough}"}}\n{ends}'
    (tmp_path / "one.toml").write_text(text, encoding="utf-8")
    for name in ("u", "a.UInt64_input"):
        with wb.load(tmp_path / "one.toml", interface=interface, start_values={name: 2**64 - 1}) as system:
            assert wb.simulate(system, stop=1.0, in_process=True).signals["y"][-1] == 2.0**64


@pytest.mark.parametrize("value", [10**19, 2**53 + 2])
def test_a_connection_hands_no_rounded_numbers_on(value: int, feedthrough: Path) -> None:
    with (
        wb.connect(
            dict.fromkeys("ab", feedthrough),
            [("a.UInt64_output", "b.UInt64_input")],
            outputs=["b.UInt64_output"],
            start_values={"a.UInt64_input": value},
        ) as system,
        pytest.raises(InputError, match=rf"UInt64_input: signals are exact to ±2\^53, and {value} is beyond"),
    ):
        wb.simulate(system, stop=1.0, in_process=True)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_table_into_a_whole_number_is_a_staircase(interface: str, feedthrough: Path) -> None:
    """Nothing lies between two whole numbers; straight lines would force values that the table does not hold."""
    with wb.load(feedthrough, interface=interface) as model:
        given = {"Int32_input": wb.Table([0.0, 1.0], [0.0, 3.0])}
        found = wb.simulate(model, stop=1.5, inputs=given, outputs=["Int32_output"], in_process=True)
    assert set(found["Int32_output"].tolist()) == {0.0, 3.0}
    assert found["Int32_output"][found.time < 0.99].max() == 0.0


def test_a_sine_into_a_whole_number_tells_that_it_is_sampled(feedthrough: Path) -> None:
    sine = wb.Sine(frequency=1.0, amplitude=3.0)
    with wb.load(feedthrough, interface="me") as model:
        found = wb.simulate(model, stop=0.5, inputs={"Int32_input": sine}, in_process=True)
        assert any(note.startswith("Int32_input: may change at events only") for note in found.notes)
        found = wb.simulate(model, stop=0.5, inputs={"Float64_continuous_input": sine}, in_process=True)
        assert not any("events only" in note for note in found.notes)
