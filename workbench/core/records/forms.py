"""How the value of an option is written as text, and read again: one form for each kind of value."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from workbench.core.records.names_in_text import split_names
from workbench.core.records.quantity import alike, amount, number, quantity, shortest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = [
    "FILE",
    "FILES",
    "MODEL",
    "TEXTS",
    "VARIED",
    "Amount",
    "Amounts",
    "Band",
    "Configurations",
    "File",
    "Form",
    "Grid",
    "Limits",
    "Names",
    "Numbers",
    "Quantities",
    "Ranges",
    "Settings",
    "Starts",
    "Values",
    "Widths",
    "pairs",
    "setting",
    "several",
    "table",
    "two_numbers",
    "varied",
    "whole",
    "written",
]


@dataclass(frozen=True, kw_only=True)
class Form:
    """How values of one kind are written.

    Attributes:
        metavar: what `--help` shows in place of the value, such as "LO:HI".
        read: the texts that were given for an option → its value; raises ValueError with what is wrong.
        write: the value → texts, one for each time the option has to be given.
        take: what Python or a TOML file holds → the value; raises ValueError with what is wrong.
        repeated: whether the option can be given several times.
        example: what stands in an empty field in place of the metavar, where that says too little.
        files: the texts → those files and models that they name, for whoever opens only some.
    """

    metavar: str
    read: Callable[[Sequence[str]], Any]
    write: Callable[[Any], list[str]]
    take: Callable[[Any], Any]
    repeated: bool = False
    example: str = ""
    files: Callable[[Sequence[str]], Sequence[str]] = lambda _: ()


def two_numbers(value: Any) -> tuple[float, float]:  # noqa: ANN401 - what Python or a TOML file holds
    """Return two numbers, or read "LO:HI".

    Raises:
        ValueError: there are not two, or one is not a number.
    """
    found = tuple(map(number, value.split(":"))) if isinstance(value, str) else several(value)
    if len(found) != 2:
        raise ValueError(f"takes two numbers, not {len(found)}")
    return found[0], found[1]


def table(value: Any) -> dict[str, Any]:  # noqa: ANN401 - what Python or a TOML file holds
    """Return name → value; None: none.

    Raises:
        ValueError: the values have no names.
    """
    if not isinstance(value, Mapping | None):
        raise ValueError(f"'{value}' is not of the form NAME = VALUE")
    return {str(name): x for name, x in (value or {}).items()}


def pairs(texts: Iterable[str], sample: str = "NAME=VALUE") -> dict[str, str]:
    """Split repeated NAME=VALUE.

    Args:
        texts: as they were given.
        sample: what the message shows.

    Raises:
        ValueError: no equals sign, no name, a name given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise ValueError(f"'{text}' is not of the form {sample}")
        if name in found:
            raise ValueError(f"'{name}' is given twice")
        found[name] = value
    return found


# -- the forms ---------------------------------------------------------------------------------


def _read_numbers(texts: Sequence[str]) -> tuple[float, ...]:
    return tuple(number(item) for text in texts for item in text.split(","))


def several(value: Amounts) -> tuple[float, ...]:
    """Return one number, or several, as a tuple.

    Args:
        value: as Python or a TOML file has it.
    """
    return tuple(number(item) for item in _items(value))


def _items(value: Any) -> Iterable[Any]:  # noqa: ANN401
    items: Iterable[Any] = [value] if isinstance(value, int | float | str | Mapping) else value
    return items


_NUMBERS = Form(
    metavar="A,..",
    example="1,2,5",
    read=_read_numbers,
    write=lambda value: [",".join(map(shortest, value))],
    take=several,
)


def _read_band(texts: Sequence[str]) -> tuple[float, float]:
    parts = texts[-1].split(":")
    if len(parts) != 2:
        raise ValueError(f"'{texts[-1]}' is not of the form LO:HI, as in 0.1:10")
    return number(parts[0]), number(parts[1])


_BAND = Form(
    metavar="LO:HI",
    example="0.1:10",
    read=_read_band,
    write=lambda value: [":".join(map(shortest, value))],
    take=two_numbers,
)


def _take_names(value: Any) -> tuple[str, ...]:  # noqa: ANN401
    return tuple(split_names(value)) if isinstance(value, str) else tuple(map(str, value))


_NAMES = Form(
    metavar="NAME,..",
    read=lambda texts: tuple(name for text in texts for name in split_names(text)),
    write=lambda value: [",".join(value)] if value else [],
    take=_take_names,
    repeated=True,
)


def _read_values(texts: Sequence[str]) -> dict[str, float]:
    return {name: _named(name, text) for name, text in pairs(texts).items()}


def _named(name: str, value: Any, read: Callable[[Any], float] = amount) -> float:  # noqa: ANN401
    try:
        return read(value)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _take_amounts(value: Any) -> tuple[float, ...]:  # noqa: ANN401
    return alike(map(amount, value.split(",") if isinstance(value, str) else _items(value)))


