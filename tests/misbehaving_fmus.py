"""An FMU that misbehaves in one call of FMI 2.0, in one of many ways; see tests/c/misbehaving."""

from __future__ import annotations

from pathlib import Path

from tests.stub_fmus import write_stub

__all__ = ["CALLS", "OUTSIDE", "WAYS", "build_misbehaving"]

WAYS = (
    "segfault", "abort", "exit0", "exit3", "hang", "nan", "events", "memory", "stdout", "descriptors", "thread", "cwd",
    "rounding", "_arithmetic", "_flush", "_traps", "_comma", "_data", "_stack", "_size", "_space", "_few", "_cpu",
)  # fmt: skip

# Where it can happen: interface → calls. "load" and "unload" take what they do from the environment (MISBEHAVES).
_BOTH = (
    "instantiate", "setupExperiment", "enterInitialization", "exitInitialization", "getReal", "setReal", "getFMUstate",
    "terminate", "freeInstance",
)  # fmt: skip
CALLS = {
    "me": (
        *_BOTH, "enterEventMode", "newDiscreteStates", "enterContinuousTime", "setTime", "setContinuousStates",
        "getContinuousStates", "getDerivatives", "getEventIndicators", "completedIntegratorStep",
    ),
    "cs": (*_BOTH, "doStep"),
}  # fmt: skip
OUTSIDE = ("load", "unload")

_XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Misbehaving" guid="{guid}" numberOfEventIndicators="1">
  <ModelExchange modelIdentifier="misbehaving" canGetAndSetFMUstate="true" />
  <CoSimulation modelIdentifier="misbehaving" canGetAndSetFMUstate="true"
                canHandleVariableCommunicationStepSize="true" />
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.01" />
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input"><Real start="1" /></ScalarVariable>
    <ScalarVariable name="x" valueReference="1" causality="local" initial="exact"><Real start="0" /></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="2" causality="local"><Real derivative="2" /></ScalarVariable>
    <ScalarVariable name="y" valueReference="3" causality="output"><Real /></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="4" /></Outputs>
    <Derivatives><Unknown index="3" /></Derivatives>
    <InitialUnknowns><Unknown index="3" /><Unknown index="4" /></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def build_misbehaving(folder: Path, way: str, call: str) -> Path:
    """Write ``folder/WAY-CALL.fmu``."""
    return write_stub(folder / f"{way}-{call}.fmu", "misbehaving", _XML.format(guid=f"{{{way}@{call}}}"))
