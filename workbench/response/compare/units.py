"""The unit in which a measure is shown."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.core.values.conversion import named_conversion

__all__ = ["DisplayedUnit", "shown_unit"]

STANDARD_GRAVITY = 9.80665  # [m/s2], by definition


@dataclass(frozen=True)
class DisplayedUnit:
    """A unit for tables and pictures.

    Attributes:
        unit: its name; None: there is none.
        factor: value in it = factor · value as it is.
    """

    unit: str | None
    factor: float = 1.0


def shown_unit(own: str | None, wanted: str | None) -> DisplayedUnit:
    """Return the unit in which a variable is shown: the wanted one where it measures the same, else its own.

    Args:
        own: the variable's unit; None: none declared.
        wanted: "g" (standard gravity), or a unit by its symbol; None: the variable's own.
    """
    if own is None or wanted is None:
        return DisplayedUnit(own)
    # g is never grams, but the standard gravity.
    target, share = ("m/s2", 1.0 / STANDARD_GRAVITY) if wanted == "g" else (wanted, 1.0)
    result = named_conversion(own, target)
    if result is None or result[1]:
        return DisplayedUnit(own)
    return DisplayedUnit(wanted, result[0] * share)