_AMOUNTS = replace(
    _NUMBERS, read=lambda texts: alike(amount(item) for text in texts for item in text.split(",")), take=_take_amounts
)
_AMOUNT = Form(
    metavar="A",
    example="0.1",
    read=lambda texts: amount(texts[-1]),
    write=lambda value: [shortest(value)],
    take=amount,
)
_VALUES = Form(
    metavar="NAME=VALUE",
    read=_read_values,
    write=lambda value: [f"{name}={shortest(x)}" for name, x in value.items()],
    take=lambda value: {name: _named(name, x) for name, x in table(value).items()},
    repeated=True,
)


def _take_quantities(value: Any) -> dict[str, float | str]:  # noqa: ANN401
    found = {}
    for name, given in table(value).items():
        try:
            number_, unit = quantity(given)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
        found[name] = str(given).strip() if unit else number_
    return found


_QUANTITIES = Form(
    metavar="NAME=VALUE",
    read=lambda texts: _take_quantities(pairs(texts)),
    write=lambda value: [f"{name}={written(x)}" for name, x in value.items()],
    take=_take_quantities,
    repeated=True,
)


def _read_grid(texts: Sequence[str]) -> dict[str, tuple[float, ...]]:
    return {name: _several_named(name, text.split(",")) for name, text in pairs(texts).items()}


def _several_named(name: str, values: Iterable[Any]) -> tuple[float, ...]:
    found = [_named(name, x) for x in values]
    try:
        return alike(found)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _take_grid(value: Any) -> dict[str, tuple[float, ...]]:  # noqa: ANN401
    return {
        name: _several_named(name, [x] if isinstance(x, int | float | str) else x) for name, x in table(value).items()
    }


_GRID = Form(
    metavar="NAME=A,B,..",
    read=_read_grid,
    write=lambda value: [f"{name}={','.join(map(shortest, x))}" for name, x in value.items()],
    take=_take_grid,
    repeated=True,
)


def _read_widths(texts: Sequence[str]) -> float | tuple[float, ...] | dict[str, float]:
    if any("=" in text for text in texts):
        return _read_values(texts)
    found = _read_numbers(texts)
    return found[0] if len(found) == 1 else found


def _write_widths(value: Any) -> list[str]:  # noqa: ANN401
    if isinstance(value, Mapping):
        return _VALUES.write(value)
    return _NUMBERS.write(several(value))


def _take_widths(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, Mapping):
        return _VALUES.take(value)
    return number(value) if isinstance(value, int | float) else several(value)


_WIDTHS = Form(metavar="[NAME=]WIDTH", read=_read_widths, write=_write_widths, take=_take_widths, repeated=True)


