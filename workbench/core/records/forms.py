"""How the value of an option is written as text, and read: one form for each kind of value."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from workbench.core.records.names_in_text import split_names
from workbench.core.records.quantity import alike, amount, number, plain, quantity, shortest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = [
    "ARRAY",
    "FILE",
    "FILES",
    "LISTED",
    "MODEL",
    "ONE",
    "SPAN",
    "TEXTS",
    "VARIED",
    "Amount",
    "Amounts",
    "Band",
    "Configurations",
    "File",
    "Form",
    "Grid",
    "Layout",
    "Limits",
    "Names",
    "Numbers",
    "Quantities",
    "Ranges",
    "Settings",
    "Starts",
    "Values",
    "Widths",
    "by_name",
    "of_type",
    "pairs",
    "setting",
    "several",
    "table",
    "two_numbers",
    "varied",
    "whole",
    "word_or_number",
    "written",
]


# -- how values are laid out as text -------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How a value is laid out as text.

    Attributes:
        kind: "one" value, "list" of such, "span" of two, "names" with a value each, or "mixed": a list or names.
        split: the texts that were given for an option → its parts, which are not read yet.
        join: the value → texts, one for each time the option has to be given.
        inner: of the value that each name has; None: there are no names.
    """

    kind: Literal["one", "list", "span", "names", "mixed"]
    split: Callable[[Sequence[str]], Any]
    join: Callable[[Any], list[str]]
    inner: Layout | None = None


def _two(texts: Sequence[str]) -> list[str]:
    parts = texts[-1].split(":")
    if len(parts) != 2:
        raise ValueError(f"'{texts[-1]}' is not of the form LO:HI, as in 0.1:10")
    return parts


ONE = Layout(kind="one", split=lambda texts: texts[-1], join=lambda value: [written(value)])
LISTED = Layout(
    kind="list",
    split=lambda texts: [item for text in texts for item in text.split(",")],
    join=lambda value: [",".join(map(written, value))] if len(value) else [],
)
_NAMED = replace(LISTED, split=lambda texts: [name for text in texts for name in split_names(text)])
SPAN = Layout(kind="span", split=_two, join=lambda value: [":".join(map(written, value))])


def by_name(inner: Layout, sample: str = "NAME=VALUE") -> Layout:
    """Return the layout of names, each with a value.

    Args:
        inner: layout of one of these values.
        sample: what a message shows.
    """
    return Layout(
        kind="names",
        split=lambda texts: {name: inner.split([text]) for name, text in pairs(texts, sample).items()},
        join=lambda value: [f"{name}={text}" for name, x in value.items() for text in inner.join(x)],
        inner=inner,
    )


@dataclass(frozen=True, kw_only=True)
class Form:
    """How values of one kind are written.

    Attributes:
        metavar: what `--help` shows in place of the value, such as "LO:HI".
        read: parts of a text, or what Python or a TOML file holds → the value; raises ValueError with what is wrong.
        layout: how they are laid out as text.
        items: types of a single value in JSON, see `schema`.
        repeated: whether the option can be given several times.
        example: what stands in an empty field in place of the metavar, where that says too little.
        infinite: whether numbers may be infinite.
        files: the texts → those files and models that they name, for whoever opens only some.
    """

    metavar: str
    read: Callable[[Any], Any] = lambda value: value
    layout: Layout = ONE
    items: tuple[str, ...] = ("string",)
    repeated: bool = False
    example: str = ""
    infinite: bool = False
    files: Callable[[Sequence[str]], Sequence[str]] = lambda _: ()

    def parts(self, value: Any) -> Any:  # noqa: ANN401 - what TOML can hold
        """Return what a TOML file holds with its texts divided as those of a command line."""
        if self.repeated and isinstance(value, list) and all(isinstance(item, str) for item in value):
            return self.layout.split(value)
        if self.layout.kind == "one" and self.items == ("string",) and isinstance(value, int | float):
            value = str(value)
        return _divided(self.layout, value)


def _divided(layout: Layout, value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, str):
        return layout.split([value])
    if layout.inner is not None and isinstance(value, Mapping):
        return {str(name): _divided(layout.inner, x) for name, x in value.items()}
    return value


# -- values of one kind --------------------------------------------------------------------------


