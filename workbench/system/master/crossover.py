"""Where the gain of a loop falls through 1, from the model exchange sides of its components.

The loop is opened at one connection, all others stay closed; the system that remains is linearised by central
differences where it starts. Not for sampled components: at one instant they stand still.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import WorkbenchError
from workbench.model.described_model import DescribedModel
from workbench.system.connection_checks import as_written
from workbench.system.description import FmuComponent, MasterOptions
from workbench.system.recipe import SystemRecipe

if TYPE_CHECKING:
    from workbench.system.components import Opened

__all__ = ["crossover", "opened_loop"]

_STEP = 1e-4  # of a difference, relative to the larger of 1 and the value
_BAND = (-4.0, 4.0)  # decades [Hz] in which a crossover is looked for
_POINTS = 400
LOOP = "loop"


def opened_loop(opened: Opened, recipe: SystemRecipe, without: int) -> DescribedModel | None:
    """Return the system with model exchange only and one connection opened; None if that cannot be.

    Args:
        opened: the system.
        recipe: how it was opened.
        without: number of the connection.
    """
    if any(p.interface == "cs" and "me" not in p.description.interfaces for p in opened.parts):
        return None
    source, destination = opened.resolved.wires[without].ends
    kept = [dataclasses.replace(w, closes_at=-math.inf) for i, w in enumerate(opened.resolved.wires) if i != without]
    system = dataclasses.replace(
        opened.description,
        components=tuple(
            dataclasses.replace(c, interface="me") if isinstance(c, FmuComponent) else c
            for c in opened.description.components
        ),
        connections=as_written(kept),
        inputs={LOOP: (destination,)},
        outputs={LOOP + "_back": source},
        master=MasterOptions(),
    )
    made = {n: dataclasses.replace(r, interface="me", step=None) for n, r in recipe.parts.items()}
    try:
        plain = dataclasses.replace(
            recipe, system=system, parts=made, interface="auto", step=None, hold_inputs=False, bias={}
        )
        return plain.open()
    except WorkbenchError:
        return None


def crossover(model: DescribedModel, factor: float) -> float | None:
    """Return the highest frequency [Hz] at which the opened loop's gain is 1; None if there is none.

    Args:
        model: made by `opened_loop`.
        factor: of the opened connection.

    Raises:
        WorkbenchError: the model cannot be evaluated.
    """
    loop = _opened(model).scaled(factor)

    def level(exponent: float) -> float:
        return float(np.log10(max(abs(loop.at(10.0**exponent)), 1e-300)))

    if not len(loop.A):
        return None
    grid = np.linspace(*_BAND, _POINTS)
    levels = np.log10(np.maximum(np.abs(loop.response(10.0**grid)), 1e-300))
    falls = np.flatnonzero((levels[:-1] > 0.0) & (levels[1:] <= 0.0))
    if not len(falls):
        return None
    k = int(falls[-1])
    from scipy.optimize import brentq  # noqa: PLC0415 - slow to import, and every command imports this module

    return float(10.0 ** brentq(level, float(grid[k]), float(grid[k + 1])))


def _opened(model: DescribedModel) -> LinearPart:
    """Return the model from its one input to its one output, linear where it starts."""
    with model.open_point() as point:
        n, x0, u0 = len(point.x0), point.x0, point.u0

        def both(v: Floats) -> Floats:
            result = point.at(v[:n], v[n:])
            return np.concatenate([result.dx, result.y])

        v0 = np.concatenate([x0, u0])
        columns = []
        for i in range(n + 1):
            e = np.zeros(n + 1)
            e[i] = _STEP * max(1.0, abs(v0[i]))
            columns.append((both(v0 + e) - both(v0 - e)) / (2.0 * e[i]))
    full = np.array(columns).T
    return LinearPart(full[:n, :n], full[:n, n], full[n, :n], full[n, n])
