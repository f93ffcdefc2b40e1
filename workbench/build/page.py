"""The pages of what was built or exported."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from workbench.build.compile_fmu import CompiledFmu
from workbench.build.container import ContainerResult
from workbench.build.export import ExportResult
from workbench.build.fmu import BuildResult, BuiltModels
from workbench.build.result import SystemFile
from workbench.errors import WorkbenchError
from workbench.requests.model_facts import hash_of
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted

__all__ = ["build_page", "built_page", "compiled_page", "container_page", "export_page", "system_file_page"]


def build_page(result: BuildResult) -> Page:
    """Return the page of a model that was built."""
    return built_page(BuiltModels((result,)))


def built_page(result: BuiltModels) -> Page:
    """Return the page of models that were built in one call."""
    rows = [
        (r.model, str(r.n_states), "implicit" if r.stiff else "explicit", ", ".join(f.name for f in r.files))
        for r in result.models
    ]
    headings = ("model", "states", "co-simulation integrates", "files")
    return Page(
        title=f"FMUs of {', '.join(r.model for r in result.models)}",
        lead=f"{counted(len(result.files), 'FMU')} for {', '.join(result.platforms)}.",
        facts={},
        sections=[Section("Models", tables=[PageTable(headings, rows)]), _files(result.files)],
        kind="build",
    )


def compiled_page(result: CompiledFmu) -> Page:
    """Return the page of an FMU whose sources were compiled."""
    what = f"{counted(len(result.sources), 'source file')} compiled for {', '.join(result.platforms)}"
    return Page(
        title=f"{result.model} compiled",
        lead=f"FMI {result.fmi}: {what}.",
        facts={"new binaries": ", ".join(result.binaries)},
        sections=[_files([result.file])],
        notes=result.notes,
        kind="build",
    )


def export_page(result: ExportResult) -> Page:
    """Return the page of a linear model that became an FMU."""
    kind = f"discrete, sampled at {result.dt:.9g} s" if result.dt > 0.0 else "continuous"
    sizes = (counted(result.n_states, "state"), counted(result.n_inputs, "input"), counted(result.n_outputs, "output"))
    renamed = [f"{old} is {new} in the FMU" for old, new in result.renamed.items()]
    return Page(
        title=f"Linear model {result.model} as an FMU",
        lead=f"FMI {result.fmi}, {kind}: {', '.join(sizes)}.",
        facts={
            "platforms": ", ".join(result.platforms),
            "co-simulation integrates": "with the implicit method" if result.stiff else "with the explicit method",
        },
        sections=[_files([result.file]), *([Section("Renamed", items=renamed)] if renamed else [])],
        notes=result.notes,
        kind="build",
    )


def container_page(result: ContainerResult) -> Page:
    """Return the page of a system that became one FMU."""
    return Page(
        title=f"System {result.model} as a container FMU",
        lead=f"FMI {result.fmi}, stepped by {result.step:g} s: every connection carries a delay of one step.",
        facts={
            "parts": ", ".join(result.components),
            "inputs": ", ".join(result.inputs) or "none",
            "outputs": ", ".join(result.outputs) or "none",
            "parameters": str(len(result.parameters)),
        },
        sections=[_files([result.file])],
        notes=result.notes,
        kind="build",
    )


def system_file_page(result: SystemFile) -> Page:
    """Return the page of a model with static blocks that became a system."""
    return Page(
        title=f"Model {result.model} as a system",
        lead=f"A {result.structure} model, its linear part sampled at {result.dt:.9g} s.",
        facts={
            "parts": ", ".join(result.components),
            "inputs": ", ".join(result.inputs),
            "outputs": ", ".join(result.outputs),
        },
        sections=[_files([result.file])],
        notes=result.notes,
        kind="build",
    )


def _files(files: Sequence[Path]) -> Section:
    rows = [(file.name, _size(file), _hash(file)) for file in files]
    return Section("Files", tables=[PageTable(("file", "size [KiB]", "SHA-256"), rows, right=(1,))])


def _size(file: Path) -> str:
    return f"{file.stat().st_size / 1024:.0f}" if file.exists() else "gone"


def _hash(file: Path) -> str:
    try:
        return hash_of(file)
    except WorkbenchError:  # moved since it was written
        return "gone"
