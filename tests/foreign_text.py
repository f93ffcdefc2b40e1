"""An FMU whose names, units and descriptions command terminals, spreadsheets and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

from tests.stub_fmus import write_stub

__all__ = ["NAMES", "SYSTEM", "build_commanding"]

# XML cannot hold ESC; U+009B does the same. Then a change of direction, a line of its own, formulas of two programs.
NAMES = {
    "u": "@cmd|calc!A1\x9b31m",
    "x": "$x_a\x85workbench: all is well$ $b",
    "dx": "der(\u202e$x_a$)",
    "y": "-y\u2066$\\frac$\nnote: a line of its own",
    "clock": "=SUM\x7f\u2028[red]<script>alert(1)</script>[/]",
}
UNIT = "m\x9b2J\u202e$"
DESCRIPTION = "\x9b31mred\n\u202e<img src=x onerror=alert(1)> $a_1$"

SYSTEM = "plant\u202e"


def _quoted(text: str) -> str:
    return quoteattr(text, {"\n": "&#10;", "\x85": "&#133;", "\u2028": "&#8232;"})


def build_commanding(
    folder: Path, names: Mapping[str, str] = NAMES, unit_name: str = UNIT, description: str = DESCRIPTION
) -> Path:
    """Write ``folder/commanding.fmu``: dx/dt = u − x, y = x, clock = time."""
    name = {key: _quoted(text) for key, text in names.items()}
    unit, says = _quoted(unit_name), _quoted(description)
    flags = 'modelIdentifier="foreign"'
    xml = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName={says} guid="{{foreign-plain}}" numberOfEventIndicators="0"
    description={says} generationTool={says} author={says} version={says}>
  <ModelExchange {flags} />
  <CoSimulation {flags} canHandleVariableCommunicationStepSize="true" />
  <UnitDefinitions><Unit name={unit} /></UnitDefinitions>
  <ModelVariables>
    <ScalarVariable name={name["u"]} valueReference="0" causality="input" description={says}>
      <Real start="1" unit={unit} /></ScalarVariable>
    <ScalarVariable name={name["x"]} valueReference="1" causality="local" initial="exact" description={says}>
      <Real start="0" /></ScalarVariable>
    <ScalarVariable name={name["dx"]} valueReference="2" causality="local"><Real derivative="2" /></ScalarVariable>
    <ScalarVariable name={name["y"]} valueReference="3" causality="output" description={says}>
      <Real unit={unit} /></ScalarVariable>
    <ScalarVariable name={name["clock"]} valueReference="4" causality="output"><Real /></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="4" /><Unknown index="5" /></Outputs>
    <Derivatives><Unknown index="3" /></Derivatives>
    <InitialUnknowns><Unknown index="3" /></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""
    return write_stub(folder / "commanding.fmu", "foreign", xml)
