"""Loops of a system at other values of a parameter."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from workbench.analysis.describing.base import Block, Floats
from workbench.analysis.limit_cycle.cut import SplitLoop, reblock, recut
from workbench.core.linear import LinearPart
from workbench.errors import InputError, suggest
from workbench.model.described import DescribedModel

__all__ = ["GAIN", "ChebyshevPart", "SystemFamily", "chebyshev_nodes", "gain_family", "stacked"]

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

    def __init__(self, model: DescribedModel, base: SplitLoop, parameter: str, *, time: float, keep: ExitStack) -> None:
        known = [v.name for v in model.description.variables if v.is_number and v.causality != "output"]
        if parameter not in known:
            raise InputError(f"{model.name}: parameter '{parameter}' is unknown; {suggest(parameter, [GAIN, *known])}")
        self._model, self._base, self._parameter, self._time = model, base, parameter, time
        self._own = parameter.startswith(f"{base.ports.component}.")
        self._polynomial: ChebyshevPart | None = None
        self._open: OrderedDict[float, tuple[SplitLoop, ExitStack]] = OrderedDict()
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

    def _cut(self, value: float) -> SplitLoop:
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


# -- a linear part as a polynomial in a parameter --------------------------------------------------

_AGREES = 1e-6


def chebyshev_nodes(low: float, high: float, count: int) -> list[float]:
    """Return count + 1 Chebyshev points of the second kind; those of `count` are among those of 2 · `count`.

    Args:
        low: lowest.
        high: highest.
        count: number of intervals.
    """
    x = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * np.arange(count + 1) / count)
    return [float(v) for v in np.round(x, 14)]


def stacked(part: LinearPart) -> Floats:
    """Return [[A, B], [C, D]], shape (n + 1, n + 1).

    Args:
        part: L.
    """
    return np.block([[part.A, part.B], [part.C, part.D]])


class ChebyshevPart:
    """Interpolates matrices by the barycentric formula [Trefethen, Approximation Theory and Practice, chapter 5].

    Args:
        low: lowest value of the parameter.
        high: highest value.
        count: of `chebyshev_nodes`.
        known: matrices at these nodes at least.
    """

    def __init__(self, low: float, high: float, count: int, known: Mapping[float, Floats]) -> None:
        self._x = np.array(chebyshev_nodes(low, high, count))
        self._values = np.array([known[float(x)] for x in self._x])
        self._weights = np.where(np.arange(count + 1) % 2, -1.0, 1.0)
        self._weights[[0, -1]] *= 0.5

    def matrices(self, value: float) -> Floats:
        """Return the matrices at a value of the parameter.

        Args:
            value: of the parameter.
        """
        apart = value - self._x
        exact = np.flatnonzero(apart == 0.0)
        if len(exact):
            return np.asarray(self._values[exact[0]], dtype=np.float64)
        share = self._weights / apart
        return np.asarray(np.tensordot(share, self._values, 1) / share.sum(), dtype=np.float64)

    def agrees(self, finer: ChebyshevPart) -> bool:
        """Whether this polynomial gives the matrices at the nodes of another.

        Args:
            finer: another.
        """
        size = np.abs(finer._values).max(axis=0)
        bound = _AGREES * (size + 1e-6 * size.max(initial=0.0))
        pairs = zip(finer._x.tolist(), finer._values, strict=True)
        return all(bool(np.all(np.abs(self.matrices(x) - there) <= bound)) for x, there in pairs)

    def __call__(self, value: float) -> LinearPart:
        """Return the linear part at a value of the parameter.

        Args:
            value: of the parameter.
        """
        m = self.matrices(value)
        return LinearPart(m[:-1, :-1], m[:-1, -1], m[-1, :-1], float(m[-1, -1]))
