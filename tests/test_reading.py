"""What the workbench reads in a description: as FMPy reads it; what it makes of bent ones; what it keeps on disk."""

from __future__ import annotations

import ast
import math
import pickle
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from tests.fmpy_reader import by_fmpy, by_us, fmpy_refuses
from tests.gemseo import gemseo_folder, needs_gemseo
from workbench.errors import FmuError
from workbench.fmi import kept, reading
from workbench.fmi.bundled import bundled_names, bundled_path
from workbench.fmi.description import ModelDescription
from workbench.fmi.reading import described_at, read_description
from workbench.health.check.run import validation

BUNDLED = [bundled_path(f"fmu:{name}{at}") for at in ("", "@3") for name in bundled_names()]


def differences(path: Path) -> dict[str, Any]:
    """Return what the two readers tell differently."""
    ours, theirs = by_us(described_at(path)), by_fmpy(path)
    for name, claims in theirs["interfaces"].items():
        if claims[2] is None:
            theirs["interfaces"][name] = (*claims[:2], ours["interfaces"][name][2], *claims[3:])
    found = {key: (ours[key], theirs[key]) for key in theirs if key != "variables" and ours[key] != theirs[key]}
    pairs = zip(ours["variables"], theirs["variables"], strict=True)
    unlike = [(a, b) for a, b in pairs if a != b and not (b[1].startswith("UInt") and a[:7] + a[9:] == b[:7] + b[9:])]
    return found | ({"variables": unlike[:3]} if unlike else {})


