"""A model that is one FMU."""

from __future__ import annotations

from typing import TYPE_CHECKING

from workbench.fmi.archive import Unpacked
from workbench.fmi.binding import instantiate
from workbench.fmi.description import ModelDescription
from workbench.fmi.instance import Instance
from workbench.fmi.library import Library
from workbench.kernel.library import intermediate_update
from workbench.model.described_model import DescribedModel
from workbench.session.fmu import Setup

if TYPE_CHECKING:
    from workbench.model.load import FmuRecipe

__all__ = ["FmuModel"]


class FmuModel(DescribedModel):
    """One FMU with a chosen interface and solver; made by `load`.

    Args:
        unpacked: the FMU as a folder; the model owns it from now on.
        description: what that FMU says about itself.
        interface: "me" or "cs", one of those offered.
        setup: how sessions begin; who opens instances is put in here.
        notes: remarks for the user.
        recipe: how to load it again.
    """

    recipe: FmuRecipe

    def __init__(
        self,
        unpacked: Unpacked,
        description: ModelDescription,
        *,
        interface: str,
        setup: Setup,
        notes: tuple[str, ...],
        recipe: FmuRecipe,
    ) -> None:
        super().__init__(
            description,
            source=str(unpacked.source),
            interface=interface,
            setup=setup,
            notes=notes,
            recipe=recipe,
        )
        self._unpacked = unpacked
        self._folder = unpacked.folder.resolve()
        self._binary: Library | None = None

    def new_instance(self) -> Instance:
        folder, source = self._folder, self.source
        loaded = None if self._binary is None else self._binary.held()
        instance = instantiate(
            self.description,
            folder,
            interface=self.interface,
            source=source,
            library=loaded,
            event_mode=not self._setup.manners.other_order,
            update=intermediate_update() if self.interface == "cs" else None,
        )
        if self._binary is None and not instance.capabilities.once_per_process:  # stays loaded between sessions
            self._binary = instance.library.held()
        return instance

    def close(self) -> None:
        super().close()
        if self._binary is not None:
            self._binary.close()
        self._unpacked.close()
