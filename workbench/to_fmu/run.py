"""Linear models and systems as FMUs: what is done."""

from __future__ import annotations

from pathlib import Path
from typing import TypeGuard

from workbench.build.export import ExportResult, export_linear
from workbench.core.job import Job
from workbench.errors import InputError
from workbench.model.described import DescribedModel
from workbench.system.container import ContainerResult, export_container
from workbench.system.description import SystemDescription
from workbench.system.read import is_system_file
from workbench.system.recipe import SystemRecipe
from workbench.to_fmu.request import Export

__all__ = ["run_export"]


def run_export(model: object, asked: Export, _job: Job) -> ExportResult | ContainerResult:
    """Write an FMU.

    Args:
        model: see `Export`.
        asked: what to write.

    Raises:
        InputError: an option that belongs to the other kind of model, or what the algorithms raise.
        BuildError: the compiler is missing or failed.
    """
    if not _is_system(model):
        if asked.step is not None:
            raise InputError("step is for systems; a linear model has its own")
        return export_linear(
            model, asked.out, fmi=asked.fmi, name=asked.name, platforms=asked.platforms, stiff=asked.stiff
        )
    if asked.step is None:
        raise InputError("step is needed for a system: the communication step between its parts, in seconds")
    if asked.platforms is not None or asked.stiff is not None:
        raise InputError("platforms and stiff are for linear models; a container has the binaries of its parts")
    return export_container(model, asked.out, step=asked.step, fmi=asked.fmi, name=asked.name)


def _is_system(model: object) -> TypeGuard[DescribedModel | SystemDescription | str | Path]:
    if isinstance(model, str | Path):
        return is_system_file(model)
    if isinstance(model, DescribedModel):
        return isinstance(model.recipe, SystemRecipe)
    return isinstance(model, SystemDescription)
