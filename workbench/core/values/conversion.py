"""Units of measurement: what FMUs define about them, the usual ones by their symbols, and conversion."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from workbench.core.records.names_in_text import plain_unit

__all__ = [
    "BASE_UNITS",
    "Unit",
    "conversion",
    "in_other_unit",
    "is_same_unit",
    "known_unit",
    "named_conversion",
    "rate_unit",
]

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_NONE = (0,) * len(BASE_UNITS)


@dataclass(frozen=True)
class Unit:
    """A unit as FMI and SSP define one: value in base units = factor · value + offset.

    Attributes:
        name: as written.
        exponents: of the base units, in the order of `BASE_UNITS`.
        factor, offset: see above.
    """

    name: str
    exponents: tuple[int, ...] = _NONE
    factor: float = 1.0
    offset: float = 0.0


def conversion(source: Unit, target: Unit) -> tuple[float, float] | None:
    """Return (factor, offset) with: value in target = factor · value in source + offset; None: not comparable.

    The exponent of rad counts, since rad/s and Hz differ by 2π; only a bare rad is the number 1.
    """
    if source.exponents != target.exponents and not _are_plain_numbers(source, target):
        return None
    return source.factor / target.factor, (source.offset - target.offset) / target.factor


def named_conversion(
    source: str,
    target: str,
    definitions: Mapping[str, Unit] | None = None,
    target_definitions: Mapping[str, Unit] | None = None,
) -> tuple[float, float] | None:
    """Return the `conversion` between units by name; None: one is not known, or they are not comparable.

    Args:
        source: name of the unit that is converted.
        target: name of the unit that is wanted.
        definitions: what `known_unit` looks into first.
        target_definitions: the same for the target; None: those of the source.
    """
    left = known_unit(source, definitions)
    right = known_unit(target, definitions if target_definitions is None else target_definitions)
    return None if left is None or right is None else conversion(left, right)


def in_other_unit(value: float, result: tuple[float, float]) -> float:
    """Return a value after a `conversion`; 700 ms are 0.7 s, not 0.7000000000000001.

    Args:
        value: in the unit that is converted.
        result: factor and offset.

    Examples:
        >>> in_other_unit(700.0, named_conversion("ms", "s"))
        0.7
    """
    factor, offset = result
    parts = round(1.0 / factor) if 0.0 < factor < 1.0 else 0
    return (value / parts if parts and math.isclose(parts * factor, 1.0, rel_tol=1e-15) else factor * value) + offset


def is_same_unit(source: Unit, target: Unit) -> bool:
    """Whether the two differ in name only."""
    result = conversion(source, target)
    return result is not None and math.isclose(result[0], 1.0, rel_tol=1e-12) and abs(result[1]) < 1e-12


def _are_plain_numbers(*units: Unit) -> bool:
    return all(not any(u.exponents[:-1]) and u.exponents[-1] in (0, 1) and u.factor == 1.0 for u in units)


# -- the usual units by symbol ------------------------------------------------------------------

_SI = {
    "g": ("kg", 1e-3),
    "m": ("m", 1.0),
    "s": ("s", 1.0),
    "A": ("A", 1.0),
    "K": ("K", 1.0),
    "mol": ("mol", 1.0),
    "cd": ("cd", 1.0),
    "rad": ("rad", 1.0),
    "Hz": ("s-1", 1.0),
    "N": ("kg m s-2", 1.0),
    "Pa": ("kg m-1 s-2", 1.0),
    "bar": ("kg m-1 s-2", 1e5),
    "J": ("kg m2 s-2", 1.0),
    "W": ("kg m2 s-3", 1.0),
    "Wh": ("kg m2 s-2", 3600.0),
    "C": ("A s", 1.0),
    "V": ("kg m2 s-3 A-1", 1.0),
    "F": ("kg-1 m-2 s4 A2", 1.0),
    "Ohm": ("kg m2 s-3 A-2", 1.0),
    "ohm": ("kg m2 s-3 A-2", 1.0),
    "Ω": ("kg m2 s-3 A-2", 1.0),
    "S": ("kg-1 m-2 s3 A2", 1.0),
    "Wb": ("kg m2 s-2 A-1", 1.0),
    "T": ("kg s-2 A-1", 1.0),
    "H": ("kg m2 s-2 A-2", 1.0),
    "l": ("m3", 1e-3),
    "L": ("m3", 1e-3),
}
_OTHERS = {
    "kg": ("kg", 1.0),
    "t": ("kg", 1e3),
    "lb": ("kg", 0.45359237),
    "min": ("s", 60.0),
    "h": ("s", 3600.0),
    "hr": ("s", 3600.0),
    "d": ("s", 86400.0),
    "deg": ("rad", math.pi / 180.0),
    "°": ("rad", math.pi / 180.0),
    "rev": ("rad", 2.0 * math.pi),
    "r": ("rad", 2.0 * math.pi),
    "rpm": ("rad s-1", math.pi / 30.0),
    "in": ("m", 0.0254),
    "ft": ("m", 0.3048),
    "mi": ("m", 1609.344),
    "kn": ("m s-1", 1852.0 / 3600.0),
    "kph": ("m s-1", 1.0 / 3.6),
    "mph": ("m s-1", 0.44704),
    "lbf": ("kg m s-2", 4.4482216152605),
    "psi": ("kg m-1 s-2", 6894.757293168361),
    "atm": ("kg m-1 s-2", 101325.0),
    "degR": ("K", 5.0 / 9.0),
    "%": ("", 0.01),
    "1": ("", 1.0),
    "-": ("", 1.0),
}
# Zero lies elsewhere: these stand alone, never inside a product.
_AFFINE = {
    name: Unit(name, tuple(int(b == "K") for b in BASE_UNITS), factor, offset)
    for names, factor, offset in ((("degC", "°C", "℃"), 1.0, 273.15), (("degF", "°F"), 5.0 / 9.0, 459.67 * 5.0 / 9.0))
    for name in names
}
_PREFIXES = {
    "da": 1e1, "h": 1e2, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12, "P": 1e15,
    "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "n": 1e-9, "p": 1e-12, "f": 1e-15,
}  # fmt: skip
_PREFIXED = re.compile(f"(?:{'|'.join(_PREFIXES)})(?:{'|'.join(_SI)})")
_FACTOR = re.compile(r"([A-Za-zΩµμ°%℃]+|1)\^?([+-]?\d+)?")


def known_unit(name: str, definitions: Mapping[str, Unit] | None = None) -> Unit | None:
    """Return what `name` stands for: a definition, else a usual symbol or product of such; None: not known.

    Understands Modelica's and UCUM's ways to write: "N.m", "kg.m2/s2", "m/s^2", "N.m/(rad.s)", "1/min", "degC", and
    each of them in brackets, "[m3]"; "Nm" where it can only be N.m.

    Args:
        name: of the unit.
        definitions: looked into first.
    """
    name = plain_unit(name)
    if definitions and name in definitions:
        return definitions[name]
    text = name.strip()
    if text in _AFFINE:
        return _AFFINE[text]
    result = _product(text) or _product(_dotted(text))
    return None if result is None else Unit(name, result[0], result[1])


def _dotted(text: str) -> str:
    """Return a unit with points in its first factor: "N.m.s/rad" for "Nms/rad"; "" where that can be read in two ways.

    Only the first symbol may have a prefix, so that "ms" inside is no millisecond.
    """
    head, slash, rest = text.partition("/")
    ways = [f"{first}.{more}" for first, more in _splits(head) if first in _SI or _PREFIXED.fullmatch(first)]
    return f"{ways[0]}{slash}{rest}" if len(ways) == 1 else ""


def _splits(text: str) -> Iterator[tuple[str, str]]:
    """Yield a first symbol and those after it, joined by points; those have no prefix."""
    for end in range(1, len(text)):
        first, rest = text[:end], text[end:]
        if rest in _SI:
            yield first, rest
        for second, more in _splits(rest):
            if second in _SI:
                yield first, f"{second}.{more}"


_Power = tuple[tuple[int, ...], float]


def _product(text: str) -> _Power | None:
    """Return exponents and factor of a product of units, with at most one group in parentheses, at the end."""
    head, slash, group = text.partition("/(")
    if slash:
        below = _product(group[:-1]) if group.endswith(")") else None
        above = _product(head)
        return None if above is None or below is None else _times(above, below, -1)
    parts = re.split(r"([./*·⋅ ])", text)
    if len(parts) % 2 == 0 or _is_ambiguous(parts[1::2]):
        return None
    result: _Power | None = (_NONE, 1.0)
    for operator, part in zip([".", *parts[1::2]], parts[::2], strict=True):
        factor = _power(part)
        if result is None or factor is None:
            return None
        result = _times(result, factor, -1 if operator == "/" else 1)
    return result


def _is_ambiguous(operators: list[str]) -> bool:
    """Whether a product follows a quotient: "a/b.c" is read in two ways."""
    return "/" in operators and any(o != "/" for o in operators[operators.index("/") :])


def _power(text: str) -> _Power | None:
    if text in ("-", ""):
        return (_NONE, 1.0) if text else None
    match = _FACTOR.fullmatch(text)
    if match is None:
        return None
    base = _symbol(match[1])
    power = int(match[2] or 1)
    return None if base is None else (tuple(power * e for e in base[0]), base[1] ** power)


def _symbol(name: str) -> _Power | None:
    for table in (_OTHERS, _SI):
        if name in table:
            return _exponents(table[name][0]), table[name][1]
    for prefix, factor in _PREFIXES.items():
        rest = name.removeprefix(prefix)
        if rest != name and rest in _SI:
            return _exponents(_SI[rest][0]), factor * _SI[rest][1]
    return None


def _exponents(text: str) -> tuple[int, ...]:
    powers = dict.fromkeys(BASE_UNITS, 0)
    for part in text.split():
        name = part.rstrip("-0123456789")
        powers[name] = int(part[len(name) :] or 1)
    return tuple(powers.values())


def _times(left: _Power, right: _Power, sign: int) -> _Power:
    exponents = tuple(a + sign * b for a, b in zip(left[0], right[0], strict=True))
    return exponents, left[1] * right[1] ** sign


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
