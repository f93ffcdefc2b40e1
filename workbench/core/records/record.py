"""Records: what every result is. Its fields are declared once; JSON, tables and data frames are derived from them."""

from __future__ import annotations

import json
import math
import numbers as numbers_of
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from importlib import import_module
from itertools import product
from json import JSONDecodeError
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Literal,
    Self,
    TextIO,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from workbench.core.machine.files import content_of
from workbench.core.records.csv_file import write_csv
from workbench.core.records.mat_file import matlab_names, write_mat
from workbench.core.records.parsing import from_json, from_toml
from workbench.errors import InputError, Mistake, suggest

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

__all__ = [
    "Record",
    "RecordPart",
    "brief",
    "complex_of",
    "entry",
    "fields_fit",
    "numbers",
    "plain",
    "read_json",
    "read_toml_table",
    "spelled_out",
]

# What Python's reader says of a quote that is not closed, with the line where it knows it.
_LINE = re.compile(r"line (\d+)")
_OPEN_QUOTE = re.compile(r"""Illegal character '\\n' \(at (line \d+)|Unterminated string|Expected "'" \(at end""")
_LONG, _WORDY, _FEW = 240, 80, 6  # characters of a part in a line, of one value; entries that are written out


def entry(
    *, key: str = "", kept: bool = True, inline: bool = False, named: bool = False, dims: Sequence[str | int] = (),
    unit: str = "", null: float = math.nan,
) -> dict[str, Any]:  # fmt: skip
    """Return what a field says of its value, for `field(metadata=…)`.

    Args:
        key: its key in JSON; "": the field's name.
        kept: False: it is not written; `restored` may give it when a file is read, else it has its default.
        inline: the keys of its value, a part, stand among those of the record.
        named: in JSON, dimensions after the first are keys: name → … → values along the first.
        dims: what the axes of an array, or of all arrays in a mapping, run over: fields that hold the coordinates or
            names, or a fixed length.
        unit: unit of an array.
        null: the number that null stands for in JSON.
    """
    return {"key": key, "kept": kept, "inline": inline, "named": named, "dims": tuple(dims), "unit": unit, "null": null}


def brief(value: object) -> str:
    """Return a value in a few words: arrays and long collections by their sizes.

    Args:
        value: of a field.
    """
    shape = getattr(value, "shape", ())  # without numpy, which is slow to import
    if shape and math.prod(shape) > _FEW:
        return f"array of shape {shape}"
    if isinstance(value, Mapping) and len(value) > _FEW:
        return f"{{{len(value)} entries}}"
    if isinstance(value, list | tuple) and len(value) > _FEW:
        return f"[{len(value)} values]"
    text = repr(value)
    return text if len(text) <= _WORDY else f"{text[: _WORDY - 1]}…"


class RecordPart:
    """A part of a record that is written to JSON and read back; a frozen dataclass.

    The keys are those of the fields, in their order, then those of `derived`.
    """

    _WHAT: ClassVar[str] = ""  # with its article, for messages
    _COMMAND: ClassVar[str] = ""  # that writes it

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__repr__" not in vars(cls):  # a dataclass leaves it as it is then
            cls.__repr__ = RecordPart.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """Return the fields in a line that a notebook can show: long arrays and tables by their sizes."""
        shown = [f"{f.name}={brief(getattr(self, f.name))}" for f in fields(self) if f.repr]  # type: ignore[arg-type]
        text = f"{type(self).__name__}({', '.join(shown)})"
        return text if len(text) <= _LONG else f"{text[: _LONG - 2]}…)"

    def derived(self) -> Mapping[str, Any]:
        """Return further keys for JSON → value: what follows from the fields."""
        return {}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the keys of a file as the fields need them, where `to_dict` wrote something else.

        Args:
            data: what `to_dict` wrote; a value may be given as it is in the record.
        """
        return data

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, ready for JSON; None in place of what is not finite."""
        own, inline = _written(self)
        return {**own, **inline, **plain(self.derived()), **own}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Return what `to_dict`, or a file with its keys, describes; further keys are ignored.

        Args:
            data: the keys.

        Raises:
            InputError: a key is missing or holds something else.
        """
        try:
            result: Self = _read(cls, data, {}, "")
        except _WrongKeyError as error:
            what = cls._WHAT or f"a {cls.__name__}"
            remedy = f"; workbench {cls._COMMAND} --json writes one" if cls._COMMAND else ""
            held: Any = data  # whatever a file holds
            other = held.get("command") if isinstance(held, Mapping) else None
            why = f"it is a result of {other}" if other not in {None, cls._COMMAND} else str(error)
            raise InputError(f"is not {what}: {why}{remedy}") from None
        return result

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Return what a JSON file holds: one that the command line wrote, or `to_dict`.

        Args:
            path: path of the file.

        Raises:
            InputError: no such file, not JSON, or something else.
        """
        data = read_json(path)
        try:
            return cls.from_dict(data)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None


