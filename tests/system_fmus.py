"""FMUs without binaries: a description only, for what reads no more than that."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from workbench.core.values.conversion import BASE_UNITS, Unit


def description_of(
    *,
    inputs: Mapping[str, str | None] | None = None,
    outputs: Mapping[str, str | None] | None = None,
    parameters: Mapping[str, str | None] | None = None,
    units: Sequence[Unit] = (),
    types: str = "",
    others: str = "",
) -> str:
    """Return an FMI 2.0 description; variables are name → unit, `types` and `others` raw XML."""
    groups = (("input", inputs or {}), ("output", outputs or {}), ("parameter", parameters or {}))
    variables = "".join(
        _variable(reference, name, causality, unit)
        for reference, (causality, name, unit) in enumerate(
            (causality, name, unit) for causality, group in groups for name, unit in group.items()
        )
    )
    first = len(inputs or {}) + 1
    known = "".join(f'<Unknown index="{first + k}"/>' for k in range(len(outputs or {})))
    structure = f"<ModelStructure>{f'<Outputs>{known}</Outputs>' if known else ''}</ModelStructure>"
    defined = f"<UnitDefinitions>{''.join(map(_unit, units))}</UnitDefinitions>" if units else ""
    return (
        '<fmiModelDescription fmiVersion="2.0" modelName="Plain" guid="{0}">'
        '<ModelExchange modelIdentifier="Plain"/><CoSimulation modelIdentifier="Plain"/>'
        f"{defined}{f'<TypeDefinitions>{types}</TypeDefinitions>' if types else ''}"
        f"<ModelVariables>{variables}{others}</ModelVariables>{structure}</fmiModelDescription>"
    )


def _variable(reference: int, name: str, causality: str, unit: str | None) -> str:
    attributes = {
        "input": 'causality="input"',
        "output": 'causality="output"',
        "parameter": 'causality="parameter" variability="fixed"',
    }[causality]
    start = "" if causality == "output" else ' start="0"'
    said = f' unit="{unit}"' if unit else ""
    return (
        f'<ScalarVariable name="{name}" valueReference="{reference}" {attributes}><Real{start}{said}/></ScalarVariable>'
    )


def _unit(unit: Unit) -> str:
    powers = " ".join(f'{b}="{e}"' for b, e in zip(BASE_UNITS, unit.exponents, strict=True) if e)
    return f'<Unit name="{unit.name}"><BaseUnit {powers} factor="{unit.factor!r}" offset="{unit.offset!r}"/></Unit>'


def plain_fmu(
    path: Path,
    *,
    inputs: Mapping[str, str | None] | None = None,
    outputs: Mapping[str, str | None] | None = None,
    parameters: Mapping[str, str | None] | None = None,
    units: Sequence[Unit] = (),
    types: str = "",
    others: str = "",
) -> None:
    """Write such an FMU."""
    text = description_of(
        inputs=inputs, outputs=outputs, parameters=parameters, units=units, types=types, others=others
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", text)
