"""Copies of a model under the same inputs, as one model: their runs share the solver's steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from workbench.errors import WorkbenchError
from workbench.fmi.variable import Value
from workbench.model import DescribedModel, Model
from workbench.model.load import FmuRecipe
from workbench.system.as_system import system_of
from workbench.system.description import SystemDescription
from workbench.system.nested import Inner, embed
from workbench.system.openable import OpenableSystem
from workbench.system.recipe import SystemRecipe

__all__ = ["copies", "of_copy"]

_COPY = "copy"


def copies(model: Model, count: int) -> DescribedModel | None:
    """Return so many copies of a model with the same inputs as one model; None: it cannot be had.

    One solver integrates all of them: what the choice of its steps does to a result is nearly the same in each, and
    differences are as accurate as those of a fixed sequence of steps (internal differentiation, H. G. Bock, Numerical
    treatment of inverse problems in chemical reaction kinetics, Springer 1981). A co-simulation has its own solver.

    Args:
        model: that is copied; it must stay open.
        count: how many.
    """
    if not isinstance(model, DescribedModel) or model.interface != "me":
        return None
    one, recipe = system_of(model, {}), model.recipe
    every = [Inner(f"{_COPY}{k}", one) for k in range(count)]
    outer = SystemDescription(
        name=model.name, components=(), inputs={n: tuple(f"{i.name}.{n}" for i in every) for n in one.inputs}
    )
    parts: Mapping[str, FmuRecipe] = {}
    starts: Mapping[str, Value] = {}
    if isinstance(recipe, SystemRecipe):
        parts, starts = recipe.parts, recipe.start_values
    elif isinstance(recipe, FmuRecipe):
        parts = {one.components[0].name: replace(recipe, bias={}, at=None)}
    try:
        return OpenableSystem(
            source=model.source, system=embed(outer, every), solver=model.solver, tolerance=model.rtol or None,
            start=model.start_time, periods=recipe.periods, bias=recipe.bias,
            parts={f"{i.name}.{n}": part for i in every for n, part in parts.items()},
            start_values={
                name if name in one.inputs else f"{i.name}.{name}": value
                for i in every
                for name, value in starts.items()
            },
        ).open()  # fmt: skip
    except WorkbenchError:  # an FMU that one process takes once, say
        return None


def of_copy(model: DescribedModel, k: int, name: str) -> str:
    """Return what a variable of the model is called in one of its copies; inputs are the same for all.

    Args:
        model: that was copied.
        k: number of the copy.
        name: of a variable.
    """
    if any(v.name == name for v in model.inputs):
        return name
    if isinstance(model.recipe, SystemRecipe):
        return f"{_COPY}{k}.{model.recipe.system.outputs.get(name, name)}"
    return f"{_COPY}{k}.{system_of(model, {}).components[0].name}.{name}"
