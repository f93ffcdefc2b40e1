"""A system as a container FMU: FMPy's container steps the parts' FMUs and hands values over between steps."""

# ruff: noqa: ANN401 - FMPy's classes have no types
from __future__ import annotations

import copy
import hashlib
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fmpy.model_description import CoSimulation, DefaultExperiment, ModelDescription, ModelVariable, Unknown

from workbench.build.container_parts import ContainerPart, container_part, container_wires, word
from workbench.build.container_variables import ContainerVariable, shown_units, shown_variables
from workbench.build.fmu import FMI_VERSIONS
from workbench.core.machine.files import file_to_write, pack
from workbench.core.machine.scratch import scratch
from workbench.errors import InputError
from workbench.fmi.variable import Value
from workbench.fmi.wiring import Wire
from workbench.model.described_model import DescribedModel
from workbench.requests.decorator import with_origin
from workbench.show.result import Result
from workbench.system.connection_checks import resolve
from workbench.system.description import Resolved, SystemDescription
from workbench.system.files.read import read_system
from workbench.system.recipe import SystemRecipe

__all__ = ["ContainerResult", "export_container"]


@dataclass(frozen=True)
class ContainerResult(Result):
    """What was exported.

    Attributes:
        model: name of the system.
        file: the FMU.
        fmi: FMI version, 2 or 3.
        step: communication step between the parts [s].
        components: names of the parts.
        inputs, outputs, parameters: names of the container's variables.
        notes: remarks, one line each.
    """

    _page = "workbench.build.page:container_page"

    model: str
    file: Path
    fmi: int
    step: float
    components: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a container", "build"

    def derived(self) -> Mapping[str, Any]:
        """Return what other records have, too.

        Keys:
            interface, solver: `cs` of a container, `null` otherwise; `null`.
        """
        return {"interface": "cs", "solver": None}


@with_origin()
def export_container(
    system: DescribedModel | SystemDescription | str | Path,
    path: str | Path,
    *,
    step: float,
    fmi: int = 2,
    name: str | None = None,
) -> ContainerResult:
    """Write a system of FMUs as one co-simulation FMU, through FMPy's container.

    A container makes a step of every part with the inputs that stood at the step's begin and then hands the outputs
    over: every connection carries a delay of one step, which the system itself has not (as model exchange). The
    container therefore comes near the system's result in proportion to the step; halve the step to see how far it is.
    Parts are integrated by the solvers that their FMUs bring. Not for systems whose result depends on exact timing,
    nor for loops that a delay of one step makes unstable.

    A container adds up its steps; FMUs that refuse to go beyond a stop time may refuse the last one where the sum ends
    above it by rounding. Powers of two, such as 1/1024 s, add up exactly.

    The parameters of the parts are the container's, as "component.parameter".

    Args:
        system: FMUs that offer co-simulation of FMI 2.0 or 3.0, connected without gain, offset, unit conversion or
            closing time; a model, a description, or a system file.
        path: the .fmu to write.
        step: communication step [s].
        fmi: FMI version of the container, 2 or 3.
        name: name of the container; None: that of the system.

    Raises:
        InputError: the container cannot express the system; the message names the component or connection and the
            reason.
        FmuError: an FMU's description is damaged.

    Examples:
        >>> parts = {"a": "fmu:FirstOrderLag", "b": "fmu:FirstOrderLag"}
        >>> system = wb.connect(parts, [("a.y", "b.u")], inputs=["a.u"], outputs=["b.y"])
        >>> with system:
        ...     container = wb.export_container(system, "lags.fmu", step=1 / 64)
        >>> with wb.load("lags.fmu") as model:
        ...     print(model.interface)
        cs
    """
    target = file_to_write(path, ".fmu")
    if not 0.0 < step < math.inf:
        raise InputError(f"step: {step:g} is not a positive number [s]")
    if fmi not in FMI_VERSIONS:
        raise InputError(f"FMI {fmi} cannot be written; choose 2 or 3")
    _check_fmpy()
    description, starts = _told(system)
    description = replace(description, name=name or description.name)
    own, of_parts = _sorted_starts(description, starts)
    parts = [container_part(c, of_parts.get(c.name, {}), step=step) for c in description.components]
    _check_together(parts)
    resolved = resolve(description, [tuple(p.variables.values()) for p in parts])
    wires, notes = container_wires(parts, resolved)
    shown = shown_variables(parts, resolved, own, fmi=fmi)
    plan = _ContainerPlan(description, tuple(parts), tuple(wires), tuple(shown), step, fmi)
    _write(plan, target)
    return _result(plan, resolved, target, notes)


