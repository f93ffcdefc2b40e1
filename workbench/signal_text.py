"""Signals as text and files have them: what command lines, studies and tables of times and values say."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypeVar

from workbench.core.conversion import named_conversion
from workbench.core.csv_file import is_number
from workbench.core.files import content_of
from workbench.core.forms import Form, pairs, table
from workbench.core.names import split_names
from workbench.errors import InputError, suggest
from workbench.gusts import gust, turbulence
from workbench.signals import Constant, Prbs, Signal, Sine, Step, Table, pulse

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Signals", "Words", "parse_signal", "read_table", "readable", "signal_text", "signals_of"]


class _AnyWord(dict[str, float]):
    """Words that are not known before the model is open: every one, to see whether the rest can be read."""

    def __contains__(self, word: object) -> bool:
        return bool(word) and not set(":=[]") & set(str(word))

    def __missing__(self, word: str) -> float:
        return 0.0


Words = Callable[[str], Mapping[str, float]]
"""Input → what may stand for a number there: items of its enumeration; true and false."""
_NO_WORDS: Mapping[str, float] = MappingProxyType({})
_ANY_WORD = _AnyWord()


def _word(text: str, words: Mapping[str, float]) -> str:
    """Return the word that a text is, in small letters where that is how it is known: "true" for "True"."""
    word = text.strip()
    return word.lower() if word not in words and word.lower() in words else word


def _is_level(text: str, words: Mapping[str, float]) -> bool:
    return is_number(text) or _word(text, words) in words


def _level(text: str, words: Mapping[str, float]) -> float:
    """Return the value that a number or a word stands for; raises ValueError if it is neither."""
    word = _word(text, words)
    return float(words[word]) if word in words and not is_number(word) else float(word)


def read_table(path: str | Path) -> Table:
    """Read a `Table` from a CSV file: time [s] in the first column, value in the second.

    One heading line is allowed, with units in brackets, as in `u [rad]`; separators are comma, semicolon, tab.

    Raises:
        InputError: no such file, not two columns of numbers, or a unit of time that is not known.
    """
    headings, rows = _rows(Path(path))
    return _column(Path(path), headings, rows, 1)


def _rows(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return the headings of a CSV file, with their units, and its rows; no headings: empty."""
    try:
        text = content_of(path).decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text (byte {error.start}); save it as UTF-8") from None
    delimiter = next((d for d in ";\t" if d in text), ",")
    try:
        rows = [row for row in csv.reader(text.splitlines(), delimiter=delimiter) if row]
    except csv.Error as error:
        raise InputError(f"{path}: is not a table of time and value: {error}") from None
    return [] if not rows or is_number(rows[0][0]) else [cell.strip() for cell in rows.pop(0)], rows


def _column(
    path: Path,
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    number: int,
    words: Mapping[str, float] = _NO_WORDS,
) -> Table:
    _, unit = _named(headings[number]) if number < len(headings) else ("", None)
    second = _seconds(path, headings[0]) if headings else 1.0
    try:
        return Table([second * float(r[0]) for r in rows], [_level(r[number], words) for r in rows], unit=unit)
    except (ValueError, IndexError):
        what = "two columns of numbers" if number == 1 else f"numbers in its columns 1 and {number + 1}"
        wrong = next((r[number].strip() for r in rows if number < len(r) and not _is_level(r[number], words)), "")
        if words and wrong:
            raise InputError(
                f"{path}: '{wrong}' is not a value that the input can have; {suggest(wrong, words)}"
            ) from None
        raise InputError(f"{path}: needs {what}, time [s] and value") from None


def _named_columns(name: str, path: Path, words: Words) -> dict[str, Signal]:
    """Return what a CSV file holds for an input: its column, or those of an array's elements.

    A file of two columns holds it whatever they are called.
    """
    headings, rows = _rows(path)
    known = {_named(heading)[0]: number for number, heading in enumerate(headings) if number}
    width = len(headings) or max((len(row) for row in rows), default=0)
    if name in known:
        wanted = {name: known[name]}
    elif not (wanted := {one: number for one, number in known.items() if one.startswith(f"{name}[")}) and width <= 2:
        wanted = {name: 1}
    if wanted:
        return {one: _column(path, headings, rows, number, words(one)) for one, number in wanted.items()}
    which = suggest(name, known) if known else "give it a line of headings"
    raise InputError(f"{path}: none of its {width} columns is called {name}; {which}")


def _named(heading: str) -> tuple[str, str | None]:
    """Return a column's name and unit: "u" and "m" for "u [m]"."""
    name, bracket, unit = heading.rpartition(" [")
    return (name, unit.rstrip("] ").strip() or None) if bracket else (heading, None)


