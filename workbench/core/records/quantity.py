"""Numbers in the texts of options, and numbers with a unit of their own."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Self

__all__ = [
    "DecimalCommaError",
    "Quantity",
    "alike",
    "amount",
    "number",
    "plain",
    "quantities_in",
    "quantity",
    "shortest",
]


def plain(value: Any) -> Any:  # noqa: ANN401 - what Python or a TOML file holds
    """Return Python's own value in place of a NumPy scalar or an array without dimensions; others as they are."""
    return value.item() if getattr(value, "ndim", None) == 0 and hasattr(value, "item") else value


def number(value: Any) -> float:  # noqa: ANN401 - text, or what Python or a TOML file holds
    """Return a number, or read one.

    Raises:
        ValueError: it is not a number.
    """
    try:
        if (isinstance(value, str) and "_" in value) or isinstance(value, bool):  # Python reads 1_0 as 10, True as 1
            raise ValueError(value)
        return value if isinstance(value, Quantity) else float(value)  # whose unit must not be lost
    except OverflowError:
        raise ValueError("a whole number beyond 1e308 is too large") from None
    except (TypeError, ValueError):
        raise ValueError(f"'{str(value).strip()}' is not a number") from None


# A number, and a unit behind it: a word, a sign, or 1/s. A comma is told apart for what it is.
_QUANTITY = re.compile(r"\s*([-+0-9.eE]*[0-9.])\s*((?:[^\W\d_]|[°%℃\[(1]|,(?=\d)).*?)?\s*")


class Quantity(float):
    """A number in a unit of its own, as a float, until the model tells the unit of the variable.

    Attributes:
        unit: as it was given.
    """

    unit: str

    def __new__(cls, value: float, unit: str = "") -> Self:
        made = super().__new__(cls, value)
        made.unit = unit
        return made

    def __repr__(self) -> str:
        return shortest(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Quantity) and (float(self), self.unit) == (float(other), other.unit)

    def __hash__(self) -> int:
        return hash((float(self), self.unit))


class DecimalCommaError(ValueError):
    """A number has a comma before its decimals: `0,5` for 0.5."""


def quantity(value: float | str) -> tuple[float, str]:
    """Return number and unit of "25deg"; a number alone has the unit "".

    Args:
        value: as it was given.

    Raises:
        DecimalCommaError: its decimals follow a comma.
        ValueError: it does not begin with a number.
    """
    if not isinstance(value, str) or value.strip().lstrip("+-").lower() in {"nan", "inf", "infinity"}:
        return number(value), ""  # what is not finite is refused as such
    match = _QUANTITY.fullmatch(value)
    text, unit = (match[1], match[2] or "") if match else ("", "")
    if unit.startswith(","):
        raise DecimalCommaError(
            f"'{value}' has a comma for its decimals; write a point, as in {value.replace(',', '.', 1)}"
        )
    try:
        return float(text), unit
    except ValueError:
        raise ValueError(f"'{value}' is not a number with a unit, as in 25deg") from None


def amount(value: Any) -> float:  # noqa: ANN401 - text, or what Python or a TOML file holds
    """Return a number, or read one; a `Quantity` where it has a unit.

    Raises:
        ValueError: it is neither.
    """
    try:
        return number(value)
    except ValueError:
        try:
            return Quantity(*quantity(value))
        except DecimalCommaError:
            raise
        except ValueError:
            pass
        raise


def alike(values: Iterable[float]) -> tuple[float, ...]:
    """Return numbers that all have a unit, or none has; what is not finite needs none."""
    result = tuple(values)
    bare = [x for x in result if not isinstance(x, Quantity) and math.isfinite(x)]
    if bare and (given := next((x for x in result if isinstance(x, Quantity)), None)) is not None:
        raise ValueError(f"'{given}' has a unit, and '{shortest(bare[0])}' beside it has none; give each its unit")
    return result


def quantities_in(value: Any) -> Iterator[Quantity]:  # noqa: ANN401 - of any option
    """Yield the quantities among the numbers of an option's value.

    Args:
        value: a number, or a tuple or mapping of such.
    """
    if isinstance(value, Quantity):
        yield value
    elif isinstance(value, tuple | Mapping):
        parts = tuple(value.values()) if isinstance(value, Mapping) else value
        if not set(map(type, parts)) <= {float, str}:  # of a million numbers none is looked at by itself
            for part in parts:
                yield from quantities_in(part)


def shortest(value: float) -> str:
    """Return the shortest text that gives the number again, with its unit where it has one."""
    if isinstance(value, Quantity):
        return f"{shortest(float(value))}{value.unit}"
    return f"{value:g}" if float(f"{value:g}") == value else repr(value)