def _check_fmpy() -> None:
    """Raise an InputError if the installed FMPy is older than its container."""
    from importlib.util import find_spec  # noqa: PLC0415

    if find_spec("fmpy.container_fmu") is None:
        raise InputError("this version of FMPy cannot write containers; upgrade it: pip install --upgrade fmpy")


# -- what the system is -----------------------------------------------------------------------


def _told(system: DescribedModel | SystemDescription | str | Path) -> tuple[SystemDescription, Mapping[str, Value]]:
    """Return the system's description and the start values that it was loaded with."""
    if isinstance(system, SystemDescription):
        return system, {}
    if isinstance(system, str | Path):
        return read_system(system), {}
    recipe = system.recipe
    if not isinstance(recipe, SystemRecipe):
        raise InputError(f"{system.name} is not a connected system; a container is made of several FMUs")
    if recipe.bias:
        raise InputError(f"input {next(iter(recipe.bias))}: a container cannot have a bias")
    return recipe.system, recipe.start_values


def _sorted_starts(
    description: SystemDescription, starts: Mapping[str, Value]
) -> tuple[dict[str, Value], dict[str, dict[str, Value]]]:
    """Return the start values of the system's inputs, and those of each component by its FMU's names."""
    own: dict[str, Value] = {}
    of_parts: dict[str, dict[str, Value]] = {}
    names = sorted((c.name for c in description.components), key=len, reverse=True)
    for full, value in starts.items():
        part = next((n for n in names if full.startswith(f"{n}.")), None)
        if full in description.inputs or part is None:
            own[full] = value
        else:
            of_parts.setdefault(part, {})[full.removeprefix(f"{part}.")] = value
    return own, of_parts


def _check_together(parts: Sequence[ContainerPart]) -> None:
    """Refuse two instances of an FMU of which one process takes one only."""
    first: dict[Path, str] = {}
    for part in parts:
        if part.stepping.canBeInstantiatedOnlyOncePerProcess and part.path in first:
            raise InputError(
                f"component {part.name}: one process takes one instance of its FMU, and {first[part.path]} is another"
            )
        first.setdefault(part.path, part.name)


# -- writing ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _ContainerPlan:
    description: SystemDescription
    parts: tuple[ContainerPart, ...]
    wires: tuple[Wire, ...]
    shown: tuple[ContainerVariable, ...]
    step: float
    fmi: int


def _write(plan: _ContainerPlan, target: Path) -> None:
    from fmpy.container_fmu.cli import create_container_fmu  # noqa: PLC0415  older versions have none

    with scratch("container") as folder:
        staged = _stage(plan.parts, folder / "fmus")
        unpacked = folder / "container"
        unpacked.mkdir()
        create_container_fmu(_configuration(plan, staged), unpacked, folder / "container.fmu")
        # FMPy packs a zip into itself and dates it; this one depends on the contents only.
        (unpacked / "Container.zip").unlink(missing_ok=True)
        _pack(unpacked, target)


def _stage(parts: Sequence[ContainerPart], folder: Path) -> dict[Path, Path]:
    """Copy every FMU into a folder, under names that differ: the container unpacks each by its name."""
    folder.mkdir()
    staged: dict[Path, Path] = {}
    for part in parts:
        if part.path not in staged:
            place = folder / f"{len(staged) + 1}_{part.stepping.modelIdentifier}.fmu"
            staged[part.path] = place
            if part.path.is_dir():
                shutil.move(shutil.make_archive(str(place), "zip", root_dir=part.path), place)
            else:
                shutil.copyfile(part.path, place)
    return staged


def _configuration(plan: _ContainerPlan, staged: Mapping[Path, Path]) -> Any:
    from fmpy.container_fmu.config import Component, Configuration, Connection  # noqa: PLC0415  as in _write

    components = [Component(p.name, staged[p.path], p.described) for p in plan.parts]
    return Configuration(
        parallelDoStep=False,
        modelDescription=_model_description(plan),
        components=components,
        connections=[
            Connection(
                components[w.from_component],
                [_connector(plan.parts[w.from_component], w.source.name)],
                components[w.to_component],
                [_connector(plan.parts[w.to_component], w.destination.name)],
            )
            for w in plan.wires
        ],
        variableMappings={
            s.variable: [(components[p.component], plan.parts[p.component].shown[p.variable.name]) for p in s.ports]
            for s in plan.shown
        },
    )