def _seconds(path: Path, heading: str) -> float:
    """Return how many seconds the unit in the heading of the column of times is."""
    _, unit = _named(heading)
    factor, offset = named_conversion(unit or "s", "s") or (0.0, 0.0)
    if not factor or offset:
        raise InputError(f"{path}: the times of '{heading}' do not convert to s; give them in s")
    return factor


_KEYS: Mapping[str, tuple[str, ...]] = {
    "sine": ("amplitude", "frequency", "offset", "phase", "start"),
    "step": ("time", "value", "initial"),
    "prbs": ("hold", "amplitude", "offset", "order", "seed", "start"),
    "pulse": ("duration", "value", "time"),
    "gust": ("duration", "gradient", "speed", "value", "time"),
    "turbulence": ("intensity", "speed", "duration", "length", "step", "seed"),
}


def _sine(k: Mapping[str, float]) -> Signal:
    return Sine(
        frequency=_required("sine", k, "frequency"),
        amplitude=k.get("amplitude", 1.0),
        phase=k.get("phase", 0.0),
        offset=k.get("offset", 0.0),
        start=k.get("start", 0.0),
    )


def _step(k: Mapping[str, float]) -> Signal:
    return Step(
        time=_required("step", k, "time"),
        value=_required("step", k, "value"),
        initial=k.get("initial", 0.0),
    )


def _prbs(k: Mapping[str, float]) -> Signal:
    return Prbs(
        hold=_required("prbs", k, "hold"),
        amplitude=k.get("amplitude", 1.0),
        offset=k.get("offset", 0.0),
        order=_whole("prbs", "order", k.get("order", 11)),
        seed=_whole("prbs", "seed", k.get("seed", 1)),
        start=k.get("start", 0.0),
    )


def _pulse(k: Mapping[str, float]) -> Signal:
    return pulse(time=k.get("time", 0.0), value=k.get("value", 1.0), duration=_required("pulse", k, "duration"))


def _gust(k: Mapping[str, float]) -> Signal:
    return gust(**k)


def _turbulence(k: Mapping[str, float]) -> Signal:
    return turbulence(
        intensity=k.get("intensity", 1.0),
        speed=_required("turbulence", k, "speed"),
        duration=_required("turbulence", k, "duration"),
        length=k.get("length", 762.0),
        step=k.get("step", 0.01),
        seed=_whole("turbulence", "seed", k.get("seed", 1)),
    )


_LEVELS = {"step": ("value", "initial")}  # which of the options may be words
_TABLE, _HOLD, _UNIT = "table", "hold", "unit"
_FILES = (".csv", ".txt")
_MAKERS: Mapping[str, Callable[[Mapping[str, float]], Signal]] = {
    "sine": _sine,
    "step": _step,
    "prbs": _prbs,
    "pulse": _pulse,
    "gust": _gust,
    "turbulence": _turbulence,
}


def _required(kind: str, values: Mapping[str, float], key: str) -> float:
    if key not in values:
        raise InputError(f"{kind}: {key} is missing; write {kind}:{key}=…")
    return values[key]


def _whole(kind: str, key: str, value: float) -> int:
    if not math.isfinite(value) or value != int(value):
        raise InputError(f"{kind}: {key} must be a whole number, not {value:g}")
    return int(value)


def _key_values(kind: str, text: str, words: Mapping[str, float]) -> dict[str, float]:
    values: dict[str, float] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        key, equals, value = (p.strip() for p in part.partition("="))
        if key not in _KEYS[kind]:
            raise InputError(f"{kind}: unknown option '{key}'; {suggest(key, _KEYS[kind])}")
        here = words if key in _LEVELS.get(kind, ()) else _NO_WORDS
        if not equals or not _is_level(value, here):
            other = f"; {suggest(value, here)}" if here else ""
            raise InputError(f"{kind}: {key} needs a number, as in {key}=1.0, not '{value}'{other}")
        values[key] = _level(value, here)
    return values


