"""FMPy's reader as the oracle of ours: the same facts of a description, in the same form."""

# ruff: noqa: ANN401 - FMPy's classes have no types
from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import fmpy.model_description as oracle
import numpy as np

from workbench.core.records.names_in_text import plain_unit
from workbench.fmi.description import ModelDescription

__all__ = ["by_fmpy", "by_us", "fmpy_refuses"]


def fmpy_refuses(path: Path) -> str:
    """Return the first rule that FMPy finds bent when it is strict; empty: none."""
    try:
        oracle.read_model_description(str(path))
    except oracle.ValidationError as error:
        return str(error.problems[0])
    except Exception as error:  # noqa: BLE001 - FMPy raises bare Exception for some rules
        return str(error) or "refused"
    return ""


def by_us(found: ModelDescription) -> dict[str, Any]:
    """Return facts of a description that the workbench has read."""
    return {
        "version": found.fmi_version,
        "name": found.model_name,
        "token": found.token,
        "tool": found.generation_tool,
        "text": found.description,
        "experiment": (
            found.experiment.start_time,
            found.experiment.stop_time,
            found.experiment.tolerance,
            found.experiment.step,
        ),
        "interfaces": {
            name: (
                *(c.identifier, c.state, c.directional_derivatives, c.interpolates_inputs, c.event_mode),
                *(c.completed_step, c.once_per_process, c.needs_tool),
            )
            for name, c in found.interfaces.items()
        },
        "states": [s.name for s in found.states],
        "derivatives": [d.name for d in found.derivatives],
        "counts": (found.state_count, found.indicator_count),
        "shapes": dict(found.shapes),
        "categories": found.log_categories,
        "units": {
            name: (
                *(None if u.exponents is None else tuple(u.exponents.values()), u.factor, u.offset),
                *((d.name, d.factor, d.offset) for d in u.display),
            )
            for name, u in found.units.items()
        },
        "variables": [
            (
                *(v.name, v.type, v.unit, v.start, v.description, v.causality, v.variability, v.minimum, v.maximum),
                *(v.nominal, v.value_reference, v.element, v.derivative_of, v.dependencies, v.initial, v.display_unit),
            )
            for v in found.variables
        ],
    }


def by_fmpy(path: Path) -> dict[str, Any]:
    """Return the same facts as FMPy reads them."""
    raw: Any = oracle.read_model_description(str(path), validate=False)
    depends = {
        u.variable.name: tuple(d.name for d in u.dependencies)
        for u in (*raw.outputs, *raw.derivatives)
        if u.dependencies is not None
    }
    variables = [s for v in raw.modelVariables for s in _scalars(v, depends)]
    by_name = {v[0]: v for v in variables}
    derivatives = [u.variable.name + i for u in raw.derivatives for i in _indices(u.variable)]
    experiment = raw.defaultExperiment
    given = ("startTime", "stopTime", "tolerance", "stepSize")
    return {
        "version": raw.fmiVersion,
        "name": raw.modelName,
        "token": raw.guid or "",
        "tool": raw.generationTool,
        "text": raw.description,
        "experiment": tuple(None if experiment is None else _number(getattr(experiment, n)) for n in given),
        "interfaces": {
            name: _claims(raw, name, element)
            for name, element in (("me", raw.modelExchange), ("cs", raw.coSimulation))
            if element is not None
        },
        "states": [by_name[d][12] or f"state[{n}]" for n, d in enumerate(derivatives, 1)],
        "derivatives": derivatives,
        "counts": (raw.numberOfContinuousStates, raw.numberOfEventIndicators),
        "shapes": {int(v.valueReference): tuple(v.shape) for v in raw.modelVariables if v.shape},
        "categories": tuple(c.name for c in raw.logCategories),
        "units": {plain_unit(u.name): _unit(u) for u in raw.unitDefinitions},
        "variables": variables,
    }


def _claims(raw: Any, name: str, element: Any) -> tuple[Any, ...]:
    cs, one, three = name == "cs", raw.fmiVersion == "1.0", raw.fmiVersion.startswith("3")
    return (
        element.modelIdentifier,
        element.canGetAndSetFMUstate,
        # FMPy reads FMI 2.0's spelling only.
        None if three else element.providesDirectionalDerivative,
        cs and not three and element.canInterpolateInputs,
        cs and element.hasEventMode,
        not cs and (one or element.needsCompletedIntegratorStep),
        element.canBeInstantiatedOnlyOncePerProcess,
        element.needsExecutionTool,
    )


def _unit(unit: Any) -> tuple[Any, ...]:
    shown = tuple((d.name, d.factor, d.offset) for d in unit.displayUnits)
    base = unit.baseUnit
    if base is None:
        return (None, 1.0, 0.0, *shown)
    exponents = tuple(getattr(base, name) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad"))
    return (exponents, base.factor, base.offset, *shown)


def _indices(raw: Any) -> list[str]:
    if not raw.shape:
        return [""]
    return ["[" + ",".join(str(i + 1) for i in index) + "]" for index in np.ndindex(raw.shape)]


def _scalars(raw: Any, depends: dict[str, tuple[str, ...]]) -> list[tuple[Any, ...]]:
    base = raw.declaredType
    indices = _indices(raw)
    starts = _starts(raw, len(indices))

    def told(name: str, attribute: Any) -> Any:
        return getattr(base, name, None) if attribute is None else attribute

    nominal = _number(told("nominal", raw.nominal))
    return [
        (
            raw.name + index,
            raw.type,
            plain_unit(told("unit", raw.unit or None) or "") or None,
            starts[n],
            raw.description,
            raw.causality,
            raw.variability,
            # FMPy reads no bounds of unsigned numbers.
            None if raw.type.startswith("UInt") else _number(told("min", raw.min)),
            None if raw.type.startswith("UInt") else _number(told("max", raw.max)),
            abs(nominal) if nominal else None,
            raw.valueReference,
            n,
            raw.derivative.name + index if hasattr(raw.derivative, "name") else None,
            depends.get(raw.name),
            raw.initial,
            told("displayUnit", raw.displayUnit),
        )
        for n, index in enumerate(indices)
    ]


def _number(text: Any) -> float | None:
    try:
        value = float(text)
    except (TypeError, ValueError):
        return None
    return value if math.isfinite(value) else None


def _starts(raw: Any, size: int) -> list[Any]:
    if raw.start is None:
        return [None] * size
    readers: dict[str, Any] = {"Boolean": lambda t: t in ("true", "1"), "String": str, "Binary": str}
    real = raw.type in ("Real", "Float32", "Float64", "Clock")
    read = readers.get(raw.type, float if real else int)
    texts = raw.start.split() if raw.shape and raw.type != "String" else [raw.start]
    values = [read(t) for t in texts]
    return values * size if len(values) == 1 else values
