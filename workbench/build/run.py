"""What becomes an FMU: what is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeGuard

from workbench.build.compile_fmu import CompiledFmu, add_binaries
from workbench.build.container import ContainerResult, export_container
from workbench.build.export import ExportResult, export_linear
from workbench.build.fmu import FMI_VERSIONS, BuiltModels, build_all, build_fmu
from workbench.build.references import add_references
from workbench.build.request import Build, Compile, Export
from workbench.build.result import SystemFile
from workbench.build.toolchain import require
from workbench.core.machine.files import named_path
from workbench.core.records.record import read_json
from workbench.errors import InputError
from workbench.identification.structures.request import STRUCTURES
from workbench.identification.structures.result import StructureResult
from workbench.jobs.job import Job
from workbench.model.described_model import DescribedModel
from workbench.requests.call import files_of
from workbench.requests.kept import remember
from workbench.requests.origin import Origin
from workbench.system.description import SystemDescription
from workbench.system.files.read import is_system_file
from workbench.system.files.ssp_write import write_ssp
from workbench.system.files.toml_write import write_toml
from workbench.system.recipe import SystemRecipe

__all__ = ["run_build", "run_compile", "run_export"]


def run_export(model: object, request: Export, job: Job) -> ExportResult | ContainerResult | SystemFile:
    """Write an FMU, or a model with static blocks as a system.

    Args:
        model: see `Export`.
        request: what to write.
        job: is told what takes long.

    Raises:
        InputError: an option that belongs to the other kind of model, or what the algorithms raise.
        BuildError: the compiler is missing or failed.
    """
    blocks = _with_blocks(model)
    if blocks is not None:
        return _system_file(blocks, request)
    if not _is_system(model):
        if request.step is not None:
            raise InputError("step is for systems; a linear model has its own")
        made = export_linear(
            model, request.out, fmi=request.fmi, name=request.name, platforms=request.platforms, stiff=request.stiff,
            job=job,
        )  # fmt: skip
        if request.reference_results:
            add_references(made.file)
        return made
    if request.step is None:
        raise InputError("step is needed for a system: the communication step between its parts, in seconds")
    if request.platforms is not None or request.stiff is not None:
        raise InputError("platforms and stiff are for linear models; a container has the binaries of its parts")
    if request.reference_results:
        raise InputError("reference_results is for models; what a container computes depends on its step")
    return export_container(model, request.out, step=request.step, fmi=request.fmi, name=request.name)


_WRITERS = {".toml": write_toml, ".ssp": write_ssp}


def _with_blocks(model: object) -> StructureResult | None:
    """Return a model with static blocks, also from its JSON file; None: it is something else."""
    if isinstance(model, StructureResult):
        return model
    if not isinstance(model, str | Path) or is_system_file(model) or named_path(model).suffix.lower() != ".json":
        return None
    data = read_json(model)
    is_structure = isinstance(data, dict) and data.get("structure") in STRUCTURES
    return StructureResult.read(model) if is_structure else None


def _system_file(blocks: StructureResult, request: Export) -> SystemFile:
    """Write a model with static blocks as a system."""
    target = named_path(request.out)
    write = _WRITERS.get(target.suffix.lower())
    if write is None:
        raise InputError(
            f"out: the model is a {blocks.structure} model, whose static blocks an FMU of a linear model cannot hold; "
            f"write it as a system: {target.with_suffix('.toml')} or {target.with_suffix('.ssp').name}"
        )
    for name in ("fmi", "step", "platforms", "stiff", "reference_results"):
        if getattr(request, name) != getattr(Export(target), name):
            raise InputError(f"{name} is for FMUs; leave it out for a system")
    system = blocks.to_system(request.name or target.stem)
    notes = write(system, target) or ()
    starts = ", ".join(f"{n} = {x:.6g}" for n, x in zip(blocks.linear.state_names, blocks.linear.x0, strict=True))
    where = (f"the linear block starts at the state of the first sample of its data: {starts}",) if starts else ()
    return SystemFile(
        model=system.name, file=target, structure=blocks.structure,
        components=tuple(component.name for component in system.components),
        inputs=tuple(system.inputs), outputs=tuple(system.outputs), dt=blocks.linear.dt,
        notes=(*where, "the disturbance is left out: a system has no noise input", *notes),
    )  # fmt: skip


def run_build(sources: Sequence[str | Path], request: Build, job: Job) -> BuiltModels:
    """Build Modelica models; see `Build`."""
    out, paths = named_path(request.out), [named_path(source) for source in sources]
    folder = out.suffix != ".fmu"
    if folder and request.model is not None:
        example = out / f"{request.model}.fmu"
        raise InputError(f"model: {out} is a folder, for all models; name the FMU to write, e.g. {example}")
    if not out.parent.is_dir():
        raise InputError(f"out: the folder '{out.parent}' does not exist")
    require("rumoca", "ziglang")
    how: dict[str, Any] = {"out": out, "platforms": request.platforms, "stiff": request.stiff}
    if folder:
        models = build_all(paths, fmi=FMI_VERSIONS if request.fmi is None else (request.fmi,), job=job, **how)
    else:
        models = [build_fmu(paths, model=request.model, fmi=request.fmi or 2, job=job, **how)]
    if request.reference_results:
        for file in BuiltModels(tuple(models)).files:
            add_references(file)
    read = (file for path in paths for file in (path.rglob("*.mo") if path.is_dir() else [path]))
    built = BuiltModels(tuple(models))
    remember(built, Origin(files=files_of(sorted(read))))
    return built


def run_compile(path: str | Path, request: Compile, job: Job) -> CompiledFmu:
    """Compile the sources of an FMU; see `Compile`."""
    made = add_binaries(path, request.out, request.platforms, job)
    remember(made, Origin(files=files_of([made.file])))
    return made


def _is_system(model: object) -> TypeGuard[DescribedModel | SystemDescription | str | Path]:
    if isinstance(model, str | Path):
        return is_system_file(model)
    if isinstance(model, DescribedModel):
        return isinstance(model.recipe, SystemRecipe)
    return isinstance(model, SystemDescription)
