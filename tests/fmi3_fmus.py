"""FMUs of FMI 3.0 in C for what is new there, built for this machine: clocks, structural sizes, terminals."""

from __future__ import annotations

import zipfile
from pathlib import Path

from tests.stub_fmus import write_stub
from workbench.core.machine.files import pack
from workbench.fmi.bundled import bundled_path

__all__ = ["build_aliased", "build_sized", "build_ticking"]

_TICKING = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Ticking" instantiationToken="{token}">
  {interfaces}
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous" />
    <Float64 name="u" valueReference="1" causality="input" start="0" />
    <Float64 name="held" valueReference="2" causality="output" variability="discrete" clocks="100" />
    <Float64 name="x" valueReference="3" causality="output" initial="exact" start="0" />
    <Float64 name="der(x)" valueReference="4" causality="local" derivative="3" />
    <Float64 name="down_at" valueReference="5" causality="output" variability="discrete" clocks="101" />
    <Float64 name="grown_at" valueReference="6" causality="output" variability="discrete" clocks="102" />
    <Int32 name="evens" valueReference="20" causality="output" clocks="100" />
    <Int32 name="downs" valueReference="21" causality="output" clocks="101" />
    <Int32 name="grows" valueReference="22" causality="output" clocks="102" />
    <Clock name="even" valueReference="100" causality="input" intervalVariability="constant" intervalDecimal="0.1"
      shiftDecimal="0.05" />
    <Clock name="counted" valueReference="101" causality="input" intervalVariability="countdown" />
    <Clock name="growing" valueReference="102" causality="input" intervalVariability="changing" />
    <Clock name="every2" valueReference="103" causality="output" intervalVariability="triggered" clocks="100" />
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="2" /><Output valueReference="3" /><Output valueReference="5" />
    <Output valueReference="6" /><Output valueReference="20" /><Output valueReference="21" />
    <Output valueReference="22" /><Output valueReference="103" />
    <ContinuousStateDerivative valueReference="4" />
    <InitialUnknown valueReference="4" />
  </ModelStructure>
</fmiModelDescription>
"""

_EXCHANGE = """
  <ModelExchange modelIdentifier="ticking" canGetAndSetFMUState="{state}" />
  <CoSimulation modelIdentifier="ticking" canGetAndSetFMUState="{state}" hasEventMode="true"
    canHandleVariableCommunicationStepSize="true" />
"""

_SIZED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Sized" instantiationToken="{token}">
  <ModelExchange modelIdentifier="sized" canGetAndSetFMUState="true" providesDirectionalDerivatives="{forward}"
    providesAdjointDerivatives="{adjoint}" />
  <CoSimulation modelIdentifier="sized" canGetAndSetFMUState="true" {asks}
    canHandleVariableCommunicationStepSize="true" />
  <UnitDefinitions>
    <Unit name="rad"><BaseUnit rad="1" /><DisplayUnit name="deg" factor="57.29577951308232" /></Unit>
    <Unit name="K"><BaseUnit K="1" /><DisplayUnit name="degC" offset="-273.15" /></Unit>
  </UnitDefinitions>
  <TypeDefinitions>
    <EnumerationType name="Mode"><Item name="eco" value="1" /><Item name="sport" value="2" /></EnumerationType>
  </TypeDefinitions>
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous" />
    <UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed" start="2" min="1" max="8" />
    <Float64 name="a" valueReference="2" causality="parameter" variability="fixed" start="1 2">
      <Dimension valueReference="1" /></Float64>
    <Float64 name="x" valueReference="3" causality="local" initial="exact" start="0 0" unit="rad" displayUnit="deg">
      <Dimension valueReference="1" /></Float64>
    <Float64 name="der(x)" valueReference="4" causality="local" derivative="3">
      <Dimension valueReference="1" /></Float64>
    <Float64 name="u" valueReference="5" causality="input" start="0 0" unit="K" displayUnit="degC"
      intermediateUpdate="{between}">
      <Dimension valueReference="1" /></Float64>
    <Float64 name="sum" valueReference="6" causality="output" />
    <Enumeration name="mode" valueReference="7" causality="parameter" variability="fixed" declaredType="Mode"
      start="1" />
    <String name="label" valueReference="8" causality="parameter" variability="fixed">
      <Start value="as built" /></String>
    <Float64 name="y" valueReference="9" causality="{shown}"><Dimension valueReference="1" /></Float64>
    <Binary name="blob" valueReference="10" causality="parameter" variability="fixed"><Start value="00ff" /></Binary>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="6" />{listed}
    <ContinuousStateDerivative valueReference="4" />
    <InitialUnknown valueReference="4" /><InitialUnknown valueReference="6" />{initial}
  </ModelStructure>
</fmiModelDescription>
"""

