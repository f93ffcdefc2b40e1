"""SSP: packages of our own are valid and read back the same."""

from __future__ import annotations

import gc
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp import ssd as fmpy_ssd
from lxml import etree

from tests.fmi3_fmus import build_sized
from tests.reference_fmus import build_reference
from tests.ssp_packages import (
    variables_of,
)
from workbench.core.values.conversion import BASE_UNITS
from workbench.errors import FmuError, InputError
from workbench.fmi.bundled import bundled_path
from workbench.fmi.description import DefaultExperiment
from workbench.fmi.variable import Value
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Sine
from workbench.system.connect import open_description
from workbench.system.connection_checks import resolve
from workbench.system.description import (
    Connection,
    FmuComponent,
    FunctionComponent,
    GainComponent,
    LinearComponent,
    MasterOptions,
    SumComponent,
    SystemDescription,
)
from workbench.system.files.read import read_system
from workbench.system.files.ssp_write import write_ssp
from workbench.system.files.toml_write import write_toml
from workbench.system.fmu_facts import fmu_facts
from workbench.system.load import load


def loop() -> SystemDescription:
    """Return a system with all that a package can hold."""
    return SystemDescription(
        name="loop",
        components=(
            FmuComponent(name="rudder", file="fmu:Rudder", interface="me", set={"pS": 2.1e7}, solver="gear"),
            FmuComponent(name="rudder2", file="fmu:Rudder", interface="cs", step=1e-3),
            FmuComponent(name="lag", file="fmu:FirstOrderLag@3", dependencies="all"),
            GainComponent(name="k", gain=0.1, units={"u": "deg"}),
            LinearComponent(
                name="filter",
                A=np.array([[-1.0 / 3.0, 0.1], [0.0, -2.0]]),
                B=np.array([[1.0], [0.7]]),
                C=np.array([[1.0, 0.0]]),
                D=np.zeros((1, 1)),
                dt=0.0,
                input_names=("u",),
                output_names=("y",),
                state_names=("p", "q"),
                x0=np.array([0.1, 0.2]),
                units={"y": "rad"},
            ),
        ),
        connections=(
            Connection(source="rudder.del", destination="k.u", gain=-1.0 / 3.0, offset=0.1),
            Connection(source="k.y", destination="filter.u", closes_at=140.0),
            Connection(source="filter.y", destination="rudder2.delC", unit="deg"),
            Connection(source="rudder2.del", destination="lag.u", convert=False),
        ),
        inputs={"command": ("rudder.delC",)},
        outputs={"y": "lag.y", "angle": "rudder.del"},
        default_experiment=DefaultExperiment(0.0, 12.5, 1e-7, 0.01),
    )


# FMI version → variables of the feed-through FMU: enumeration, Boolean, whole number, text.
TYPED = {
    2: ("option_input", "boolean_input", "integer_input", "string_input"),
    3: ("Enumeration_input", "Boolean_input", "Int64_input", "String_input"),
}


@pytest.mark.parametrize("fmi", TYPED)
def test_values_of_every_type_come_back(fmi: int, tmp_path: Path) -> None:
    path = build_reference(tmp_path, "feedthrough", fmi)
    option, truth, whole, text = TYPED[fmi]
    largest = 2**31 - 1 if fmi == 2 else 2**62 + 1  # which is not a float
    given: dict[str, Value] = {
        option: "second",
        truth: "True",
        whole: largest,
        text: 'a & <b> "c" é',
        "fixed_parameter": "2.5",
    }
    system = SystemDescription(
        name="typed",
        components=(FmuComponent(name="f", file=str(path), set=given),),
        outputs={n: f"f.{n.replace('_input', '_output')}" for n in (option, truth, whole)},
    )
    write_ssp(system, tmp_path / "typed.ssp")
    fmpy_ssd.read_ssd(str(tmp_path / "typed.ssp"), validate=True)
    (component,) = read_system(tmp_path / "typed.ssp").components
    assert isinstance(component, FmuComponent)
    assert component.set == {option: 2, truth: True, whole: largest, text: given[text], "fixed_parameter": 2.5}
    with open_description(read_system(tmp_path / "typed.ssp")) as model:
        run = simulate(model, stop=0.1)
    assert [run.signals[n][-1] for n in (option, truth)] == [2.0, 1.0]


