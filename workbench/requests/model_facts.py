"""What a report tells about a model: its FMUs with their hashes and tools, and the settings."""

from __future__ import annotations

import weakref
from dataclasses import replace
from pathlib import Path

from workbench.errors import WorkbenchError
from workbench.fmi.bundled import name_of_bundled
from workbench.fmi.description import ModelDescription
from workbench.fmi.reading import described_at
from workbench.model.base import Model
from workbench.model.content_hash import hash_of
from workbench.model.described_model import DescribedModel, LoadRecipe
from workbench.model.load import FmuRecipe
from workbench.model.loading import DEFAULT_TOLERANCE
from workbench.requests.origin import FmuOrigin, ModelFacts
from workbench.system.description import Component, FmuComponent
from workbench.system.recipe import SystemRecipe

__all__ = ["facts_of", "fmu_facts", "hash_of"]

# A model's facts are fixed when it is made; an analysis may be called thousands of times on it.
_KNOWN: weakref.WeakKeyDictionary[Model, ModelFacts] = weakref.WeakKeyDictionary()


def facts_of(model: Model) -> ModelFacts:
    """Return what is known about a model."""
    if model not in _KNOWN:
        _KNOWN[model] = _facts_of(model)
    return _KNOWN[model]


def _facts_of(model: Model) -> ModelFacts:
    recipe = model.recipe
    if not isinstance(model, DescribedModel) or not isinstance(recipe, LoadRecipe):
        return ModelFacts(name=model.name, interface=model.interface, solver=model.solver, notes=model.notes)
    components = recipe.system.components if isinstance(recipe, SystemRecipe) else ()
    return ModelFacts(
        name=model.name,
        source=_source(recipe),
        interface=model.interface,
        solver=model.solver,
        tolerance=_tolerance(model, recipe),
        step=recipe.step or model.grid,
        start_values=dict(recipe.start_values),
        defaults={
            v.name: v.start
            for v in model.description.variables
            if v.name in recipe.start_values and v.start is not None
        },
        bias=dict(recipe.bias),
        fmus=_fmus(model, recipe),
        blocks={c.name: type(c).__name__.removesuffix("Component").lower() for c in components if not _is_fmu(c)},
        notes=model.notes,
    )


def _is_fmu(component: Component) -> bool:
    return isinstance(component, FmuComponent)


def _source(recipe: LoadRecipe) -> str:
    """Return what `load` takes: what is bundled by its name, another by its file's name alone."""
    path = Path(recipe.source)
    return name_of_bundled(path) or (path.name if path.exists() else "")


def _tolerance(model: DescribedModel, recipe: LoadRecipe) -> float | None:
    own = model.description.experiment.tolerance
    if model.interface == "cs":
        return recipe.tolerance or own
    return recipe.tolerance or (own if isinstance(recipe, SystemRecipe) else None) or DEFAULT_TOLERANCE


# -- FMUs --------------------------------------------------------------------------------------


def fmu_facts(path: Path, description: ModelDescription, interface: str) -> FmuOrigin:
    """Return what is known about one FMU.

    Args:
        path: of the file or folder.
        description: what the FMU says of itself.
        interface: "me" or "cs"; empty where none was chosen.
    """
    return FmuOrigin(
        component="",
        model=description.model_name,
        file=path.name,
        sha256=_hash_or_none(path),
        fmi_version=description.fmi_version,
        generation_tool=description.generation_tool or "",
        interface=interface,
    )


def _fmus(model: DescribedModel, recipe: LoadRecipe) -> tuple[FmuOrigin, ...]:
    if isinstance(recipe, SystemRecipe):
        return tuple(_part(name, part, model.interface) for name, part in recipe.parts.items())
    path = recipe.path if isinstance(recipe, FmuRecipe) else Path(recipe.source)
    return (fmu_facts(path, model.description, model.interface),)


def _part(name: str, recipe: FmuRecipe, interface: str) -> FmuOrigin:
    path = recipe.path
    chosen = interface if interface in ("me", "cs") else recipe.interface
    try:
        result = described_at(Path(recipe.folder) if Path(recipe.folder).is_dir() else path)
    except (WorkbenchError, OSError):  # removed since it was loaded; a result is no worse for that
        return FmuOrigin(
            component=name, model="", file=path.name, sha256="", fmi_version="", generation_tool="", interface=chosen
        )
    offered = "me" if "me" in result.interfaces else "cs"
    return replace(fmu_facts(path, result, offered if chosen == "auto" else chosen), component=name)


def _hash_or_none(path: Path) -> str:
    try:
        return hash_of(path)
    except WorkbenchError:  # removed since it was loaded; a result is no worse for that
        return ""
