"""FMUs of FMI 1.0, built for this machine from Modelica and the C runtime: no registry has real ones.

The wrappers tests/c/fmi1*.c translate to the runtime's FMI 2.0 functions.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import fmpy

from workbench.build.fmu import Sources, _kept, generate
from workbench.build.toolchain import compile_all, host_only
from workbench.core.machine.files import pack

HERE = Path(__file__).parent
MODELS = {
    "FirstOrderLag": HERE.parent / "modelica_src" / "FirstOrderLag" / "FirstOrderLag.mo",
    "Hybrid": HERE / "modelica" / "Hybrid.mo",
}
# FMI 2.0 causality and variability → FMI 1.0's.
_CAUSALITY = {"input": "input", "output": "output"}
_VARIABILITY = {"constant": "constant", "fixed": "parameter", "tunable": "parameter", "discrete": "discrete"}
_CAPABILITIES = {"canHandleVariableCommunicationStepSize": "true", "canInterpolateInputs": "true"}


def build_fmi1(folder: Path, model: str, interface: str) -> Path:
    """Build one of MODELS, or of tests/modelica, as ``folder/NAME_me.fmu`` or ``folder/NAME_cs.fmu``."""
    sources = generate(MODELS.get(model, HERE / "modelica" / f"{model}.mo"), model)
    (host,) = host_only()
    target = folder / f"{model}_{interface}.fmu"
    # The runtime where the builder keeps it: the compiler knows by the path that it has compiled these files before.
    runtime = _kept({name: data for name, data in sources.c_files.items() if name != "model.c"})
    with tempfile.TemporaryDirectory() as temporary:
        code = Path(temporary) / "sources"
        code.mkdir()
        own = {"model.c", "fmi1_values.c", f"fmi1_{interface}.c"}
        compiled = [str(code / name) if name in own else name for name in write_sources(code, sources, interface)]
        library = compile_all(runtime, compiled, [host], Path(temporary) / "lib", model)[host.name].read_bytes()
    binary = f"binaries/{host.name_2}/{sources.identifier}{host.suffix}"
    pack(target, {"modelDescription.xml": describe(sources.descriptions[2], model, interface), binary: library})
    return target


def write_sources(folder: Path, sources: Sources, interface: str) -> list[str]:
    """Write all C files; return those to be compiled."""
    for name, contents in sources.c_files.items():
        (folder / name).write_bytes(contents)
    added = ["fmi1_values.c", f"fmi1_{interface}.c"]
    for name in ["fmi1.h", *added]:
        (folder / name).write_bytes((HERE / "c" / name).read_bytes())
    header = Path(fmpy.__file__).parent / "c-code" / "fmi1Functions.h"
    (folder / header.name).write_bytes(header.read_bytes())
    (folder / "identifier.h").write_text(f"#define MODEL_IDENTIFIER {sources.identifier}\n")
    return [*(name for name in sources.compiled if not name.startswith("fmi3")), *added]


def describe(version_2: bytes, model: str, interface: str) -> bytes:
    """Translate a model description of FMI 2.0."""
    old = ET.fromstring(version_2)  # noqa: S314  written by us
    states = sum(1 for e in old.iter("Real") if e.get("derivative"))
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": "1.0",
            "modelName": model,
            "modelIdentifier": model,
            "guid": old.attrib["guid"],
            "numberOfContinuousStates": str(states),
            "numberOfEventIndicators": old.attrib["numberOfEventIndicators"],
        },
    )
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0.0"})
    variables = ET.SubElement(root, "ModelVariables")
    for variable in old.iter("ScalarVariable"):
        if variable.get("causality") != "independent":
            _variable(variables, variable)
    if interface == "cs":
        stand_alone = ET.SubElement(ET.SubElement(root, "Implementation"), "CoSimulation_StandAlone")
        ET.SubElement(stand_alone, "Capabilities", _CAPABILITIES)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root)


def _variable(parent: ET.Element, old: ET.Element) -> None:
    new = ET.SubElement(
        parent,
        "ScalarVariable",
        {
            "name": old.attrib["name"],
            "valueReference": old.attrib["valueReference"],
            "causality": _CAUSALITY.get(old.attrib["causality"], "internal"),
            "variability": _VARIABILITY.get(old.attrib["variability"], "continuous"),
        },
    )
    (typed,) = old
    kept = {k: v for k, v in typed.attrib.items() if k in ("start", "min", "max", "nominal")}
    ET.SubElement(new, typed.tag, kept)
