"""Write modelDescription.xml for FMI 2.0.4 and FMI 3.0.2, and FMI 3's buildDescription.xml."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

from workbench.build.causalise import Assignment
from workbench.build.emit_tables import indicator_references, initial, remembering, variability
from workbench.build.scalar_model import ScalarModel, ScalarVariable
from workbench.build.structure import dependencies, of_variable
from workbench.build.units import base_unit


@dataclass(frozen=True, slots=True)
class BuiltExperiment:
    """FMI's default experiment [s]."""

    stop_time: float | None
    tolerance: float
    interval: float | None


@dataclass(frozen=True, slots=True)
class ModelDescriptionParts:
    """All that both model descriptions are written from."""

    model: ScalarModel
    order: Sequence[Assignment]
    token: str
    tool: str
    experiment: BuiltExperiment
    sources: Sequence[str]
    naming: str = "structured"  # FMI's variable naming convention

    @property
    def identifier(self) -> str:
        """Return the model identifier: the model's name as a C identifier."""
        return self.model.name.replace(".", "_")


LOG_CATEGORIES = {
    "logEvents": "Events of Co-Simulation and information from the model",
    "logStatusWarning": "A value outside its declared range and the like",
    "logStatusDiscard": "An evaluation that failed and may succeed with other values",
    "logStatusError": "Why a call returned an error",
    "logAll": "All messages",
}

_FMI2_TYPES = {"real": "Real", "integer": "Integer", "boolean": "Boolean", "enumeration": "Enumeration"}
_FMI3_TYPES = {"real": "Float64", "integer": "Int32", "boolean": "Boolean", "enumeration": "Enumeration"}
_CAUSALITY = {"time": "independent", "input": "input", "parameter": "parameter", "calculated": "calculatedParameter"}


def model_description_2(description: ModelDescriptionParts) -> bytes:
    """Return FMI 2.0's modelDescription.xml."""
    model = description.model
    root = _root(description, "2.0", {"guid": description.token})
    root.set("numberOfEventIndicators", str(model.n_indicators))
    common = {
        "modelIdentifier": description.identifier,
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
    }
    exchange = ET.SubElement(
        root, "ModelExchange", {**common, "completedIntegratorStepNotNeeded": _flag(not model.delays)}
    )
    slave = ET.SubElement(
        root,
        "CoSimulation",
        {
            **common,
            "canHandleVariableCommunicationStepSize": "true",
            "canInterpolateInputs": "true",
            "maxOutputDerivativeOrder": "1",
        },
    )
    for interface in (exchange, slave):
        files = ET.SubElement(interface, "SourceFiles")
        for name in description.sources:
            ET.SubElement(files, "File", {"name": name})
    _variables(root, description, fmi=2)
    _structure_2(root, description)
    return _bytes(root)


def model_description_3(description: ModelDescriptionParts) -> bytes:
    """Return FMI 3.0's modelDescription.xml."""
    model = description.model
    root = _root(description, "3.0", {"instantiationToken": description.token})
    common = {
        "modelIdentifier": description.identifier,
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
    }
    ET.SubElement(root, "ModelExchange", {**common, "needsCompletedIntegratorStep": _flag(bool(model.delays))})
    ET.SubElement(
        root,
        "CoSimulation",
        {
            **common,
            "canHandleVariableCommunicationStepSize": "true",
            "maxOutputDerivativeOrder": "1",
            "providesIntermediateUpdate": "true",
            "mightReturnEarlyFromDoStep": "true",
            "canReturnEarlyAfterIntermediateUpdate": "true",
            "hasEventMode": "true",
        },
    )
    variables = _variables(root, description, fmi=3)
    _indicators_3(variables, model)
    _structure_3(root, description)
    return _bytes(root)


