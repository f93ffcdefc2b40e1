"""Units of rates, in the notation that FMUs use: "m/s" → "m/s2"."""

from __future__ import annotations

import re

__all__ = ["rate_unit"]

_PER_SECONDS = re.compile(r"(?<=/)s([2-8]?)$")


def rate_unit(unit: str | None) -> str | None:
    """Return the unit of the time derivative of something in a unit; None: that is not known.

    Args:
        unit: as a model declares it; None or empty: it declares none.

    Examples:
        >>> rate_unit("1"), rate_unit("1/s"), rate_unit("rad/s2"), rate_unit("N.m")
        ('1/s', '1/s2', 'rad/s3', 'N.m/s')
    """
    if not unit:
        return None
    unit = unit.replace(" ", "")
    if "/" not in unit:
        return f"{unit}/s"
    seconds = _PER_SECONDS.search(unit)
    if seconds and unit.count("/") == 1:
        return f"{unit[: seconds.start()]}s{int(seconds[1] or 1) + 1}"
    return f"({unit})/s"
