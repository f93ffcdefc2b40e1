"""What SSP 1.0 and 2.0 allow and few files have: signal dictionaries, transformations, systems in other files."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp import simulation as fmpy_ssp

from tests.fmi1_fmus import build_fmi1
from tests.platforms import needs_module
from tests.ssp_packages import (
    NAMESPACES,
    component,
    connections,
    elements,
    fmu_bytes,
    minimal,
    package,
    refusal,
    two,
    variables_of,
    wire,
)
from tests.system_fmus import plain_fmu
from workbench.core.values.conversion import Unit
from workbench.model.loading import Loading
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Constant
from workbench.system.connect import open_description
from workbench.system.connection_checks import resolve
from workbench.system.description import Connection, FmuComponent, SystemDescription
from workbench.system.files.read import read_system
from workbench.system.files.ssp_write import write_ssp

LENGTH = (0, 1, 0, 0, 0, 0, 0, 0)
A = component("a", {"y": ("output", "")})
B = component("b", {"u": ("input", ""), "y": ("output", "")})


# -- signal dictionaries ----------------------------------------------------------------------------


def _entry(name: str, unit: str) -> str:
    return f'<ssb:DictionaryEntry name="{name}"><ssc:Real unit="{unit}"/></ssb:DictionaryEntry>'


def _dictionary(*entries: str) -> str:
    return f'<ssb:SignalDictionary {NAMESPACES} version="1.0">{"".join(entries)}</ssb:SignalDictionary>'


def _reference(name: str, dictionary: str, **kinds: str) -> str:
    inner = "".join(f'<ssd:Connector name="{n}" kind="{k}"><ssc:Real/></ssd:Connector>' for n, k in kinds.items())
    return (
        f'<ssd:SignalDictionaryReference name="{name}" dictionary="{dictionary}">'
        f"<ssd:Connectors>{inner}</ssd:Connectors></ssd:SignalDictionaryReference>"
    )


def _bus(dictionary: str) -> str:
    """Return a system whose part a writes to a bus, and part b in a system inside reads from it."""
    inside = (
        '<ssd:System name="inner">'
        + elements(B, _reference("there", "bus", travel="output"))
        + connections(wire("there.travel", "b.u"))
        + "</ssd:System>"
    )
    return (
        elements(A, _reference("here", "bus", travel="input"), inside)
        + connections(wire("here.travel", "a.y"))  # start and end do not say which way it goes
        + f"<ssd:SignalDictionaries>{dictionary}</ssd:SignalDictionaries>"
    )


@pytest.mark.parametrize("outside", [False, True])
def test_a_signal_dictionary_connects_what_refers_to_it(tmp_path: Path, *, outside: bool) -> None:
    written = _dictionary(_entry("travel", "m"), _entry("unused", "m"))
    inline = f'<ssd:SignalDictionary name="bus">{written}</ssd:SignalDictionary>'
    referred = '<ssd:SignalDictionary name="bus" source="resources/bus.ssb"/>'
    ssp = two(tmp_path, minimal(_bus(referred if outside else inline)))
    if outside:
        with zipfile.ZipFile(ssp, "a") as archive:
            archive.writestr("resources/bus.ssb", written)
    system = read_system(ssp)
    (found,) = resolve(system, variables_of(system)).wires
    assert [(c.source, c.destination) for c in system.connections] == [("a.y", "inner.b.u")]
    assert found.gain == pytest.approx(1e-3)  # a.y is in mm, b.u in m


def test_two_dictionaries_are_mapped_to_each_other(tmp_path: Path) -> None:
    one, other = (
        f'<ssd:SignalDictionary name="{name}">{_dictionary(_entry(entry, "m"))}</ssd:SignalDictionary>'
        for name, entry in (("one", "travel"), ("other", "x"))
    )
    system = (
        elements(A, B, _reference("p", "one", travel="inout"), _reference("q", "other", x="inout"))
        + connections(
            wire("a.y", "p.travel"),
            wire("p.travel", "q.x", inner='<ssc:LinearTransformation factor="3" offset="1"/>'),
            wire("q.x", "b.u"),
        )
        + f"<ssd:SignalDictionaries>{one}{other}</ssd:SignalDictionaries>"
    )
    found = read_system(two(tmp_path, minimal(system)))
    (wired,) = resolve(found, variables_of(found)).wires
    np.testing.assert_allclose((wired.gain, wired.offset), (3e-3, 1.0))


@pytest.mark.parametrize(
    ("system", "said"),
    [
        (
            elements(A, _reference("here", "buss", travel="input"))
            + '<ssd:SignalDictionaries><ssd:SignalDictionary name="bus"/></ssd:SignalDictionaries>',
            "SignalDictionaryReference 'here': there is no signal dictionary 'buss'; did you mean bus?",
        ),
        (
            _bus(f'<ssd:SignalDictionary name="bus">{_dictionary(_entry("travels", "m"))}</ssd:SignalDictionary>'),
            "SignalDictionaryReference 'here': the dictionary 'bus' has no entry 'travel'; did you mean travels?",
        ),
        (
            _bus('<ssd:SignalDictionary name="bus" source="resources/no.ssb"/>'),
            "SignalDictionary 'bus': the file 'resources/no.ssb' is missing in the package",
        ),
        (
            _bus('<ssd:SignalDictionary name="bus" type="text/x-dbc"/>'),
            "SignalDictionary 'bus': type 'text/x-dbc' is not read",
        ),
    ],
)
def test_faults_of_dictionaries_are_told(tmp_path: Path, system: str, said: str) -> None:
    assert said in refusal(two(tmp_path, minimal(system)))


# -- parameters -------------------------------------------------------------------------------------


def _bound(parameters: str, mapping: str, more: str = "") -> str:
    return (
        f"<ssd:ParameterBindings><ssd:ParameterBinding {more}><ssd:ParameterValues>"
        f'<ssv:ParameterSet version="2.0" name="s"><ssv:Parameters>{parameters}</ssv:Parameters></ssv:ParameterSet>'
        f"</ssd:ParameterValues>{mapping}</ssd:ParameterBinding></ssd:ParameterBindings>"
    )


def _parameter(name: str, inner: str) -> str:
    return f'<ssv:Parameter name="{name}">{inner}</ssv:Parameter>'


def _mapped(*entries: tuple[str, str, str, tuple[tuple[str, str], ...]]) -> str:
    written = "".join(
        f'<ssm:MappingEntry source="{s}" target="{t}"><ssc:{kind}MappingTransformation>'
        + "".join(f'<ssc:MapEntry source="{a}" target="{b}"/>' for a, b in table)
        + f"</ssc:{kind}MappingTransformation></ssm:MappingEntry>"
        for s, t, kind, table in entries
    )
    inside = f'<ssm:ParameterMapping version="1.0">{written}</ssm:ParameterMapping>'
    return f"<ssd:ParameterMapping>{inside}</ssd:ParameterMapping>"


def _typed_fmu(folder: Path) -> bytes:
    types = '<SimpleType name="Mode"><Enumeration><Item name="off" value="3"/><Item name="on" value="8"/></Enumeration>'
    kinds = {
        "mode": '<Enumeration declaredType="Mode" start="3"/>',
        "count": '<Integer start="0"/>',
        "flag": '<Boolean start="false"/>',
        "label": '<String start=""/>',
    }
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{9 + k}" causality="parameter" variability="fixed">{kind}'
        "</ScalarVariable>"
        for k, (name, kind) in enumerate(kinds.items())
    )
    plain_fmu(folder / "a.fmu", types=f"{types}</SimpleType>", others=variables)
    return (folder / "a.fmu").read_bytes()


PARAMETERS = (
    _parameter("gear", '<ssv:Integer value="2"/>')
    + _parameter("active", '<ssv:Boolean value="1"/>')
    + _parameter("state", '<ssv:Enumeration><ssv:Value value="running"/></ssv:Enumeration>')
    + _parameter("name", '<ssv:String><ssv:Value value="left wing"/></ssv:String>')
)
TABLES = (
    ("gear", "count", "Integer", (("1", "10"), ("2", "20"))),
    ("active", "flag", "Boolean", (("true", "false"), ("false", "true"))),
    ("state", "mode", "Enumeration", (("running", "on"), ("stopped", "off"))),
)


def test_mapping_transformations_of_parameters(tmp_path: Path) -> None:
    ssd = minimal(elements(component("a", extra=_bound(PARAMETERS, _mapped(*TABLES)))), version="2.0")
    (a,) = read_system(
        package(tmp_path / "p.ssp", {"SystemStructure.ssd": ssd, "resources/a.fmu": _typed_fmu(tmp_path)})
    ).components
    assert isinstance(a, FmuComponent)
    assert a.set == {"count": 20, "flag": False, "mode": 8}  # the name is not in the mapping: it is not applied


def test_a_value_that_a_mapping_does_not_have_is_told(tmp_path: Path) -> None:
    mapping = _mapped(("gear", "count", "Integer", (("1", "10"), ("3", "30"))))
    ssd = minimal(elements(component("a", extra=_bound(PARAMETERS, mapping))))
    path = package(tmp_path / "p.ssp", {"SystemStructure.ssd": ssd, "resources/a.fmu": _typed_fmu(tmp_path)})
    assert "mapping gear → count: the IntegerMappingTransformation has no entry for '2'; it has: 1, 3" in refusal(path)


def test_values_as_elements_and_parameter_files_inside_the_component(tmp_path: Path) -> None:
    inside = (
        f'<ssv:ParameterSet {NAMESPACES} version="2.0" name="s"><ssv:Parameters>'
        + _parameter("label", '<ssv:String><ssv:Value value="left wing"/></ssv:String>')
        + "</ssv:Parameters></ssv:ParameterSet>"
    )
    fmu = tmp_path / "with.fmu"
    fmu.write_bytes(_typed_fmu(tmp_path))
    with zipfile.ZipFile(fmu, "a") as archive:
        archive.writestr("extra/values.ssv", inside)
    binding = '<ssd:ParameterBinding sourceBase="component" source="extra/{}.ssv"/>'

    def described(name: str) -> Path:
        extra = f"<ssd:ParameterBindings>{binding.format(name)}</ssd:ParameterBindings>"
        ssd = minimal(elements(component("a", extra=extra)))
        return package(tmp_path / "p.ssp", {"SystemStructure.ssd": ssd, "resources/a.fmu": fmu.read_bytes()})

    (a,) = read_system(described("values")).components
    assert isinstance(a, FmuComponent)
    assert a.set == {"label": "left wing"}
    assert "the file 'extra/value.ssv' is missing in resources/a.fmu" in refusal(described("value"))


# -- systems in other files --------------------------------------------------------------------------


def _real(name: str, value: float) -> str:
    return _parameter(name, f'<ssv:Real value="{value}"/>')


IN = '<ssd:Connectors><ssd:Connector name="in" kind="input"><ssc:Real unit="m"/></ssd:Connector></ssd:Connectors>'


def _nested(source: str, kind: str, extra: str = "") -> str:
    begin = f'<ssd:Component name="part" type="application/x-ssp-{kind}" source="{source}">'
    return f"{begin}{IN}{extra}</ssd:Component>"


def _inner() -> str:
    set_inside = _bound(_real("c.k", 1.0) + _real("c.l", 2.0), "")
    return minimal(IN + set_inside + elements(component("c")) + connections(wire("in", "c.u")))


def _with_inner(folder: Path, kind: str) -> Path:
    """Return a package with a in mm, connected to a system in a file of its own; a parameter of that is set outside."""
    c = fmu_bytes(
        folder, "c", inputs={"u": "m"}, outputs={"y": "m"}, parameters={"k": None, "l": None}, units=[Unit("m", LENGTH)]
    )
    extra = _bound(_real("c.k", 5.0), "")
    source = {"package": "resources/inner.ssp", "definition": "resources/sub/SystemStructure.ssd"}[kind]
    ssp = two(folder, minimal(elements(A, _nested(source, kind, extra)) + connections(wire("a.y", "part.in"))))
    with zipfile.ZipFile(ssp, "a") as archive:
        if kind == "package":
            files: dict[str, str | bytes] = {"SystemStructure.ssd": _inner(), "resources/c.fmu": c}
            archive.writestr("resources/inner.ssp", package(folder / "inner.ssp", files).read_bytes())
        else:
            archive.writestr("resources/sub/SystemStructure.ssd", _inner().replace("resources/c.fmu", "../c.fmu"))
            archive.writestr("resources/c.fmu", c)
    return ssp


@pytest.mark.parametrize("kind", ["package", "definition"])
def test_a_component_that_is_a_system_in_another_file(tmp_path: Path, kind: str) -> None:
    system = read_system(_with_inner(tmp_path, kind))
    assert [c.name for c in system.components] == ["a", "part.c"]
    inner = system.components[1]
    assert isinstance(inner, FmuComponent)
    assert inner.set == {"k": 5.0, "l": 2.0}  # what is bound outside counts
    assert inner.called.startswith(f"{system.source}/resources/")
    assert inner.called.endswith("inner.ssp/resources/c.fmu" if kind == "package" else "resources/c.fmu")
    (wired,) = resolve(system, variables_of(system)).wires
    assert wired.gain == pytest.approx(1e-3)
    assert Path(inner.file).exists()
    folder = system.folder
    assert folder is not None
    folder.close()
    assert not Path(inner.file).exists()


def test_a_system_that_holds_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "s.ssd").write_text(minimal(elements(_nested("s.ssd", "definition"))), encoding="utf-8")
    assert "more than 16 systems inside each other; does one hold itself?" in refusal(tmp_path / "s.ssd")


# -- other parts, other readers ----------------------------------------------------------------------


def test_parts_of_fmi_1_and_units_in_brackets(tmp_path: Path) -> None:
    needs_module("rumoca", "build")
    lag = build_fmi1(tmp_path, "FirstOrderLag", "cs").read_bytes()
    connectors = {"u": ("input", "[m3]"), "y": ("output", "[m3]")}
    ssd = minimal(
        '<ssd:Connectors><ssd:Connector name="r" kind="input"><ssc:Real unit="[m3]"/></ssd:Connector>'
        '<ssd:Connector name="q" kind="output"><ssc:Real unit="l"/></ssd:Connector></ssd:Connectors>'
        + elements(component("a", connectors), component("b", connectors))
        + connections(wire("r", "a.u"), wire("a.y", "b.u"), wire("b.y", "q")),
        '<ssd:Units><ssc:Unit name="[m3]"><ssc:BaseUnit m="3"/></ssc:Unit>'
        '<ssc:Unit name="l"><ssc:BaseUnit m="3" factor="0.001"/></ssc:Unit></ssd:Units>',
    )
    path = package(tmp_path / "p.ssp", {"SystemStructure.ssd": ssd, "resources/a.fmu": lag, "resources/b.fmu": lag})
    with open_description(read_system(path), Loading(step=0.01)) as model:
        result = simulate(model, stop=5.0, inputs={"r": Constant(1.0)}, outputs=["q"], interval=0.5)
    t = result.time
    exact = 1000.0 * (1.0 - (1.0 + t) * np.exp(-t))  # two lags of 1 s, in litres
    assert np.max(np.abs(result.signals["q"] - exact)) < 1000.0 * 0.01


def test_a_written_package_is_run_by_fmpy(tmp_path: Path) -> None:
    """FMPy steps every part with the outputs that the others had a step before: off by a step at each connection."""
    step = 0.005
    system = SystemDescription(
        name="lags",
        components=tuple(FmuComponent(name=n, file="fmu:FirstOrderLag", interface="cs") for n in ("a", "b")),
        connections=(Connection(source="a.y", destination="b.u"),),
        inputs={"u": ("a.u",)},
        outputs={"y": "b.y"},
    )
    write_ssp(system, tmp_path / "lags.ssp")
    theirs = fmpy_ssp.simulate_ssp(
        str(tmp_path / "lags.ssp"), stop_time=3.0, step_size=step, input={"u": lambda _: 1.0}
    )
    t = theirs["time"]
    exact = 1.0 - (1.0 + t) * np.exp(-t)
    assert np.max(np.abs(theirs["y"] - exact)) < 2.0 * step
    with open_description(read_system(tmp_path / "lags.ssp"), Loading(step=step)) as model:
        ours = simulate(model, stop=3.0, inputs={"u": Constant(1.0)}, outputs=["y"], interval=0.5)
    assert np.max(np.abs(ours.signals["y"] - np.interp(ours.time, t, theirs["y"]))) < 3.0 * step
