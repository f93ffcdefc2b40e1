"""Read what an FMU or a system says of itself, and try how the FMU's state is saved."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from workbench.core.machine.cycles import undisturbed
from workbench.errors import FmuError
from workbench.fmi.archive import Unpacked, locate, unpack
from workbench.fmi.description import DisplayUnit, ModelDescription
from workbench.fmi.platforms import binary_path
from workbench.fmi.reading import read_description
from workbench.fmi.structure import STRUCTURAL
from workbench.fmi.ticking import time_based
from workbench.fmi.variable import Variable
from workbench.health.info.request import Info
from workbench.health.info.result import (
    ClockFacts,
    FmuInfo,
    InterfaceFacts,
    SystemInfo,
    VariableFacts,
)
from workbench.health.info.snapshots import Snapshots, probe_snapshots
from workbench.health.references.declared import references_in
from workbench.jobs.job import Job
from workbench.jobs.options import Limits
from workbench.model.load import FmuRecipe
from workbench.requests.kept import remember
from workbench.requests.model_facts import fmu_facts
from workbench.requests.origin import ModelFacts, Origin
from workbench.system.files.read import is_system_file

__all__ = ["run"]


def run(path: str | Path, request: Info, job: Job) -> FmuInfo | SystemInfo:
    """Read an FMU or a system; see `Info`."""
    if is_system_file(path):
        from workbench.health.info.system import system_info  # noqa: PLC0415 - an FMU needs nothing of it

        return system_info(path)
    with undisturbed():
        return _fmu(path, request, job)


def _fmu(path: str | Path, request: Info, job: Job) -> FmuInfo:
    source = locate(path)
    with unpack(source) as unpacked:
        result = read_description(unpacked.folder, source=str(source))
        references, remarks = references_in(unpacked.folder)
        remarks = (*remarks, *(r.problem for r in references if r.problem))
        reasons = {i: _why_not(unpacked.folder, c.identifier, source) for i, c in result.interfaces.items()}
        runs = [i for i, reason in reasons.items() if not reason]
        probed = _probed(unpacked, runs, request.place.limits, job) if request.probe and runs else {}
        snapshots = {i: found for i, found in probed.items() if isinstance(found, Snapshots)}
        reasons |= {i: f"{source}: {found}" for i, found in probed.items() if isinstance(found, str)}
        runs = [i for i in runs if not reasons[i]]

    def having(causality: str) -> tuple[VariableFacts, ...]:
        return VariableFacts.of(v for v in result.variables if v.causality == causality and v.type != "Clock")

    shown = ("input", "output", "parameter", STRUCTURAL)
    listed = [*result.states, *(v for v in result.variables if v.causality in shown)]
    record = FmuInfo(
        model=result.model_name,
        description=result.description,
        fmi_version=result.fmi_version,
        generation_tool=result.generation_tool,
        interfaces=tuple(sorted(result.interfaces)),
        platforms=tuple(result.platforms),
        runnable=bool(runs),
        runs_here=tuple(sorted(runs)),
        inputs=having("input"),
        outputs=having("output"),
        states=VariableFacts.of(result.states),
        parameters=having("parameter"),
        capabilities={name: InterfaceFacts(c, snapshots.get(name)) for name, c in result.interfaces.items()},
        experiment=result.experiment,
        notes=(*result.notes, *remarks, *dict.fromkeys(filter(None, reasons.values()))),
        structural_parameters=having(STRUCTURAL),
        scheduled_execution=result.scheduled is not None,
        clocks=_clocks(result),
        terminals=result.terminals,
        enumerations={v.name: items for v in listed if (items := result.enumerations.get(v.declared_type or ""))},
        display_units=_display_units(listed, result),
        reference_results=references,
    )
    facts = ModelFacts(name=result.model_name, fmus=(fmu_facts(source, result, ""),))  # no interface was chosen
    remember(record, Origin(models=(facts,)))
    return record


def _display_units(variables: Iterable[Variable], described: ModelDescription) -> dict[str, DisplayUnit]:
    """Return variable → the unit in which it is to be shown."""
    shown = ((v, described.units.get(v.unit or "")) for v in variables if v.display_unit)
    return {v.name: d for v, unit in shown if unit is not None for d in unit.display if d.name == v.display_unit}


def _clocks(described: ModelDescription) -> tuple[ClockFacts, ...]:
    """Return the clocks; they tick in event mode, so not in every interface."""
    here = any(name == "me" or claims.event_mode for name, claims in described.interfaces.items())
    driven = time_based(described.clocks)
    return tuple(
        ClockFacts(
            name=name,
            kind=clock.kind,
            causality=clock.causality,
            interval=clock.interval,
            shift=clock.shift,
            driven=here and name in driven,
            variables=tuple(v for v, clocks in described.clocked.items() if name in clocks),
        )
        for name, clock in described.clocks.items()
    )


def _why_not(folder: Path, identifier: str, source: Path) -> str:
    """Return why an interface does not run here; empty: it does."""
    try:
        binary_path(folder, identifier, source=str(source))
    except FmuError as error:
        return str(error)
    return ""


def _probed(unpacked: Unpacked, interfaces: Sequence[str], limits: Limits, job: Job) -> dict[str, Snapshots | str]:
    """Return how snapshots are taken with each interface that has a binary, or why that cannot be loaded."""
    recipe = FmuRecipe(
        source=str(unpacked.source),
        folder=str(unpacked.folder),
        interface=interfaces[0],
        solver="auto",
    )
    return probe_snapshots(recipe, interfaces, limits, job)
