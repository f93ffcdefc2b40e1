"""SSP: packages as OMSimulator and others write them, read; packages of our own, valid and read back the same."""

from __future__ import annotations

import gc
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp import ssd as fmpy_ssd
from lxml import etree

from tests.system_fmus import plain_fmu
from workbench.analysis.simulate import simulate
from workbench.errors import FmuError, InputError, WorkbenchError
from workbench.fmi.bundled import bundled_path
from workbench.fmi.description import Experiment
from workbench.fmi.variable import Variable
from workbench.signals import Sine
from workbench.system.connect import open_description
from workbench.system.description import (
    Connection,
    FmuComponent,
    FunctionComponent,
    GainComponent,
    LinearComponent,
    SumComponent,
    SystemDescription,
)
from workbench.system.fmu_facts import fmu_facts
from workbench.system.health import resolve
from workbench.system.read import read_system
from workbench.system.ssp_blocks import block_variables
from workbench.system.ssp_write import write_ssp
from workbench.system.units import BASE_UNITS, Unit

NAMESPACES = " ".join(
    f'xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for prefix, name in {
        "ssc": "Common",
        "ssd": "Description",
        "ssv": "ParameterValues",
        "ssm": "ParameterMapping",
        "ssb": "SignalDictionary",
    }.items()
)

# What OMSimulator 2.1 writes for two FMUs in a strongly coupled system inside a weakly coupled one: empty Connectors,
# geometry, its own annotations with solver settings, parameters in a file with a mapping.
OMS = f"""<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription {NAMESPACES}
  xmlns:oms="https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
  name="demo" version="1.0">
  <ssd:System name="root">
    <ssd:Connectors>
      <ssd:Connector name="command" kind="input"><ssc:Real unit="deg" /></ssd:Connector>
      <ssd:Connector name="angle" kind="output">
        <ssc:Real unit="deg" /><ssd:ConnectorGeometry x="1.0" y="0.5" />
      </ssd:Connector>
    </ssd:Connectors>
    <ssd:ParameterBindings>
      <ssd:ParameterBinding source="resources/demo.ssv">
        <ssd:ParameterMapping source="resources/demo.ssm" />
      </ssd:ParameterBinding>
    </ssd:ParameterBindings>
    <ssd:Elements>
      <ssd:System name="sc">
        <ssd:Connectors>
          <ssd:Connector name="in" kind="input"><ssc:Real unit="deg" /></ssd:Connector>
          <ssd:Connector name="out" kind="output"><ssc:Real unit="deg" /></ssd:Connector>
        </ssd:Connectors>
        <ssd:Elements>
          <ssd:Component name="rudder" type="application/x-fmu-sharedlibrary" source="resources/0001_rudder.fmu">
            <ssd:Connectors>
              <ssd:Connector name="delC" kind="input">
                <ssc:Real unit="deg" /><ssd:ConnectorGeometry x="0.0" y="0.5" />
              </ssd:Connector>
              <ssd:Connector name="del" kind="output"><ssc:Real unit="deg" /></ssd:Connector>
            </ssd:Connectors>
            <ssd:ParameterBindings>
              <ssd:ParameterBinding>
                <ssd:ParameterValues>
                  <ssv:ParameterSet version="1.0" name="parameters">
                    <ssv:Parameters>
                      <ssv:Parameter name="bypass"><ssv:Real value="0.25" /></ssv:Parameter>
                      <ssv:Parameter name="pS"><ssv:Real value="1" /></ssv:Parameter>
                    </ssv:Parameters>
                  </ssv:ParameterSet>
                </ssd:ParameterValues>
              </ssd:ParameterBinding>
            </ssd:ParameterBindings>
          </ssd:Component>
        </ssd:Elements>
        <ssd:Connections>
          <ssd:Connection startElement="" startConnector="in" endElement="rudder" endConnector="delC" />
          <ssd:Connection startElement="rudder" startConnector="del" endElement="" endConnector="out" />
        </ssd:Connections>
        <ssd:Annotations>
          <ssc:Annotation type="org.openmodelica"><oms:Annotations><oms:SimulationInformation>
            <oms:VariableStepSolver description="cvode" relativeTolerance="0.0001" />
          </oms:SimulationInformation></oms:Annotations></ssc:Annotation>
        </ssd:Annotations>
      </ssd:System>
      <ssd:Component name="lag" type="application/x-fmu-sharedlibrary" source="resources/0002_lag.fmu">
        <ssd:Connectors />
      </ssd:Component>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="" startConnector="command" endElement="sc" endConnector="in" />
      <ssd:Connection startElement="sc" startConnector="out" endElement="" endConnector="angle">
        <ssd:ConnectionGeometry pointsX="0.1 0.2" pointsY="0.3 0.4" />
      </ssd:Connection>
      <ssd:Connection startElement="sc" startConnector="out" endElement="lag" endConnector="u"
        suppressUnitConversion="true"><ssc:LinearTransformation factor="-0.5" offset="2" /></ssd:Connection>
    </ssd:Connections>
    <ssd:Annotations>
      <ssc:Annotation type="org.openmodelica"><oms:Annotations><oms:SimulationInformation>
        <oms:FixedStepMaster description="oms-ma" stepSize="0.001000" />
      </oms:SimulationInformation></oms:Annotations></ssc:Annotation>
    </ssd:Annotations>
  </ssd:System>
  <ssd:Units>
    <ssc:Unit name="deg"><ssc:BaseUnit rad="1" factor="0.017453292519943295" /></ssc:Unit>
  </ssd:Units>
  <ssd:DefaultExperiment startTime="0.000000" stopTime="5.000000" />
</ssd:SystemStructureDescription>
"""
OMS_SSV = f"""<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet {NAMESPACES} version="1.0" name="demo"><ssv:Parameters>
  <ssv:Parameter name="supply"><ssv:Real value="200" unit="bar" /></ssv:Parameter>
  <ssv:Parameter name="start"><ssv:Real value="1.5" /></ssv:Parameter>
  <ssv:Parameter name="nobody"><ssv:Real value="7" /></ssv:Parameter>
</ssv:Parameters><ssv:Units>
  <ssc:Unit name="bar"><ssc:BaseUnit kg="1" m="-1" s="-2" factor="100000" /></ssc:Unit>
</ssv:Units></ssv:ParameterSet>
"""
OMS_SSM = f"""<?xml version="1.0" encoding="UTF-8"?>
<ssm:ParameterMapping {NAMESPACES} version="1.0">
  <ssm:MappingEntry source="supply" target="sc.rudder.pS" />
  <ssm:MappingEntry source="start" target="lag.u"><ssc:LinearTransformation factor="2" offset="-1"/></ssm:MappingEntry>
  <ssm:MappingEntry source="nobody" target="sc.rudder.nonsense" />
</ssm:ParameterMapping>
"""


