"""A model with other parameters, as a system file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from workbench.fmi.bundled import name_of_bundled
from workbench.model import DescribedModel
from workbench.system.description import FmuComponent, SystemDescription
from workbench.system.files.ssp_write import write_ssp
from workbench.system.files.toml_write import write_toml
from workbench.system.parameters import with_values
from workbench.system.recipe import SystemRecipe

__all__ = ["system_of", "write_system_of"]

_NAME = "model"  # of the only component, where the model is an FMU


def write_system_of(model: DescribedModel, values: Mapping[str, float], path: Path) -> None:
    """Write a system file of the model with these parameters.

    Args:
        model: an FMU or a system.
        values: parameter → value.
        path: of the file, .toml or .ssp.

    Raises:
        InputError: the file cannot be written.
    """
    system = system_of(model, values)
    if path.suffix.lower() == ".ssp":
        write_ssp(system, path)
    else:
        write_toml(system, path)


def system_of(model: DescribedModel, values: Mapping[str, float]) -> SystemDescription:
    """Return the model as a system, an FMU as its only component.

    Args:
        model: an FMU or a system.
        values: parameter → value in place of its own.
    """
    if isinstance(model.recipe, SystemRecipe):
        return with_values(model.recipe.system, {**model.recipe.start_values, **values})
    path = Path(model.source).resolve()
    file = name_of_bundled(path) or str(path)
    part = FmuComponent(
        name=_NAME, file=file, interface=model.interface, set={**model.start_values, **values},
        step=model.recipe.step, solver=model.recipe.solver,
    )  # fmt: skip
    return SystemDescription(
        name=model.name, components=(part,), inputs={v.name: (f"{_NAME}.{v.name}",) for v in model.inputs},
        outputs={v.name: f"{_NAME}.{v.name}" for v in model.outputs},
    )  # fmt: skip
