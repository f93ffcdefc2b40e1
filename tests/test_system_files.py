"""System files (.toml), the health of connections, and units: closed forms and refusals in one line."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from tests.system_fmus import description_of, plain_fmu
from workbench.cli.app import run
from workbench.core.values.conversion import BASE_UNITS, Unit, conversion, is_same_unit, known_unit
from workbench.errors import FmuError, InputError
from workbench.fmi.variable import Variable
from workbench.system.connection_checks import resolve, settled
from workbench.system.description import (
    Connection,
    FmuComponent,
    GainComponent,
    LinearComponent,
    Resolved,
    SumComponent,
    SystemDescription,
)
from workbench.system.files.read import is_system_file, read_system
from workbench.system.fmu_facts import fmu_facts

LOOP = """
name = "loop"
[components]
plant = "fmu:FirstOrderLag"
rudder = {model = "fmu:Rudder", set = {delC = 1, bypass = true}, interface = "me"}
k = 2
s = {sum = "+-", unit = "deg"}
p = {numerator = [3], denominator = [1, 2, 1], units = {u = "m"}}
l = {A = [[-1.0]], B = [[1.0, 2.0]], C = [[1.0]], inputs = ["a", "b"], dt = 0.01}
[connections]
"s.u1" = "rudder.del"
k.u = "s.y"
rudder.delC = {from = "k.y", gain = -1, closes_at = 140}
[inputs]
reference = "s.u2"
both = ["l.a", "l.b"]
[outputs]
del = "rudder.del"
[experiment]
stop = 10
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "loop.toml"
    path.write_text(text, encoding="utf-8")
    return path


