"""SSP: packages as OMSimulator and others write them are read; faults are told in one line."""

from __future__ import annotations

import json
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.ssp_packages import (
    component,
    connections,
    elements,
    fmu_bytes,
    minimal,
    oms_package,
    package,
    refusal,
    two,
    variables_of,
    wire,
)
from tests.system_fmus import plain_fmu
from workbench.errors import FmuError, InputError
from workbench.fmi.bundled import bundled_path
from workbench.health.info.result import SystemInfo
from workbench.model.content_hash import content_hash
from workbench.system.connection_checks import resolve
from workbench.system.description import (
    Connection,
    FmuComponent,
    SystemDescription,
)
from workbench.system.files.read import read_system
from workbench.system.recipe import SystemRecipe


def test_a_part_without_binary_is_named_by_its_place_in_the_package(tmp_path: Path) -> None:
    path = two(tmp_path, minimal(elements(component("a"), component("b"))))
    with pytest.raises(FmuError) as caught:
        wb.load(path)
    place = f"component a: {path}/resources/a.fmu: no binary"
    assert str(caught.value).startswith(place)


def test_no_temporary_folder_is_shown(tmp_path: Path) -> None:
    """Neither in what a reader of pages, files and errors sees, nor in what is written."""
    path, lag = tmp_path / "s.ssp", FmuComponent(name="lag", file="fmu:FirstOrderLag")
    wb.write_ssp(SystemDescription(name="s", components=(lag,)), path)
    place = f"{path}/resources/{bundled_path('fmu:FirstOrderLag').name}"
    found = wb.info(path)
    assert isinstance(found, SystemInfo)
    assert found.components[0].what == place
    with wb.load(path) as model:
        assert isinstance(model.recipe, SystemRecipe)
        (recipe,) = model.recipe.parts.values()
        assert (recipe.source, recipe.content()) == (place, content_hash(bundled_path("fmu:FirstOrderLag")))
        assert "fmi-workbench-" not in json.dumps([model.recipe.identity(), wb.simulate(model, stop=0.1).to_dict()])
        with pytest.raises(InputError, match=f"{re.escape(place)} is inside a package; write an .ssp instead"):
            wb.write_toml(replace(model.recipe.system, folder=None), tmp_path / "b.toml")


@pytest.mark.parametrize("key", ["model", "linear"])
def test_a_block_of_a_package_names_no_other_file(tmp_path: Path, key: str) -> None:
    block = '<ssd:Component name="b" source="b.json" type="application/x-fmi-workbench-block"/>'
    files = {"SystemStructure.ssd": minimal(elements(block)), "b.json": json.dumps({key: str(tmp_path / "x")})}
    told = f"component 'b': b.json names another file ('{key}'); write it out there"
    assert refusal(package(tmp_path / "s.ssp", files)) == told


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
    assert ignored.startswith("demo.ssv: 'nonsense' is not a variable of 'sc.rudder'; ignored")
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
    assert wires[0].gain == pytest.approx(1e-3, rel=1e-14)


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
    assert found.gain * millimetres + found.offset == pytest.approx(3.0 * (centimetres / 100.0), rel=1e-14)


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
    np.testing.assert_allclose([[w.gain, w.offset] for w in found], [[0.01, 0.0], [4000.0, 1.0]], rtol=1e-14)


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
            "connection a.y → b.u: factor='x' is not a number",
        ),
        (minimal(elements(component("a"), component("a"))), "two elements are called 'a'; rename one"),
        (minimal(elements(component("c"))), "component 'c': the file 'resources/c.fmu' is missing in the package"),
        (minimal(""), "the system has no components"),
        (
            minimal(
                elements(component("a", {"y": ("calculatedParameter", "")}), component("b", {"u": ("input", "")}))
                + connections(wire("a.y", "b.u"))
            ),
            "connection a.y → b.u: a component's calculatedParameter is not passed on",
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
    told = refusal(package(tmp_path / "d.ssp", broken))
    assert told.startswith(f"component 'a': {tmp_path / 'd.ssp'}/resources/a.fmu: not a zip archive")


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