TERMINALS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiTerminalsAndIcons fmiVersion="3.0">
  <Terminals>
    <Terminal name="drive" matchingRule="bus" terminalKind="test.bus" description="What drives it">
      <TerminalMemberVariable variableName="u[1]" memberName="first" variableKind="signal" />
      <TerminalMemberVariable variableName="u[2]" memberName="second" variableKind="signal" />
      <TerminalMemberVariable variableName="sum" memberName="total" variableKind="signal" />
    </Terminal>
    <Terminal name="shown" matchingRule="bus">
      <TerminalMemberVariable variableName="y[1]" memberName="first" variableKind="signal" />
      <TerminalMemberVariable variableName="y[2]" memberName="second" variableKind="signal" />
    </Terminal>
  </Terminals>
</fmiTerminalsAndIcons>
"""


def build_ticking(folder: Path, *, state: bool = True, behaviour: str = "ticking", scheduled: bool = False) -> Path:
    """Write ``folder/ticking.fmu`` (see tests/c/ticking/ticking.c).

    Args:
        folder: where.
        state: whether it saves its state.
        behaviour: "ticking", or "ticking-backwards": an interval is negative.
        scheduled: it offers scheduled execution alone.
    """
    offered = _EXCHANGE.format(state=str(state).lower())
    interfaces = '<ScheduledExecution modelIdentifier="ticking" />' if scheduled else offered
    description = _TICKING.format(token=behaviour, interfaces=interfaces)
    return write_stub(folder / "ticking.fmu", "ticking", description, fmi=3)


def build_sized(
    folder: Path,
    *,
    forward: bool = True,
    adjoint: bool = True,
    shown: bool = True,
    behaviour: str = "sized",
    between: bool = True,
    terminals: str = TERMINALS,
) -> Path:
    """Write ``folder/sized.fmu`` (see tests/c/sized/sized.c), with terminals.

    Args:
        folder: where.
        forward: whether it offers directional derivatives.
        adjoint: whether it offers adjoint ones.
        shown: whether y is an output.
        behaviour: "sized"; "sized-lies": adjoint derivatives are wrong; "sized-asks": it asks for inputs inside a step.
        between: whether its inputs may be set there.
        terminals: the file that has them.
    """
    description = _SIZED.format(
        forward=str(forward).lower(),
        adjoint=str(adjoint).lower(),
        token=behaviour,
        asks='providesIntermediateUpdate="true"' if behaviour == "sized-asks" else "",
        between=str(between).lower(),
        shown="output" if shown else "local",
        listed='<Output valueReference="9" />' if shown else "",
        initial='<InitialUnknown valueReference="9" />' if shown else "",
    )
    more = {"terminalsAndIcons/terminalsAndIcons.xml": terminals.encode()}
    return write_stub(folder / "sized.fmu", "sized", description, fmi=3, more=more)


def build_aliased(folder: Path) -> Path:
    """Write ``folder/Aliased.fmu``: 1/(tau s + 1) from u to y, whose variables have second names, as Dymola's have."""
    file = folder / "Aliased.fmu"
    with zipfile.ZipFile(bundled_path("fmu:FirstOrderLag@3")) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    lines = contents["modelDescription.xml"].decode().split("\n")
    for number, line in enumerate(lines):
        name = line.partition('<Float64 name="')[2].partition('"')[0]
        if name and name != "time":
            lines[number] = line.replace(" />", f'><Alias name="second.{name}" /></Float64>')
    pack(file, contents | {"modelDescription.xml": "\n".join(lines).encode()})
    return file