def _connector(part: ContainerPart, name: str) -> Any:
    """Return FMPy's variable with the word that the container's configuration has for its type."""
    made = copy.copy(part.shown[name])
    made.type = word(part, part.variables[name])
    return made


def _model_description(plan: _ContainerPlan) -> Any:
    stop = plan.description.default_experiment.stop_time
    stops = [float(e.stopTime) for p in plan.parts if (e := p.described.defaultExperiment) and e.stopTime]
    last = stop if stop is not None else max(stops, default=None)
    kind = "Real" if plan.fmi == 2 else "Float64"
    # The container gives the value reference 0 to time and counts the others from 1, in their order.
    time = ModelVariable(name="time", type=kind, causality="independent", variability="continuous")
    outputs = [s.variable for s in plan.shown if s.variable.causality == "output"]
    return ModelDescription(
        fmiVersion=f"{plan.fmi}.0",
        modelName=plan.description.name,
        instantiationToken=_token(plan),
        generationTool="FMI workbench, with FMPy's container",
        description=f"connected FMUs, handing values over every {plan.step:.9g} s",
        defaultExperiment=DefaultExperiment(stopTime=None if last is None else repr(last), stepSize=repr(plan.step)),
        coSimulation=CoSimulation(
            fixedInternalStepSize=plan.step,
            needsExecutionTool=any(p.stepping.needsExecutionTool for p in plan.parts),
            canBeInstantiatedOnlyOncePerProcess=any(p.stepping.canBeInstantiatedOnlyOncePerProcess for p in plan.parts),
        ),
        unitDefinitions=shown_units(plan.parts, plan.shown),
        modelVariables=[time, *(s.variable for s in plan.shown)],
        outputs=[Unknown(variable=v) for v in outputs],
        initialUnknowns=[Unknown(variable=v) for v in outputs],
    )


def _token(plan: _ContainerPlan) -> str:
    """Return an identifier that depends on what the container consists of only."""
    words = [plan.fmi, plan.step, plan.description.name]
    words += [(p.name, p.described.instantiationToken) for p in plan.parts]
    words += [(w.from_component, w.source.name, w.to_component, w.destination.name) for w in plan.wires]
    words += [
        (s.variable.name, s.variable.start, [(p.component, p.variable.name) for p in s.ports]) for s in plan.shown
    ]
    return f"{{{hashlib.sha256(repr(words).encode()).hexdigest()[:32]}}}"


def _pack(folder: Path, target: Path) -> None:
    """Write an unpacked FMU as a file."""
    pack(target, {f.relative_to(folder).as_posix(): f.read_bytes() for f in folder.rglob("*") if f.is_file()})


# -- what is told -----------------------------------------------------------------------------


def _result(plan: _ContainerPlan, resolved: Resolved, target: Path, notes: Sequence[str]) -> ContainerResult:
    names = {
        kind: tuple(s.variable.name for s in plan.shown if s.variable.causality == kind)
        for kind in ("input", "output", "parameter")
    }
    return ContainerResult(
        model=plan.description.name,
        file=target,
        fmi=plan.fmi,
        step=plan.step,
        components=tuple(p.name for p in plan.parts),
        inputs=names["input"],
        outputs=names["output"],
        parameters=names["parameter"],
        notes=(*plan.description.notes, *resolved.notes, *notes, *_delay(plan)),
    )


def _delay(plan: _ContainerPlan) -> list[str]:
    step = f"{plan.step:.9g} s"
    said = [
        f"communication step {step}: the importing tool must step the container by multiples of it",
        "the parts are integrated by the solvers that their FMUs bring for co-simulation",
    ]
    if plan.wires:
        said.append(
            f"a container steps its parts one after the other by {step} with their inputs held: each of the "
            f"{len(plan.wires)} connections carries a delay of one step, which the system as one set of equations "
            "(model exchange) does not have; halve the step to see its effect"
        )
    return said
