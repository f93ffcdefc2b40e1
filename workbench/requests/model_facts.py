"""What a report tells about a model: its FMUs with their hashes and tools, and the settings."""

from __future__ import annotations

import weakref
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from workbench.system.description import Component
    from workbench.system.recipe import SystemRecipe

__all__ = ["facts_of", "fmu_facts", "hash_of"]

# Fields of a component that are none of its parameters, and the longest text of one.
_NO_PARAMETERS, _LONGEST = {"name", "units", "unit", "function"}, 60

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
    system = _system(recipe)
    return ModelFacts(
        name=model.name,
        source=_source(recipe),
        interface=model.interface,
        solver=model.solver,
        tolerance=_tolerance(model, recipe, system),
        step=recipe.step or model.grid,
        start_values=dict(recipe.start_values),
        defaults={
            v.name: v.start
            for v in model.description.variables
            if v.name in recipe.start_values and v.start is not None
        },
        bias=dict(recipe.bias),
        fmus=_fmus(model, recipe) if system is None else _parts(model, system),
        sha256="" if system is None else _hash_or_none(Path(system.source)),
        blocks={} if system is None else _blocks(system),
        notes=model.notes,
    )


def _system(recipe: LoadRecipe) -> SystemRecipe | None:
    """Return the recipe if it is that of a system; what systems consist of is not imported for an FMU."""
    if isinstance(recipe, FmuRecipe):
        return None
    from workbench.system.recipe import SystemRecipe  # noqa: PLC0415 - see above

    return recipe if isinstance(recipe, SystemRecipe) else None


def _blocks(recipe: SystemRecipe) -> dict[str, str]:
    return {c.name: _block(c) for c in recipe.system.components if c.name not in recipe.parts}


def _block(component: Component) -> str:
    """Return what a block is, with its parameters."""
    values = {f.name: getattr(component, f.name) for f in fields(component) if f.name not in _NO_PARAMETERS}
    kind = str(values.pop("kind", "")) or type(component).__name__.removesuffix("Component").lower()
    given = values.pop("parameters", {}) | values
    words = ", ".join(f"{k} = {_short(v)}" for k, v in given.items() if v is not None)
    return f"{kind}: {words}" if words else kind


def _short(value: object) -> str:
    text = str(value.tolist() if hasattr(value, "tolist") else value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _source(recipe: LoadRecipe) -> str:
    """Return what `load` takes: what is bundled by its name, another by its file's name alone."""
    path = Path(recipe.source)
    return name_of_bundled(path) or (path.name if path.exists() else "")


def _tolerance(model: DescribedModel, recipe: LoadRecipe, system: SystemRecipe | None) -> float | None:
    own = model.description.experiment.tolerance
    if model.interface == "cs":
        return recipe.tolerance or own
    return recipe.tolerance or (own if system is not None else None) or DEFAULT_TOLERANCE


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
    path = recipe.path if isinstance(recipe, FmuRecipe) else Path(recipe.source)
    return (fmu_facts(path, model.description, model.interface),)


def _parts(model: DescribedModel, system: SystemRecipe) -> tuple[FmuOrigin, ...]:
    return tuple(_part(name, part, model.interface) for name, part in system.parts.items())


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
