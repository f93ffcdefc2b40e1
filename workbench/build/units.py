"""Units that the workbench can express in SI base units, for the model descriptions.

A unit outside the table is still declared by its name, which FMI allows (FMI 2.0.4, 2.2.2).
"""

from __future__ import annotations

import math

# name → (factor, exponents of the base units)
_TABLE: dict[str, tuple[float, dict[str, int]]] = {
    "1": (1.0, {}),
    "s": (1.0, {"s": 1}),
    "ms": (1e-3, {"s": 1}),
    "Hz": (1.0, {"s": -1}),
    "m": (1.0, {"m": 1}),
    "mm": (1e-3, {"m": 1}),
    "m2": (1.0, {"m": 2}),
    "m3": (1.0, {"m": 3}),
    "m/s": (1.0, {"m": 1, "s": -1}),
    "m/s2": (1.0, {"m": 1, "s": -2}),
    "m3/s": (1.0, {"m": 3, "s": -1}),
    "kg": (1.0, {"kg": 1}),
    "kg.m2": (1.0, {"kg": 1, "m": 2}),
    "kg/m3": (1.0, {"kg": 1, "m": -3}),
    "N": (1.0, {"kg": 1, "m": 1, "s": -2}),
    "N.m": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "N/m": (1.0, {"kg": 1, "s": -2}),
    "N.s/m": (1.0, {"kg": 1, "s": -1}),
    "N.m/rad": (1.0, {"kg": 1, "m": 2, "s": -2, "rad": -1}),
    "N.m.s/rad": (1.0, {"kg": 1, "m": 2, "s": -1, "rad": -1}),
    "Pa": (1.0, {"kg": 1, "m": -1, "s": -2}),
    "Pa/s": (1.0, {"kg": 1, "m": -1, "s": -3}),
    "bar": (1e5, {"kg": 1, "m": -1, "s": -2}),
    "rad": (1.0, {"rad": 1}),
    "rad/s": (1.0, {"rad": 1, "s": -1}),
    "rad/s2": (1.0, {"rad": 1, "s": -2}),
    "deg": (math.pi / 180.0, {"rad": 1}),
    "deg/s": (math.pi / 180.0, {"rad": 1, "s": -1}),
    "A": (1.0, {"A": 1}),
    "mA": (1e-3, {"A": 1}),
    "V": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "K": (1.0, {"K": 1}),
    "W": (1.0, {"kg": 1, "m": 2, "s": -3}),
}


def base_unit(unit: str) -> dict[str, str] | None:
    """Return the attributes of FMI's BaseUnit element for `unit`, or None when it is not in the table."""
    entry = _TABLE.get(unit)
    if entry is None:
        return None
    factor, exponents = entry
    attributes = {name: str(exponent) for name, exponent in exponents.items()}
    if factor != 1.0:
        attributes["factor"] = repr(factor)
    return attributes


def rate_unit(unit: str | None) -> str | None:
    """Return the unit of the time derivative of something in `unit`, or None where that is not known."""
    if not unit:
        return None
    if unit == "1":
        return "1/s"
    return f"{unit}2" if unit.endswith("/s") else f"{unit}/s"
