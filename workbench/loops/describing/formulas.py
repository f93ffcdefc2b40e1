"""Static blocks with closed forms of N(A)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.loops.describing.static import StaticBlock

__all__ = [
    "FormulaBlock",
    "cubic",
    "dead_band",
    "preload",
    "quadratic",
    "quantiser",
    "relay",
    "saturation",
]


class FormulaBlock(StaticBlock):
    """A static block whose N(A) is known in closed form; the other harmonics are by quadrature.

    Args:
        function: takes and returns shape (n,).
        formula: amplitude → N.
        name: for tables and pictures.
        levels: inputs at which the function or its slope jumps.
    """

    def __init__(
        self,
        function: Callable[[Floats], Floats],
        formula: Callable[[float], float],
        *,
        name: str,
        levels: Sequence[float] | None = (),
    ) -> None:
        super().__init__(function, name=name, levels=levels)
        self._formula = formula

    def gain(self, amplitude: float, frequency: float = 1.0) -> complex:
        return complex(self._formula(amplitude))


def _check(kind: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{kind}: {name} must be positive, not {value:g}")


def _cap(ratio: float) -> float:
    """Return the part of the fundamental that a saturation at `ratio` of the amplitude lets through."""
    if ratio >= 1.0:
        return 1.0
    return 2.0 / math.pi * (math.asin(ratio) + ratio * math.sqrt(1.0 - ratio * ratio))


def saturation(limit: float = 1.0, slope: float = 1.0) -> FormulaBlock:
    """Y = slope · v, at most ±limit. N = (2k/π)(asin r + r √(1 − r²)), r = limit/(kA) [Slotine & Li, 5.2.1].

    Args:
        limit: of the output.
        slope: k.
    """
    _check("saturation", limit=limit, slope=slope)
    corner = limit / slope
    return FormulaBlock(
        lambda v: np.clip(slope * v, -limit, limit),
        lambda a: slope * _cap(corner / a),
        name="saturation",
        levels=(-corner, corner),
    )


def dead_band(width: float = 1.0, slope: float = 1.0) -> FormulaBlock:
    """Y = 0 within ±width, beyond it slope · (v ∓ width). N is the slope less that of a saturation.

    Args:
        width: from the middle to one end.
        slope: beyond the band.
    """
    _check("dead_band", width=width, slope=slope)
    return FormulaBlock(
        lambda v: slope * (v - np.clip(v, -width, width)),
        lambda a: slope * (1.0 - _cap(width / a)),
        name="dead band",
        levels=(-width, width),
    )


def quantiser(resolution: float = 1.0) -> FormulaBlock:
    """Y = resolution · round(v/resolution). N = (4q/πA) Σ √(1 − ((2i − 1)q/2A)²) [Gelb & Vander Velde, appendix B].

    Args:
        resolution: q, distance of two levels.
    """
    _check("quantiser", resolution=resolution)

    def formula(a: float) -> float:
        edges = (np.arange(1, math.floor(a / resolution + 0.5) + 1) - 0.5) * resolution / a
        return float(4.0 * resolution / (math.pi * a) * np.sum(np.sqrt(np.maximum(0.0, 1.0 - edges**2))))

    return FormulaBlock(lambda v: resolution * np.floor(v / resolution + 0.5), formula, name="quantiser", levels=None)


def relay(level: float = 1.0, dead_zone: float = 0.0) -> FormulaBlock:
    """Y = ±level, 0 within ±dead_zone. N = (4M/πA) √(1 − (δ/A)²) [Slotine & Li, 5.2.1].

    Args:
        level: M.
        dead_zone: δ, from the middle to one end.
    """
    _check("relay", level=level)

    def formula(a: float) -> float:
        return 4.0 * level / (math.pi * a) * math.sqrt(1.0 - (dead_zone / a) ** 2) if a > dead_zone else 0.0

    return FormulaBlock(
        lambda v: np.where(np.abs(v) > dead_zone, level * np.sign(v), 0.0),
        formula,
        name="relay",
        levels=(-dead_zone, dead_zone),
    )


def preload(level: float = 1.0, slope: float = 1.0) -> FormulaBlock:
    """Y = slope · v + level · sign(v). N = k + 4M/πA.

    Args:
        level: M, the jump is twice that.
        slope: k.
    """
    _check("preload", level=level)
    return FormulaBlock(
        lambda v: slope * v + level * np.sign(v), lambda a: slope + 4.0 * level / (math.pi * a), name="preload"
    )


def quadratic(coefficient: float = 1.0) -> FormulaBlock:
    """Y = α v |v|. N = 8αA/3π (the source report, 8.3).

    Args:
        coefficient: α.
    """
    return FormulaBlock(
        lambda v: coefficient * v * np.abs(v), lambda a: 8.0 * coefficient * a / (3.0 * math.pi), name="quadratic"
    )


def cubic(coefficient: float = 1.0) -> FormulaBlock:
    """Y = α v³. N = 3αA²/4.

    Args:
        coefficient: α.
    """
    return FormulaBlock(lambda v: coefficient * v**3, lambda a: 0.75 * coefficient * a * a, name="cubic")
