"""Loops of a system at other values of a parameter."""

from __future__ import annotations

from collections import OrderedDict
from contextlib import ExitStack
from dataclasses import replace

from workbench.analysis.describing.base import Block, Floats
from workbench.analysis.limit_cycle.chebyshev import ChebyshevPart, chebyshev_nodes, stacked
from workbench.analysis.limit_cycle.cut import Cut, reblock, recut
from workbench.core.linear import LinearPart
from workbench.errors import InputError, suggest
from workbench.model.described import DescribedModel

__all__ = ["GAIN", "SystemFamily", "gain_family"]

GAIN = "gain"
_KEPT = 6  # opened systems
_FIRST_NODES, _MOST_NODES = 4, 32


def gain_family(part: LinearPart, block: Block, value: float) -> tuple[LinearPart, Block]:
    """Return a loop with another gain.

    Args:
        part: L.
        block: as it is.
        value: factor on L.
    """
    return part.scaled(value), block


class SystemFamily:
    """The loop of a system cut at one component, over one of its parameters or start values.

    Args:
        model: the system.
        base: its loop as it is.
        parameter: full name, "component.variable".
        time: session time [s].
        keep: closes what is open in the end.

    Raises:
        InputError: unknown parameter.
    """

    def __init__(self, model: DescribedModel, base: Cut, parameter: str, *, time: float, keep: ExitStack) -> None:
        known = [v.name for v in model.description.variables if v.is_number and v.causality != "output"]
        if parameter not in known:
            raise InputError(f"{model.name}: parameter '{parameter}' is unknown; {suggest(parameter, [GAIN, *known])}")
        self._model, self._base, self._parameter, self._time = model, base, parameter, time
        self._own = parameter.startswith(f"{base.ports.component}.")
        self._polynomial: ChebyshevPart | None = None
        self._open: OrderedDict[float, tuple[Cut, ExitStack]] = OrderedDict()
        keep.callback(self._close, 0)

    def __call__(self, value: float) -> tuple[LinearPart, Block]:
        """Return the linear part and the block at a value.

        Args:
            value: of the parameter.
        """
        if self._polynomial is not None and self._base.block is not None:
            return self._polynomial(value), self._base.block
        loop = self._cut(value)
        if loop.block is None:
            raise InputError(
                f"{self._model.name}: block {self._base.ports.component} has a memory and cannot be followed"
            )
        return loop.part, loop.block

    def prepare(self, low: float, high: float) -> None:
        """Look for a polynomial that gives the linear part between two values, so that no system needs to be opened.

        Chebyshev nodes are doubled until the new ones confirm the old; where they do not, or where the operating
        point moves, systems are opened at each value as before.

        Args:
            low: lowest value.
            high: highest value.
        """
        if self._own:
            return
        nodes = _FIRST_NODES
        known: dict[float, Floats] = {}
        before: ChebyshevPart | None = None
        while nodes <= _MOST_NODES:
            for x in chebyshev_nodes(low, high, nodes):
                if x not in known:
                    loop = self._cut(x)
                    if loop.centre != self._base.centre:
                        return
                    known[x] = stacked(loop.part)
            now = ChebyshevPart(low, high, nodes, known)
            if before is not None and before.agrees(now):
                self._polynomial = now
                return
            before, nodes = now, 2 * nodes

    def _cut(self, value: float) -> Cut:
        if value not in self._open:
            recipe = self._model.recipe
            starts = {**recipe.start_values, self._parameter: value}
            with ExitStack() as stack:
                only = {self._parameter: value}
                quick = reblock(self._model, self._base, only, time=self._time, keep=stack) if self._own else None
                if quick is not None:
                    self._open[value] = (quick, stack.pop_all())
                    self._close(_KEPT)
                    return quick
                opened = stack.enter_context(replace(recipe, start_values=starts).open())
                loop = recut(opened, self._base, own=self._own, time=self._time, keep=stack)
                self._open[value] = (loop, stack.pop_all())
            self._close(_KEPT)
        self._open.move_to_end(value)
        return self._open[value][0]

    def _close(self, rest: int) -> None:
        while len(self._open) > rest:
            self._open.popitem(last=False)[1][1].close()
