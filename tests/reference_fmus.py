"""Small FMUs with one subject each, for FMI 1.0, 2.0 and 3.0, written for these tests: tests/c/reference2, reference3.

The subjects are those of the Reference FMUs of the Modelica Association that no other FMU of the tests has.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from functools import partial
from pathlib import Path

from tests.fmi1_fmus import describe
from tests.stub_fmus import stub_fmu
from workbench.core.machine.files import pack

__all__ = ["SUBJECTS", "build_reference"]

# Version of FMI → subjects. In FMI 1.0 Model Exchange is not told where its resources are.
SUBJECTS = {
    1: ("stair", "resource", "feedthrough"),
    2: ("stair", "resource", "feedthrough"),
    3: ("stair", "resource", "feedthrough", "space", "clocks"),
}

_EXPERIMENT = {"stair": 'startTime="0" stopTime="12" stepSize="0.25"', "clocks": 'startTime="0" stopTime="4"'}

# -- FMI 2.0 -----------------------------------------------------------------------------------------

_PASSED_ON = (
    ("real_continuous", "continuous", "Real", "0"),
    ("real_discrete", "discrete", "Real", "0"),
    ("integer", "discrete", "Integer", "0"),
    ("boolean", "discrete", "Boolean", "false"),
    ("string", "discrete", "String", "Set me!"),
    ("option", "discrete", "Enumeration", "1"),
)


def _variable(name: str, reference: int, causality: str, variability: str, kind: str, start: str | None) -> str:
    said = f' variability="{variability}"' if variability else ""
    value = f' start="{start}"' if start is not None else ""
    declared = ' declaredType="Option"' if kind == "Enumeration" else ""
    return (
        f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}"{said}>'
        f"<{kind}{value}{declared} /></ScalarVariable>"
    )


def _variables(subject: str) -> list[str]:
    if subject != "feedthrough":
        name = "counter" if subject == "stair" else "y"
        return [_variable(name, 1, "output", "discrete", "Integer", None)]
    found = []
    for i, (name, variability, kind, start) in enumerate(_PASSED_ON):
        found.append(_variable(f"{name}_input", 2 * i + 1, "input", variability, kind, start))
        found.append(_variable(f"{name}_output", 2 * i + 2, "output", variability, kind, None))
    found.append(_variable("fixed_parameter", 13, "parameter", "fixed", "Real", "0"))
    found.append(_variable("tunable_parameter", 14, "parameter", "tunable", "Real", "0"))
    return found


def _description_2(subject: str) -> str:
    variables = _variables(subject)
    unknowns = "".join(
        f'<Unknown index="{i}" {"dependencies=" + chr(34) + str(i - 1) + chr(34) if subject == "feedthrough" else ""}/>'
        for i, v in enumerate(variables, start=1)
        if 'causality="output"' in v
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{subject}" guid="{{reference-{subject}}}"
    generationTool="Tests of the workbench" numberOfEventIndicators="0">
  <ModelExchange modelIdentifier="reference2" />
  <CoSimulation modelIdentifier="reference2" canHandleVariableCommunicationStepSize="true" />
  <TypeDefinitions>
    <SimpleType name="Option">
      <Enumeration><Item name="first" value="1" /><Item name="second" value="2" /></Enumeration>
    </SimpleType>
  </TypeDefinitions>
  <DefaultExperiment {_EXPERIMENT.get(subject, 'startTime="0" stopTime="2"')} />
  <ModelVariables>{"".join(variables)}</ModelVariables>
  <ModelStructure>
    <Outputs>{unknowns}</Outputs>
    <InitialUnknowns>{unknowns}</InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def _description_1(subject: str, interface: str) -> bytes:
    """Return a description of FMI 1.0: without the enumeration, whose items it would have to declare."""
    text = _description_2(subject).replace("Enumeration", "Integer").replace(' declaredType="Option"', "")
    root = ET.fromstring(describe(text.encode(), "reference2", interface))  # noqa: S314  written by us
    root.set("modelName", subject)
    experiment = root.find("DefaultExperiment")
    assert experiment is not None
    experiment.set("stopTime", "12" if subject == "stair" else "2")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root)


# -- FMI 3.0 -----------------------------------------------------------------------------------------

_PASSED_ON_3 = (
    ("Float32_continuous", "continuous", "Float32"), ("Float32_discrete", "discrete", "Float32"),
    ("Float64_continuous", "continuous", "Float64"), ("Float64_discrete", "discrete", "Float64"),
    *((name, "discrete", name) for name in ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")),
    ("String", "discrete", "String"), ("Binary", "discrete", "Binary"), ("Boolean", "discrete", "Boolean"),
    ("Enumeration", "discrete", "Enumeration"),
)  # fmt: skip


def _feedthrough_3() -> tuple[str, str]:
    variables, structure = [], []
    for i, (name, variability, kind) in enumerate(_PASSED_ON_3):
        declared = ' declaredType="Option"' if kind == "Enumeration" else ""
        start = {"Boolean": ' start="false"', "Enumeration": ' start="1"'}.get(kind, ' start="0"')
        inner = {"String": '<Start value="Set me!" />', "Binary": '<Start value="666f6f" />'}.get(kind, "")
        common = f'variability="{variability}"{declared}'
        variables.append(
            f'<{kind} name="{name}_input" valueReference="{2 * i + 1}" causality="input" {common}'
            f"{'' if inner else start}>{inner}</{kind}>"
        )
        variables.append(f'<{kind} name="{name}_output" valueReference="{2 * i + 2}" causality="output" {common} />')
        structure.append(f'valueReference="{2 * i + 2}" dependencies="{2 * i + 1}" dependenciesKind="constant"')
    for reference, variability in ((33, "fixed"), (35, "tunable")):
        variables.append(
            f'<Float64 name="{variability}_parameter" valueReference="{reference}" causality="parameter"'
            f' variability="{variability}" start="0" />'
        )
    lines = [f"<Output {s} />" for s in structure] + [f"<InitialUnknown {s} />" for s in structure]
    return "".join(variables), "".join(lines)


_SPACE_ARRAYS = (
    ("A", 4, "nn", "parameter", "-1 2 -2 -1"), ("B", 5, "nm", "parameter", "1 0"), ("C", 6, "rn", "parameter", "0 1"),
    ("D", 7, "rm", "parameter", "0"), ("x0", 8, "n", "parameter", "0 0"), ("u", 9, "m", "input", "0"),
    ("y", 10, "r", "output", None), ("x", 11, "n", "local", None), ("der(x)", 12, "n", "local", None),
)  # fmt: skip
_SIZES = {"m": (1, 1), "n": (2, 2), "r": (3, 1)}


def _space_3() -> tuple[str, str]:
    variables = [
        f'<UInt64 name="{name}" valueReference="{reference}" causality="structuralParameter" variability="fixed"'
        f' start="{start}" min="0" max="5" />'
        for name, (reference, start) in _SIZES.items()
    ]
    for name, reference, shape, causality, start in _SPACE_ARRAYS:
        sizes = "".join(f'<Dimension valueReference="{_SIZES[letter][0]}" />' for letter in shape)
        more = f' start="{start}"' if start is not None else ""
        more += ' variability="tunable"' if causality == "parameter" else ""
        more += ' derivative="11"' if name == "der(x)" else ""
        variables.append(
            f'<Float64 name="{name}" valueReference="{reference}" causality="{causality}"{more}>{sizes}</Float64>'
        )
    structure = (
        '<Output valueReference="10" /><ContinuousStateDerivative valueReference="12" />'
        '<InitialUnknown valueReference="10" /><InitialUnknown valueReference="11" />'
        '<InitialUnknown valueReference="12" />'
    )
    return "".join(variables), structure


_CLOCKS_3 = (
    (
        '<Int32 name="ticks" valueReference="1" causality="output" variability="discrete" clocks="3" />'
        '<Int32 name="slower_ticks" valueReference="2" causality="output" variability="discrete" clocks="4" />'
        '<Clock name="every_second" valueReference="3" causality="input" intervalVariability="constant"'
        ' intervalDecimal="1.0" />'
        '<Clock name="now_and_then" valueReference="4" causality="input" intervalVariability="triggered" />'
    ),
    '<Output valueReference="1" /><Output valueReference="2" />',
)


def _one_output_3(name: str) -> tuple[str, str]:
    return (
        f'<Int32 name="{name}" valueReference="1" causality="output" variability="discrete" />',
        '<Output valueReference="1" /><InitialUnknown valueReference="1" />',
    )


_WRITTEN_3: dict[str, Callable[[], tuple[str, str]]] = {
    "stair": partial(_one_output_3, "counter"),
    "resource": partial(_one_output_3, "y"),
    "feedthrough": _feedthrough_3,
    "space": _space_3,
    "clocks": lambda: _CLOCKS_3,
}


def _description_3(subject: str) -> str:
    variables, structure = _WRITTEN_3[subject]()
    saves = 'canGetAndSetFMUState="true"'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{subject}" instantiationToken="{{reference-{subject}}}"
    generationTool="Tests of the workbench">
  <ModelExchange modelIdentifier="reference3" {saves} />
  <CoSimulation modelIdentifier="reference3" {saves} canHandleVariableCommunicationStepSize="true"
                canReturnEarlyAfterIntermediateUpdate="true" hasEventMode="true" />
  <TypeDefinitions>
    <EnumerationType name="Option"><Item name="first" value="1" /><Item name="second" value="2" /></EnumerationType>
  </TypeDefinitions>
  <DefaultExperiment {_EXPERIMENT.get(subject, 'startTime="0" stopTime="2"')} />
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous" />
    {variables}
  </ModelVariables>
  <ModelStructure>{structure}</ModelStructure>
</fmiModelDescription>
"""


def build_reference(folder: Path, subject: str, fmi: int, interface: str = "") -> Path:
    """Write an FMU of one of `SUBJECTS`.

    Args:
        folder: where.
        subject: of that version.
        fmi: 1, 2 or 3.
        interface: "me" or "cs": FMI 1.0 has one in an FMU.
    """
    text = {1: lambda: _description_1(subject, interface), 2: lambda: _description_2(subject).encode()}.get(
        fmi, lambda: _description_3(subject).encode()
    )()
    file = folder / f"{subject}{fmi}{interface}.fmu"
    library = "reference3" if fmi == 3 else "reference2"
    resources = {"resources/y.txt": b"a"} if subject == "resource" else {}
    pack(file, {"modelDescription.xml": text, **stub_fmu(library, fmi, interface), **resources})
    return file