@pytest.mark.parametrize("path", BUNDLED, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_bundled_fmus_are_read_as_fmpy_reads_them(path: Path) -> None:
    assert differences(path) == {}
    assert described_at(path).problems == ()
    assert fmpy_refuses(path) == ""


@needs_gemseo
def test_openmodelicas_fmus_are_read_as_fmpy_reads_them() -> None:
    for path in sorted(gemseo_folder().rglob("*.fmu")):
        assert differences(path) == {}, path
        assert bool(described_at(path).notes) == bool(fmpy_refuses(path)), path


# -- bent descriptions -------------------------------------------------------------------------

TWO = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="M" guid="{g}" numberOfEventIndicators="0">
  <ModelExchange modelIdentifier="M"/>
  <UnitDefinitions><Unit name="m"><DisplayUnit name="mm" factor="1000"/></Unit></UnitDefinitions>
  <TypeDefinitions>
    <SimpleType name="T"><Real unit="m" min="-1" max="2" nominal="5" displayUnit="mm"/></SimpleType>
    <SimpleType name="E"><Enumeration><Item name="a" value="3"/><Item name="b" value="7"/></Enumeration></SimpleType>
  </TypeDefinitions>
  <VendorAnnotations><Tool name="t"><ModelVariables ><ScalarVariable name="no"/></ModelVariables></Tool>
  </VendorAnnotations>
  <ModelVariables>
    <ScalarVariable name="x" valueReference="0" initial="exact">
      <Real declaredType="T" max="1" start="0"/></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="1"><Real derivative="1"/></ScalarVariable>
    <ScalarVariable name="e" valueReference="2" causality="parameter" variability="fixed">
      <Enumeration declaredType="E" start="7"/></ScalarVariable>
    <ScalarVariable name="y" valueReference="3" causality="output"><Real unit="m" displayUnit="mm"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="4" dependencies="1" dependenciesKind="fixed"/></Outputs>
    <Derivatives><Unknown index="2"/></Derivatives>
    <InitialUnknowns><Unknown index="2"/><Unknown index="4"/></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""

THREE = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="M" instantiationToken="t">
  <CoSimulation modelIdentifier="M"/>
  <TypeDefinitions><UInt8Type name="N" min="1" max="9"/></TypeDefinitions>
  <ModelVariables>
    <UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed" start="2"/>
    <Float64 name="u" valueReference="2" causality="input" start="1 2"><Dimension valueReference="1"/>
      <Alias name="v" description="the same"/></Float64>
    <UInt8 name="k" valueReference="3" causality="parameter" variability="fixed" declaredType="N" max="5" start="4"/>
    <String name="s" valueReference="4" causality="parameter" variability="fixed">
      <Dimension start="2"/><Start value="a b"/><Start value="c"/></String>
    <Float64 name="time" valueReference="5" causality="independent"/>
  </ModelVariables>
  <ModelStructure/>
</fmiModelDescription>
"""

ONE = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="1.0" modelName="M" modelIdentifier="m" guid="g" numberOfContinuousStates="0"
 numberOfEventIndicators="0">
  <ModelVariables><ScalarVariable name="k" valueReference="1" variability="parameter"><Real start="2"/></ScalarVariable>
  </ModelVariables>
  <Implementation><CoSimulation_StandAlone>
    <Capabilities canHandleVariableCommunicationStepSize="false" canBeInstantiatedOnlyOncePerProcess="true"/>
  </CoSimulation_StandAlone></Implementation>
</fmiModelDescription>
"""

Read = Callable[[str], ModelDescription]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def from_text(xml: str) -> ModelDescription:
        (tmp_path / "modelDescription.xml").write_text(xml, encoding="utf-8")
        return read_description(tmp_path, source="M")

    return from_text


def test_what_a_type_says_holds_for_its_variables(read: Read) -> None:
    found = read(TWO)
    assert found.problems == ()
    x, _, e, y = found.variables
    assert (x.unit, x.minimum, x.maximum, x.nominal, x.display_unit) == ("m", -1.0, 1.0, 5.0, "mm")
    assert (e.start, dict(found.enumerations["E"])) == (7, {"a": 3, "b": 7})
    assert (y.display_unit, y.dependencies) == ("mm", ("x",))
    assert [(d.name, d.factor) for d in found.units["m"].display] == [("mm", 1000.0)]


def test_fmi_3_sizes_aliases_and_lists_of_strings(read: Read) -> None:
    found = read(THREE)
    assert found.problems == ()
    assert [v.name for v in found.variables] == ["n", "u[1]", "u[2]", "k", "s[1]", "s[2]", "time", "v[1]", "v[2]"]
    by_name = {v.name: v for v in found.variables}
    assert (by_name["k"].minimum, by_name["k"].maximum) == (1.0, 5.0)  # of unsigned numbers, too
    assert [by_name[n].start for n in ("u[1]", "u[2]", "s[1]", "s[2]")] == [1.0, 2.0, "a b", "c"]
    assert (by_name["v[2]"].description, by_name["v[2]"].value_reference, by_name["v[2]"].element) == ("the same", 2, 1)


def test_fmi_1_says_what_its_co_simulation_can_do(read: Read) -> None:
    found = read(ONE)
    assert found.problems == ()
    assert list(found.interfaces) == ["cs"]
    assert not found.interfaces["cs"].variable_step
    assert found.interfaces["cs"].once_per_process
    assert read(ONE.replace(' canHandleVariableCommunicationStepSize="false"', "")).interfaces["cs"].variable_step
    assert (found.variables[0].causality, found.variables[0].variability) == ("parameter", "fixed")


# A rule, in which document it is bent and how; whether FMPy reads the file when it is lenient.
BENT = {
    "'Unheard': This element is not expected": (TWO, "<ModelVariables>", "<Unheard/><ModelVariables>"),
    "variable x has the name of x (line 12)": (TWO, 'name="e" value', 'name="x" value'),
    "variable der(x) is of type Integer, which cannot be continuous": (TWO, '<Real derivative="1"/>', "<Integer/>"),
    "variable x has no start value": (TWO, ' start="0"', ""),
    "variable der(x) has a start value, which a calculated": (TWO, "<Real deri", '<Real start="1" deri'),
    'variable e has causality="parameter" and variability="continuous"': (TWO, 'variability="fixed"', ""),
    'variable e has initial="approx", which a fixed parameter': (TWO, '"fixed">', '"fixed" initial="approx">'),
    'variable x has the type "V", which is not defined': (TWO, 'declaredType="T"', 'declaredType="V"'),
    'variable y has the unit "k", which is not defined': (TWO, 'unit="m" displayUnit="mm"/></S', 'unit="k"/></S'),
    'variable y has the display unit "k"': (TWO, 'displayUnit="mm"/></Sc', 'displayUnit="k"/></Sc'),
    "variable k has the value reference of u (line 7)": (THREE, 'valueReference="3"', 'valueReference="2"'),
    "there must be exactly one independent variable": (THREE, 'causality="independent"', ""),
}


@pytest.mark.parametrize("rule", BENT)
def test_bent_rules_of_variables_are_told_and_the_rest_is_read(read: Read, tmp_path: Path, rule: str) -> None:
    xml, old, new = BENT[rule]
    assert xml.count(old) == 1
    found = read(xml.replace(old, new))
    assert any(rule in problem for problem in found.problems), found.problems
    assert found.notes[0].startswith("modelDescription.xml violates the FMI standard: ")
    assert len(found.variables) == len(read(xml).variables)
    (tmp_path / "modelDescription.xml").write_text(xml.replace(old, new), encoding="utf-8")
    assert fmpy_refuses(tmp_path), "FMPy finds no fault in it"


@pytest.mark.parametrize(
    ("document", "old", "new", "told"),
    [
        (TWO, 'causality="output"', 'causality="outputt"', "attribute 'causality'"),
        (TWO, 'causality="output"', 'Causality="output"', "The attribute 'Causality' is not allowed"),
        (TWO, 'variability="fixed"', 'variability="fix"', "attribute 'variability'"),
        (TWO, ' start="0"', ' start="zero"', "attribute 'start'"),
        (TWO, 'derivative="1"', 'derivative="9"', "is the derivative of one that is not there"),
        (THREE, 'causality="input"', 'causality="inputt"', "attribute 'causality'"),
        (THREE, '<Float64 name="time"', '<Float65 name="time"', "'Float65': This element is not expected"),
        (ONE, 'variability="parameter"', 'variability="parameterr"', "attribute 'variability'"),
    ],
)
def test_what_hides_what_a_variable_is_breaks_the_file(
    read: Read, document: str, old: str, new: str, told: str
) -> None:
    assert document.count(old) == 1
    found = read(document.replace(old, new))
    assert any(told in problem for problem in found.lost), found.lost
    answer = validation(found)
    assert (answer.verdict, told in answer.evidence) == ("broken", True)
    if any("violates" in note for note in found.notes):
        assert "may be lost" in next(note for note in found.notes if "violates" in note) or "Real" in new


@pytest.mark.parametrize(
    ("old", "new"), [('min="-1"', 'min="low"'), ('nominal="5"', 'nominal="big"'), ("<Outputs>", '<Outputs note="x">')]
)
def test_what_a_variable_is_stays_known_where_other_attributes_are_wrong(read: Read, old: str, new: str) -> None:
    found = read(TWO.replace(old, new))
    assert (found.lost, len(found.problems) > 0, validation(found).verdict) == ((), True, "watch")


def test_a_file_without_variables_is_broken(read: Read) -> None:
    head, _, tail = TWO.partition("  <ModelVariables>")
    empty = head + "<ModelVariables/><ModelStructure/></fmiModelDescription>" + tail[:0]
    assert validation(read(empty)).verdict == "broken"


@pytest.mark.parametrize(
    ("rule", "old", "new"),
    [
        ("Outputs: 2 kinds for 1 dependencies", 'Kind="fixed"', 'Kind="fixed dependent"'),
        ("Outputs lacks y", '<Unknown index="4" dependencies="1" dependenciesKind="fixed"/>', '<Unknown index="1"/>'),
        ("der(x) is listed as a derivative, and does not say of what", '<Real derivative="1"/>', "<Real/>"),
        ("InitialUnknowns lacks der(x)", '<Unknown index="2"/><Unknown index="4"/>', '<Unknown index="4"/>'),
        ("InitialUnknowns must not list x", '<Unknown index="2"/><Un', '<Unknown index="1"/><Unknown index="2"/><Un'),
        ("'der(x' is not a structured name", '"der(x)"', '"der(x"'),
    ],
)
def test_rules_that_many_exporters_bend_are_told_by_check_only(read: Read, rule: str, old: str, new: str) -> None:
    xml = TWO.replace('guid="{g}"', 'guid="{g}" variableNamingConvention="structured"')
    assert read(xml).problems == ()
    assert xml.count(old) == 1
    found = read(xml.replace(old, new))
    assert any(rule in problem for problem in found.problems), found.problems
    assert not any("violates" in note for note in found.notes)


@pytest.mark.parametrize(
    ("why", "xml", "old", "new"),
    [
        ('line 12: valueReference="x" is not a whole number', TWO, 'valueReference="0"', 'valueReference="x"'),
        ("line 12: variable x has no valueReference", TWO, 'valueReference="0"', ""),
        ("names a variable with index 9", TWO, '<Derivatives><Unknown index="2"', '<Derivatives><Unknown index="9"'),
        (
            "has an entry whose index is missing",
            TWO,
            '<InitialUnknowns><Unknown index="2"',
            "<InitialUnknowns><Unknown",
        ),
        ("array u does not say how large it is", THREE, 'fixed" start="2"/>', 'fixed"/>'),
        ("array s has 3000000 elements", THREE, '<Dimension start="2"/>', '<Dimension start="3000000"/>'),
        ("not well-formed", TWO, "<ModelVariables>", "<Unheard/><ModelVariables><"),
        ('fmiVersion="4.0"', TWO, '"2.0"', '"4.0"'),
    ],
)
def test_what_cannot_be_read_is_refused_by_line(read: Read, why: str, xml: str, old: str, new: str) -> None:
    assert xml.count(old) == 1
    with pytest.raises(FmuError, match="cannot be read") as caught:
        read(xml.replace(old, new))
    assert why in str(caught.value)


@pytest.mark.parametrize("fmu", ["fmu:Rudder", "fmu:Rudder@3"])
def test_what_another_parser_calls_broken_is_refused_by_line(tmp_path: Path, fmu: str) -> None:
    """A file that was cut, or has one wrong bit, is not read as far as it goes: the rest would be other numbers."""
    with zipfile.ZipFile(bundled_path(fmu)) as archive:
        whole = archive.read(reading.DESCRIPTION)
    cut = [whole[:k] for k in (*range(0, len(whole), 131), *range(len(whole) - 30, len(whole)))]
    flips = ((k, 1 << k % 8) for k in range(0, len(whole), 43))
    flipped = [whole[:k] + bytes([whole[k] ^ bit]) + whole[k + 1 :] for k, bit in flips]
    refused = 0
    for data in (*cut, *flipped):
        try:
            ET.fromstring(data)  # noqa: S314 - our own file
        except ET.ParseError:
            (tmp_path / reading.DESCRIPTION).write_bytes(data)
            with pytest.raises(FmuError, match=rf"^.*: {reading.DESCRIPTION} .*\bline \d+.*$"):
                described_at(tmp_path)
            refused += 1
    assert refused > len(cut)


TWICE = """<ScalarVariable name="u" valueReference="4" causality="input"><Real start="0"/></ScalarVariable>
    <ScalarVariable name="u2" valueReference="4" causality="input"><Real start="5"/></ScalarVariable>
    <ScalarVariable name="i" valueReference="4" causality="input" variability="discrete"><Integer start="7"/>
    </ScalarVariable>"""


def test_two_inputs_with_one_value_reference_are_one_variable(read: Read) -> None:
    xml = TWO.replace("</ModelVariables>\n", f"{TWICE}</ModelVariables>\n").replace('ies="1"', 'ies="6"')
    found = read(xml)
    by_name = {v.name: v for v in found.variables}
    assert found.input_names == {"u", "i"}
    assert (by_name["u2"].alias_of, by_name["u2"].start, by_name["u"].start) == ("u", 0.0, 0.0)
    assert by_name["y"].dependencies == ("u",)
    rule = "line 19: variable u2 has a start value, as has u of the same value reference"
    assert found.problems == (rule,)
    assert any("u2 (line 19) has the value reference of u, and is another name of it" in n for n in found.notes)
    only = read(xml.replace('<Real start="0"/></ScalarVariable>\n    <ScalarVariable name="u2"',
                            '<Real/></ScalarVariable>\n    <ScalarVariable name="u2"'))  # fmt: skip
    assert {v.name: v.start for v in only.variables if v.value_reference == 4} == {"u": 5.0, "u2": 5.0, "i": 7}


def test_a_derivative_of_nothing_is_told(read: Read) -> None:
    found = read(TWO.replace('derivative="1"', 'derivative="9"'))
    assert "variable der(x) (line 14) is the derivative of one that is not there" in found.notes
    assert [s.name for s in found.states] == ["state[1]"]


@pytest.mark.parametrize(
    ("note", "old", "new"),
    [
        ("the variable of line 14 has no name, and is called unnamed#1", 'name="der(x)"', 'name=""'),
        ("the variable of line 14 has no name, and is called unnamed#1", 'name="der(x)"', ""),
        ("the variable of line 17 has no name, and is called unnamed#3", 'name="y"', 'name=""'),
        ("the variable of line 17 has the name of another, x, and is called x#3", 'name="y"', 'name="x"'),
        ("variable der(x) (line 14) is said to be the derivative of itself", 'derivative="1"', 'derivative="2"'),
        ("start value '1e999' of x is not a valid Real; ignored", 'start="0"', 'start="1e999"'),
        ("a derivative is listed twice, and taken once", '<Unknown index="2"/></D', '<Unknown index="2"/>' * 2 + "</D"),
        ("variable e (line 15) has no type, and is left out", '<Enumeration declaredType="E" start="7"/>', ""),
    ],
)
def test_what_was_bent_is_told_and_the_rest_is_read(read: Read, note: str, old: str, new: str) -> None:
    assert TWO.count(old) == 1
    found = read(TWO.replace(old, new))
    assert note in found.notes
    assert len(found.states) == len(found.derivatives) == 1
    assert len({v.name for v in found.variables}) == len(found.variables) == 4 - ("left out" in note)
    assert [v.value_reference for v in found.variables if v.causality == "output"] == [3]


@pytest.mark.parametrize(
    ("told", "old", "new"),
    [
        ("x has a start value and the derivative der(x), which the", '<Unknown index="2"/></D', "</D"),
        ("derivative y names x, as another does, as its state, which is called state[2]",
         '<Unknown index="2"/></D', '<Unknown index="2"/><Unknown index="4"/></D'),
        ('the unit "m" is defined twice, differently', "<UnitDefinitions>", '<UnitDefinitions><Unit name="m"/>'),
        ("line 3: ModelExchange is there twice", "<ModelExchange ", "<ModelExchange/><ModelExchange "),
    ],
)  # fmt: skip
def test_what_can_be_meant_in_two_ways_is_told(read: Read, told: str, old: str, new: str) -> None:
    assert TWO.count(old) == 1
    xml = TWO.replace('<Real unit="m" displayUnit="mm"/></S', '<Real derivative="1"/></S') if " y " in told else TWO
    found = read(xml.replace(old, new))
    assert any(told in note for note in found.notes), found.notes


def test_start_values_of_another_number_than_the_elements_are_told(read: Read) -> None:
    found = read(THREE.replace('start="1 2"', 'start="1 2 3"'))
    assert "u has 3 start values for 2 elements; ignored" in found.notes
    assert [v.start for v in found.variables if v.causality == "input"] == [None, None]


def test_a_size_that_the_user_gives_need_not_fit_the_start_values(tmp_path: Path) -> None:
    (tmp_path / reading.DESCRIPTION).write_text(THREE, encoding="utf-8")
    assert read_description(tmp_path, source="M", structure={"n": 3}).notes == ()


def test_infinity_is_a_start_value_and_a_derivative_needs_a_type(read: Read) -> None:
    assert read(TWO.replace('start="0"', 'start="INF"')).variables[0].start == math.inf
    with pytest.raises(FmuError, match=r"variable der\(x\) is listed as a derivative, and has no type"):
        read(TWO.replace('<Real derivative="1"/>', ""))


# -- kept on disk ------------------------------------------------------------------------------


@pytest.fixture
def large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A description that counts as large, a cache of its own, and no memory of what was read."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(reading, "_LARGE", 100)
    monkeypatch.setattr(reading, "_known", type(reading._known)())
    (tmp_path / "modelDescription.xml").write_text(TWO, encoding="utf-8")
    return tmp_path


def kept_files(folder: Path) -> list[Path]:
    return list((folder / "cache/fmi-workbench/descriptions").glob("*"))


def test_a_large_description_is_read_once(large: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = read_description(large, source="M")
    assert len(kept_files(large)) == 1
    reading._known.clear()
    monkeypatch.setattr(reading, "_read", None)  # it would be called
    assert read_description(large, source="M") == first


@pytest.mark.parametrize("content", [b"", b"no pickle", pickle.dumps(print), pickle.dumps(Path()), pickle.dumps(3)])
def test_what_is_foreign_there_is_read_anew(large: Path, content: bytes) -> None:
    first = read_description(large, source="M")
    (file,) = kept_files(large)
    file.write_bytes(_as_kept(file, content))
    reading._known.clear()
    assert read_description(large, source="M") == first
    assert not file.read_bytes().endswith(content or b"\0")


def _as_kept(file: Path, content: bytes) -> bytes:
    """Return a file that is whole, and is named as the description that lies there."""
    return kept._head(file.read_bytes()[:32].hex(), content) + content


def test_one_wrong_bit_anywhere_is_noticed(large: Path) -> None:
    (large / "modelDescription.xml").write_text(TWO.replace('nominal="5"', 'nominal="7"'), encoding="utf-8")
    first = read_description(large, source="M")
    (file,) = kept_files(large)
    whole = file.read_bytes()
    places = [0, 40, 70, len(whole) // 2, len(whole) - 2, whole.index(struct.pack(">d", 7.0)) + 2]
    flipped = [whole[:i] + bytes([whole[i] ^ 4]) + whole[i + 1 :] for i in places]
    for wrong in (*flipped, whole[:-1], whole[:40], whole + b"more", b"", b"garbage" * 50):
        file.write_bytes(wrong)
        reading._known.clear()
        assert read_description(large, source="M") == first
        assert file.read_bytes() == whole


def test_what_lies_there_under_another_name_is_not_taken(large: Path) -> None:
    read_description(large, source="M")
    (of_one,) = kept_files(large)
    (large / "modelDescription.xml").write_text(TWO.replace('"M"', '"N"'), encoding="utf-8")
    read_description(large, source="N")
    (of_other,) = set(kept_files(large)) - {of_one}
    of_other.write_bytes(of_one.read_bytes())
    reading._known.clear()
    assert read_description(large, source="N").model_name == "N"


def test_processes_at_once_read_the_same(large: Path) -> None:
    with (large / "modelDescription.xml").open("a", encoding="utf-8") as file:
        file.write(f"<!--{'x' * (1 << 20)}-->")
    script = "import sys, pathlib; from workbench.fmi.reading import described_at as d; print(d(pathlib.Path('.')))"
    command = [sys.executable, "-c", script]
    at_once = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=large) for _ in range(3)]
    said = {process.communicate(timeout=120)[0] for process in at_once}
    assert [text[:17] for text in said] == ["ModelDescription("]
    assert [file.suffix for file in kept_files(large)] == [".pickle"]


def test_nothing_that_is_kept_can_call_a_function(large: Path) -> None:
    class Call:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (large / "called",)

    read_description(large, source="M")
    (file,) = kept_files(large)
    digest = file.read_bytes()[:32].hex()
    file.write_bytes(_as_kept(file, pickle.dumps(Call())))
    assert kept.kept(digest) is None
    assert not (large / "called").exists()


def test_a_change_of_whatever_reads_a_description_makes_another_place(monkeypatch: pytest.MonkeyPatch) -> None:
    place, read_bytes = kept._of_readers.__wrapped__(), Path.read_bytes
    readers = _with_all_imports("declared_xml", "description_maker", "structure")
    assert len(readers) > 8
    for reader in readers:
        monkeypatch.setattr(Path, "read_bytes", lambda p, of=reader: read_bytes(p) + b"#" * (p == of))
        assert kept._of_readers.__wrapped__() != place, reader


def _with_all_imports(*names: str) -> set[Path]:
    """Return files of workbench/fmi and all that they import of the workbench."""
    found: set[Path] = set()
    root = Path(kept.__file__).parents[2]
    waiting = [root / f"workbench/fmi/{name}.py" for name in names]
    while waiting:
        file = waiting.pop()
        if file.is_file() and file not in found:
            found.add(file)
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("workbench."):
                    modules = [f"{node.module}", *(f"{node.module}.{a.name}" for a in node.names)]
                    waiting += [root / f"{module.replace('.', '/')}.py" for module in modules]
    return found


def test_old_ones_are_removed_and_a_folder_that_cannot_be_made_is_no_error(
    large: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "_MOST", 2)
    for name in "ABC":
        (large / "modelDescription.xml").write_text(TWO.replace('"M"', f'"{name}"'), encoding="utf-8")
        read_description(large, source="M")
    assert len(kept_files(large)) == 2
    (large / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(large / "file"))
    reading._known.clear()
    assert read_description(large, source="M").model_name == "C"
