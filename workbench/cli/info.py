"""`workbench info`: what an FMU or a system is and can do."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workbench.cli.options import Json, ModelName, Report
from workbench.cli.table import variable_dict, variable_table

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.analysis.snapshots import Snapshots
    from workbench.fmi.archive import Unpacked
    from workbench.fmi.description import Description
    from workbench.fmi.variable import Variable
    from workbench.origin import Origin
    from workbench.report import Page

__all__ = ["info"]


def info(
    model: ModelName,
    probe: Annotated[
        bool, typer.Option("--probe/--no-probe", help="Try in a worker process whether the FMU's saved state works.")
    ] = True,
    json_path: Json = None,
    report: Report = None,
) -> None:
    """Show what an FMU is and can do: interfaces, platforms, variables; of a system: components and connections.

    Example: `workbench info fmu:Rudder`
    """
    from workbench.cli.notes import note
    from workbench.cli.output import Output
    from workbench.system.read import is_system_file

    if is_system_file(model):
        from workbench.cli.info_system import info_system

        info_system(model, Output("info", json_path=json_path, report=report))
        return
    from workbench.fmi.archive import locate, unpack
    from workbench.fmi.description import read_description

    out = Output("info", json_path=json_path, report=report)
    path = locate(model)
    with unpack(path) as unpacked:
        description = read_description(unpacked.folder, source=str(path))
        runnable = [i for i, c in description.interfaces.items() if _runs(unpacked.folder, c.identifier)]
        snapshots = _snapshots(unpacked, description, runnable) if probe and runnable else {}
    for text in description.notes:
        note(text)
    out.console.print(_facts(description, runnable, snapshots))
    for title, variables in _groups(description).items():
        if variables:
            out.console.print(variable_table(title, variables))
    told = _to_dict(description, runnable, snapshots)
    out.write(told, page=lambda: _page(told), origin=_origin(path, description))


def _page(told: dict[str, Any]) -> Page:
    from workbench.report.info import info_page

    return info_page(told)


def _origin(path: Path, description: Description) -> Origin:
    """Return which FMU it is; none of its interfaces was chosen."""
    from workbench.origin import ModelFacts, Origin
    from workbench.origin.models import fmu_facts

    return Origin(models=(ModelFacts(name=description.model_name, fmus=(fmu_facts(path, description, ""),)),))


def _runs(folder: Any, identifier: str) -> bool:  # noqa: ANN401 - a path; typed where it is used
    from workbench.errors import FmuError
    from workbench.fmi.platforms import binary_path

    try:
        binary_path(folder, identifier, source="")
    except FmuError:
        return False
    return True


def _snapshots(unpacked: Unpacked, description: Description, interfaces: list[str]) -> dict[str, Snapshots]:
    """How snapshots are taken with each interface that runs here."""
    from concurrent.futures import ThreadPoolExecutor
    from importlib import import_module

    from workbench.analysis.snapshots import probe_snapshots
    from workbench.model.load import FmuRecipe

    recipe = FmuRecipe(
        source=str(unpacked.source),
        folder=str(unpacked.folder),
        owned=unpacked.owned,
        interface=interfaces[0],
        solver="auto",
    )
    with ThreadPoolExecutor(1) as thread:
        thread.submit(import_module, "rich.table")  # needed next; loaded while the worker starts
        return probe_snapshots(recipe, description.interfaces, interfaces)  # here, where Ctrl-C ends it


def _groups(description: Description) -> dict[str, tuple[Variable, ...]]:
    def having(causality: str) -> tuple[Variable, ...]:
        return tuple(v for v in description.variables if v.causality == causality)

    return {
        "inputs": having("input"),
        "outputs": having("output"),
        "states": description.states,
        "parameters": having("parameter"),
    }


def _to_dict(description: Description, runnable: list[str], snapshots: dict[str, Snapshots]) -> dict[str, Any]:
    return {
        "model": description.model_name,
        "description": description.description,
        "fmi_version": description.fmi_version,
        "generation_tool": description.generation_tool,
        "interfaces": sorted(description.interfaces),
        "platforms": list(description.platforms),
        "runnable": bool(runnable),
        **{name: [variable_dict(v) for v in group] for name, group in _groups(description).items()},
        "capabilities": {
            name: {**asdict(c), "snapshots": asdict(snapshots[name]) if name in snapshots else None}
            for name, c in description.interfaces.items()
        },
        "experiment": asdict(description.experiment),
        "notes": list(description.notes),
    }


def _facts(description: Description, runnable: list[str], snapshots: dict[str, Snapshots]) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table.grid(padding=(0, 2))
    abilities = {"state": "get/set state", "directional_derivatives": "directional derivatives"}
    for name, value in {
        "model": description.model_name,
        "description": description.description,
        "FMI": f"{description.fmi_version} ({', '.join(sorted(description.interfaces)) or 'no interface'})",
        "made by": description.generation_tool,
        "platforms": ", ".join(description.platforms) or "none",
        "runs here": ", ".join(sorted(runnable)) or "no",
        "can": ", ".join(
            f"{text} ({name})"
            for name, c in sorted(description.interfaces.items())
            for key, text in abilities.items()
            if getattr(c, key)
        ),
        "snapshots": "; ".join(f"{name}: {_how(s)}" for name, s in sorted(snapshots.items())),
    }.items():
        if value:
            table.add_row(name, escape(str(value)))
    return table


def _how(snapshots: Snapshots) -> str:
    return snapshots.method if not snapshots.why else f"{snapshots.method} ({snapshots.why})"
