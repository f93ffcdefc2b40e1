"""SSP packages as OMSimulator and others write them, made by hand."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.system_fmus import plain_fmu
from workbench.core.values.conversion import Unit
from workbench.errors import WorkbenchError
from workbench.fmi.bundled import bundled_path
from workbench.fmi.variable import Variable
from workbench.system.description import (
    FmuComponent,
    SystemDescription,
)
from workbench.system.files.read import read_system
from workbench.system.files.ssp_blocks import block_variables
from workbench.system.fmu_facts import fmu_facts

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
