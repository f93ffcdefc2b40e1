"""Signals: what forces an input, as a function of absolute session time [s].

A signal is a frozen value: two equal signals force alike, so a session knows that it may go on
without a restart. Frequencies in Hz, phases in degrees.
"""

from __future__ import annotations

import csv
import math
import sys
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain, pairwise
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from workbench.core.csv_file import is_number
from workbench.core.files import content_of
from workbench.core.forms import Form, pairs, table
from workbench.core.names import split_names
from workbench.errors import InputError, shortened, suggest

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "Constant",
    "Prbs",
    "Signal",
    "Signals",
    "Sine",
    "Step",
    "Table",
    "gust",
    "parse_signal",
    "pulse",
    "signal_text",
    "signals_of",
]


class Signal(ABC):
    """A scalar function of time that forces one input.

    Obligations of a subclass:
      1. `__call__(t)` returns the RIGHT limit at t; it is pure and defined for every finite t.
      2. `next_break(t)` returns the first time > t where the value or the slope jumps, or
         `math.inf`. Between two breaks the signal is smooth. At the returned time
         `__call__` already gives the value after the jump.
      3. `longest_step` is the longest step [s] that cannot overlook the signal's shape.
      4. Equality means "forces alike" (frozen dataclass).
    """

    @abstractmethod
    def __call__(self, t: float) -> float:
        """Return the right limit at time t [s]."""

    @abstractmethod
    def next_break(self, t: float) -> float:
        """Return the next time at which value or slope jumps [s]; `math.inf`: there is none.

        Args:
            t: time after which it is [s].
        """

    @property
    def longest_step(self) -> float:
        """The longest step [s] that still sees the signal's shape; `math.inf`: any."""
        return math.inf


def _finite(owner: str, **values: float) -> None:
    for name, value in values.items():
        if (
            not -math.inf < value < math.inf or abs(value) > sys.float_info.max
        ):  # a whole number may be beyond all floats
            raise InputError(f"{owner}: {name} must be a finite number, not {shortened(str(value))}")


def _positive(owner: str, **values: float) -> None:
    _finite(owner, **values)
    for name, value in values.items():
        if value <= 0.0:
            raise InputError(f"{owner}: {name} must be positive, not {value:g}")


@dataclass(frozen=True)
class Constant(Signal):
    """`value` at all times.

    Attributes:
        value: in the unit of the input.

    Examples:
        >>> print(wb.Constant(2.0)(0.5))
        2.0
    """

    value: float

    def __post_init__(self) -> None:
        _finite("constant", value=self.value)

    def __call__(self, t: float) -> float:
        return self.value

    def next_break(self, t: float) -> float:
        return math.inf


@dataclass(frozen=True, kw_only=True)
class Sine(Signal):
    """offset + amplitude · sin(2π · frequency · (t − start) + phase).

    Attributes:
        amplitude: half the peak-to-peak value.
        frequency: [Hz], positive.
        phase: [deg].
        offset: mean value.
        start: time from which the phase counts [s]; the sine also exists before it.

    Examples:
        >>> print(wb.Sine(amplitude=2.0, frequency=0.5, offset=1.0)(0.5))
        3.0
    """

    amplitude: float = 1.0
    frequency: float
    phase: float = 0.0
    offset: float = 0.0
    start: float = 0.0
    _omega: float = field(init=False, repr=False, compare=False)
    _phi: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        _positive("sine", frequency=self.frequency)
        _finite("sine", amplitude=self.amplitude, phase=self.phase)
        _finite("sine", offset=self.offset, start=self.start)
        object.__setattr__(self, "_omega", 2.0 * math.pi * self.frequency)
        object.__setattr__(self, "_phi", math.radians(self.phase))

    def __call__(self, t: float) -> float:
        return self.offset + self.amplitude * math.sin(self._omega * (t - self.start) + self._phi)

    def next_break(self, t: float) -> float:
        return math.inf

    @property
    def longest_step(self) -> float:
        return 0.125 / self.frequency


