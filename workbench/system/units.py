"""Units of measurement: what FMUs define about them, and the conversion from one to another."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["BASE_UNITS", "Unit"]

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Unit:
    """A unit as FMI and SSP define one: value in base units = factor · value + offset.

    Attributes:
        name: as written.
        exponents: of the base units, in the order of `BASE_UNITS`.
        factor, offset: see above.
    """

    name: str
    exponents: tuple[int, ...] = (0,) * len(BASE_UNITS)
    factor: float = 1.0
    offset: float = 0.0
