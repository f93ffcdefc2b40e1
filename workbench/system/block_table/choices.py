"""Blocks of several inputs, friction, and tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from workbench.core.records.option import option
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.system.block_table.base import Block, Described, Matrix, Values

__all__ = ["Friction", "Lookup", "Lookup2d", "Maximum", "Minimum", "Product", "Switch"]

_EXTRAPOLATION = ("hold", "linear", "error")
_SEVERAL = "several inputs"
_TABLES = "tables"


class Friction(Block):
    """Coulomb friction with stiction, as a force against a motion.

    u1 is the speed, u2 the sum of all other forces on the moving mass. While it sticks the friction is as large as that
    force, so the mass stays at rest; it breaks away beyond the breakaway force. A speed that is prescribed, and goes
    through zero, slides on when it exceeds stuck_speed; u2 may then be left open.
    """

    kind = "friction"
    group = _SEVERAL
    equations = (
        "sliding: y = coulomb · sign(u1) + viscous · u1\nstuck: y = u2, until |u2| > breakaway or |u1| > stuck_speed"
    )
    number = "friction"
    coulomb: float = option("Friction while sliding.", default=1.0, least=0.0)
    breakaway: float | None = option("Force at which it breaks away; left out: coulomb.", default=None, least=0.0)
    viscous: float = option("Friction in proportion to the speed.", default=0.0, least=0.0)
    stuck_speed: float = option("Speed up to which it can be stuck.", default=1e-6, positive=True)

    @property
    def inputs(self) -> tuple[str, ...]:
        return "u1", "u2"

    @property
    def _static(self) -> float:
        return self.coulomb if self.breakaway is None else self.breakaway

    def check(self) -> None:
        if self._static < self.coulomb:
            raise InputError(f"breakaway = {self._static:g} must not be below coulomb = {self.coulomb:g}")

    @property
    def remembers(self) -> Mapping[str, float]:
        return {"sliding": 0.0}

    @property
    def indicators(self) -> int:
        return 2

    def packed(self) -> tuple[float, ...]:
        return self.coulomb, self._static, self.viscous, self.stuck_speed

    def described(self) -> Described | None:
        return Described("preload", {"level": self.coulomb, "slope": self.viscous}) if self.coulomb > 0.0 else None

    def sector(self) -> tuple[float, float] | None:
        return self.viscous, math.inf


class Product(Block):
    """Multiplies its inputs."""

    kind = "product"
    group = _SEVERAL
    equations = "y = u1 · u2 · …"
    number = "product"
    count: int = option("Number of inputs.", default=2, least=2)

    @property
    def inputs(self) -> tuple[str, ...]:
        return _numbered(self.count)


def _numbered(count: int) -> tuple[str, ...]:
    return tuple(f"u{k}" for k in range(1, count + 1))


class _Extreme(Block):
    group = _SEVERAL
    number = "extreme"
    way: ClassVar[float]
    count: int = option("Number of inputs.", default=2, least=2)

    @property
    def inputs(self) -> tuple[str, ...]:
        return _numbered(self.count)

    @property
    def indicators(self) -> int:
        return self.count

    def packed(self) -> tuple[float, ...]:
        return (self.way,)


class Maximum(_Extreme):
    """Shows its largest input."""

    kind = "maximum"
    equations = "y = max(u1, u2, …)"
    way = 1.0


class Minimum(_Extreme):
    """Shows its smallest input."""

    kind = "minimum"
    equations = "y = min(u1, u2, …)"
    way = -1.0


class Switch(Block):
    """Shows one of two inputs, as a third one decides."""

    kind = "switch"
    group = _SEVERAL
    equations = "y = u1 where u2 > threshold, else u3"
    number = "switch"
    threshold: float = option("Value of u2 above which the output is u1.", default=0.5)

    @property
    def inputs(self) -> tuple[str, ...]:
        return "u1", "u2", "u3"

    @property
    def indicators(self) -> int:
        return 1

    def packed(self) -> tuple[float, ...]:
        return (self.threshold,)


class Lookup(Block):
    """Table of one input: straight lines between points."""

    kind = "lookup"
    group = _TABLES
    equations = "y = the line through the points (x, y) to both sides of u"
    number = "lookup"
    sample: ClassVar[Mapping[str, Any]] = {"x": [-1.0, 0.0, 1.0], "y": [-1.0, 0.0, 2.0]}
    x: Values = option("Inputs of the points, rising.")
    y: Values = option("Outputs at the points.")
    extrapolation: str = option(
        "Beyond the ends: hold the last output, go on along the last line, or end with an error.", default="hold",
        choices=_EXTRAPOLATION,
    )  # fmt: skip

    def check(self) -> None:
        _check_grid("x", self.x)
        if len(self.y) != len(self.x):
            raise InputError(f"y has {len(self.y)} values for {len(self.x)} of x")
        if not np.isfinite(self.y).all():
            raise InputError("y holds a value that is not finite")

    @property
    def indicators(self) -> int:
        return 2

    def packed(self) -> tuple[float, ...]:
        return (float(_EXTRAPOLATION.index(self.extrapolation)),)

    def grids(self) -> tuple[tuple[float, ...], ...]:
        return self.x, self.y

    def static(self, u: Floats) -> Floats:
        x, y = np.array(self.x), np.array(self.y)
        if self.extrapolation == "error" and ((u < x[0]) | (u > x[-1])).any():
            raise InputError(f"the table ends at {x[0]:g} and {x[-1]:g}, and extrapolation is 'error'")
        i = np.clip(np.searchsorted(x, u) - 1, 0, len(x) - 2)
        at = np.clip(u, x[0], x[-1]) if self.extrapolation == "hold" else u
        result: Floats = y[i] + (at - x[i]) * (y[i + 1] - y[i]) / (x[i + 1] - x[i])
        return result

    def levels(self) -> tuple[float, ...]:
        return self.x

    def sector(self) -> tuple[float, float] | None:
        x = np.array(self.x)
        if self.static(np.zeros(1))[0] != 0.0 if x[0] <= 0.0 <= x[-1] or self.extrapolation != "error" else True:
            return None
        slopes = np.diff(self.y) / np.diff(x)
        chords = [y / v for v, y in zip(self.x, self.y, strict=True) if v != 0.0]
        i = int(np.clip(np.searchsorted(x, 0.0) - 1, 0, len(x) - 2))
        near = [slopes[i], *slopes[i + 1 : i + 2 if x[i + 1] == 0.0 else i + 1]] if x[0] <= 0.0 <= x[-1] else []
        ends = [0.0] if self.extrapolation == "hold" else [slopes[0], slopes[-1]] * (self.extrapolation == "linear")
        every = [*chords, *near, *ends]
        return float(min(every)), float(max(every))


def _check_grid(name: str, grid: tuple[float, ...]) -> None:
    if len(grid) < 2 or not np.isfinite(grid).all() or not (np.diff(grid) > 0.0).all():
        raise InputError(f"{name} needs two or more finite values that rise")


class Lookup2d(Block):
    """Table of two inputs: bilinear between points."""

    kind = "lookup_2d"
    group = _TABLES
    equations = "y = bilinear between the points (x1[i], x2[j], z[i][j]) around (u1, u2)"
    number = "lookup_2d"
    sample: ClassVar[Mapping[str, Any]] = {"x1": [0.0, 1.0], "x2": [0.0, 1.0], "z": [[0.0, 1.0], [1.0, 2.0]]}
    x1: Values = option("Values of u1 at the points, rising.")
    x2: Values = option("Values of u2 at the points, rising.")
    z: Matrix = option("Outputs at the points: one row for each x1, one column for each x2.")
    extrapolation: str = option(
        "Beyond the ends: hold the last output, go on along the last line, or end with an error.", default="hold",
        choices=_EXTRAPOLATION,
    )  # fmt: skip

    def check(self) -> None:
        _check_grid("x1", self.x1)
        _check_grid("x2", self.x2)
        if np.shape(self.z) != (len(self.x1), len(self.x2)):
            raise InputError(f"z has the shape {np.shape(self.z)}; {len(self.x1)} rows of {len(self.x2)} are needed")
        if not np.isfinite(self.z).all():
            raise InputError("z holds a value that is not finite")

    @property
    def inputs(self) -> tuple[str, ...]:
        return "u1", "u2"

    @property
    def indicators(self) -> int:
        return 4

    def packed(self) -> tuple[float, ...]:
        return (float(_EXTRAPOLATION.index(self.extrapolation)),)

    def grids(self) -> tuple[tuple[float, ...], ...]:
        return self.x1, self.x2, tuple(value for row in self.z for value in row)