@dataclass(frozen=True, kw_only=True)
class Step(Signal):
    """`initial` before `time` [s], `value` from `time` on.

    Attributes:
        time: of the step [s].
        value: from then on, in the unit of the input.
        initial: before, likewise.

    Examples:
        >>> step = wb.Step(time=0.1, value=5.0)
        >>> print(step(0.0), step(0.2))
        0.0 5.0
    """

    time: float
    value: float
    initial: float = 0.0

    def __post_init__(self) -> None:
        _finite("step", time=self.time, value=self.value, initial=self.initial)

    def __call__(self, t: float) -> float:
        return self.value if t >= self.time else self.initial

    def next_break(self, t: float) -> float:
        return self.time if t < self.time else math.inf


_LONGEST_ORDER = 18  # a signal keeps all bits of its period; `excite` takes longer registers


@lru_cache(maxsize=16)
def _register_bits(order: int, seed: int) -> tuple[bool, ...]:
    """One period, 2^order − 1 bits, of the shift register that starts with `seed`."""
    from workbench.shift_register import register_bits  # noqa: PLC0415  numpy is slow

    return tuple(register_bits(order, (1 << order) - 1, state=seed).astype(bool).tolist())


@dataclass(frozen=True, kw_only=True)
class Prbs(Signal):
    """Pseudo-random binary sequence offset ± amplitude from a maximum-length shift register.

    Attributes:
        hold: how long one bit lasts [s].
        amplitude: half the distance of the two levels.
        offset: middle of the two levels.
        order: length of the register, 2 … 18; the sequence repeats after 2^order − 1 bits.
        seed: start value of the register (its lowest `order` bits must not all be 0).
        start: when the first bit begins [s]; before it the sequence runs as if periodic.

    Source: L. Ljung, System Identification, 2nd ed., section 13.3.

    Examples:
        A period of 2³ - 1 bits holds 4 ones.

        >>> signal = wb.Prbs(hold=1.0, order=3, amplitude=1.0)
        >>> print(sum(signal(k + 0.5) > 0 for k in range(7)))
        4
    """

    hold: float
    amplitude: float = 1.0
    offset: float = 0.0
    order: int = 11
    seed: int = 1
    start: float = 0.0

    def __post_init__(self) -> None:
        _positive("prbs", hold=self.hold)
        _finite("prbs", amplitude=self.amplitude, offset=self.offset, start=self.start)
        from workbench.shift_register import TAPS  # noqa: PLC0415  numpy is slow

        if not min(TAPS) <= self.order <= _LONGEST_ORDER:
            raise InputError(f"prbs: order must be {min(TAPS)} … {_LONGEST_ORDER}, not {self.order}")
        if self.seed & ((1 << self.order) - 1) == 0:
            raise InputError(f"prbs: seed {self.seed} leaves the register empty; use 1")

    def _index(self, t: float) -> int:
        i = math.floor((t - self.start) / self.hold)
        # The quotient may round across a bit's border; the border itself decides.
        if self._begin(i + 1) <= t:
            return i + 1
        return i - 1 if self._begin(i) > t else i

    def _begin(self, i: int) -> float:
        return self.start + i * self.hold

    def bits(self) -> tuple[bool, ...]:
        """Return one period of the sequence, True is the upper level; 2^order − 1 bits."""
        return _register_bits(self.order, self.seed)

    def _bit(self, i: int) -> bool:
        bits = self.bits()
        return bits[i % len(bits)]

    def __call__(self, t: float) -> float:
        sign = 1.0 if self._bit(self._index(t)) else -1.0
        return self.offset + sign * self.amplitude

    def next_break(self, t: float) -> float:
        i = self._index(t)
        k = i + 1
        while self._bit(k) == self._bit(i):  # at most `order` equal bits in a row
            k += 1
        return self._begin(k)

    @property
    def longest_step(self) -> float:
        return self.hold