def test_values_with_units_and_arrays_come_back(tmp_path: Path) -> None:
    rudder = FmuComponent(name="r", file="fmu:Rudder", set={"pS": "210bar"})
    path = build_sized(tmp_path)
    system = SystemDescription(
        name="units",
        components=(
            rudder,
            FmuComponent(name="s", file=str(path), set={"a": "[1, 2]"}),
            FmuComponent(name="t", file=str(path), set={"n": 3, "a": "[1, 2, 3]"}),
        ),
        outputs={"y": "r.del"},
    )
    write_ssp(system, tmp_path / "units.ssp")
    of_rudder, plain, sized = read_system(tmp_path / "units.ssp").components
    assert isinstance(of_rudder, FmuComponent)
    assert isinstance(plain, FmuComponent)
    assert isinstance(sized, FmuComponent)
    assert of_rudder.set == {"pS": pytest.approx(2.1e7, rel=1e-15)}
    assert plain.set == {"a[1]": 1.0, "a[2]": 2.0}
    assert sized.set == {"n": 3, "a": "[1, 2, 3]"}
    with open_description(read_system(tmp_path / "units.ssp")) as model:
        assert simulate(model, stop=0.1).time[-1] == 0.1


def test_a_value_that_is_not_one_is_refused_in_one_line(tmp_path: Path) -> None:
    path = build_reference(tmp_path, "feedthrough", 2)
    part = FmuComponent(name="f", file=str(path), set={"option_input": "secnd"})
    with pytest.raises(InputError, match=r"component f: option_input: .*no item 'secnd'; did you mean"):
        write_ssp(SystemDescription(name="wrong", components=(part,)), tmp_path / "wrong.ssp")


def test_written_package_is_valid_ssp_1_and_read_by_fmpy(tmp_path: Path) -> None:
    notes = write_ssp(loop(), tmp_path / "loop.ssp")
    assert "component k is not an FMU: other tools cannot run it" in notes
    assert any("closes at 140 s: for other tools it is closed from the start" in n for n in notes)
    read = fmpy_ssd.read_ssd(str(tmp_path / "loop.ssp"), validate=True)  # against the schema of SSP 1.0
    names = [e.name for e in read.system.elements]
    assert names == ["rudder", "rudder2", "lag", "k", "filter"]
    assert read.system.elements[0].source == read.system.elements[1].source == "resources/Rudder.fmu"
    (parameter,) = read.system.elements[0].parameterBindings[0].parameterValues[0].parameters
    assert (parameter.name, parameter.type, float(parameter.value)) == ("pS", "Real", 2.1e7)
    ends = {(c.startElement, c.startConnector, c.endElement, c.endConnector) for c in read.system.connections}
    assert ("filter", "y", "rudder2", "delC") in ends
    assert (None, "command", "rudder", "delC") in ends
    with zipfile.ZipFile(tmp_path / "loop.ssp") as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))
        sets = root.findall(".//{*}ParameterSet")
        assert archive.read("resources/Rudder.fmu") == bundled_path("fmu:Rudder").read_bytes()
    schema = Path(fmpy_ssd.__file__).with_name("schema") / "SystemStructureParameterValues.xsd"
    for parameter_set in sets:
        etree.XMLSchema(file=str(schema)).assertValid(parameter_set)


def test_written_package_is_read_back_the_same(tmp_path: Path) -> None:
    given = loop()
    write_ssp(given, tmp_path / "loop.ssp")
    found = read_system(tmp_path / "loop.ssp")
    before, after = (resolve(s, variables_of(s)) for s in (given, found))
    assert [(w.gain, w.offset, w.closes_at) for w in after.wires] == [
        (w.gain, w.offset, w.closes_at) for w in before.wires
    ]
    assert (found.inputs, found.outputs) == (given.inputs, given.outputs)
    assert found.default_experiment == given.default_experiment
    assert found.notes == ()
    for old, new in zip(given.components, found.components, strict=True):
        assert type(old) is type(new)
        for attribute in ("name", "interface", "set", "step", "solver", "gain", "dt", "state_names"):
            assert getattr(new, attribute, None) == getattr(old, attribute, None)
        for attribute in ("A", "B", "C", "D", "x0"):
            np.testing.assert_array_equal(getattr(new, attribute, 0.0), getattr(old, attribute, 0.0))
    write_ssp(found, tmp_path / "again.ssp")
    first = zipfile.ZipFile(tmp_path / "loop.ssp").read("SystemStructure.ssd")
    assert zipfile.ZipFile(tmp_path / "again.ssp").read("SystemStructure.ssd") == first


def test_written_package_simulates_to_the_same_bytes(tmp_path: Path) -> None:
    given = SystemDescription(
        name="loop",
        components=(
            FmuComponent(name="rudder", file="fmu:Rudder", interface="me", set={"pS": 2.0e7}),
            SumComponent(name="s", signs=(1.0, -1.0), unit="deg"),
            GainComponent(name="k", gain=0.7, units={"u": "deg", "y": "rad"}),
        ),
        connections=(
            Connection(source="s.y", destination="k.u"),
            Connection(source="k.y", destination="rudder.delC", unit="deg", closes_at=0.3),
            Connection(source="rudder.del", destination="s.u2"),
        ),
        inputs={"command": ("s.u1",)},
        outputs={"angle": "rudder.del"},
    )
    write_ssp(given, tmp_path / "loop.ssp")
    histories = []
    for system in (given, read_system(tmp_path / "loop.ssp")):
        with open_description(system) as model:
            result = simulate(model, stop=1.0, inputs={"command": Sine(amplitude=2.0, frequency=2.0)})
        result.to_csv(tmp_path / "angle.csv")
        histories.append((tmp_path / "angle.csv").read_bytes())
    assert histories[0] == histories[1]
    assert np.ptp(np.loadtxt(tmp_path / "angle.csv", delimiter=",", skiprows=1)[:, -1]) > 0.1


