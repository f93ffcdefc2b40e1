"""Frequencies and amplitudes of a sweep: grids and checks."""

from __future__ import annotations

import math

from workbench.core.records.forms import Amounts, Numbers, several
from workbench.errors import InputError

__all__ = ["frequency_grid", "geometric_band", "positive_values"]


def frequency_grid(
    frequencies: Numbers | None, band: tuple[float, float] | None, ratio: float, *, falling: bool
) -> tuple[float, ...]:
    """Return the frequencies in the order in which they are to be measured [Hz].

    Args:
        frequencies: explicit list [Hz], or None.
        band: lowest and highest frequency [Hz], or None; exactly one of the two is given.
        ratio: of each frequency of a band to the one below it, above 1.
        falling: whether a falling order is kept as given; else the order is rising.

    Raises:
        InputError: both or none given, a value that is not a positive number, ratio not above 1, a
            band that falls where it may not.
    """
    if (frequencies is None) == (band is None):
        which = "neither is given" if band is None else "both are given"
        raise InputError(f"frequencies: give either a list of them or `band`, the lowest and the highest [Hz]; {which}")
    if band is not None:
        return geometric_band(*band, ratio, falling=falling)
    values = positive_values("frequencies", () if frequencies is None else frequencies, unit="Hz")
    if falling and values == tuple(sorted(values, reverse=True)):
        return values
    return tuple(sorted(values))


def geometric_band(low: float, high: float, ratio: float, *, falling: bool = False) -> tuple[float, ...]:
    """Return low, low·ratio, low·ratio², … and, as the last one, high itself [Hz].

    With `falling` a band may be given from the top: high, high/ratio, … low.

    Raises:
        InputError: see `frequency_grid`.
    """
    positive_values("band", (low, high), unit="Hz", distinct=False)
    if not (math.isfinite(ratio) and ratio > 1.0):
        raise InputError(f"ratio: {ratio:g} must be above 1")
    if low == high:
        return (low,)
    if low > high and not falling:
        raise InputError(
            f"band: falls from {low:g} to {high:g} Hz; give the lower frequency first (only a carried sweep may fall)"
        )
    factor = ratio if high > low else 1.0 / ratio
    # One step that would end within rounding of the last point is the last point.
    steps = math.ceil(math.log(max(low, high) / min(low, high)) / math.log(ratio) - 1e-9)
    if steps > 100_000:
        raise InputError(f"ratio: {ratio:g} makes {steps} frequencies in the band; use a larger one")
    return (*(low * factor**i for i in range(steps)), high)


def positive_values(name: str, values: Amounts, *, unit: str, distinct: bool = True) -> tuple[float, ...]:
    """Return `values` as floats after checking that there are some, all positive, none twice.

    Raises:
        InputError: otherwise; the message names `name` and the value.
    """
    checked = several(values)
    if not checked:
        raise InputError(f"{name}: none given; give at least one [{unit}]")
    for value in checked:
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{name}: {value:g} is not a positive number [{unit}]")
    if distinct and len(set(checked)) < len(checked):
        twice = next(v for v in checked if checked.count(v) > 1)
        raise InputError(f"{name}: {twice:g} is given twice [{unit}]")
    return checked