class Record(RecordPart):
    """A frozen dataclass that is written to JSON and tables, and read back."""

    def rows(self) -> Iterable[Sequence[Any]]:
        """Return the rows of the table, the heading first; a row of one cell with # is a remark.

        Without an own method of the class: one row for each element of the arrays with the most dimensions.
        """
        axes, columns = self._table()
        yield [*axes, *columns]
        values = [_flat(column) for column in columns.values()]
        steps = [_flat(*axes.values())] if len(axes) == 1 else zip(*product(*map(_flat, axes.values())), strict=True)
        yield from zip(*steps, *values, strict=True)

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one, by their name in the heading."""
        return {name: unit for name, _, _, unit in self._arrays()}

    def to_csv(self, path: str | Path | TextIO) -> Any:  # noqa: ANN401 - some tell which files they wrote
        """Write the table of the result; its first line is the heading, "name [unit]" where a column has a unit.

        Args:
            path: path of the file, or an open text stream.

        Raises:
            InputError: the file cannot be written, or there is no table.
        """
        write_csv(path, map(_plain_row, self.rows()), units=self.column_units())

    def to_mat(self, path: str | Path) -> None:
        """Write the fields as variables of MATLAB, with the units of arrays in the struct `units`.

        A name that MATLAB does not allow, as plant.x, is changed, to plant_x; where there are such,
        `original_names` has both.

        Args:
            path: path of the file, .mat.

        Raises:
            InputError: another suffix, or the file cannot be written.
        """
        values = {declared.name: getattr(self, declared.name) for declared in fields(self)}  # type: ignore[arg-type]
        units = {name: unit for name, _, _, unit in self._arrays() if unit}
        known = values.get("units")
        if isinstance(known, Mapping):
            units |= {name: unit for name, unit in known.items() if unit}
        names = matlab_names(name for name, *_ in self._arrays())
        changed = {own: name for name, own in names.items() if own != name}
        write_mat(path, {**values, "units": units, **({"original_names": changed} if changed else {})})

    def to_dataframe(self) -> DataFrame:
        """Return the table of the result for pandas; what is not known of any row is not a number there.

        Raises:
            InputError: pandas is not installed, or there is no table.
        """
        heading, *rows = (row for row in map(_plain_row, self.rows()) if not _is_remark(row))
        frame: DataFrame = _library("pandas").DataFrame(rows, columns=heading)
        return frame.astype({name: float for name in heading if frame[name].isna().all()})

    def to_xarray(self) -> Dataset:
        """Return the arrays of the result for xarray, each with its coordinates, where it has some, and its unit.

        Raises:
            InputError: xarray is not installed, or there is no array over named axes.
        """
        library = _library("xarray")
        arrays = {name: (dims, array, {"unit": unit} if unit else {}) for name, dims, array, unit in self._arrays()}
        if not arrays:
            raise InputError(f"{type(self).__name__} has no array over named axes")
        axes = dict.fromkeys(axis for dims, _, _ in arrays.values() for axis in dims if self._axis(axis) is not None)
        coordinates = {name: arrays.pop(name, (name, list(self._axis(name)))) for name in axes}
        data: Dataset = library.Dataset(arrays, coordinates)
        return data

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401 - an array of numbers
        """Return the array of this name, e.g. a signal.

        Raises:
            InputError: there is none.
        """
        arrays = {known: array for known, _, array, _ in self._arrays()}
        if name not in arrays:
            raise InputError(f"{type(self).__name__} has no '{name}'; {suggest(name, arrays)}")
        return arrays[name]

    def _arrays(self) -> Iterator[tuple[str, tuple[str, ...], Any, str]]:
        """Yield name, dimensions, array and unit; those in mappings by their own names."""
        known = getattr(self, "units", None)
        units: Mapping[str, str | None] = known if isinstance(known, Mapping) else {}
        for declared in fields(self):  # type: ignore[arg-type]  # every record is a dataclass
            said, held = declared.metadata, getattr(self, declared.name)
            dims = said.get("dims", ())
            if not dims or not isinstance(dims[0], str):
                continue
            named = (axis if isinstance(axis, str) else f"{declared.name}_{k}" for k, axis in enumerate(dims))
            dims = tuple(f"{axis}_2" if axis in dims[:k] else axis for k, axis in enumerate(named))
            several = held if isinstance(held, Mapping) else {declared.name: held}
            for name, array in several.items():
                yield name, dims, array, said["unit"] or units.get(name) or ""

    def _table(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the axes and the columns of the arrays with the most dimensions."""
        arrays = list(self._arrays())
        tables = [dims for _, dims, _, _ in arrays if all(self._axis(axis) is not None for axis in dims)]
        dims = max(tables, key=len, default=())
        if not dims:
            raise InputError(f"{type(self).__name__} has no table")
        columns = {name: array for name, over, array, _ in arrays if over == dims and name not in dims}
        return {axis: self._axis(axis) for axis in dims}, columns

    def _axis(self, name: str) -> Any:  # noqa: ANN401 - an array or names
        """Return the coordinates or names along an axis; None: it is counted."""
        return getattr(self, name.removesuffix("_2"), None)