def two_numbers(value: Any) -> tuple[float, float]:  # noqa: ANN401 - what Python or a TOML file holds
    """Return two numbers, or read "LO:HI".

    Raises:
        ValueError: there are not two, or one is not a number.
    """
    result = tuple(map(number, value.split(":"))) if isinstance(value, str) else several(value)
    if len(result) != 2:
        raise ValueError(f"takes two numbers, not {len(result)}")
    return result[0], result[1]


def table(value: Any) -> dict[str, Any]:  # noqa: ANN401 - what Python or a TOML file holds
    """Return name → value; None: none.

    Raises:
        ValueError: the values have no names.
    """
    if not isinstance(value, Mapping | None):
        raise ValueError(f"'{value}' does not say of what these are the values; give a name with each")
    return {str(name): plain(x) for name, x in (value or {}).items()}


def pairs(texts: Iterable[str], sample: str = "NAME=VALUE") -> dict[str, str]:
    """Split repeated NAME=VALUE.

    Args:
        texts: as they were given.
        sample: what the message shows.

    Raises:
        ValueError: no equals sign, no name, a name given twice.
    """
    result: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise ValueError(f"'{text}' is not of the form {sample}")
        if name in result:
            raise ValueError(f"'{name}' is given twice")
        result[name] = value
    return result


def several(value: Amounts) -> tuple[float, ...]:
    """Return one number, or several, as a tuple.

    Args:
        value: as Python or a TOML file has it.
    """
    items = _items(value)
    numbers = tuple(items.tolist() if hasattr(items, "tolist") else items)
    return numbers if set(map(type, numbers)) == {float} else tuple(map(number, numbers))


def _array(value: Amounts) -> NDArray[np.float64]:
    """Return numbers as an array: there may be a million, and they are looked at as a whole."""
    import numpy as np  # noqa: PLC0415 - not before there are numbers

    plain = isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype == np.float64
    result = np.array(value if plain else several(value), dtype=np.float64)
    result.flags.writeable = False
    return result


def _items(value: Any) -> Iterable[Any]:  # noqa: ANN401
    items: Iterable[Any] = [value] if isinstance(value, int | float | str | Mapping) else value
    return items


def _amounts(value: Any) -> tuple[float, ...]:  # noqa: ANN401
    return alike(map(amount, value.split(",") if isinstance(value, str) else _items(value)))


def _names(value: Any) -> tuple[str, ...]:  # noqa: ANN401
    if isinstance(value, Mapping):
        raise ValueError(f"{dict(value)!r} has values; names alone are wanted, as a list")
    names = tuple(split_names(value)) if isinstance(value, str) else tuple(value)
    if (wrong := next((x for x in names if not isinstance(x, str)), None)) is not None:
        raise ValueError(f"{wrong!r} is not a name")
    return names


def _each(read: Callable[[Any], Any]) -> Callable[[Any], dict[str, Any]]:
    """Return the reader of names, each with a value; what is wrong with one is told with its name."""

    def each(value: Any) -> dict[str, Any]:  # noqa: ANN401
        result = {}
        for name, x in table(value).items():
            if isinstance(x, str) and (more := re.fullmatch(r"([^,=]*),\s*([^,=]+=.*)", x)):
                both = f"{name}={more[1]} and {more[2]}"
                raise ValueError(f"one name and value at a time; repeat the option for each: {both}")
            try:
                result[name] = read(x)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None
        return result

    return each


def _quantity_or_number(value: Any) -> float | str:  # noqa: ANN401
    result, unit = quantity(value)
    return str(value).strip() if unit else result


_values = _each(amount)


def _widths(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, Mapping):
        return _values(value)
    result = several(value)
    return result[0] if isinstance(value, int | float) else result


def _split_widths(texts: Sequence[str]) -> Any:  # noqa: ANN401
    if any("=" in text for text in texts):
        return pairs(texts)
    result = LISTED.split(texts)
    return number(result[0]) if len(result) == 1 else result


def _join_widths(value: Any) -> list[str]:  # noqa: ANN401
    return _ONE_EACH.join(value) if isinstance(value, Mapping) else LISTED.join(several(value))


def _ends(value: Any) -> tuple[float, float]:  # noqa: ANN401
    """Return two ends; of "LO:HI" either may be left out."""
    if isinstance(value, str):
        low, colon, high = (part.strip() for part in value.partition(":"))
        if not colon or not (low or high):
            raise ValueError(f"needs LO:HI, LO: or :HI, not '{value}'")
        value = low or "-inf", high or "inf"
    result = _amounts(value)
    if len(result) != 2:
        raise ValueError(f"takes two numbers, not {len(result)}")
    return result[0], result[1]