@dataclass(frozen=True)
class Table(Signal):
    """Values over time, held before the first and after the last point.

    Attributes:
        times: shape (n,) [s], not falling; a time given twice is a jump.
        values: shape (n,).
        interpolate: "linear" between the points or "hold" (a staircase).

    Examples:
        >>> print(wb.Table([0.0, 1.0, 2.0], [0.0, 4.0, 4.0])(0.25))
        1.0
    """

    times: Sequence[float]
    values: Sequence[float]
    interpolate: Literal["linear", "hold"] = "linear"

    def __post_init__(self) -> None:
        times = tuple(float(t) for t in self.times)
        values = tuple(float(v) for v in self.values)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)
        if not times or len(times) != len(values):
            raise InputError(f"table: {len(times)} times and {len(values)} values; need equally many")
        if not all(map(math.isfinite, times + values)):
            raise InputError("table: every time and value must be finite")
        for before, after in pairwise(times):
            if after < before:
                raise InputError(f"table: time falls from {before:g} to {after:g} s")
        if self.interpolate not in ("linear", "hold"):
            raise InputError(f"table: interpolate '{self.interpolate}'; known: linear, hold")

    def __call__(self, t: float) -> float:
        i = bisect_right(self.times, t)
        if i == 0:
            return self.values[0]
        if i == len(self.times) or self.interpolate == "hold":
            return self.values[i - 1]
        t0, t1 = self.times[i - 1], self.times[i]
        y0, y1 = self.values[i - 1], self.values[i]
        return y0 + (y1 - y0) * ((t - t0) / (t1 - t0))

    def next_break(self, t: float) -> float:
        i = bisect_right(self.times, t)
        return self.times[i] if i < len(self.times) else math.inf


def pulse(*, time: float = 0.0, value: float = 1.0, duration: float) -> Table:
    """Return a rectangular pulse: `value` from `time` on for `duration`, 0 before and after.

    Args:
        time: when it begins [s].
        value: height of the pulse.
        duration: how long it lasts [s], positive.

    Raises:
        InputError: a value out of range.

    Examples:
        >>> wb.pulse(value=2.0, duration=0.1)
        Table(times=(0.0, 0.0, 0.1, 0.1), values=(0.0, 2.0, 2.0, 0.0), interpolate='linear')
    """
    _positive("pulse", duration=duration)
    _finite("pulse", time=time, value=value)
    end = time + duration
    return Table([time, time, end, end], [0.0, value, value, 0.0])


_GUST_POINTS = 64


def gust(*, time: float = 0.0, value: float = 1.0, duration: float) -> Table:
    """Return the pulse of a discrete gust, value · (1 − cos(2π (t − time)/duration))/2, by 64 straight lines.

    Args:
        time: when it begins [s].
        value: height of the gust, in the middle.
        duration: how long it lasts [s], positive.

    Raises:
        InputError: a value out of range.

    Source: the "1 − cosine" gust of CS-25.341.

    Examples:
        The largest value is in the middle.

        >>> gust = wb.gust(value=3.0, duration=2.0)
        >>> print(gust.times[gust.values.index(3.0)])
        1.0
    """
    _positive("gust", duration=duration)
    _finite("gust", time=time, value=value)
    share = [k / _GUST_POINTS for k in range(_GUST_POINTS + 1)]
    values = [0.5 * value * (1.0 - math.cos(2.0 * math.pi * s)) for s in share]
    return Table([time + s * duration for s in share], values)


def read_table(path: str | Path) -> Table:
    """Read a `Table` from a CSV file: time [s] in the first column, value in the second.

    One heading line is allowed; separators are comma, semicolon, tab.

    Raises:
        InputError: no such file, not two columns of numbers.
    """
    _, rows = _rows(Path(path))
    return _column(Path(path), rows, 1)


