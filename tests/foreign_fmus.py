"""FMUs with the manners of other exporters, built for this machine: what FMI allows, and not every importer expects."""

from __future__ import annotations

from pathlib import Path

from tests.stub_fmus import stub_library
from workbench.build.pack import pack
from workbench.toolchain import host_only

__all__ = ["build_shy"]


def _shy_description(name: str) -> str:
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Shy" instantiationToken="{{shy-{name}}}">
  <CoSimulation modelIdentifier="shy" hasEventMode="true" canHandleVariableCommunicationStepSize="true" />
  <DefaultExperiment startTime="0" stopTime="2" stepSize="0.01" />
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous" />
    <Float64 name="u" valueReference="1" causality="input" start="1" />
    <Float64 name="x" valueReference="2" causality="local" initial="exact" start="0" />
    <Float64 name="y" valueReference="3" causality="output" />
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="3" />
    <InitialUnknown valueReference="3" />
  </ModelStructure>
</fmiModelDescription>
"""


def build_shy(folder: Path, name: str) -> Path:
    """Write ``folder/NAME.fmu`` of FMI 3.0: "works", "instantiate", "update" or "ends" (see tests/c/shy/shy.c)."""
    (host,) = host_only()
    file = folder / f"{name}.fmu"
    binary = f"binaries/{host.name}/shy{host.suffix}"
    pack(file, {"modelDescription.xml": _shy_description(name).encode(), binary: stub_library("shy")})
    return file