def plain(value: Any) -> Any:  # noqa: ANN401, PLR0911 - whatever a record holds, a line each
    """Return a value as JSON can hold it.

    Arrays and tuples become lists, complex numbers pairs, names strings; None stands for what is not finite.
    """
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, RecordPart):
        return value.to_dict()
    if is_dataclass(value):
        own, inline = _written(value)
        return {**own, **inline}
    if isinstance(value, Mapping):
        return {_name(key): plain(inner) for key, inner in value.items()}
    if hasattr(value, "tolist"):
        return _nested(value)
    if isinstance(value, Path):
        return str(value)
    return [plain(inner) for inner in value]


def numbers(data: Mapping[str, Any], key: str, shape: Sequence[int] = ()) -> Any:  # noqa: ANN401 - an array of floats
    """Return the array that a key holds, for `restored`; None becomes NaN.

    Args:
        data: the keys.
        key: its name.
        shape: that it must have; empty: any.
    """
    import numpy as np  # noqa: PLC0415  slow to import, and options import this module

    return _array(np.dtype[np.float64], data[key], {}, key, {"dims": shape})


def complex_of(data: Mapping[str, Any]) -> Any:  # noqa: ANN401 - an array of complex numbers
    """Return the array whose parts are the keys "real" and "imag", for `restored`."""
    real = numbers(data, "real")
    return real + 1j * numbers(data, "imag", real.shape)


