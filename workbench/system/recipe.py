"""How to make a system again, in another process or on another machine."""

# ruff: noqa: ANN401 - JSON has no type
from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import KW_ONLY, field, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from workbench.errors import FmuError, InputError
from workbench.model.load import FmuRecipe
from workbench.model.recipe import LoadRecipe
from workbench.system.components import OpenComponent, Opened, open_parts
from workbench.system.connection_checks import resolve
from workbench.system.description import FmuComponent, FunctionComponent, SystemDescription
from workbench.system.parameters import with_parameters
from workbench.system.terminals import members_connected

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
        found, master = super().tighter(factor), self.system.master
        if master.step_tolerance is None:
            return found
        master = replace(master, step_tolerance=factor * master.step_tolerance)
        return replace(found, system=replace(self.system, master=master))

    def open(self) -> DescribedModel:
        """Return the model.

        Raises:
            InputError, FmuError: see `connect`.
        """
        # Slow to import, and everything that asks what a recipe is imports this module.
        from workbench.system.master.model import MasterModel  # noqa: PLC0415
        from workbench.system.model import SystemModel  # noqa: PLC0415

        system, starts = with_parameters(self.system, self.start_values)
        if system is not self.system:
            return replace(self, system=system, start_values=starts).open()
        with ExitStack() as undo:
            parts = self._open_parts(undo)
            system = members_connected(self.system, parts)
            opened = Opened(system, parts, resolve(system, [p.description.variables for p in parts]))
            self._check_interface(opened)
            model = (SystemModel if opened.interface == "me" else MasterModel)(opened, self.with_parts(parts))
            undo.pop_all()
        return model

    def _open_parts(self, undo: ExitStack) -> tuple[OpenComponent, ...]:
        """Open the components; a message names those of a package by their places in it, not where it is unpacked."""
        try:
            return open_parts(self.system.components, undo, self.parts, interface=self.interface)
        except (InputError, FmuError) as error:
            unpacked = self.system.folder
            if unpacked is None or str(unpacked.folder) not in str(error):
                raise
            inside = rf"{re.escape(str(unpacked.folder))}/(?:\d+/)?"
            raise type(error)(re.sub(inside, lambda _: f"{self.source}/", str(error))) from None

    def _check_interface(self, opened: Opened) -> None:
        if self.interface not in ("auto", opened.interface):
            kinds = ", ".join(f"{p.name}: {p.interface}" for p in opened.parts)
            raise InputError(f"{self.source}: interface {self.interface} is wanted, but its components have {kinds}")
        for name in self.system.master.given():
            if opened.interface == "me":
                raise InputError(f"{self.source}: {name} is for systems with co-simulation components; this has none")

    def with_parts(self, parts: Sequence[OpenComponent]) -> Self:
        """Return the recipe with the FMUs as they are opened now."""
        found = {p.name: recipe for p in parts if (recipe := p.recipe) is not None}
        # The folder of an .ssp belongs to the model that was loaded first.
        return replace(self, parts=found)

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
        return _plain(component)

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
