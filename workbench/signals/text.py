"""Signals as text has them: what command lines and studies say."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypeVar

from workbench.core.records.csv_file import is_number
from workbench.core.records.forms import ONE, Form, by_name, table
from workbench.core.records.names_in_text import split_names
from workbench.core.records.quantity import plain
from workbench.errors import InputError, suggest
from workbench.signals.file import is_file, named_columns, read_table
from workbench.signals.gusts import gust, turbulence
from workbench.signals.kinds import Constant, Prbs, Signal, Sine, Step, Table, check_finite, exactly, pulse
from workbench.signals.numbers import ANYTHING, PLAIN, Meaning, Numbers

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Signals", "parse_signal", "readable", "signal_text", "signals_of"]


_KEYS: Mapping[str, Mapping[str, Meaning]] = {
    "sine": {"amplitude": "change", "frequency": "frequency", "offset": "level", "phase": "phase", "start": "time"},
    "step": {"time": "time", "value": "level", "initial": "level"},
    "prbs": {
        "hold": "time", "amplitude": "change", "offset": "level", "order": "count", "seed": "count", "start": "time",
    },
    "pulse": {"duration": "time", "value": "height", "time": "time"},
    "gust": {"duration": "time", "gradient": "length", "speed": "speed", "value": "height", "time": "time"},
    "turbulence": {
        "intensity": "change", "speed": "speed", "duration": "time", "length": "length", "step": "time",
        "seed": "count",
    },
}  # fmt: skip
_WORDY = ("step",)  # whose values may be words


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


_TABLE, _HOLD, _UNIT = "table", "hold", "unit"
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


def _key_values(kind: str, text: str, numbers: Numbers) -> dict[str, float]:
    known = _KEYS[kind]
    values: dict[str, float] = {}
    before = ""
    for part in filter(None, (p.strip() for p in text.split(","))):
        key, equals, value = (p.strip() for p in part.partition("="))
        if before and not equals and key[:1].isdigit():
            raise InputError(f"{kind}: '{before},{key}' has a comma for its decimals; write {before}.{key}")
        before = part
        if key not in known:
            raise InputError(f"{kind}: unknown option '{key}'; {suggest(key, known)}")
        here = numbers if kind in _WORDY else replace(numbers, words={})
        try:
            values[key] = here.read(value, known[key])
        except InputError as error:
            raise InputError(f"{kind}: {key}: {error}") from None
        except ValueError:
            other = f"; {suggest(value, here.words)}" if here.words and known[key] == "level" else ""
            raise InputError(f"{kind}: {key} needs a number, as in {key}=1.0, not '{value}'{other}") from None
    return values


def parse_signal(text: str | Path, words: Mapping[str, float] = PLAIN.words) -> Signal:
    """Return the signal that `text` describes.

    Args:
        text: a number, `sine:amplitude=1,frequency=2,offset=0,phase=0`, `step:time=1,value=2`,
            `prbs:hold=0.1,amplitude=1`, `pulse:duration=0.1,value=0.8`, `gust:duration=0.5,value=100`,
            `turbulence:intensity=1.5,speed=250,duration=60`,
            `table:0=0,1=2` (time [s] and value; `hold=1` makes it a staircase, `unit=rad` is that of the values), or
            the name of a CSV file with time and value, with units in its headings or in those of time [s] and input.
            Times, frequencies and phases may have other units, as in `time=100ms`, `frequency=3rad/s`, `phase=1rad`;
            values of the input only where the input is known, as in `simulate(model, inputs={"u": "2deg"})`.
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
    return _parsed(str(text), Numbers(words))