def package(path: Path, files: Mapping[str, str | bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def fmu_bytes(folder: Path, name: str = "x", **groups: object) -> bytes:
    path = folder / f"{name}.fmu"
    plain_fmu(path, **groups)  # type: ignore[arg-type]
    return path.read_bytes()


def oms_package(path: Path, ssd: str = OMS) -> Path:
    return package(
        path,
        {
            "SystemStructure.ssd": ssd,
            "resources/0001_rudder.fmu": bundled_path("fmu:Rudder").read_bytes(),
            "resources/0002_lag.fmu": bundled_path("fmu:FirstOrderLag").read_bytes(),
            "resources/demo.ssv": OMS_SSV,
            "resources/demo.ssm": OMS_SSM,
        },
    )


def minimal(system: str, rest: str = "", version: str = "1.0") -> str:
    return (
        f'<ssd:SystemStructureDescription {NAMESPACES} name="test" version="{version}">'
        f'<ssd:System name="root">{system}</ssd:System>{rest}</ssd:SystemStructureDescription>'
    )


def component(name: str, connectors: Mapping[str, tuple[str, str]] | None = None, extra: str = "") -> str:
    inner = ""
    for n, (kind, unit) in (connectors or {}).items():
        real = f'<ssc:Real unit="{unit}"/>' if unit else "<ssc:Real/>"
        inner += f'<ssd:Connector name="{n}" kind="{kind}">{real}</ssd:Connector>'
    listed = f"<ssd:Connectors>{inner}</ssd:Connectors>" if inner else ""
    return f'<ssd:Component name="{name}" source="resources/{name}.fmu">{listed}{extra}</ssd:Component>'


def wire(start: str, end: str, attributes: str = "", inner: str = "") -> str:
    ends = ""
    for side, name in (("start", start), ("end", end)):
        element, dot, connector = name.rpartition(".")
        ends += f' {side}Element="{element}"' if dot else ""
        ends += f' {side}Connector="{connector}"'
    return f"<ssd:Connection{ends} {attributes}>{inner}</ssd:Connection>"


def elements(*parts: str) -> str:
    return f"<ssd:Elements>{''.join(parts)}</ssd:Elements>"


def connections(*parts: str) -> str:
    return f"<ssd:Connections>{''.join(parts)}</ssd:Connections>"


def two(folder: Path, ssd: str, name: str = "test.ssp") -> Path:
    """Return a package with the FMUs a (y in mm, k) and b (u in m)."""
    length = (0, 1, 0, 0, 0, 0, 0, 0)
    return package(
        folder / name,
        {
            "SystemStructure.ssd": ssd,
            "resources/a.fmu": fmu_bytes(
                folder, "a", outputs={"y": "mm"}, parameters={"k": "m"}, units=[Unit("mm", length, 1e-3)]
            ),
            "resources/b.fmu": fmu_bytes(folder, "b", inputs={"u": "m"}, outputs={"y": "m"}, units=[Unit("m", length)]),
        },
    )


def variables_of(system: SystemDescription) -> list[tuple[Variable, ...]]:
    return [
        tuple(fmu_facts(c.file).variables.values()) if isinstance(c, FmuComponent) else block_variables(c)
        for c in system.components
    ]


def refusal(path: Path) -> str:
    with pytest.raises(WorkbenchError) as caught:
        read_system(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(str(path))
    assert "fmi-workbench-" not in text  # no temporary folder in the message
    return text.removeprefix(f"{path}: ")


# -- reading --------------------------------------------------------------------------------------


def test_package_of_omsimulator(tmp_path: Path) -> None:
    system = read_system(oms_package(tmp_path / "demo.ssp"))
    rudder, lag = system.components
    assert isinstance(rudder, FmuComponent)
    assert isinstance(lag, FmuComponent)
    assert (system.name, rudder.name, lag.name, rudder.interface) == ("demo", "sc.rudder", "lag", "auto")
    assert rudder.set == {"bypass": 0.25, "pS": pytest.approx(2e7)}  # bar to Pa; the higher binding wins
    assert lag.set == {"u": 2.0}
    assert system.inputs == {"command": ("sc.rudder.delC",)}
    assert system.outputs == {"angle": "sc.rudder.del"}
    assert system.connections == (
        Connection(source="sc.rudder.del", destination="lag.u", gain=-0.5, offset=2.0, convert=False),
    )
    assert (system.default_experiment.start_time, system.default_experiment.stop_time) == (0.0, 5.0)
    ignored, foreign = system.notes
    assert ignored.startswith("demo.ssv: 'nonsense' is no variable of 'sc.rudder'; ignored")
    assert foreign == "annotations of other tools are ignored: org.openmodelica"


def test_folder_lives_as_long_as_the_description(tmp_path: Path) -> None:
    system = read_system(oms_package(tmp_path / "demo.ssp"))
    assert isinstance(system.components[0], FmuComponent)
    file = Path(system.components[0].file)
    assert file.is_file()
    assert system.folder is not None
    system.folder.close()
    assert not file.exists()


def test_ssd_beside_its_resources_and_its_folder(tmp_path: Path) -> None:
    with zipfile.ZipFile(oms_package(tmp_path / "demo.ssp")) as archive:
        archive.extractall(tmp_path / "open")
    for path in (tmp_path / "open", tmp_path / "open" / "SystemStructure.ssd"):
        system = read_system(path)
        assert system.folder is None
        assert isinstance(system.components[0], FmuComponent)
        assert system.components[0].file == str((tmp_path / "open/resources/0001_rudder.fmu").resolve())


def test_system_without_connectors_shows_those_of_its_components(tmp_path: Path) -> None:
    ssd = minimal(elements(component("a"), component("b")) + connections(wire("a.y", "b.u")))
    system = read_system(two(tmp_path, ssd))
    assert system.connections == (Connection(source="a.y", destination="b.u"),)
    assert system.outputs == {"a.y": "a.y", "b.y": "b.y"}
    assert system.inputs == {}
    wires = resolve(system, variables_of(system)).wires
    assert wires[0].factor == pytest.approx(1e-3, rel=1e-14)


def test_direction_follows_from_the_connectors_not_from_start_and_end(tmp_path: Path) -> None:
    parts = elements(component("a", {"y": ("output", "")}), component("b", {"u": ("input", "")}))
    system = read_system(two(tmp_path, minimal(parts + connections(wire("b.u", "a.y")))))
    assert system.connections == (Connection(source="a.y", destination="b.u"),)


def test_odd_definitions_of_units_are_told(tmp_path: Path) -> None:
    """As one finds them: the factor of deg upside down."""
    units = '<ssd:Units><ssc:Unit name="deg"><ssc:BaseUnit rad="1" factor="57.29746"/></ssc:Unit></ssd:Units>'
    system = read_system(two(tmp_path, minimal(elements(component("a")), units)))
    assert any(
        n.startswith("unit 'deg' is defined with factor 57.2975 and offset 0 to base units") for n in system.notes
    )


def test_transformations_through_nested_systems_are_one(tmp_path: Path) -> None:
    """y [mm] → ×2 + 10 in cm at the nested system's connector → ×3 in m at the input: hop by hop by hand."""
    inner = (
        '<ssd:System name="inner"><ssd:Connectors><ssd:Connector name="c" kind="input"><ssc:Real unit="cm"/>'
        "</ssd:Connector></ssd:Connectors>"
        + elements(component("b"))
        + connections(wire("c", "b.u", inner='<ssc:LinearTransformation factor="3"/>'))
        + "</ssd:System>"
    )
    outer = connections(wire("a.y", "inner.c", inner='<ssc:LinearTransformation factor="2" offset="10"/>'))
    system = read_system(two(tmp_path, minimal(elements(component("a"), inner) + outer)))
    (found,) = resolve(system, variables_of(system)).wires
    millimetres = 7.0
    centimetres = 2.0 * (millimetres / 10.0) + 10.0
    assert found.factor * millimetres + found.offset == pytest.approx(3.0 * (centimetres / 100.0), rel=1e-14)


def test_units_and_transformations_at_the_boundary_become_gains(tmp_path: Path) -> None:
    own = (
        '<ssd:Connectors><ssd:Connector name="r" kind="input"><ssc:Real unit="cm"/></ssd:Connector>'
        '<ssd:Connector name="q" kind="output"><ssc:Real unit="mm"/></ssd:Connector></ssd:Connectors>'
    )
    ends = connections(wire("r", "b.u"), wire("b.y", "q", inner='<ssc:LinearTransformation factor="4" offset="1"/>'))
    definitions = (
        '<ssd:Units><ssc:Unit name="cm"><ssc:BaseUnit m="1" factor="0.01"/></ssc:Unit>'
        '<ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit></ssd:Units>'
    )
    system = read_system(two(tmp_path, minimal(own + elements(component("b")) + ends, definitions)))
    assert system.inputs == {"r": ("r_in.u",)}
    assert system.outputs == {"q": "q_out.y"}
    found = resolve(system, variables_of(system)).wires
    np.testing.assert_allclose([[w.factor, w.offset] for w in found], [[0.01, 0.0], [4000.0, 1.0]], rtol=1e-14)


def test_parameters_by_exposed_connectors_prefix_and_enumeration(tmp_path: Path) -> None:
    types = '<SimpleType name="Mode"><Enumeration><Item name="off" value="3"/><Item name="on" value="8"/></Enumeration>'
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{9 + k}" causality="parameter" variability="fixed">{kind}'
        "</ScalarVariable>"
        for k, (name, kind) in enumerate(
            {
                "mode": '<Enumeration declaredType="Mode" start="3"/>',
                "count": '<Integer start="0"/>',
                "flag": '<Boolean start="false"/>',
                "label": '<String start=""/>',
            }.items()
        )
    )
    plain_fmu(tmp_path / "a.fmu", parameters={"k": "m"}, types=f"{types}</SimpleType>", others=variables)
    values = {
        "mode": '<ssv:Enumeration value="on"/>',
        "count": '<ssv:Integer value="4"/>',
        "flag": '<ssv:Boolean value="true"/>',
        "label": '<ssv:String value="left wing"/>',
    }
    sets = "".join(f'<ssv:Parameter name="{n}">{v}</ssv:Parameter>' for n, v in values.items())
    system = (
        '<ssd:Connectors><ssd:Connector name="K" kind="parameter"><ssc:Real/></ssd:Connector></ssd:Connectors>'
        "<ssd:ParameterBindings>"
        '<ssd:ParameterBinding prefix="a."><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="s">'
        f"<ssv:Parameters>{sets}</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>"
        '<ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="s"><ssv:Parameters>'
        '<ssv:Parameter name="K"><ssv:Real value="250" unit="mm"/></ssv:Parameter>'
        "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
        + elements(component("a", {"k": ("parameter", "")}))
        + connections(wire("K", "a.k", inner='<ssc:LinearTransformation factor="2"/>'))
    )
    path = package(
        tmp_path / "p.ssp",
        {"SystemStructure.ssd": minimal(system), "resources/a.fmu": (tmp_path / "a.fmu").read_bytes()},
    )
    (a,) = read_system(path).components
    assert isinstance(a, FmuComponent)
    assert a.set == {"mode": 8, "count": 4, "flag": True, "label": "left wing", "k": pytest.approx(0.5)}


def test_ssp_2_with_its_types_is_read(tmp_path: Path) -> None:
    connector = '<ssd:Connector name="u" kind="input"><ssc:Float64 unit="m"/></ssd:Connector>'
    part = (
        f'<ssd:Component name="b" source="resources/b.fmu"><ssd:Connectors>{connector}</ssd:Connectors></ssd:Component>'
    )
    system = read_system(two(tmp_path, minimal(elements(part), version="2.0")))
    assert isinstance(system.components[0], FmuComponent)
    assert system.components[0].units == {"u": "m"}


def test_one_ssd_of_another_name_is_taken_with_a_note(tmp_path: Path) -> None:
    path = package(
        tmp_path / "x.ssp",
        {"Variant.ssd": minimal(elements(component("b"))), "resources/b.fmu": fmu_bytes(tmp_path, inputs={"u": None})},
    )
    assert "the package has no SystemStructure.ssd; Variant.ssd was read" in read_system(path).notes


# -- refusals -------------------------------------------------------------------------------------

PARTS = elements(component("a", {"y": ("output", "")}), component("b", {"u": ("input", ""), "y": ("output", "")}))


@pytest.mark.parametrize(
    ("ssd", "said"),
    [
        (
            minimal(PARTS + connections(wire("aa.y", "b.u"))),
            "a connection of system 'root' names 'aa.y', but there is no element 'aa'; did you mean a?",
        ),
        (minimal(PARTS + connections(wire("a.y", "b.y"))), "connection a.y → b.y: connects two outputs"),
        (
            minimal(PARTS + connections(wire("a.y", "b.u", inner="<ssc:IntegerMappingTransformation/>"))),
            "connection a.y → b.u: IntegerMappingTransformation is not read",
        ),
        (
            minimal(PARTS + connections(wire("a.y", "b.u", inner='<ssc:LinearTransformation factor="x"/>'))),
            "connection a.y → b.u: factor='x' is no number",
        ),
        (minimal(elements(component("a"), component("a"))), "two elements are called 'a'; rename one"),
        (minimal(elements(component("c"))), "component 'c': the file 'resources/c.fmu' is missing in the package"),
        (minimal(""), "the system has no components"),
        (
            minimal(
                elements(component("a", {"y": ("calculatedParameter", "")}), component("b", {"u": ("input", "")}))
                + connections(wire("a.y", "b.u"))
            ),
            "connection a.y → b.u: a component's calculatedParameter is not handed over",
        ),
        (
            minimal(PARTS + connections(wire("a.y", "b.u", 'startIndices="1"'))),
            "takes elements of the array 'y', which is not read",
        ),
        (
            minimal(elements('<ssd:Component name="t" source="t.csv" type="application/table"/>')),
            "component 't': type 'application/table' is not read; only FMUs",
        ),
        (
            minimal(elements('<ssd:Component name="t" source="../../etc/x.fmu"/>')),
            "component 't': source '../../etc/x.fmu' leads out of the package; refused",
        ),
        (
            minimal(elements('<ssd:Component name="t" source="https://a.invalid/x.fmu"/>')),
            "component 't': source 'https://a.invalid/x.fmu' is not a file in the package",
        ),
        (
            minimal(elements('<ssd:SignalDictionaryReference name="bus" dictionary="d"/>')),
            "'bus' is a SignalDictionaryReference; signal dictionaries are not read",
        ),
        (
            minimal('<ssd:SignalDictionaries><ssd:SignalDictionary name="d"/></ssd:SignalDictionaries>'),
            "SignalDictionary 'd': signal dictionaries are not read",
        ),
        (
            minimal(
                elements(
                    component(
                        "a",
                        extra='<ssd:ParameterBindings><ssd:ParameterBinding source="resources/no.ssv"/>'
                        "</ssd:ParameterBindings>",
                    )
                )
            ),
            "ParameterBinding of 'a': the file 'resources/no.ssv' is missing in the package",
        ),
        ("<ssd>", "SystemStructure.ssd: is not well-formed XML"),
        ("<other/>", "SystemStructure.ssd: the root is 'other', but 'SystemStructureDescription' is expected"),
        (f'<!DOCTYPE x [<!ENTITY e "e">]>{minimal(PARTS)}', "SystemStructure.ssd: declares a document type"),
    ],
)
def test_faults_are_told_in_one_line(tmp_path: Path, ssd: str, said: str) -> None:
    assert said in refusal(two(tmp_path, ssd))


def test_broken_and_hostile_packages(tmp_path: Path) -> None:
    (tmp_path / "a.ssp").write_bytes(b"PK\x03\x04 no zip")
    assert "not a zip archive or damaged" in refusal(tmp_path / "a.ssp")
    assert "would leave the target folder" in refusal(package(tmp_path / "b.ssp", {"../evil.txt": "x"}))
    assert not (tmp_path.parent / "evil.txt").exists()
    assert "no SystemStructure.ssd inside" in refusal(package(tmp_path / "c.ssp", {"readme.txt": "x"}))
    broken = {"SystemStructure.ssd": minimal(elements(component("a"))), "resources/a.fmu": "no zip"}
    assert "component 'a': resources/a.fmu: not a zip archive" in refusal(package(tmp_path / "d.ssp", broken))


def test_connectors_in_a_circle_are_refused(tmp_path: Path) -> None:
    def inner(name: str) -> str:
        own = (
            '<ssd:Connectors><ssd:Connector name="i" kind="input"/><ssd:Connector name="o" kind="output"/>'
            "</ssd:Connectors>"
        )
        return f'<ssd:System name="{name}">{own}{connections(wire("i", "o"))}</ssd:System>'

    ring = connections(wire("p.o", "q.i"), wire("q.o", "p.i"), wire("q.o", "b.u"))
    text = refusal(two(tmp_path, minimal(elements(inner("p"), inner("q"), component("b")) + ring)))
    assert "connectors drive each other in a circle" in text


# -- writing --------------------------------------------------------------------------------------


def loop() -> SystemDescription:
    """Return a system with all that a package can hold."""
    return SystemDescription(
        name="loop",
        components=(
            FmuComponent(name="rudder", file="fmu:Rudder", interface="me", set={"pS": 2.1e7}, solver="gear"),
            FmuComponent(name="rudder2", file="fmu:Rudder", interface="cs", step=1e-3),
            FmuComponent(name="lag", file="fmu:FirstOrderLag@3"),
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
        default_experiment=Experiment(0.0, 12.5, 1e-7, 0.01),
    )


def test_written_package_is_valid_ssp_1_and_read_by_fmpy(tmp_path: Path) -> None:
    notes = write_ssp(loop(), tmp_path / "loop.ssp")
    assert "component k is no FMU: other tools cannot run it" in notes
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
    assert [(w.factor, w.offset, w.closes_at) for w in after.wires] == [
        (w.factor, w.offset, w.closes_at) for w in before.wires
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