def read_json(path: str | Path) -> Any:  # noqa: ANN401 - whatever JSON holds
    """Return what a JSON file holds.

    Args:
        path: path of the file.

    Raises:
        InputError: no such file, or not JSON.
    """
    try:
        return from_json(content_of(Path(path)).decode("utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except JSONDecodeError as error:
        raise InputError(f"{path}: is not JSON (line {error.lineno}, column {error.colno})") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not JSON, nor another text") from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from None


def read_toml_table(path: Path, *, twice: str = "") -> dict[str, Any]:
    """Return what a TOML file holds.

    Args:
        path: path of the file.
        twice: what to say besides where a key appears twice.

    Raises:
        InputError: no such file, or not TOML.
    """
    try:
        return from_toml(content_of(path).decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text (byte {error.start})") from None
    except ValueError as error:
        said = f"is not TOML: {error}{f'; a key appears twice{twice}' if 'overwrite' in str(error) else ''}"
        if begun := _OPEN_QUOTE.search(said):
            said = f"is not TOML: {f'{begun[1]}: ' if begun[1] else ''}a text in quotes has no end"
        line = _LINE.search(said)
        raise InputError(f"{path}: {said}", [Mistake(said, str(path), int(line[1]) if line else None)]) from None


# -- writing -----------------------------------------------------------------------------------


def _written(record: Any) -> tuple[dict[str, Any], dict[str, Any]]:  # noqa: ANN401 - a dataclass
    """Return the keys of the fields, and those of the parts that stand among them."""
    own: dict[str, Any] = {}
    inline: dict[str, Any] = {}
    for declared in fields(record):
        said, held = declared.metadata, getattr(record, declared.name)
        if said.get("inline"):
            inline |= plain(held) or {}
        elif said.get("named"):
            own[_key(declared)] = plain(_by_name(held, [getattr(record, axis) for axis in said["dims"][1:]]))
        elif said.get("kept", True):
            own[_key(declared)] = plain(held)
    return own, inline


def _by_name(array: Any, names: Sequence[Sequence[str]]) -> Any:  # noqa: ANN401 - an array, or mappings of arrays
    if not names:
        return array
    return {name: _by_name(array[:, k], names[1:]) for k, name in enumerate(names[0])}


def _nested(array: Any) -> Any:  # noqa: ANN401 - nested lists, or one number
    import numpy as np  # noqa: PLC0415  slow to import, and options import this module

    known = array.dtype.kind in "biu" or (array.dtype.kind == "f" and np.isfinite(array).all())
    return array.tolist() if known else plain(array.tolist())


def _key(declared: Field[Any]) -> str:
    return declared.metadata.get("key") or declared.name


def _name(key: object) -> str:
    return str(key).removesuffix(".0") if isinstance(key, float) else str(key)


def _flat(array: Any) -> list[Any]:  # noqa: ANN401 - an array or a sequence
    return list(array.ravel().tolist() if hasattr(array, "ravel") else array)


def _plain_row(row: Sequence[Any]) -> list[Any]:
    """Return cells as `plain` has them; most are finite numbers, which are so (x − x is not 0 for others)."""
    return [cell if type(cell) is float and cell - cell == 0.0 else plain(cell) for cell in row]


def _is_remark(row: Sequence[Any]) -> bool:
    return len(row) == 1 and str(row[0]).startswith("#")


# -- reading -----------------------------------------------------------------------------------


class _WrongKeyError(Exception):
    """A key is missing or holds something else; says which."""


def _read(kind: Any, data: Any, lengths: Mapping[str, int], where: str) -> Any:  # noqa: ANN401 - of JSON
    """Return a dataclass; `lengths` are those of the fields around it, by which empty arrays have their shape."""
    if not isinstance(data, Mapping):
        raise _WrongKeyError(f"{where or 'it'} is not an object with keys")
    if issubclass(kind, RecordPart):
        try:
            data = kind.restored(data)
        except KeyError as error:
            raise _WrongKeyError(f"'{_path(where, error.args[0])}' is missing") from None
        except (AttributeError, IndexError, TypeError, ValueError) as error:
            what = f"'{where}'" if where else "a key"
            raise _WrongKeyError(f"{what} holds something else than it should ({error})") from None
    hints, result, lengths = _hints(kind), {}, dict(lengths)
    own = {_key(declared) for declared in fields(kind) if not declared.metadata.get("inline")}
    # Names and coordinates first: they say how long the axes of the others are.
    for declared in sorted(fields(kind), key=lambda f: len(f.metadata.get("dims", ()))):
        said, key = declared.metadata, _key(declared)
        here = _path(where, key)
        if said.get("inline"):
            rest = {name: held for name, held in data.items() if name not in own} or None
            result[declared.name] = _value(hints[declared.name], rest, lengths, where, said)
        elif key in data:
            result[declared.name] = _value(hints[declared.name], data[key], lengths, here, said)
        elif not _may_be_left_out(declared, lengths):
            raise _WrongKeyError(f"'{here}' is missing")
        if isinstance(known := result.get(declared.name, _default(declared)), Sized) and (
            len(known) or not isinstance(known, tuple)
        ):
            lengths[declared.name] = len(known)  # without names it is not known
    return kind(**result)


def _may_be_left_out(declared: Field[Any], lengths: Mapping[str, int]) -> bool:
    """Return whether a field has a default, as long as its axis if it is an array."""
    if declared.default is MISSING and declared.default_factory is MISSING:
        return False
    held, dims = _default(declared), declared.metadata.get("dims")
    return not (isinstance(held, Sized) and dims) or lengths.get(dims[0], len(held)) == len(held)


def _default(declared: Field[Any]) -> object:
    """Return what an array or the like is that is left out: its length counts, too."""
    return None if declared.default_factory is MISSING else declared.default_factory()


def _path(where: str, key: object) -> str:
    return f"{where}.{key}" if where else str(key)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _value(kind: Any, given: Any, lengths: Mapping[str, int], where: str, said: Mapping[str, Any]) -> Any:  # noqa: ANN401, PLR0911
    """Return what JSON holds as the type of a field, or of something in it, says."""
    kind = spelled_out(kind)
    base: Any = get_origin(kind) or kind
    inner = get_args(kind)
    if base is Any or base is object or base is Literal:
        return given
    if isinstance(base, type) and isinstance(given, base) and not issubclass(base, (*_SIMPLE, tuple, Mapping)):
        return given  # `restored` made it
    if base in (Union, UnionType):
        return _one_of(inner, given, lengths, where, said)
    if given is None and base is float:
        return said.get("null", math.nan)
    if base in _SIMPLE:
        return _SIMPLE[base](given, where)
    if base.__name__ == "ndarray":
        return _array(inner[1], given, lengths, where, said)
    if hasattr(base, "__dataclass_fields__"):
        return _read(base, given, lengths, where)
    if base is tuple and inner[1:] != (...,):
        _refuse(not isinstance(given, Sequence) or len(given) != len(inner), where, f"a list of {len(inner)}", given)
        return tuple(_value(k, v, lengths, where, said) for k, v in zip(inner, given, strict=True))
    if issubclass(base, Mapping):
        _refuse(not isinstance(given, Mapping), where, "an object that gives a value to each name", given)
        key, held = inner
        return {
            (key(name) if key in (int, float) else name): _value(held, v, lengths, f"{where}.{name}", said)
            for name, v in given.items()
        }
    _refuse(isinstance(given, str) or not isinstance(given, Sequence), where, "a list", given)
    return tuple(_value(inner[0], v, lengths, where, said) for v in given)


def fits(kind: Any, held: Any) -> bool:  # noqa: ANN401, PLR0911 - a line each
    """Return whether a value is of a type that a field has; what is in a dataclass within is not looked at.

    Args:
        kind: the type.
        held: the value.
    """
    kind = spelled_out(kind)
    base: Any = get_origin(kind) or kind
    inner = get_args(kind)
    if base in (Union, UnionType):
        return any(fits(one, held) for one in inner)
    if base is Literal:
        return held in inner
    if base in _NUMBERS:
        return isinstance(held, _NUMBERS[base]) or (base is bool and type(held).__name__ == "bool_")
    if base is Any or not isinstance(base, type) or base is object:  # or a variable
        return True
    if base.__name__ == "ndarray":
        array, dtype = held, get_args(inner[1])[0] if inner else object
        return isinstance(held, base) and (dtype in (Any, object) or array.dtype.kind in _kinds_in(dtype))
    if base is tuple and inner[1:] != (...,) and inner:
        return isinstance(held, tuple) and len(held) == len(inner) and all(map(fits, inner, held))
    if issubclass(base, Mapping) and len(inner) == 2:
        return isinstance(held, Mapping) and all(fits(inner[0], k) and fits(inner[1], v) for k, v in held.items())
    if issubclass(base, Iterable) and inner and not isinstance(held, str):
        return isinstance(held, list | base) and all(fits(inner[0], one) for one in held)
    return isinstance(held, base)


def _kinds_in(dtype: Any) -> str:  # noqa: ANN401 - a type of NumPy
    """Return the kinds of numbers that a type holds."""
    order, kind = "biufc", getattr(dtype, "__name__", "complex")
    return order if kind.startswith("complex") else order[:4] if kind.startswith("float") else order[:3]


def fields_fit(record: Any) -> str:  # noqa: ANN401 - a dataclass
    """Return the first field of a dataclass that is not there, or of another type than its own; empty: none is."""
    kind: Any = type(record)
    hints = _hints(kind)
    for declared in fields(record):
        if not hasattr(record, declared.name) or not fits(hints[declared.name], getattr(record, declared.name)):
            return declared.name
    return ""


def spelled_out(kind: Any) -> Any:  # noqa: ANN401
    """Return the type that an alias with parameters stands for: NumPy's `NDArray` is one since version 2.5."""
    alias = getattr(get_origin(kind), "__value__", None)
    return kind if alias is None else alias[get_args(kind)]


def _one_of(kinds: Sequence[Any], given: Any, lengths: Mapping[str, int], where: str, said: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return the first of several types that it is."""
    if given is None and NoneType in kinds:
        return None
    problem = None
    for kind in kinds:
        if kind is not NoneType:
            try:
                return _value(kind, given, lengths, where, said)
            except _WrongKeyError as error:
                problem = problem or error
    raise problem or _WrongKeyError(where)


def _array(kind: Any, given: Any, lengths: Mapping[str, int], where: str, said: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return an array: nested lists, complex numbers as pairs, None as NaN; empty ones in the shape of their axes."""
    import numpy as np  # noqa: PLC0415  slow to import, and options import this module

    dtype, dims = np.dtype(get_args(kind)[0]), said.get("dims", ())
    pairs = np.issubdtype(dtype, np.complexfloating)
    try:
        given = _stacked(given, len(dims) - 1, np) if said.get("named") else given
        result = np.array(given, dtype=np.float64 if pairs else dtype)
    except (AttributeError, OverflowError, TypeError, ValueError) as error:
        raise _WrongKeyError(f"'{where}' is not an array of numbers: {error}") from None
    _refuse(result.ndim == 0, where, "a list", given)
    if pairs and result.size:
        result = np.ascontiguousarray(result).view(np.complex128)[..., 0]
    known = [*result.shape, *(0 for _ in dims)]
    expected = tuple(
        axis if isinstance(axis, int) else lengths.get(axis, n) for axis, n in zip(dims, known, strict=False)
    )
    if result.size == 0:
        return np.zeros(expected or result.shape, dtype)
    if dims and result.shape != expected:
        raise _WrongKeyError(f"'{where}' has the shape {result.shape}, not {expected}")
    return result


def _stacked(given: Any, levels: int, np: Any) -> Any:  # noqa: ANN401
    if not levels or not given:
        return given if not levels else []
    return np.stack([np.asarray(_stacked(v, levels - 1, np), dtype=float) for v in given.values()], axis=1)


def _refuse(wrong: bool, where: str, needed: str, given: object) -> None:  # noqa: FBT001 - a condition
    if wrong:
        raise _WrongKeyError(f"'{where}' must be {needed}, not {json.dumps(given, default=str)[:60]}")


def _number(given: Any, where: str) -> float:  # noqa: ANN401 - of JSON
    _refuse(not (given is None or isinstance(given, int | float)), where, "a number", given)
    try:
        return math.nan if given is None else float(given)
    except OverflowError:  # a whole number of hundreds of digits
        raise _WrongKeyError(f"'{where}' is too large for a number") from None


def _complex(given: Any, where: str) -> complex:  # noqa: ANN401 - of JSON
    if isinstance(given, complex):
        return given
    _refuse(not isinstance(given, Sequence) or len(given) != 2, where, "a pair of numbers", given)
    return complex(*(_number(part, where) for part in given))


def _of(kind: type, needed: str) -> Callable[[Any, str], Any]:
    def check(given: Any, where: str) -> Any:  # noqa: ANN401 - of JSON
        _refuse(not isinstance(given, kind), where, needed, given)
        return given

    return check


_NUMBERS: dict[Any, Any] = {
    bool: bool, int: numbers_of.Integral, float: numbers_of.Real, complex: numbers_of.Complex,
}  # fmt: skip

_SIMPLE: dict[Any, Callable[[Any, str], Any]] = {
    float: _number,
    complex: _complex,
    bool: _of(bool, "true or false"),
    int: _of(int, "a whole number"),
    str: _of(str, "text"),
    Path: lambda given, where: Path(_SIMPLE[str](given, where)),
    NoneType: _of(NoneType, "null"),
}


# -- what is loaded when it is needed ------------------------------------------------------------


def _library(name: str) -> Any:  # noqa: ANN401 - a module
    try:
        return import_module(name)
    except ImportError:
        raise InputError(f"{name} is not installed; pip install {name}") from None
