"""Which components are sampled, and when: from their model exchange twins, their clocks, or the step they are given."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise

import numpy as np

from workbench.core.values.calendar import Calendar, Sampler, exact, simplest_between
from workbench.errors import WorkbenchError
from workbench.fmi.ticking import periodic
from workbench.model.load import FmuRecipe
from workbench.session.point import FmuPoint
from workbench.system.components import OpenComponent
from workbench.system.description import FmuComponent
from workbench.system.master.units import Units

__all__ = ["Sampled", "find_ticks", "repeating"]

_TICKS = 200  # so many instants are looked at
_PROBE = 1e-2  # how far inputs are moved to see whether an output follows, relative to the larger of 1 and the value
_SAME = 1e-12  # relative: outputs that move less stand still
_REPEATS = 1e-6  # relative to the period: how far instants may lie off a pattern
_LONGEST_PATTERN = 64


@dataclass(frozen=True)
class Sampled:
    """A sampled component.

    Attributes:
        ticks: its instants.
        held: its outputs stand still between them.
        anew: they count from where a session begins.
    """

    ticks: Calendar
    held: bool
    anew: bool = False

    def begun(self, time: float) -> tuple[Sampler, ...]:
        """Return its instants in a session that begins at `time` [s]."""
        begin = exact(time) if self.anew else 0
        return tuple(replace(s, offset=s.offset + begin) for s in self.ticks.samplers)


def find_ticks(parts: Sequence[OpenComponent], units: Units) -> dict[int, Sampled]:
    """Return the sampled co-simulation units with their instants.

    Args:
        parts: the components.
        units: what is stepped.
    """
    result: dict[int, Sampled] = {}
    for k, unit in enumerate(units.units):
        sampled = _sampled(parts[unit.members[0]]) if unit.group is None else None
        if sampled is not None:
            result[k] = sampled
    return result


def _sampled(part: OpenComponent) -> Sampled | None:
    recipe = part.recipe
    if isinstance(part.component, FmuComponent) and part.component.step is not None:
        return Sampled(Calendar((Sampler(exact(part.component.step)),)), held=False, anew=True)
    if recipe is None:
        return None
    if "me" in part.description.interfaces:
        twin = dataclasses.replace(recipe, interface="me", solver="auto", step=None, hold_inputs=False)
        return _of_twin(twin)
    clocks = periodic(part.description.clocks)
    if not clocks:
        return None
    return Sampled(Calendar(tuple(dict.fromkeys(clocks))), held=part.description.state_count == 0, anew=True)


def _of_twin(recipe: FmuRecipe) -> Sampled | None:
    """Ask the model exchange side of a component for its instants."""
    try:
        with recipe.open() as model:
            with FmuPoint(model.open_session()) as point:
                held = not len(point.states) and _stands_still(point)
            with FmuPoint(model.open_session()) as point:
                ticks = repeating([float(t) for t in point.ticks(_TICKS, float("inf"))])
    except WorkbenchError:  # what cannot be asked is stepped as it comes
        return None
    return None if ticks is None else Sampled(ticks, held=held)


def _stands_still(point: FmuPoint) -> bool:
    """Whether no output follows an input as long as no time passes."""
    x, u = point.x0, point.u0
    y = point.at(x, u).y
    for i in range(len(u)):
        if point.inputs[i].is_continuous_input:
            moved = u.copy()
            moved[i] += _PROBE * max(1.0, abs(u[i]))
            if np.abs(point.at(x, moved).y - y).max(initial=0.0) > _SAME * np.abs(y).max(initial=1.0):
                return False
    return True


def repeating(times: Sequence[float]) -> Calendar | None:
    """Return the shortest pattern that repeats in these instants [s], seen twice at least; None if there is none."""
    gaps = [b - a for a, b in pairwise(times)]
    for length in range(1, min(_LONGEST_PATTERN, len(gaps) // 2) + 1):
        period = times[length] - times[0]
        if all(abs(gaps[i + length] - gaps[i]) <= _REPEATS * period for i in range(len(gaps) - length)):
            return _meant(times, length)
    return None


def _meant(times: Sequence[float], length: int) -> Calendar:
    """Return the pattern in the simplest numbers within rounding: whoever adds up is off by half an ulp a tick."""
    error = Fraction(0.5 * len(times) * math.ulp(max(map(abs, times))))
    spans = [(Fraction(times[k]) - Fraction(times[k % length]), k // length) for k in range(length, len(times))]
    low = max((span - 2 * error) / n for span, n in spans)
    high = min((span + 2 * error) / n for span, n in spans)
    # Instants that keep their rate less exactly: what the whole stretch says.
    period = simplest_between(low, high) if low <= high else exact(float(spans[-1][0] / spans[-1][1]))
    firsts = [simplest_between(Fraction(t) - error, Fraction(t) + error) for t in times[:length]]
    return Calendar(tuple(Sampler(period, first) for first in firsts))