def _parsed(text: str, numbers: Numbers) -> Signal:
    text = text.strip()
    kind, colon, rest = text.partition(":")
    if colon and kind == _TABLE:
        return _table(rest, numbers)
    if colon and kind in _MAKERS:
        return _MAKERS[kind](_key_values(kind, rest, numbers))
    if is_file(text):
        return read_table(text, numbers)
    try:
        return Constant(numbers.read(text))
    except ValueError:
        pass
    if numbers.words:
        known = suggest(text, numbers.words)
        raise InputError(f"'{text}' is neither a signal nor a value that the input can have; {known}")
    if colon:
        raise InputError(f"'{kind}:' is not a signal; {suggest(kind, [*_MAKERS, _TABLE])}")
    raise InputError(
        f"'{text}' is not a signal; write a number, a .csv file, or one of "
        + ", ".join([*(f"{k}:{next(iter(_KEYS[k]))}=…" for k in _MAKERS), f"{_TABLE}:TIME=VALUE,…"])
    )


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


def _table(text: str, numbers: Numbers) -> Table:
    """Read TIME=VALUE,.., hold=1 for a staircase, and unit=UNIT of the values that have none."""
    items = [(key.strip(), value.strip()) for key, _, value in (part.partition("=") for part in text.split(","))]
    others = dict(item for item in items if item[0] in (_HOLD, _UNIT))
    points = [item for item in items if item[0] not in others]
    try:
        times = [numbers.read(t, "time") for t, _ in points]
        values = [numbers.read(x) for _, x in points]
    except InputError as error:
        raise InputError(f"{_TABLE}: {error}") from None
    except ValueError:
        wrong = next((x for t, x in points if is_number(t) and x and not numbers.has(x)), "")
        other = f"; '{wrong}': {suggest(wrong, numbers.words)}" if numbers.words and wrong else ""
        raise InputError(f"{_TABLE}: '{text}' is not of the form TIME=VALUE,.., as in table:0=0,1=2{other}") from None
    if _UNIT in others and not all(numbers.has(x) for _, x in points):
        raise InputError(f"{_TABLE}: give the unit once, as {_UNIT}={others[_UNIT]} or beside the values")
    if (held := others.get(_HOLD, "0")) not in ("0", "1"):
        raise InputError(f"{_TABLE}: '{_HOLD}={held}' is neither {_HOLD}=1, a staircase, nor {_HOLD}=0, straight lines")
    return Table(times, values, "hold" if held == "1" else "linear", others.get(_UNIT))


_Reading: TypeAlias = Callable[[str], Numbers]
_Given: TypeAlias = "Signal | float | str | Path | Sequence[Any] | NDArray[Any]"


def _as_text(value: Any) -> Any:  # noqa: ANN401 - what a caller gives for a signal
    """Return the name of a file as text; others as they are."""
    return str(value) if isinstance(value, PurePath) else value


def signals_of(given: Mapping[str, _Given], numbers: _Reading = lambda _: PLAIN) -> dict[str, Signal]:
    """Return name → signal; those of a whole array by its elements, `u[1]`, `u[2]`.

    Args:
        given: name → a signal, a number, or what `parse_signal` reads; of a whole array a list of such, or a CSV file
            with a column for each element. Of a file with several columns that with the input's name is taken.
        numbers: input → how the numbers in its text are read.

    Raises:
        InputError: a text that `parse_signal` refuses, or something else.

    Examples:
        >>> signals_of({"u": [1.0, "step:time=1,value=2"]})
        {'u[1]': Constant(value=1.0), 'u[2]': Step(time=1.0, value=2.0, initial=0.0)}
    """
    return _every(given, numbers, lambda name, value: _signal(name, value, numbers(name)))


def readable(given: Mapping[str, _Given]) -> dict[str, Signal | str]:
    """Return name → signal as `signals_of` does, but a text with words or units as it is: a model says what they mean.

    Args:
        given: see `signals_of`.

    Raises:
        InputError: a text that is not a signal, whatever its words and units mean.
    """
    result: dict[str, Signal | str] = {}
    for name, value in ((name, _as_text(value)) for name, value in given.items()):
        try:
            _merge(result, _every({name: value}, lambda _: PLAIN, _left))
        except InputError:
            if not isinstance(value, str) or not is_file(value):
                raise
            signals_of({name: value}, lambda _: ANYTHING)
            _merge(result, {name: value})
    return result