def _rising(value: Any) -> tuple[float, float]:  # noqa: ANN401
    result = several(value.split(":") if isinstance(value, str) else value)
    if len(result) != 2 or not -math.inf < result[0] < result[1] < math.inf:
        raise ValueError(f"{':'.join(f'{x:g}' for x in result)} is not of the form LO:HI with LO < HI")
    return result[0], result[1]


def _values_or_range(value: Any) -> Any:  # noqa: ANN401
    """Return values, N equidistant ones of "LO:HI:N", or the text "LO:HI" as it is."""
    if not isinstance(value, str) or ":" not in value:
        return _amounts(value)
    low, high = _rising(":".join(value.split(":")[:2]))
    if value.count(":") == 1:
        return value
    steps = _whole_number(value.split(":", 2)[2]) - 1
    if steps < 1:
        raise ValueError(f"'{value}' is not of the form LO:HI:N with N of 2 or more")
    return (*(low + (high - low) * i / steps for i in range(steps)), high)


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
    result = _each(lambda values: [number(x) for x in values])({name: limits.split(":" if ":" in limits else ",")})[
        name
    ]
    if ":" in limits and (len(result) != 2 or not result[0] < result[1]):
        raise ValueError(f"'{text}' is not of the form NAME=LO:HI with LO < HI, as in airspeed=150:350")
    return name, limits


def _split_varied(texts: Sequence[str]) -> str:
    pairs(texts)  # with values, on the command line
    return texts[-1]


def _varied(text: str) -> str:
    varied(text)
    return text


def setting(text: str) -> float | int | bool | str:
    """Read a start value as what it looks like; the model converts it to the variable's type.

    Args:
        text: as it was given.
    """
    if text.lower() in {"true", "false"}:
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text) if "_" not in text else text  # Python reads 1_0 as 10
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


def _settings(value: Any) -> dict[str, Any]:  # noqa: ANN401
    result = table(value)
    written = {n: x if isinstance(x, str) or not hasattr(x, "__len__") else whole(x) for n, x in result.items()}
    for name, x in result.items():
        if not isinstance(x, str) and "nan" in re.split(r"[\[\],]", str(written[name])):
            raise ValueError(f"{name}: nan is not a number")
    return written


def _texts(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, Mapping):
        return value
    return (value,) if isinstance(value, str | Path) else tuple(value)


def _data_sets(value: Any) -> tuple[Any, ...]:  # noqa: ANN401
    return (value,) if isinstance(value, str) or not isinstance(value, Sequence) else tuple(value)


def _file(value: Any) -> str | Path:  # noqa: ANN401
    if not isinstance(value, str | PathLike):
        raise ValueError(f"'{value}' is not the path of a file")
    return Path(value) if not isinstance(value, str) else value


def _model(value: Any) -> str:  # noqa: ANN401
    if not isinstance(value, str | Path):
        raise ValueError(f"'{value}' is not the file of an FMU, or fmu:NAME")
    return str(value)


def _whole_number(text: str) -> int:
    try:
        if "_" in text:  # see `number`
            raise ValueError(text)
        return int(text)
    except ValueError:
        raise ValueError(f"'{text}' is not a whole number") from None


# -- the forms -----------------------------------------------------------------------------------

_NUMBER, _WITH_UNIT, _SCALAR = ("number",), ("number", "string"), ("number", "string", "boolean")
_ONE_EACH = by_name(ONE)

# Of plain types. What Python gives for them is taken as it is.
_PLAIN = {
    float: Form(metavar="NUMBER", items=_NUMBER, layout=replace(ONE, split=lambda texts: number(texts[-1]))),
    int: Form(metavar="N", items=("integer",), layout=replace(ONE, split=lambda texts: _whole_number(texts[-1]))),
    str: Form(metavar="TEXT"),
}


def of_type(kind: Any) -> Form | None:  # noqa: ANN401 - a type
    """Return the form of values of a plain type; None: there is none, as for switches, which have no value."""
    return _PLAIN.get(kind)