def message_of(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_system(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(str(path))
    return text.removeprefix(f"{path}: ")


# -- system files ---------------------------------------------------------------------------------


def test_file_gives_components_connections_inputs_and_outputs(tmp_path: Path) -> None:
    system = read_system(written(tmp_path, LOOP))
    plant, rudder, k, s, p, held = system.components
    assert isinstance(plant, FmuComponent)
    assert (plant.file, plant.interface) == ("fmu:FirstOrderLag", "auto")
    assert isinstance(rudder, FmuComponent)
    assert (rudder.interface, rudder.set) == ("me", {"delC": 1, "bypass": True})
    assert k == GainComponent(name="k", gain=2.0)
    assert s == SumComponent(name="s", signs=(1.0, -1.0), unit="deg")
    assert isinstance(p, LinearComponent)
    assert isinstance(held, LinearComponent)
    assert (held.dt, held.input_names, held.output_names) == (0.01, ("a", "b"), ("y",))
    assert system.connections[1] == Connection(source="s.y", destination="k.u")
    assert system.connections[2] == Connection(source="k.y", destination="rudder.delC", gain=-1.0, closes_at=140.0)
    assert system.inputs == {"reference": ("s.u2",), "both": ("l.a", "l.b")}
    assert system.outputs == {"del": "rudder.del"}
    assert (system.name, system.default_experiment.stop_time) == ("loop", 10.0)


def test_transfer_function_has_its_response(tmp_path: Path) -> None:
    p = read_system(written(tmp_path, LOOP)).components[4]
    assert isinstance(p, LinearComponent)
    s = 2j
    response = p.C @ np.linalg.solve(s * np.eye(len(p.A)) - p.A, p.B) + p.D
    assert response[0, 0] == pytest.approx(3.0 / (s * s + 2.0 * s + 1.0), rel=1e-12)


def test_static_transfer_function_is_a_linear_system_without_states(tmp_path: Path) -> None:
    text = LOOP.replace("numerator = [3], denominator = [1, 2, 1]", "numerator = [0, 3], denominator = [0, 2]")
    p = read_system(written(tmp_path, text)).components[4]
    assert isinstance(p, LinearComponent)
    assert p.A.shape == (0, 0)
    assert p.D.tolist() == [[1.5]]


def test_paths_are_relative_to_the_file(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    plain_fmu(tmp_path / "sub" / "Plant.fmu")
    system = read_system(written(tmp_path, '[components]\nplant = "sub/Plant.fmu"\n'))
    assert system.components == (FmuComponent(name="plant", file=str((tmp_path / "sub" / "Plant.fmu").resolve())),)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("gain = -1", "gian = -1", "[connections] \"rudder.delC\": key 'gian' is unknown; did you mean gain?"),
        ("gain = -1", 'gain = "x"', "[connections] \"rudder.delC\": key 'gain' must be a number, not 'x'"),
        ('from = "k.y", ', "", "[connections] \"rudder.delC\": key 'from' is missing"),
        ('= "rudder.del"\nk', "= [1]\nk", '[connections] "s.u1": must be a source such as'),
        ("[connections]", "[conections]", "key 'conections' is unknown; did you mean connections"),
        ("set =", "sett =", "[components] rudder: key 'sett' is unknown; did you mean set?"),
        (
            '"fmu:Rudder"',
            '"fmu:Ruder"',
            "[components] rudder: fmu:Ruder: no bundled FMU of that name; did you mean Rud",
        ),
        ('"fmu:Rudder"', '"Missing.fmu"', "no such file: "),
        ('interface = "me"', 'interface = "em"', "key 'interface' must be 'auto', 'me' or 'cs', not 'em'"),
        ('interface = "me"', "step = -1", "key 'step' must be greater than 0, not -1"),
        ('sum = "+-"', 'sums = "+-"', "[components] s: key 'sums' is unknown; did you mean sum?"),
        ('sum = "+-"', 'sum = "+x"', "key 'sum' holds 'x'; write one + or - for each input"),
        ("k = 2", "k = true", '[components] k: must be a file such as "Plant.fmu"'),
        (
            "k = 2",
            "k = {}",
            "[components] k: does not say what it is; give one of: model, block, gain, sum, A, linear, numerator",
        ),
        ("k = 2", 'k = {modl = "a.fmu"}', "[components] k: key 'modl' is unknown; did you mean model?"),
        ("[[1.0, 2.0]]", "[[1.0, 2.0], [1]]", "[components] l: key 'B' has rows of different lengths"),
        ("C = [[1.0]]", "C = [[1.0, 2.0]]", "[components] l: key 'C' has shape (1, 2), but (1, 1) is needed"),
        ('["a", "b"], dt', '["a", "a"], dt', "[components] l: key 'inputs' holds a name twice"),
        ('["a", "b"], dt', '["a"], dt', "[components] l: key 'inputs' has 1 names, but there are 2"),
        ("[3], den", "[1, 2, 3, 4], den", "[components] p: the numerator's degree exceeds the denominator's"),
        ('{u = "m"}', '{v = "m"}', "[components] p: key 'units' names 'v', no input or output of it"),
        ("stop = 10", "stopp = 10", "[experiment]: key 'stopp' is unknown; did you mean stop"),
        ("stop = 10", "stop = nan", "[experiment]: key 'stop' must be a finite number"),
        ('= "s.u2"', "= 3", "[inputs] key 'reference' must be a string or a list, not 3"),
        ('k.u = "s.y"', 'k.u = "s.y"\nk.u = "p.y"', "a key appears twice: an input takes one source"),
        ('name = "loop"', 'name = "loop', "is not TOML: "),
    ],
)
def test_faults_are_told_in_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in LOOP
    assert said in message_of(written(tmp_path, LOOP.replace(old, new)))


def test_near_files_are_named_where_an_fmu_is_missing(tmp_path: Path) -> None:
    plain_fmu(tmp_path / "Drivetrain.fmu")
    text = message_of(written(tmp_path, '[components]\nplant = "Drivetran.fmu"\n'))
    assert text.endswith("did you mean Drivetrain.fmu?")


def test_other_files_are_no_systems(tmp_path: Path) -> None:
    assert is_system_file("a.toml")
    assert is_system_file("a.SSP")
    assert not is_system_file("a.fmu")
    (tmp_path / "a.txt").write_text("")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe")
    for name, said in (("a.txt", "is not a system"), ("none.toml", "no such file"), ("b.toml", "is not UTF-8 text")):
        assert said in message_of(tmp_path / name)
    assert "a folder without SystemStructure.ssd" in message_of(tmp_path)


INNER = """
[components]
plant = "fmu:FirstOrderLag"
k = 2
[connections]
"plant.u" = "k.y"
[inputs]
u = ["k.u"]
[outputs]
y = "plant.y"
"""


def test_systems_are_components_of_systems(tmp_path: Path) -> None:
    (tmp_path / "inner.toml").write_text(INNER)
    text = """
[components]
s = {sum = "+-"}
a = "inner.toml"
b = "inner.toml"
[connections]
"a.u" = "s.y"
"b.u" = {from = "a.y", gain = 3}
"s.u2" = "b.plant.y"
[inputs]
r = "s.u1"
[outputs]
y = "b.y"
"""
    system = read_system(written(tmp_path, text))
    assert [c.name for c in system.components] == ["s", "a.plant", "a.k", "b.plant", "b.k"]
    assert system.connections == (
        Connection(source="a.k.y", destination="a.plant.u"),
        Connection(source="b.k.y", destination="b.plant.u"),
        Connection(source="s.y", destination="a.k.u"),
        Connection(source="a.plant.y", destination="b.k.u", gain=3.0),
        Connection(source="b.plant.y", destination="s.u2"),
    )
    assert system.outputs == {"y": "b.plant.y"}
    said = message_of(written(tmp_path, text.replace('"b.u"', '"b.v"')))
    assert said == "'v' is not an input of the system 'b'; known: u"
    said = message_of(written(tmp_path, text.replace('a = "inner.toml"', 'a = {model = "inner.toml", step = 1}')))
    assert said == "[components] a: inner.toml is a system; set, interface, solver and step belong in its own file"
    said = message_of(written(tmp_path, text.replace('a = "inner.toml"', 'a = "loop.toml"')))
    assert said == "[components] a: loop.toml contains itself"


# -- health ---------------------------------------------------------------------------------------

PLANT = (
    Variable("w", unit="rad", causality="output"),
    Variable("x", unit="mm", causality="output"),
    Variable("q", unit="furlong", causality="output"),
    Variable("n", "Integer", causality="output"),
    Variable("flag", "Boolean", causality="output"),
    Variable("text", "String", causality="output"),
    *(Variable(f"v[{k}]", causality="output") for k in (1, 2)),
    Variable("u", unit="m", causality="input", start=3.0),
    Variable("m", "Integer", causality="input"),
    Variable("label", "String", causality="input"),
    *(Variable(f"a[{k}]", causality="input") for k in (1, 2)),
    *(Variable(f"b[{k}]", causality="input") for k in (1, 2, 3)),
    Variable("J", causality="parameter"),
    Variable("z"),
)
GAIN = (Variable("u", causality="input"), Variable("y", causality="output"))


def resolved(
    *connections: Connection,
    inputs: Mapping[str, tuple[str, ...]] | None = None,
    outputs: Mapping[str, str] | None = None,
    unit: str = "deg",
) -> Resolved:
    plant = FmuComponent(name="plant", file="nowhere.fmu")
    description = SystemDescription(
        name="test",
        components=(plant, GainComponent(name="k", units={"u": unit})),
        connections=connections,
        inputs=inputs or {},
        outputs=outputs or {},
    )
    return resolve(description, [PLANT, GAIN])


def between(
    source: str,
    destination: str,
    *,
    gain: float = 1.0,
    offset: float = 0.0,
    unit: str | None = None,
    convert: bool = True,
) -> Connection:
    return Connection(source=source, destination=destination, gain=gain, offset=offset, unit=unit, convert=convert)


def test_wire_knows_components_and_variables() -> None:
    result = resolved(between("k.y", "plant.u", gain=-2.0, offset=0.5), outputs={"angle": "plant.w"})
    (wire,) = result.wires
    assert (wire.from_component, wire.source.name, wire.to_component, wire.destination.name) == (1, "y", 0, "u")
    assert (wire.gain, wire.offset) == (-2.0, 0.5)
    assert result.outputs["angle"].variable == PLANT[0]


def test_unconnected_inputs_are_told_with_their_start_values() -> None:
    (note,) = resolved(between("k.y", "plant.a[1]")).notes
    assert note.startswith("not connected, these inputs keep their start values: plant.u = 3 m, ")
    assert "plant.a[1]" not in note
    assert "plant.a[2]" in note


def test_arrays_are_connected_element_by_element() -> None:
    wires = resolved(between("plant.v", "plant.a")).wires
    assert [(w.source.name, w.destination.name) for w in wires] == [("v[1]", "a[1]"), ("v[2]", "a[2]")]


@pytest.mark.parametrize(
    ("connection", "factor", "offset"),
    [
        (between("plant.w", "k.u", unit="deg"), 180.0 / math.pi, 0.0),
        (between("plant.w", "k.u", unit="rad"), 180.0 / math.pi, 0.0),
        (between("plant.w", "k.u", convert=False, gain=-3.0), -3.0, 0.0),
        (between("plant.x", "plant.u", unit="mm", gain=2.0, offset=5.0), 2e-3, 5e-3),
        (between("plant.x", "plant.u", unit="m", gain=2.0, offset=5.0), 2e-3, 5.0),
        (between("plant.n", "plant.u"), 1.0, 0.0),  # an integer fits a real
        (between("k.y", "plant.u", unit="km"), 1000.0, 0.0),  # the unit stands for one that is not declared
    ],
)
def test_gain_and_unit_become_factor_and_offset(connection: Connection, factor: float, offset: float) -> None:
    (wire,) = resolved(connection).wires
    assert wire.gain == pytest.approx(factor, rel=1e-14)
    assert wire.offset == pytest.approx(offset, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize(
    ("connection", "said"),
    [
        (between("plnt.w", "k.u"), "'plnt' (in 'plnt.w') is not a component; did you mean plant?"),
        (between("w", "k.u"), "'w' names no component: write 'component.variable'; known: k, plant"),
        (between("plant.ww", "k.u"), "'ww' is not an output of component 'plant'; did you mean w?"),
        (between("plant.w", "k.uu"), "'uu' is not an input of component 'k'; did you mean u?"),
        (between("plant.w", "k.y"), "'y' is an output and cannot be driven; the destination must be an input"),
        (between("k.u", "plant.u"), "'u' is an input, which drives nothing; the source must be an output"),
        (between("plant.z", "plant.u"), "'z' is a local variable; the source must be an output"),
        (between("k.y", "plant.J"), "'J' is a parameter, not an input; give its value in the component's 'set'"),
        (
            between("plant.w", "k.u"),
            'units differ: rad → deg; unit = "deg" converts (× 57.2958), convert = false',
        ),
        (between("plant.x", "plant.u"), 'units differ: mm → m; unit = "m" converts (× 0.001)'),
        (between("plant.w", "plant.u"), "units rad → m measure different things"),
        (between("plant.w", "k.u", unit="m"), "'w' is in rad, which is not compatible with m"),
        (between("plant.w", "k.u", unit="furlong"), "unit 'furlong' is not known"),
        (between("plant.q", "plant.u"), "units furlong → m, and 'furlong' is not known"),
        (between("plant.w", "k.u", unit="deg", convert=False), "'convert = false' forbids it"),
        (between("plant.flag", "k.u"), "types do not fit: 'flag' is a Boolean, 'u' a Real"),
        (between("k.y", "plant.m"), "types do not fit: 'y' is a Real, 'm' an Integer"),
        (between("plant.text", "plant.label"), "values of type String cannot be connected"),
        (between("plant.n", "plant.m", gain=2.0), "gain, offset and unit are for real inputs"),
        (between("plant.v", "plant.b"), "2 elements to 3 elements; connect element by element"),
        (between("k.y", "plant.u", gain=math.inf), "gain must be a finite number"),
    ],
)
def test_unhealthy_connections_are_refused_in_one_line(connection: Connection, said: str) -> None:
    with pytest.raises(InputError) as caught:
        resolved(connection)
    text = str(caught.value)
    assert text.startswith(f"system test: connection {connection.source} → {connection.destination}: ")
    assert said in text


def test_two_sources_for_one_input_are_refused() -> None:
    with pytest.raises(InputError, match=r"plant\.u has two sources, k\.y and plant\.v\[1\]; an input takes one"):
        resolved(between("k.y", "plant.u"), between("plant.v[1]", "plant.u"))
    with pytest.raises(InputError, match=r"plant\.u has two sources, k\.y and the system's input r"):
        resolved(between("k.y", "plant.u"), inputs={"r": ("plant.u",)})


def test_inputs_and_outputs_of_the_system_are_checked() -> None:
    with pytest.raises(InputError, match=r"input r: drives plant\.u and k\.u, whose units differ: m and deg"):
        resolved(inputs={"r": ("plant.u", "k.u")})
    with pytest.raises(InputError, match=r"input r: drives plant\.u \(Real\) and plant\.m \(Integer\)"):
        resolved(inputs={"r": ("plant.u", "plant.m")})
    with pytest.raises(InputError, match=r"input r: 'w' is an output and cannot be driven"):
        resolved(inputs={"r": ("plant.w",)})
    with pytest.raises(InputError, match=r"output q: 'q2' is not an output of component 'plant'"):
        resolved(outputs={"q": "plant.q2"})
    with pytest.raises(InputError, match=r"output q: plant\.v is an array; name one element, such as plant\.v\[1\]"):
        resolved(outputs={"q": "plant.v"})
    with pytest.raises(InputError, match="'r' is an input and an output of the system"):
        resolved(inputs={"r": ("plant.u",)}, outputs={"r": "plant.w"})
    with pytest.raises(InputError, match=r"'plant\.x' names an input or output of the system and a variable"):
        resolved(outputs={"plant.x": "plant.w"})


def test_names_with_dots_are_read_as_far_as_they_exist() -> None:
    parts = (FmuComponent(name="a", file="x.fmu"), GainComponent(name="a.b"))
    wire = Connection(source="a.b.c", destination="a.b.u")
    description = SystemDescription(name="test", components=parts, connections=(wire,))
    (found,) = resolve(description, [(Variable("b.c", causality="output"),), GAIN]).wires
    assert (found.from_component, found.to_component) == (0, 1)
    both = (Variable("b.c", causality="output"), Variable("b.u", causality="input"))
    with pytest.raises(InputError, match=r"'a\.b\.u' can be read as 'u' of 'a\.b' and 'b\.u' of 'a'"):
        resolve(description, [both, GAIN])


def test_units_of_one_end_only_are_told_in_one_note(tmp_path: Path) -> None:
    """What has no unit cannot be converted, which SSP allows in silence; a unit that the connection names is enough."""
    plain_fmu(tmp_path / "a.fmu", inputs={"w": "", "v": ""}, outputs={"y": "m", "z": "1"})
    plain_fmu(tmp_path / "b.fmu", inputs={"u": "", "n": "", "k": ""}, outputs={"x": "", "q": "s"})
    parts = tuple(FmuComponent(name=name, file=str(tmp_path / f"{name}.fmu")) for name in "ab")
    ends = (
        Connection(source="a.y", destination="b.u"),
        Connection(source="a.z", destination="b.n"),
        Connection(source="a.y", destination="b.k", unit="m"),
    )
    back = (Connection(source="b.x", destination="a.v"), Connection(source="b.q", destination="a.w"))
    description = SystemDescription(name="test", components=parts, connections=(*ends, *back))
    result = resolve(description, [tuple(fmu_facts(p.file).variables.values()) for p in parts])
    (note,) = result.notes
    assert "2 connections" in note
    assert "unchanged: a.y (m) → b.u (none), b.q (s) → a.w (none)" in note


def test_unit_definitions_of_both_fmus_convert_with_a_note(tmp_path: Path) -> None:
    length = {"mm": Unit("mm", (0, 1, 0, 0, 0, 0, 0, 0), 1e-3), "m": Unit("m", (0, 1, 0, 0, 0, 0, 0, 0))}
    files = [tmp_path / "a.fmu", tmp_path / "b.fmu"]
    plain_fmu(files[0], outputs={"y": "mm"}, units=[length["mm"]])
    plain_fmu(files[1], inputs={"u": "m"}, units=[length["m"]])
    parts = tuple(FmuComponent(name=f.stem, file=str(f)) for f in files)
    description = SystemDescription(
        name="test", components=parts, connections=(Connection(source="a.y", destination="b.u"),)
    )
    result = resolve(description, [tuple(fmu_facts(str(f)).variables.values()) for f in files])
    assert result.wires[0].gain == pytest.approx(1e-3, rel=1e-14)
    assert result.notes == ("a.y → b.u: converted from mm to m by the unit definitions (× 0.001)",)
    variables = [tuple(fmu_facts(str(f)).variables.values()) for f in files]
    for file in files:
        file.unlink()
    with pytest.raises(InputError, match="units differ: mm → m"):
        resolve(description, variables)
    again = resolve(settled(description, result), variables)
    assert (again.wires, again.notes) == (result.wires, ())


def test_facts_of_broken_fmus_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.fmu").write_bytes(b"PK\x03\x04 no zip")
    with zipfile.ZipFile(tmp_path / "b.fmu", "w") as archive:
        archive.writestr("readme.txt", "")
    with zipfile.ZipFile(tmp_path / "c.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", '<!DOCTYPE x [<!ENTITY e "e">]>' + description_of())
    for name, said in (("a", "not a zip archive"), ("b", "no modelDescription.xml"), ("c", "declares a document type")):
        with pytest.raises(FmuError, match=said):
            fmu_facts(str(tmp_path / f"{name}.fmu"))


# -- units ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "target", "factor", "offset"),
    [
        ("m", "mm", 1e3, 0.0),
        ("rad", "deg", 180.0 / math.pi, 0.0),
        ("rpm", "rad/s", math.pi / 30.0, 0.0),
        ("r/min", "rpm", 1.0, 0.0),
        ("km/h", "m/s", 1.0 / 3.6, 0.0),
        ("kW.h", "J", 3.6e6, 0.0),
        ("N.m/(rad.s)", "kg.m2/(s3.rad)", 1.0, 0.0),
        ("W/(m2.K)", "mW/(cm2.K)", 0.1, 0.0),
        ("m/s^2", "m.s-2", 1.0, 0.0),
        ("1/min", "Hz", 1.0 / 60.0, 0.0),
        ("degC", "K", 1.0, 273.15),
        ("degF", "degC", 5.0 / 9.0, -160.0 / 9.0),
        ("l/min", "m3/s", 1e-3 / 60.0, 0.0),
        ("rad", "1", 1.0, 0.0),
    ],
)
def test_usual_units_convert(source: str, target: str, factor: float, offset: float) -> None:
    left, right = known_unit(source), known_unit(target)
    assert left is not None
    assert right is not None
    found = conversion(left, right)
    assert found is not None
    assert found[0] == pytest.approx(factor, rel=1e-12)
    assert found[1] == pytest.approx(offset, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("source", "target"), [("rad/s", "Hz"), ("deg", "1"), ("m", "s"), ("N.m", "N.m/rad")])
def test_units_of_other_things_do_not_convert(source: str, target: str) -> None:
    left, right = known_unit(source), known_unit(target)
    assert left is not None
    assert right is not None
    assert conversion(left, right) is None
    assert not is_same_unit(left, right)


@pytest.mark.parametrize("name", ["", "furlong", "N.m/rad.s", "m//s", "degC/s", "(m)"])
def test_other_units_are_not_known(name: str) -> None:
    assert known_unit(name) is None


def test_definitions_come_before_symbols() -> None:
    foot = Unit("ft", tuple(int(b == "m") for b in BASE_UNITS), 0.3048006096)
    assert known_unit("ft", {"ft": foot}) == foot


def test_a_block_as_a_key_and_a_gain_as_a_block_say_how_they_are_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.toml"
    file.write_text('[components]\nplant = {integrator = 1.0}\n[outputs]\ny = "plant.y"\n', encoding="utf-8")
    assert run(["info", str(file)]) == 2
    assert 'write {block = "integrator", …} (workbench info --blocks integrator)' in capsys.readouterr().err
    assert run(["info", "--blocks", "sum"]) == 2
    assert 'sum is no block; a system file has it as NAME = {sum = "+-"}' in capsys.readouterr().err