def parse_signal(text: str, words: Mapping[str, float] = _NO_WORDS) -> Signal:
    """Return the signal that `text` describes.

    Args:
        text: a number, `sine:amplitude=1,frequency=2,offset=0,phase=0`, `step:time=1,value=2`,
            `prbs:hold=0.1,amplitude=1`, `pulse:duration=0.1,value=0.8`, `gust:duration=0.5,value=100`,
            `turbulence:intensity=1.5,speed=250,duration=60`,
            `table:0=0,1=2` (time [s] and value; `hold=1` makes it a staircase, `unit=rad` is that of the values), or
            the name of a CSV file with time and value, with units in its headings or in those of time [s] and input.
        words: what may stand for a number besides, such as the items of an enumeration: alone, in a table, and as
            `value` and `initial` of a step.

    Raises:
        InputError: unknown kind or option, missing option, not a number, no such file.

    Examples:
        >>> wb.parse_signal("sine:amplitude=2,frequency=0.5")
        Sine(amplitude=2.0, frequency=0.5, phase=0.0, offset=0.0, start=0.0)
        >>> wb.parse_signal("step:time=1,initial=Off,value=On", {"Off": 1, "On": 2})
        Step(time=1.0, value=2.0, initial=1.0)
    """
    text = text.strip()
    if is_number(text):
        return Constant(float(text))
    kind, colon, rest = text.partition(":")
    if colon and kind == _TABLE:
        return _table(rest, words)
    if colon and kind in _MAKERS:
        return _MAKERS[kind](_key_values(kind, rest, words))
    if _is_file(text):
        return _column(Path(text), *_rows(Path(text)), 1, words)
    if _is_level(text, words):
        return Constant(_level(text, words))
    if words:
        raise InputError(f"'{text}' is neither a signal nor a value that the input can have; {suggest(text, words)}")
    raise InputError(
        f"'{text}' is not a signal; write a number, a .csv file, or one of "
        + ", ".join([*(f"{k}:{_KEYS[k][0]}=…" for k in _MAKERS), f"{_TABLE}:TIME=VALUE,…"])
    )


def _is_file(text: str) -> bool:
    return text.strip().lower().endswith(_FILES)


# -- several of them ---------------------------------------------------------------------------


def signal_text(signal: Signal) -> str:
    """Return the text that `parse_signal` reads as an equal signal.

    Args:
        signal: any but one that was defined outside of this module.

    Raises:
        InputError: it has no text.

    Examples:
        >>> print(signal_text(wb.Step(time=1.0, value=2.0)))
        step:time=1.0,value=2.0,initial=0.0
    """
    if isinstance(signal, Constant):
        return repr(signal.value)
    if isinstance(signal, Table):
        points = zip(signal.times, signal.values, strict=True)
        hold = [f"{_HOLD}=1"] if signal.interpolate == _HOLD else []
        unit = [f"{_UNIT}={signal.unit}"] if signal.unit else []
        return f"{_TABLE}:{','.join([*(f'{t!r}={x!r}' for t, x in points), *hold, *unit])}"
    kind = type(signal).__name__.lower()
    if kind not in _MAKERS:
        raise InputError(f"a signal of class {type(signal).__name__} cannot be written as text")
    return f"{kind}:{','.join(f'{key}={getattr(signal, key)!r}' for key in _KEYS[kind])}"


def _table(text: str, words: Mapping[str, float]) -> Table:
    """Read TIME=VALUE,.., hold=1 for a staircase, and unit=UNIT of the values."""
    items = [(key.strip(), value.strip()) for key, _, value in (part.partition("=") for part in text.split(","))]
    others = dict(item for item in items if item[0] in (_HOLD, _UNIT))
    points = [item for item in items if item[0] not in others]
    if not all(is_number(t) and _is_level(x, words) for t, x in points):
        wrong = next((x for t, x in points if is_number(t) and x and not _is_level(x, words)), "")
        other = f"; '{wrong}': {suggest(wrong, words)}" if words and wrong else ""
        raise InputError(f"{_TABLE}: '{text}' is not of the form TIME=VALUE,.., as in table:0=0,1=2{other}")
    if (held := others.get(_HOLD, "0")) not in ("0", "1"):
        raise InputError(f"{_TABLE}: '{_HOLD}={held}' is neither {_HOLD}=1, a staircase, nor {_HOLD}=0, straight lines")
    times, values = [float(t) for t, _ in points], [_level(x, words) for _, x in points]
    return Table(times, values, "hold" if held == "1" else "linear", others.get(_UNIT))


_Given: TypeAlias = "Signal | float | str | Sequence[Any] | NDArray[Any]"


def signals_of(given: Mapping[str, _Given], words: Words = lambda _: _NO_WORDS) -> dict[str, Signal]:
    """Return name → signal; those of a whole array by its elements, `u[1]`, `u[2]`.

    Args:
        given: name → a signal, a number, or what `parse_signal` reads; of a whole array a list of such, or a CSV file
            with a column for each element. Of a file with several columns that with the input's name is taken.
        words: input → what may stand for a number; see `parse_signal`.

    Raises:
        InputError: a text that `parse_signal` refuses, or something else.

    Examples:
        >>> signals_of({"u": [1.0, "step:time=1,value=2"]})
        {'u[1]': Constant(value=1.0), 'u[2]': Step(time=1.0, value=2.0, initial=0.0)}
    """
    return _every(given, words, lambda name, value: _signal(name, value, words(name)))


