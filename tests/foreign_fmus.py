"""FMUs with the manners of other exporters, built for this machine: what FMI allows, and not every importer expects."""

from __future__ import annotations

from pathlib import Path

from tests.stub_fmus import write_stub

__all__ = ["build_foreign", "build_shy"]


def _foreign_description(name: str, *, experiment: str, outputs: bool, states: bool, unit: str, y: str) -> str:
    kind = "output" if outputs else "local"
    listed = '<Outputs><Unknown index="4" /><Unknown index="5" /></Outputs>' if outputs else ""
    flags = 'modelIdentifier="foreign"'
    exchange = f"<ModelExchange {flags} />" if states else ""
    derivatives = '<Derivatives><Unknown index="3" /></Derivatives>' if states else ""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Foreign" guid="{{foreign-{name}}}" numberOfEventIndicators="0">
  {exchange}
  <CoSimulation {flags} canHandleVariableCommunicationStepSize="true" />
  <UnitDefinitions><Unit name="{unit}" /></UnitDefinitions>
  {experiment}
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input"><Real start="1" unit="{unit}" /></ScalarVariable>
    <ScalarVariable name="x" valueReference="1" causality="local" initial="exact"><Real start="0" /></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="2" causality="local"><Real derivative="2" /></ScalarVariable>
    <ScalarVariable name="{y}" valueReference="3" causality="{kind}"><Real unit="{unit}" /></ScalarVariable>
    <ScalarVariable name="clock" valueReference="4" causality="{kind}"><Real /></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    {listed}
    {derivatives}
    <InitialUnknowns><Unknown index="3" /></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def build_foreign(
    folder: Path,
    name: str = "plain",
    *,
    experiment: str = "",
    outputs: bool = True,
    states: bool = True,
    unit: str = "[m3]",
    y: str = "y[1,2]",
) -> Path:
    """Write ``folder/NAME.fmu`` of FMI 2.0: dx/dt = u − x from 0 under u = 1, y = x, clock = time.

    Args:
        folder: where.
        name: of a behaviour: "plain", "strict", "event" or "step" (see tests/c/foreign/foreign.c).
        experiment: its DefaultExperiment element.
        outputs: whether y and clock are declared as outputs.
        states: whether it offers Model Exchange and shows its state.
        unit: of u and y.
        y: name of y.
    """
    xml = _foreign_description(name, experiment=experiment, outputs=outputs, states=states, unit=unit, y=y)
    return write_stub(folder / f"{name}.fmu", "foreign", xml)


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
    """Write ``folder/NAME.fmu`` of FMI 3.0: "works", "instantiate", "update", "ends" or "lost" (tests/c/shy/shy.c)."""
    return write_stub(folder / f"{name}.fmu", "shy", _shy_description(name), fmi=3)