def _read_limits(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    return {name: _span(name, text) for name, text in pairs(texts, "NAME=LO:HI").items()}


def _span(name: str, text: str) -> tuple[float, float]:
    """Read LO:HI; either may be left out."""
    low, colon, high = (part.strip() for part in text.partition(":"))
    if not colon or not (low or high):
        raise ValueError(f"{name} needs LO:HI, LO: or :HI, not '{text}'")
    return _ends(name, (low or "-inf", high or "inf"))


def _ends(name: str, value: Any) -> tuple[float, float]:  # noqa: ANN401 - what Python or a TOML file holds
    ends = _several_named(name, value.split(":") if isinstance(value, str) else value)
    if len(ends) != 2:
        raise ValueError(f"{name}: takes two numbers, not {len(ends)}")
    return ends[0], ends[1]


_LIMITS = Form(
    metavar="NAME=LO:HI",
    read=_read_limits,
    write=lambda value: [f"{name}={shortest(low)}:{shortest(high)}" for name, (low, high) in value.items()],
    take=lambda value: {name: _ends(name, x) for name, x in table(value).items()},
    repeated=True,
)


def _take_ranges(value: Any) -> dict[str, tuple[float, float]]:  # noqa: ANN401
    found = {name: several(ends) for name, ends in table(value).items()}
    for name, ends in found.items():
        if len(ends) != 2 or not -math.inf < ends[0] < ends[1] < math.inf:
            written = ":".join(f"{x:g}" for x in ends)
            raise ValueError(f"{name}={written} is not of the form NAME=LO:HI with LO < HI")
    return {name: (ends[0], ends[1]) for name, ends in found.items()}


_RANGES = replace(
    _LIMITS,
    read=lambda texts: _take_ranges(
        {name: [_named(name, x) for x in text.split(":")] for name, text in pairs(texts, "NAME=LO:HI").items()}
    ),
    take=_take_ranges,
)


def varied(text: str) -> tuple[str, str]:
    """Return the name and the values, LO:HI or A,B,.., of what is varied; no values where there is a name alone.

    Args:
        text: NAME=LO:HI, NAME=A,B,.. or NAME.

    Raises:
        ValueError: another form, or limits that do not rise.
    """
    if "=" not in text:
        return text, ""
    ((name, limits),) = pairs([text]).items()
    found = [_named(name, x, number) for x in limits.split(":" if ":" in limits else ",")]
    if ":" in limits and (len(found) != 2 or not found[0] < found[1]):
        raise ValueError(f"'{text}' is not of the form NAME=LO:HI with LO < HI, as in airspeed=150:350")
    return name, limits


def _read_varied(texts: Sequence[str]) -> str:
    pairs(texts)  # with values, on the command line
    return _take_varied(texts[-1])


def _take_varied(text: str) -> str:
    varied(text)
    return text


VARIED = Form(metavar="NAME=LO:HI", read=_read_varied, write=lambda value: [value], take=_take_varied)


def setting(text: str) -> float | int | bool | str:
    """Read a start value as what it looks like; the model converts it to the variable's type.

    Args:
        text: as it was given.
    """
    if text.lower() in {"true", "false"}:
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def written(value: object) -> str:
    """Return the text of a number, a switch or a text, as `setting` reads it."""
    if isinstance(value, bool):
        return str(value).lower()
    return shortest(value) if isinstance(value, float) else str(value)


def whole(value: Any) -> str:  # noqa: ANN401 - what Python or a TOML file holds
    """Return the text of a whole array: "[1,2]", "[[1,2],[3,4]]".

    Args:
        value: a list, a tuple or an array; of texts, numbers, or such again.
    """
    items = value.tolist() if hasattr(value, "tolist") else value
    return f"[{','.join(whole(x) if isinstance(x, list | tuple) else written(x) for x in items)}]"


def _take_settings(value: Any) -> dict[str, Any]:  # noqa: ANN401
    found = table(value)
    return {n: x if isinstance(x, str) or not hasattr(x, "__len__") else whole(x) for n, x in found.items()}


_SETTINGS = Form(
    metavar="NAME=VALUE",
    read=lambda texts: {name: setting(text) for name, text in pairs(texts).items()},
    write=lambda value: [f"{name}={written(x)}" for name, x in value.items()],
    take=_take_settings,
    repeated=True,
)

_CONFIGURATIONS = Form(
    metavar="NAME=VALUE,..",
    read=lambda texts: tuple(_SETTINGS.read(split_names(text)) for text in texts),
    write=lambda value: [",".join(_SETTINGS.write(one)) for one in value],
    take=lambda value: tuple(_SETTINGS.take(one) for one in ([value] if isinstance(value, Mapping) else value or ())),
    repeated=True,
)

# Texts as they are, commas and all; what Python takes in their place may be something else, or have names.
TEXTS = Form(
    metavar="TEXT",
    read=tuple,
    write=lambda value: [str(item) for item in (value.values() if isinstance(value, Mapping) else value)],
    take=lambda value: (
        (value,) if isinstance(value, str | Path) else value if isinstance(value, Mapping) else tuple(value)
    ),
    repeated=True,
)

FILE = Form(
    metavar="PATH",
    read=lambda texts: Path(texts[-1]),
    write=lambda value: [str(value)],
    take=lambda value: value,
    files=lambda texts: texts,
)

# One or more data sets: files on the command line, anything that can be read as data in Python.
FILES = Form(
    metavar="DATA,..",
    read=lambda texts: tuple(part for text in texts for part in text.split(",") if part),
    write=lambda value: [",".join(map(str, value))] if value else [],
    take=lambda value: (value,) if isinstance(value, str) or not isinstance(value, Sequence) else tuple(value),
    repeated=True,
)


def _take_model(value: Any) -> str:  # noqa: ANN401
    if not isinstance(value, str | Path):
        raise ValueError(f"'{value}' is not the file of an FMU, or fmu:NAME")
    return str(value)


# An FMU beside the model that is analysed.
MODEL = Form(
    metavar="MODEL",
    read=lambda texts: texts[-1],
    write=lambda value: [value],
    take=_take_model,
    files=lambda texts: texts,
)


# -- types of options: what Python takes, and the form on the command line ----------------------

if TYPE_CHECKING:
    Numbers = Sequence[float] | NDArray[np.float64] | float
    Amounts = Numbers | str | Sequence[float | str]
    Amount = float | str
    Band = tuple[float, float]
    Names = Sequence[str]
    Values = Mapping[str, float]
    Quantities = Mapping[str, Any]  # numbers; texts such as "2deg" until the model is open
    Limits = Mapping[str, tuple[float, float]]
    Ranges = Mapping[str, tuple[float, float]]
    Grid = Mapping[str, Sequence[float]]
    Widths = float | Sequence[float] | Mapping[str, float]
    Settings = Mapping[str, float | int | bool | str]
    Starts = Mapping[str, float | int | bool | str | Sequence[Any] | NDArray[Any]]
    Configurations = Sequence[Settings]
    File = str | Path
else:
    Numbers = Annotated[object, _NUMBERS]
    Amounts = Annotated[object, _AMOUNTS]
    Amount = Annotated[object, _AMOUNT]
    Band = Annotated[object, _BAND]
    Names = Annotated[object, _NAMES]
    Values = Annotated[object, _VALUES]
    Quantities = Annotated[object, _QUANTITIES]
    Limits = Annotated[object, _LIMITS]
    Ranges = Annotated[object, _RANGES]
    Grid = Annotated[object, _GRID]
    Widths = Annotated[object, _WIDTHS]
    Settings = Annotated[object, _SETTINGS]
    Starts = Annotated[object, _SETTINGS]
    Configurations = Annotated[object, _CONFIGURATIONS]
    File = Annotated[object, FILE]
