"""How to open a system, here or in another process or on another machine."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

from workbench.errors import InputError
from workbench.model.described_model import DescribedModel
from workbench.system.components import Opened, open_parts
from workbench.system.connection_checks import resolve
from workbench.system.master.model import MasterModel
from workbench.system.model import SystemModel
from workbench.system.parameters import with_parameters
from workbench.system.recipe import SystemRecipe
from workbench.system.terminals import members_connected

__all__ = ["OpenableSystem"]


class OpenableSystem(SystemRecipe):
    """A system that can be opened: of model exchange as one equation, else stepped by a master."""

    def open(self) -> DescribedModel:
        system, starts = with_parameters(self.system, self.start_values)
        if system is not self.system:
            return replace(self, system=system, start_values=starts).open()
        with ExitStack() as undo:
            parts = open_parts(self.system.components, undo, self.parts, interface=self.interface)
            system = members_connected(self.system, parts)
            opened = Opened(system, parts, resolve(system, [p.description.variables for p in parts]))
            self._check_interface(opened)
            model = (SystemModel if opened.interface == "me" else MasterModel)(opened, self.with_parts(parts))
            undo.pop_all()
        return model

    def _check_interface(self, opened: Opened) -> None:
        if self.interface not in ("auto", opened.interface):
            kinds = ", ".join(f"{p.name}: {p.interface}" for p in opened.parts)
            raise InputError(f"{self.source}: interface {self.interface} is wanted, but its components have {kinds}")
        for name in self.system.master.given():
            if opened.interface == "me":
                raise InputError(f"{self.source}: {name} is for systems with co-simulation components; this has none")