def word_or_number(*words: str, what: str) -> Form:
    """Return the form of a word or a whole number, 0 or more.

    Args:
        words: that it can be.
        what: the number, for messages, with its article.
    """

    def split(texts: Sequence[str]) -> int | str:
        if texts[-1] not in words and not texts[-1].isdecimal():
            raise ValueError(f"'{texts[-1]}' is neither {' nor '.join([*words, what])}")
        return texts[-1] if texts[-1] in words else int(texts[-1])

    def read(value: Any) -> int | str:  # noqa: ANN401 - what Python or a TOML file holds
        if isinstance(value, str) and value not in words and value.isdecimal():
            return int(value)
        if value not in words and (isinstance(value, bool) or not isinstance(value, Integral) or value < 0):
            raise ValueError(f"'{value}' is neither {' nor '.join([*words, what])}")
        return value if isinstance(value, str) else int(value)

    return Form(
        metavar="|".join([*words, "N"]), read=read, layout=replace(ONE, split=split), items=("integer", "string")
    )


_NUMBERS = Form(metavar="A,..", example="1,2,5", read=several, layout=LISTED, items=_NUMBER)
ARRAY = replace(_NUMBERS, read=_array)
_BAND = Form(metavar="LO:HI", example="0.1:10", read=two_numbers, layout=SPAN, items=_NUMBER)
_NAMES = Form(metavar="NAME,..", read=_names, layout=_NAMED, repeated=True)
_AMOUNTS = replace(_NUMBERS, read=_amounts, items=_WITH_UNIT)
_AMOUNT = Form(metavar="A", example="0.1", read=amount, items=_WITH_UNIT)
_VALUES = Form(metavar="NAME=VALUE", read=_values, layout=_ONE_EACH, items=_WITH_UNIT, repeated=True)
_QUANTITIES = replace(_VALUES, read=_each(_quantity_or_number))
_GRID = replace(_VALUES, metavar="NAME=A,B,..", read=_each(_amounts), layout=by_name(LISTED))
OVER = replace(
    _GRID,
    metavar="NAME=A,B,..|LO:HI",
    read=_each(_values_or_range),
    layout=by_name(
        Layout(
            kind="list",
            split=lambda texts: texts[-1] if ":" in texts[-1] else LISTED.split(texts),
            join=lambda value: [value] if isinstance(value, str) else LISTED.join(value),
        )
    ),
)
_WIDTHS = Form(
    metavar="[NAME=]WIDTH",
    read=_widths,
    layout=Layout(kind="mixed", split=_split_widths, join=_join_widths, inner=ONE),
    items=_WITH_UNIT,
    repeated=True,
)
_LIMITS = Form(
    metavar="NAME=LO:HI",
    read=_each(_ends),
    layout=by_name(replace(SPAN, split=lambda texts: texts[-1]), "NAME=LO:HI"),
    items=_WITH_UNIT,
    repeated=True,
    infinite=True,
)
_RANGES = replace(_LIMITS, read=_each(_rising), items=_NUMBER)
VARIED = Form(metavar="NAME=LO:HI", read=_varied, layout=replace(ONE, split=_split_varied))
_SETTINGS = Form(
    metavar="NAME=VALUE",
    read=_settings,
    layout=by_name(replace(ONE, split=lambda texts: setting(texts[-1]))),
    items=(*_SCALAR, "array"),
    repeated=True,
    infinite=True,
)
_CONFIGURATIONS = Form(
    metavar="NAME=VALUE,..",
    read=lambda value: tuple(map(_settings, [value] if isinstance(value, Mapping) else value or ())),
    layout=Layout(
        kind="list",
        split=lambda texts: [_SETTINGS.layout.split(split_names(text)) for text in texts],
        join=lambda value: [",".join(_SETTINGS.layout.join(one)) for one in value],
    ),
    items=("object", "string"),
    repeated=True,
)

# Texts as they are, commas and all; what Python takes in their place may be something else, or have names.
TEXTS = Form(
    metavar="TEXT",
    read=_texts,
    layout=Layout(
        kind="list",
        split=tuple,
        join=lambda value: [str(item) for item in (value.values() if isinstance(value, Mapping) else value)],
    ),
    repeated=True,
)
FILE = Form(metavar="PATH", layout=replace(ONE, split=lambda texts: Path(texts[-1])), files=lambda texts: texts)

# One or more data sets: files on the command line, anything that can be read as data in Python.
FILES = Form(
    metavar="DATA,..",
    read=_data_sets,
    layout=replace(LISTED, split=lambda texts: [part for text in texts for part in text.split(",") if part]),
    repeated=True,
)

# An FMU beside the model that is analysed.
MODEL = Form(metavar="MODEL", read=_model, files=lambda texts: texts)


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
    File = Annotated[object, replace(FILE, read=_file)]