def build_description(description: ModelDescriptionParts) -> bytes:
    """Return FMI 3.0's sources/buildDescription.xml."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": description.identifier})
    files = ET.SubElement(configuration, "SourceFileSet", {"language": "C11"})
    for name in description.sources:
        ET.SubElement(files, "SourceFile", {"name": name})
    return _bytes(root)


# Parts that both versions share


def _flag(value: bool) -> str:  # noqa: FBT001 - all that it is about
    return "true" if value else "false"


def _root(description: ModelDescriptionParts, version: str, token: dict[str, str]) -> ET.Element:
    attributes = {"fmiVersion": version, "modelName": description.model.name, **token}
    if description.model.description:
        attributes["description"] = description.model.description
    attributes["generationTool"] = description.tool
    attributes["variableNamingConvention"] = description.naming
    return ET.Element("fmiModelDescription", attributes)


def _definitions(root: ET.Element, model: ScalarModel) -> None:
    is_3 = root.get("fmiVersion") == "3.0"
    units = sorted({v.unit for v in model.variables if v.unit})
    if units:
        definitions = ET.SubElement(root, "UnitDefinitions")
        for unit in units:
            element = ET.SubElement(definitions, "Unit", {"name": unit})
            base = base_unit(unit)
            if base is not None:
                ET.SubElement(element, "BaseUnit", base)
    types = sorted({v.literals for v in model.variables if v.type == "enumeration"})
    if types:
        definitions = ET.SubElement(root, "TypeDefinitions")
        for number, literals in enumerate(types):
            parent = definitions
            if not is_3:
                parent = ET.SubElement(definitions, "SimpleType", {"name": f"Enumeration{number + 1}"})
            own = {"name": f"Enumeration{number + 1}"} if is_3 else {}
            element = ET.SubElement(parent, "EnumerationType" if is_3 else "Enumeration", own)
            for value, literal in enumerate(literals, start=1):
                ET.SubElement(element, "Item", {"name": literal, "value": str(value)})
    categories = ET.SubElement(root, "LogCategories")
    for name, text in LOG_CATEGORIES.items():
        ET.SubElement(categories, "Category", {"name": name, "description": text})


def _enumeration_name(model: ScalarModel, variable: ScalarVariable) -> str:
    types = sorted({v.literals for v in model.variables if v.type == "enumeration"})
    return f"Enumeration{types.index(variable.literals) + 1}"


def _default_experiment(root: ET.Element, experiment: BuiltExperiment) -> None:
    attributes = {"startTime": "0", "tolerance": repr(experiment.tolerance)}
    if experiment.stop_time is not None:
        attributes["stopTime"] = repr(experiment.stop_time)
    if experiment.interval is not None:
        attributes["stepSize"] = repr(experiment.interval)
    ET.SubElement(root, "DefaultExperiment", attributes)


def _number(variable_type: str, value: float) -> str:
    if variable_type == "real":
        return repr(float(value))
    if variable_type == "boolean":
        return "true" if value else "false"
    return str(int(value))


def _causality(variable: ScalarVariable) -> str:
    return "output" if variable.output else _CAUSALITY.get(variable.kind, "local")


def _facts(variable: ScalarVariable) -> dict[str, str]:
    """Return unit and bounds, which both versions write alike."""
    facts: dict[str, str] = {}
    if variable.type == "boolean":
        return facts
    if variable.unit and variable.type == "real":
        facts["unit"] = variable.unit
    for name, value in (("min", variable.minimum), ("max", variable.maximum)):
        if value is not None:
            facts[name] = _number(variable.type, value)
    if variable.nominal is not None and variable.type == "real":
        facts["nominal"] = _number("real", variable.nominal)
    return facts


def _start(model: ScalarModel, variable: ScalarVariable, kind: str) -> dict[str, str]:
    value = model.graph.value(variable.start)
    if (kind == "exact" or variable.kind == "input") and value is not None:
        return {"start": _number(variable.type, value)}
    return {}


def _reinitialised(model: ScalarModel, reference: int) -> bool:
    return any(a.kind == "reinit" and a.state == reference for a in model.actions)


def _initial_unknowns(model: ScalarModel) -> list[int]:
    """Return the value references of outputs, derivatives, states and parameters that are calculated."""
    remember = remembering(model)
    return [
        reference
        for reference, v in enumerate(model.variables)
        if initial(model, v, remembers=reference in remember) == "calculated"
        and (v.output or v.kind in {"derivative", "state", "calculated"})
    ]


def _variables(root: ET.Element, description: ModelDescriptionParts, *, fmi: int) -> ET.Element:
    """Add definitions, default experiment and variables; return the element of the last."""
    model = description.model
    _definitions(root, model)
    _default_experiment(root, description.experiment)
    variables = ET.SubElement(root, "ModelVariables")
    remember = remembering(model)
    for reference, variable in enumerate(model.variables):
        _variable(variables, model, reference, variable, remembers=reference in remember, fmi=fmi)
    return variables


def _variable(
    parent: ET.Element, model: ScalarModel, reference: int, variable: ScalarVariable, *, remembers: bool, fmi: int
) -> None:
    head = {"name": variable.name, "valueReference": str(reference)}
    if variable.description:
        head["description"] = variable.description
    kind = initial(model, variable, remembers=remembers)
    head |= {"causality": _causality(variable), "variability": variability(variable)}
    if kind != "none":
        head["initial"] = kind
    declared = {"declaredType": _enumeration_name(model, variable)} if variable.type == "enumeration" else {}
    typed = _facts(variable) | _start(model, variable, kind)
    last = {}
    if variable.derivative_of is not None:
        last["derivative"] = str(variable.derivative_of + (1 if fmi == 2 else 0))
    if variable.kind == "state" and _reinitialised(model, reference):
        last["reinit"] = "true"
    if fmi == 2:
        element = ET.SubElement(parent, "ScalarVariable", head)
        ET.SubElement(element, _FMI2_TYPES[variable.type], typed | declared | last)
    else:
        ET.SubElement(parent, _FMI3_TYPES[variable.type], head | declared | typed | last)


# FMI 2.0


def _structure_2(root: ET.Element, description: ModelDescriptionParts) -> None:
    model = description.model
    result = dependencies(model, description.order)
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [r for r, v in enumerate(model.variables) if v.output]
    derivatives = _of_states(model)
    for tag, references in (("Outputs", outputs), ("Derivatives", derivatives)):
        if references:
            group = ET.SubElement(structure, tag)
            for reference in references:
                needed = of_variable(model, result, reference)
                attributes = {"index": str(reference + 1), "dependencies": " ".join(str(r + 1) for r in needed)}
                if needed:
                    attributes["dependenciesKind"] = " ".join(["dependent"] * len(needed))
                ET.SubElement(group, "Unknown", attributes)
    unknowns = _initial_unknowns(model)
    if unknowns:
        group = ET.SubElement(structure, "InitialUnknowns")
        for reference in unknowns:
            ET.SubElement(group, "Unknown", {"index": str(reference + 1)})


# FMI 3.0


def _indicators_3(parent: ET.Element, model: ScalarModel) -> None:
    for number in range(model.n_indicators):
        ET.SubElement(
            parent,
            "Float64",
            {
                "name": f"event_indicator[{number + 1}]",
                "valueReference": str(len(model.variables) + number),
                "causality": "local",
                "variability": "continuous",
                "initial": "calculated",
            },
        )


def _structure_3(root: ET.Element, description: ModelDescriptionParts) -> None:
    model = description.model
    result = dependencies(model, description.order)
    structure = ET.SubElement(root, "ModelStructure")

    def unknown(tag: str, reference: int, needed: Sequence[int]) -> None:
        attributes = {"valueReference": str(reference), "dependencies": " ".join(map(str, needed))}
        if needed:
            attributes["dependenciesKind"] = " ".join(["dependent"] * len(needed))
        ET.SubElement(structure, tag, attributes)

    for reference, variable in enumerate(model.variables):
        if variable.output:
            unknown("Output", reference, of_variable(model, result, reference))
    for derivative in _of_states(model):
        unknown("ContinuousStateDerivative", derivative, of_variable(model, result, derivative))
    for reference in _initial_unknowns(model):
        ET.SubElement(structure, "InitialUnknown", {"valueReference": str(reference)})
    for key, reference in indicator_references(model).items():
        for offset in range(2 if key[0] == "quotient" else 1):
            unknown("EventIndicator", reference + offset, sorted(result.get(key, frozenset())))


def _bytes(root: ET.Element) -> bytes:
    ET.indent(root)
    text = str(ET.tostring(root, encoding="unicode"))
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _of_states(model: ScalarModel) -> list[int]:
    """Return the derivatives in the order of the states."""
    known = model.derivatives
    return [known[s] for s in model.states]