def readable(given: Mapping[str, _Given]) -> dict[str, Signal | str]:
    """Return name → signal as `signals_of` does, but a text with words in it as it is: what they mean a model says.

    Args:
        given: see `signals_of`.

    Raises:
        InputError: a text that is not a signal, whatever its words mean.
    """
    found: dict[str, Signal | str] = {}
    for name, value in given.items():
        try:
            _merge(found, _every({name: value}, lambda _: _NO_WORDS, _left))
        except InputError:
            if not isinstance(value, str) or not _is_file(value):
                raise
            signals_of({name: value}, lambda _: _ANY_WORD)
            _merge(found, {name: value})
    return found


def _left(name: str, value: object) -> Signal | str:
    """Return a signal, or the text whose words have to wait for the model."""
    try:
        return _signal(name, value, _NO_WORDS)
    except InputError:
        if not isinstance(value, str) or _is_file(value):
            raise
        try:
            _signal(name, value, _ANY_WORD)
        except InputError:
            pass
        else:
            return value.strip()
        raise


_T = TypeVar("_T", Signal, "Signal | str")


def _every(given: Mapping[str, _Given], words: Words, leaf: Callable[[str, object], _T]) -> dict[str, _T]:
    found: dict[str, _T] = {}
    for name, value in given.items():
        _merge(found, _signals(name, value, words, leaf))
    return found


def _merge(found: dict[str, _T], more: Mapping[str, _T]) -> None:
    for one, signal in more.items():
        if one in found:
            raise InputError(f"input {one}: is forced twice, by itself and with the whole array")
        found[one] = signal


def _signals(name: str, value: _Given, words: Words, leaf: Callable[[str, object], _T]) -> Mapping[str, _T]:
    if isinstance(value, str):
        text = value.strip()
        if text.startswith("[") and text.endswith("]"):
            return _elements(name, _items(text[1:-1]), words, leaf)
        if _is_file(text) and ":" not in text:
            try:
                return _named_columns(name, Path(text), words)
            except InputError as error:
                raise InputError(f"input {name}: {error}") from None
    elif isinstance(value, Sequence):
        return _elements(name, value, words, leaf)
    elif hasattr(value, "tolist"):  # an array
        return _elements(name, value.tolist(), words, leaf)
    return {name: leaf(name, value)}


def _items(text: str) -> list[str]:
    """Split a whole array at its commas, but not at those inside of a signal.

    A part KEY=VALUE belongs to the signal before it, which is the one with a colon: "1,step:time=1,value=2,3" are
    three. No signal begins with KEY=.
    """
    found: list[str] = []
    for part in split_names(text):
        before, equals, _ = part.partition("=")
        if equals and ":" not in before and found and ":" in found[-1]:
            found[-1] += f",{part}"
        else:
            found.append(part)
    return found


def _elements(name: str, values: Sequence[Any], words: Words, leaf: Callable[[str, object], _T]) -> dict[str, _T]:
    """Return element → signal of a whole array, nested where it has several dimensions."""
    found: dict[str, _T] = {}
    for number, value in enumerate(values, 1):
        begin = f"{name[:-1]},{number}]" if name.endswith("]") else f"{name}[{number}]"
        found.update(_signals(begin, value, words, leaf))
    return found


def _signal(name: str, value: object, words: Mapping[str, float]) -> Signal:
    if isinstance(value, str):
        try:
            return parse_signal(value, words)
        except InputError as error:
            raise InputError(f"input {name}: {error}") from None
    if isinstance(value, Real):
        exact: Any = value
        return Constant(float(Constant(exact).value))  # which says what is no float
    if not isinstance(value, Signal):
        raise InputError(
            f"input {name}: a {type(value).__name__} is not a signal; give a number, a text such as "
            "'step:time=1,value=2', a Table of times and values, or another Signal"
        )
    return value


_SIGNALS = Form(
    metavar="NAME=SIGNAL",
    example="u=step:time=1,value=2",
    read=lambda texts: readable(pairs(texts)),
    write=lambda value: [f"{n}={s if isinstance(s, str) else signal_text(s)}" for n, s in value.items()],
    take=lambda value: readable(table(value)),
    repeated=True,
    files=lambda texts: [value for _, _, value in (text.partition("=") for text in texts) if _is_file(value)],
)

if TYPE_CHECKING:
    Signals = Mapping[str, _Given]
else:
    Signals = Annotated[object, _SIGNALS]