def test_packages_stand_in_system_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_ssp(
            SystemDescription(
                name=name,
                components=(FmuComponent(name="lag", file="fmu:FirstOrderLag"),),
                inputs={"u": ("lag.u",)},
                outputs={"y": "lag.y"},
            ),
            tmp_path / f"{name}.ssp",
        )
    file = tmp_path / "both.toml"
    file.write_text('[components]\na = "a.ssp"\nb = "b.ssp"\n[connections]\n"b.u" = "a.y"\n[outputs]\ny = "b.y"\n')
    system = read_system(file)
    assert system.connections == (Connection(source="a.lag.y", destination="b.lag.u"),)
    files = [Path(c.file) for c in system.components if isinstance(c, FmuComponent)]
    gc.collect()
    assert len(files) == 2
    assert all(f.is_file() for f in files)
    del system
    gc.collect()
    assert not any(f.exists() for f in files)


def test_unpacked_fmus_are_packed(tmp_path: Path) -> None:
    with zipfile.ZipFile(bundled_path("fmu:FirstOrderLag")) as archive:
        archive.extractall(tmp_path / "Lag")
    part = FmuComponent(name="lag", file=str(tmp_path / "Lag"))
    write_ssp(SystemDescription(name="s", components=(part,), outputs={"y": "lag.y"}), tmp_path / "s.ssp")
    system = read_system(tmp_path / "s.ssp")
    (found,) = system.components
    assert isinstance(found, FmuComponent)
    assert Path(found.file).name == "Lag.fmu"
    assert set(fmu_facts(found.file).variables) == set(fmu_facts("fmu:FirstOrderLag").variables)


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    function = FunctionComponent(name="f", function=abs)
    with pytest.raises(InputError, match="component f is a Python function, which no file can hold"):
        write_ssp(SystemDescription(name="s", components=(function,)), tmp_path / "s.ssp")
    part = FmuComponent(name="lag", file="fmu:FirstOrderLag")
    good = SystemDescription(name="s", components=(part,))
    with pytest.raises(InputError, match=r"must end in \.ssp"):
        write_ssp(good, tmp_path / "s.zip")
    with pytest.raises(InputError, match="does not exist"):
        write_ssp(good, tmp_path / "none" / "s.ssp")
    wire = Connection(source="lag.y", destination="lag.uu")
    with pytest.raises(InputError, match="did you mean u"):
        write_ssp(SystemDescription(name="s", components=(part,), connections=(wire,)), tmp_path / "s.ssp")
    (tmp_path / "x.fmu").write_text("")
    broken = FmuComponent(name="x", file=str(tmp_path / "x.fmu"))
    with pytest.raises(FmuError, match="not a zip archive"):
        write_ssp(SystemDescription(name="s", components=(broken,)), tmp_path / "s.ssp")
    assert not (tmp_path / "s.ssp").exists()


def test_units_of_a_written_package_are_defined(tmp_path: Path) -> None:
    write_ssp(loop(), tmp_path / "loop.ssp")
    units = {u.name: u for u in fmpy_ssd.read_ssd(str(tmp_path / "loop.ssp")).units}
    assert units["deg"].factor == pytest.approx(np.pi / 180.0, rel=1e-15)
    pressure = {b: getattr(units["Pa"], b) for b in BASE_UNITS}
    assert pressure == {**dict.fromkeys(BASE_UNITS, 0), "kg": 1, "m": -1, "s": -2}


def test_what_the_master_is_told_is_not_written_and_said(tmp_path: Path) -> None:
    given = replace(loop(), master=MasterOptions(order="jacobi", extrapolation=2))
    notes = write_ssp(given, tmp_path / "loop.ssp")
    assert "of the master nothing is written: order, extrapolation" in notes
    assert read_system(tmp_path / "loop.ssp").master == MasterOptions()


def test_an_open_system_is_not_what_is_written(tmp_path: Path) -> None:
    with load("system:rudder_loop") as system:
        for write, name in ((write_ssp, "a.ssp"), (write_toml, "a.toml")):
            with pytest.raises(InputError, match=r"a SystemModel is not a system's description: give wb.read_system"):
                write(system, tmp_path / name)  # type: ignore[arg-type]
            write(system.recipe.system, tmp_path / name)  # type: ignore[attr-defined]