def _rows(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return the headings of a CSV file, without units, and its rows; no headings: empty."""
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
    return [] if not rows or is_number(rows[0][0]) else [_bare(cell.strip()) for cell in rows.pop(0)], rows


def _column(path: Path, rows: Sequence[Sequence[str]], number: int) -> Table:
    try:
        return Table([float(r[0]) for r in rows], [float(r[number]) for r in rows])
    except (ValueError, IndexError):
        words = "two columns of numbers" if number == 1 else f"numbers in its columns 1 and {number + 1}"
        raise InputError(f"{path}: needs {words}, time [s] and value") from None


def _named_columns(name: str, path: Path) -> dict[str, Signal]:
    """Return what a CSV file holds for an input: its column, or those of an array's elements.

    A file of two columns holds it whatever they are called.
    """
    headings, rows = _rows(path)
    known = {heading: number for number, heading in enumerate(headings) if number}
    if name in known:
        return {name: _column(path, rows, known[name])}
    if elements := [heading for heading in known if heading.startswith(f"{name}[")]:
        return {heading: _column(path, rows, known[heading]) for heading in elements}
    width = len(headings) or max((len(row) for row in rows), default=0)
    if width <= 2:
        return {name: _column(path, rows, 1)}
    which = suggest(name, known) if known else "give it a line of headings"
    raise InputError(f"{path}: none of its {width} columns is called {name}; {which}")


def _bare(heading: str) -> str:
    """Return a column's name without its unit: "u" for "u [m]"."""
    name, bracket, _ = heading.rpartition(" [")
    return name if bracket else heading


_KEYS: Mapping[str, tuple[str, ...]] = {
    "sine": ("amplitude", "frequency", "offset", "phase", "start"),
    "step": ("time", "value", "initial"),
    "prbs": ("hold", "amplitude", "offset", "order", "seed", "start"),
    "pulse": ("duration", "value", "time"),
    "gust": ("duration", "value", "time"),
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
    return gust(time=k.get("time", 0.0), value=k.get("value", 1.0), duration=_required("gust", k, "duration"))


_TABLE, _HOLD = "table", "hold"
_FILES = (".csv", ".txt")
_MAKERS: Mapping[str, Callable[[Mapping[str, float]], Signal]] = {
    "sine": _sine,
    "step": _step,
    "prbs": _prbs,
    "pulse": _pulse,
    "gust": _gust,
}


def _required(kind: str, values: Mapping[str, float], key: str) -> float:
    if key not in values:
        raise InputError(f"{kind}: {key} is missing; write {kind}:{key}=…")
    return values[key]


def _whole(kind: str, key: str, value: float) -> int:
    if not math.isfinite(value) or value != int(value):
        raise InputError(f"{kind}: {key} must be a whole number, not {value:g}")
    return int(value)


def _key_values(kind: str, text: str) -> dict[str, float]:
    values: dict[str, float] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        key, equals, value = (p.strip() for p in part.partition("="))
        if key not in _KEYS[kind]:
            raise InputError(f"{kind}: unknown option '{key}'; {suggest(key, _KEYS[kind])}")
        if not equals or not is_number(value):
            raise InputError(f"{kind}: {key} needs a number, as in {key}=1.0, not '{value}'")
        values[key] = float(value)
    return values


def parse_signal(text: str) -> Signal:
    """Return the signal that `text` describes.

    Args:
        text: a number, `sine:amplitude=1,frequency=2,offset=0,phase=0`, `step:time=1,value=2`,
            `prbs:hold=0.1,amplitude=1`, `pulse:duration=0.1,value=0.8`, `gust:duration=0.5,value=100`,
            `table:0=0,1=2` (time [s] and value; `hold=1` makes it a staircase), or the name of a CSV file with
            time [s] and value.

    Raises:
        InputError: unknown kind or option, missing option, not a number, no such file.

    Examples:
        >>> wb.parse_signal("sine:amplitude=2,frequency=0.5")
        Sine(amplitude=2.0, frequency=0.5, phase=0.0, offset=0.0, start=0.0)
    """
    text = text.strip()
    if is_number(text):
        return Constant(float(text))
    kind, colon, rest = text.partition(":")
    if colon and kind == _TABLE:
        return _table(rest)
    if colon and kind in _MAKERS:
        return _MAKERS[kind](_key_values(kind, rest))
    if _is_file(text):
        return read_table(text)
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
        return f"{_TABLE}:{','.join([*(f'{t!r}={x!r}' for t, x in points), *hold])}"
    kind = type(signal).__name__.lower()
    if kind not in _MAKERS:
        raise InputError(f"a signal of class {type(signal).__name__} cannot be written as text")
    return f"{kind}:{','.join(f'{key}={getattr(signal, key)!r}' for key in _KEYS[kind])}"


def _table(text: str) -> Table:
    """Read TIME=VALUE,.. and hold=1 for a staircase."""
    items = [(key.strip(), value.strip()) for key, _, value in (part.partition("=") for part in text.split(","))]
    points = [(key, value) for key, value in items if key != _HOLD]
    if not all(map(is_number, chain(*points))):
        raise InputError(f"{_TABLE}: '{text}' is not of the form TIME=VALUE,.., as in table:0=0,1=2")
    held = len(points) < len(items)
    return Table([float(t) for t, _ in points], [float(x) for _, x in points], "hold" if held else "linear")


def signals_of(given: Mapping[str, Signal | float | str | Sequence[Any] | NDArray[Any]]) -> dict[str, Signal]:
    """Return name → signal; those of a whole array by its elements, `u[1]`, `u[2]`.

    Args:
        given: name → a signal, a number, or what `parse_signal` reads; of a whole array a list of such, or a CSV file
            with a column for each element. Of a file with several columns that with the input's name is taken.

    Raises:
        InputError: a text that `parse_signal` refuses, or something else.

    Examples:
        >>> signals_of({"u": [1.0, "step:time=1,value=2"]})
        {'u[1]': Constant(value=1.0), 'u[2]': Step(time=1.0, value=2.0, initial=0.0)}
    """
    found: dict[str, Signal] = {}
    for name, value in given.items():
        for one, signal in _signals(name, value).items():
            if one in found:
                raise InputError(f"input {one}: is forced twice, by itself and with the whole array")
            found[one] = signal
    return found


def _signals(name: str, value: Signal | float | str | Sequence[Any] | NDArray[Any]) -> dict[str, Signal]:
    if isinstance(value, str):
        text = value.strip()
        if text.startswith("[") and text.endswith("]"):
            return _elements(name, split_names(text[1:-1]))
        if _is_file(text) and ":" not in text:
            try:
                return _named_columns(name, Path(text))
            except InputError as error:
                raise InputError(f"input {name}: {error}") from None
    elif isinstance(value, Sequence):
        return _elements(name, value)
    elif hasattr(value, "tolist"):  # an array
        return _elements(name, value.tolist())
    return {name: _signal(name, value)}


def _elements(name: str, values: Sequence[Any]) -> dict[str, Signal]:
    """Return element → signal of a whole array, nested where it has several dimensions."""
    found = {}
    for number, value in enumerate(values, 1):
        for one, signal in _signals(f"{name}[{number}]", value).items():
            found[one.replace("][", ",")] = signal
    return found


def _signal(name: str, value: object) -> Signal:
    if isinstance(value, str):
        try:
            return parse_signal(value)
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
    read=lambda texts: signals_of(pairs(texts)),
    write=lambda value: [f"{name}={signal_text(signal)}" for name, signal in value.items()],
    take=lambda value: signals_of(table(value)),
    repeated=True,
    files=lambda texts: [value for _, _, value in (text.partition("=") for text in texts) if _is_file(value)],
)

if TYPE_CHECKING:
    Signals = Mapping[str, Signal | float | str | Sequence[Any] | NDArray[Any]]
else:
    Signals = Annotated[object, _SIGNALS]
