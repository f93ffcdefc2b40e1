"""Which components are sampled, and when: found out on their model exchange twins."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from workbench.errors import WorkbenchError
from workbench.model.recipe import FmuRecipe
from workbench.session.point import FmuPoint
from workbench.system.master.ticks import Ticks, repeating
from workbench.system.master.units import Units
from workbench.system.parts import Part

__all__ = ["Sampled", "find_ticks"]

_TICKS = 200  # so many instants are looked at


@dataclass(frozen=True)
class Sampled:
    """A sampled component.

    Attributes:
        ticks: its instants.
        held: it has no continuous states: its outputs stand still between the instants.
    """

    ticks: Ticks
    held: bool


def find_ticks(parts: Sequence[Part], units: Units) -> dict[int, Sampled]:
    """Return the sampled co-simulation units with their instants.

    Args:
        parts: the components.
        units: what is stepped.
    """
    found: dict[int, Sampled] = {}
    for k, unit in enumerate(units.units):
        part = parts[unit.members[0]]
        ticks = _ticks(part) if unit.group is None else None
        if ticks is not None:
            found[k] = Sampled(ticks, held=_held(part))
    return found


def _held(part: Part) -> bool:
    """Whether nothing but the clock can change an output."""
    return part.description.state_count == 0


def _ticks(part: Part) -> Ticks | None:
    """Return the instants of a component, as its model exchange side tells them."""
    recipe = part.recipe
    if recipe is None or "me" not in part.description.interfaces:
        return None
    twin = dataclasses.replace(recipe, interface="me", solver="auto", step=None, hold_inputs=False, owned=False)
    return _ticks_of(twin)


def _ticks_of(recipe: FmuRecipe) -> Ticks | None:
    try:
        with recipe.open() as model, model.open_session() as session, FmuPoint(session) as point:
            times = point.ticks(_TICKS, float("inf"))
    except WorkbenchError:  # what cannot be asked is stepped as it comes
        return None
    return repeating([float(t) for t in times])
