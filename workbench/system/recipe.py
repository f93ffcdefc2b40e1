"""What a system is and how it was loaded; `openable` opens it."""

# ruff: noqa: ANN401 - JSON has no type
from __future__ import annotations

import hashlib
import json
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, field, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from workbench.errors import InputError
from workbench.model.described_model import LoadRecipe
from workbench.model.load import FmuRecipe
from workbench.system.block_table.registry import BLOCKS
from workbench.system.components import OpenComponent
from workbench.system.description import BlockComponent, FmuComponent, FunctionComponent, SystemDescription

if TYPE_CHECKING:
    from workbench.model.described_model import DescribedModel

__all__ = ["SystemRecipe"]


class SystemRecipe(LoadRecipe):
    """A system, and what `load` or `connect` was told.

    Attributes:
        system: as it is written down.
        parts: component → how to load its FMU; empty: from the file that the component names.
    """

    _: KW_ONLY
    system: SystemDescription
    parts: Mapping[str, FmuRecipe] = field(default_factory=dict)

    def __eq__(self, other: object) -> bool:
        """Whether both make the same model; workers and executors keep the one that they opened last."""
        if not isinstance(other, SystemRecipe):
            return NotImplemented
        systems = [_plain(replace(recipe.system, folder=None)) for recipe in (self, other)]
        return systems[0] == systems[1] and all(
            getattr(self, f.name) == getattr(other, f.name) for f in fields(self) if f.name != "system"
        )

    __hash__ = None  # it holds mappings

    @property
    def portable(self) -> bool:
        return not any(isinstance(c, FunctionComponent) for c in self.system.components)

    def tighter(self, factor: float) -> Self:
        """Return the recipe with `factor` times the tolerances of integration and, where it is given, of the steps."""
        result, master = super().tighter(factor), self.system.master
        if master.step_tolerance is None:
            return result
        master = replace(master, step_tolerance=factor * master.step_tolerance)
        return replace(result, system=replace(self.system, master=master))

    @abstractmethod
    def open(self) -> DescribedModel:
        """Return the model.

        Raises:
            InputError, FmuError: see `connect`.
        """

    def with_parts(self, parts: Sequence[OpenComponent]) -> Self:
        """Return the recipe with the FMUs as they are opened now."""
        result = {p.name: recipe for p in parts if (recipe := p.recipe) is not None}
        # The folder of an .ssp belongs to the model that was loaded first.
        return replace(self, parts=result)

    def changed(self, system: SystemDescription) -> Self:
        """Return the recipe of a changed system, at its own start; what was told of components still in it stays.

        Args:
            system: made from this one; its components that are others now have other start values.
        """
        same, own = self.still_in(system), self.system.inputs
        inputs = {n for n, ends in system.inputs.items() if n in own and set(ends) & set(own[n])}
        starts = {n: v for n, v in self.start_values.items() if n in inputs or any(n.startswith(f"{c}.") for c in same)}
        bias = {n: b for n, b in self.bias.items() if n in system.inputs}
        parts = {n: p for n, p in self.parts.items() if n in same}
        return replace(self, system=system, start_values=starts, bias=bias, parts=parts, at=None)

    def still_in(self, system: SystemDescription) -> set[str]:
        """Return the names of the components that a changed system has left as they are.

        Args:
            system: made from this one.
        """
        return {c.name for c in system.components if any(c is own for own in self.system.components)}

    def identity(self) -> dict[str, Any]:
        """Return what tells this system from others.

        Raises:
            InputError: it contains a Python function, which cannot be told from another.
        """
        if not self.portable:
            raise InputError(f"{self.source}: a system with a Python function has no identity to keep results under")
        return {
            "system": self._described({c.name: self._component(c) for c in self.system.components}),
            **self.settings(),
            **self.system.master.given(),
        }

    def _described(self, components: Mapping[str, Any]) -> dict[str, Any]:
        system = self.system
        return {
            "components": components,
            "connections": [_plain(c) for c in system.connections],
            "inputs": {name: list(ends) for name, ends in system.inputs.items()},
            "outputs": dict(system.outputs),
        }

    def content(self) -> str:
        fmus = {name: part.content() for name, part in self.parts.items()}
        if not (self.portable and all(fmus.values())):
            return ""
        components = {
            c.name: {"fmu": fmus[c.name], "set": dict(c.set), "units": dict(c.units)}
            if isinstance(c, FmuComponent) and c.name in fmus
            else _plain(c)
            for c in self.system.components
        }
        text = json.dumps(self._described(components), sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def _component(self, component: Any) -> Any:
        if isinstance(component, FmuComponent) and component.name in self.parts:
            return {**self.parts[component.name].identity(), "units": dict(component.units)}
        of_plug_in = BLOCKS.package_of(component.kind) if isinstance(component, BlockComponent) else ""
        return _plain(component) | ({"package": of_plug_in} if of_plug_in else {})

    def packed(self) -> Self:
        return replace(self, parts={name: recipe.packed() for name, recipe in self.parts.items()})

    def settled(self) -> Self:
        return replace(self, parts={name: recipe.settled() for name, recipe in self.parts.items()})

    def __getstate__(self) -> dict[str, Any]:
        """Send no folder along: who opens the recipe there does not own it."""
        state = {f.name: getattr(self, f.name) for f in fields(self)}
        return {**state, "system": replace(self.system, folder=None)}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)


def _plain(value: Any) -> Any:
    """Return a dataclass ready for JSON; arrays by their bytes."""
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, np.ndarray):
        return {"shape": list(value.shape), "sha256": hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(v) for v in value]
    return value
