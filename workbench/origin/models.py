"""What a report tells about a model: its FMUs with their hashes and tools, and the settings."""

from __future__ import annotations

import weakref
import zipfile
from pathlib import Path
from typing import BinaryIO

from lxml import etree

from workbench.errors import WorkbenchError
from workbench.fmi.archive import DAMAGED
from workbench.fmi.bundled import name_of_bundled
from workbench.fmi.description import Description
from workbench.model.base import Model
from workbench.model.described import DescribedModel
from workbench.model.load import FmuRecipe
from workbench.model.recipe import DEFAULT_TOLERANCE, LoadRecipe, hash_of
from workbench.origin.facts import FmuFacts, ModelFacts
from workbench.system.description import Component, FmuComponent
from workbench.system.recipe import SystemRecipe

__all__ = ["facts_of", "fmu_facts", "hash_of"]

_CO_SIMULATION = ("CoSimulation", "Implementation")  # FMI 2.0 and 3.0, FMI 1.0


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


def fmu_facts(path: Path, description: Description, interface: str) -> FmuFacts:
    """Return what is known about one FMU.

    Args:
        path: of the file or folder.
        description: what the FMU says of itself.
        interface: "me" or "cs"; empty where none was chosen.
    """
    return FmuFacts(
        component="",
        model=description.model_name,
        file=path.name,
        sha256=_hash_or_none(path),
        fmi_version=description.fmi_version,
        generation_tool=description.generation_tool or "",
        interface=interface,
    )


def _fmus(model: DescribedModel, recipe: LoadRecipe) -> tuple[FmuFacts, ...]:
    if isinstance(recipe, SystemRecipe):
        return tuple(_part(name, part, model.interface) for name, part in recipe.parts.items())
    return (fmu_facts(Path(recipe.source), model.description, model.interface),)


def _part(name: str, recipe: FmuRecipe, interface: str) -> FmuFacts:
    path = Path(recipe.source)
    version, tool, model, offered = _head(Path(recipe.folder) if Path(recipe.folder).is_dir() else path)
    chosen = interface if interface in ("me", "cs") else recipe.interface
    return FmuFacts(
        component=name,
        model=model,
        file=path.name,
        sha256=_hash_or_none(path),
        fmi_version=version,
        generation_tool=tool,
        interface=offered if chosen == "auto" else chosen,
    )


def _hash_or_none(path: Path) -> str:
    try:
        return hash_of(path)
    except WorkbenchError:  # removed since it was loaded; a result is no worse for that
        return ""


def _head(path: Path) -> tuple[str, str, str, str]:
    """Return FMI version, tool, model's name and the interface that `auto` takes; empty where the file is gone."""
    try:
        if path.is_dir():
            with (path / "modelDescription.xml").open("rb") as file:
                return _read_head(file)
        with zipfile.ZipFile(path) as archive, archive.open("modelDescription.xml") as inside:
            return _read_head(inside)  # type: ignore[arg-type]  # a zip's member is read as a file is
    except (OSError, KeyError, RuntimeError, etree.XMLSyntaxError, *DAMAGED):
        return "", "", "", ""


def _read_head(file: BinaryIO) -> tuple[str, str, str, str]:
    """Read as far as the variables begin."""
    root: dict[str, str] = {}
    seen: set[str] = set()
    for _, element in etree.iterparse(file, events=("start",), resolve_entities=False, no_network=True):
        root = root or dict(element.attrib)
        seen.add(element.tag)
        if element.tag == "ModelVariables":
            break
    only_cs = any(tag in seen for tag in _CO_SIMULATION) and "ModelExchange" not in seen
    return (
        root.get("fmiVersion", ""),
        root.get("generationTool", ""),
        root.get("modelName", ""),
        "cs" if only_cs else "me",
    )