def _left(name: str, value: object) -> Signal | str:
    """Return a signal, or the text whose words or units have to wait for the model."""
    try:
        return _signal(name, value, PLAIN)
    except InputError:
        if not isinstance(value, str) or is_file(value):
            raise
        _signal(name, value, ANYTHING)
        return value.strip()


_T = TypeVar("_T", Signal, "Signal | str")


def _every(given: Mapping[str, _Given], numbers: _Reading, leaf: Callable[[str, object], _T]) -> dict[str, _T]:
    result: dict[str, _T] = {}
    for name, value in given.items():
        _merge(result, _signals(name, value, numbers, leaf))
    return result


def _merge(result: dict[str, _T], more: Mapping[str, _T]) -> None:
    for one, signal in more.items():
        if one in result:
            raise InputError(f"input {one}: is forced twice, by itself and with the whole array")
        result[one] = signal


def _signals(name: str, value: _Given, numbers: _Reading, leaf: Callable[[str, object], _T]) -> Mapping[str, _T]:
    value = _as_text(plain(value))
    if isinstance(value, str):
        text = value.strip()
        if text.startswith("[") and text.endswith("]"):
            return _elements(name, _items(text[1:-1]), numbers, leaf)
        if is_file(text) and ":" not in text:
            try:
                return named_columns(name, Path(text), numbers)
            except InputError as error:
                raise InputError(f"input {name}: {error}") from None
    elif isinstance(value, Sequence):
        return _elements(name, value, numbers, leaf)
    elif hasattr(value, "tolist"):  # an array
        return _elements(name, value.tolist(), numbers, leaf)
    return {name: leaf(name, value)}


def _items(text: str) -> list[str]:
    """Split a whole array at its commas, but not at those inside of a signal.

    A part KEY=VALUE belongs to the signal before it, which is the one with a colon: "1,step:time=1,value=2,3" are
    three. No signal begins with KEY=.
    """
    result: list[str] = []
    for part in split_names(text):
        before, equals, _ = part.partition("=")
        if equals and ":" not in before and result and ":" in result[-1]:
            result[-1] += f",{part}"
        else:
            result.append(part)
    return result


def _elements(name: str, values: Sequence[Any], numbers: _Reading, leaf: Callable[[str, object], _T]) -> dict[str, _T]:
    """Return element → signal of a whole array, nested where it has several dimensions."""
    result: dict[str, _T] = {}
    for number, value in enumerate(values, 1):
        begin = f"{name[:-1]},{number}]" if name.endswith("]") else f"{name}[{number}]"
        result.update(_signals(begin, value, numbers, leaf))
    return result


def _signal(name: str, value: object, numbers: Numbers) -> Signal:
    if isinstance(value, str):
        try:
            return _parsed(value, numbers)
        except InputError as error:
            raise InputError(f"input {name}: {error}") from None
    if isinstance(value, Real):
        exact: Any = value
        check_finite(f"input {name}", value=exact)
        return Constant(exactly(exact))
    if not isinstance(value, Signal):
        raise InputError(
            f"input {name}: a {type(value).__name__} is not a signal; give a number, a text such as "
            "'step:time=1,value=2', a Table of times and values, or another Signal"
        )
    return value


_SIGNALS = Form(
    metavar="NAME=SIGNAL",
    example="u=step:time=1,value=2",
    read=lambda value: readable(table(value)),
    layout=by_name(replace(ONE, join=lambda signal: [signal if isinstance(signal, str) else signal_text(signal)])),
    items=("string", "number"),
    repeated=True,
    files=lambda texts: [value for _, _, value in (text.partition("=") for text in texts) if is_file(value)],
)

if TYPE_CHECKING:
    Signals = Mapping[str, _Given]
else:
    Signals = Annotated[object, _SIGNALS]
