"""Signals: what forces an input, as a function of absolute session time [s].

A signal is a frozen value: two equal signals force alike, so a session knows that it may go on
without a restart. Frequencies in Hz, phases in degrees.
"""

from __future__ import annotations

import math
import sys
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, wraps
from inspect import signature
from itertools import pairwise
from numbers import Integral, Real
from typing import Any, ClassVar, Literal, TypeVar

from workbench.core.records.quantity import plain
from workbench.errors import InputError, shortened

__all__ = [
    "Constant",
    "Prbs",
    "Signal",
    "Sine",
    "Step",
    "Table",
    "check_finite",
    "check_positive",
    "check_whole",
    "exactly",
    "levels_of",
    "pulse",
]


_Kind = TypeVar("_Kind", bound="Signal")


class Signal(ABC):
    """A scalar function of time that forces one input.

    Obligations of a subclass:
      1. `__call__(t)` returns the RIGHT limit at t; it is pure and defined for every finite t.
      2. `next_break(t)` returns the first time > t where the value or the slope jumps, or
         `math.inf`. Between two breaks the signal is smooth. At the returned time
         `__call__` already gives the value after the jump.
      3. `longest_step` is the longest step [s] that cannot overlook the signal's shape.
      4. Equality means "forces alike" (frozen dataclass).

    Attributes:
        repr_is_code: whether its `repr`, after `wb.`, makes it again.
    """

    repr_is_code: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Take Python's numbers in place of NumPy's."""
        for name, value in list(vars(self).items()):
            object.__setattr__(self, name, plain(value))

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


def _by_name(kind: type[_Kind]) -> type[_Kind]:
    """Have a class that takes its values by name say so where they are given without."""
    made = kind.__init__

    @wraps(made)
    def init(self: _Kind, *unnamed: object, **named: Any) -> None:  # noqa: ANN401 - of any field
        if unnamed:
            names = ", ".join(f"{name}=…" for name in signature(kind).parameters)
            raise TypeError(f"{kind.__name__} takes its values by name: wb.{kind.__name__}({names})")
        made(self, **named)

    kind.__init__ = init  # type: ignore[method-assign, assignment]
    return kind


def exactly(value: Any) -> float:  # noqa: ANN401 - a real number of any class
    """Return a number; a whole one that no float is stays whole, and the input that it is for says whether it may.

    Args:
        value: the number, not beyond all floats.
    """
    number = float(value)
    return int(value) if isinstance(value, Integral) and int(value) != number else number


def levels_of(signal: Signal) -> tuple[float, ...]:
    """Return the values of a signal that has few; empty: it has others."""
    if isinstance(signal, Constant):
        return (signal.value,)
    if isinstance(signal, Step):
        return signal.initial, signal.value
    return tuple(signal.values) if isinstance(signal, Table) else ()


def check_finite(owner: str, **values: float) -> None:
    """Refuse what is not a finite number, in the words of the signal that it is for."""
    for name, value in values.items():
        if not isinstance(plain(value), Real):
            raise InputError(f"{owner}: {name} must be a number, not {shortened(repr(value))}")
        if (
            not -math.inf < value < math.inf or abs(value) > sys.float_info.max
        ):  # a whole number may be beyond all floats
            raise InputError(f"{owner}: {name} must be a finite number, not {shortened(str(value))}")


def check_positive(owner: str, **values: float) -> None:
    """Refuse numbers that are not finite and positive, in the words of the signal that they are for."""
    check_finite(owner, **values)
    for name, value in values.items():
        if value <= 0.0:
            raise InputError(f"{owner}: {name} must be positive, not {value:g}")


def check_whole(owner: str, **values: object) -> None:
    """Refuse what is not a whole number, in the words of the signal that it is for."""
    for name, value in values.items():
        if not isinstance(value, Integral):
            raise InputError(f"{owner}: {name} must be a whole number, not {shortened(repr(value))}")


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
        super().__post_init__()
        check_finite("constant", value=self.value)

    def __call__(self, t: float) -> float:
        return self.value

    def next_break(self, t: float) -> float:
        return math.inf


@_by_name
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
        super().__post_init__()
        check_positive("sine", frequency=self.frequency)
        check_finite("sine", amplitude=self.amplitude, phase=self.phase)
        check_finite("sine", offset=self.offset, start=self.start)
        object.__setattr__(self, "_omega", 2.0 * math.pi * self.frequency)
        object.__setattr__(self, "_phi", math.radians(self.phase))

    def __call__(self, t: float) -> float:
        return self.offset + self.amplitude * math.sin(self._omega * (t - self.start) + self._phi)

    def next_break(self, t: float) -> float:
        return math.inf

    @property
    def longest_step(self) -> float:
        return 0.125 / self.frequency


@_by_name
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
        super().__post_init__()
        check_finite("step", time=self.time, value=self.value, initial=self.initial)

    def __call__(self, t: float) -> float:
        return self.value if t >= self.time else self.initial

    def next_break(self, t: float) -> float:
        return self.time if t < self.time else math.inf


_LONGEST_ORDER = 18  # a signal keeps all bits of its period; `excite` takes longer registers


@lru_cache(maxsize=16)
def _register_bits(order: int, seed: int) -> tuple[bool, ...]:
    """One period, 2^order − 1 bits, of the shift register that starts with `seed`."""
    from workbench.signals.shift_register import register_bits  # noqa: PLC0415  numpy is slow

    return tuple(register_bits(order, (1 << order) - 1, state=seed).astype(bool).tolist())


@_by_name
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
        super().__post_init__()
        check_positive("prbs", hold=self.hold)
        check_finite("prbs", amplitude=self.amplitude, offset=self.offset, start=self.start)
        from workbench.signals.shift_register import TAPS  # noqa: PLC0415  numpy is slow

        check_whole("prbs", order=self.order, seed=self.seed)
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


def _column(name: str, given: Any) -> tuple[float, ...]:  # noqa: ANN401 - what Python holds
    """Return the numbers of a table's column; a text, or a column of a matrix, is refused."""
    shape = getattr(given, "shape", None)
    if shape is not None and len(shape) != 1:
        raise InputError(f"table: {name} has the shape {tuple(shape)}; give one number for each time, as in [0, 1]")
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise InputError(f"table: {name} must be a list of numbers, not {shortened(repr(given))}")
    items = tuple(map(plain, given))
    for x in items:
        if not isinstance(x, Real):
            raise InputError(f"table: {name} must be numbers, not {shortened(repr(x))}")
    try:
        return tuple(map(exactly, items))
    except OverflowError:
        raise InputError("table: every time and value must be finite") from None


@dataclass(frozen=True)
class Table(Signal):
    """Values over time, held before the first and after the last point.

    Attributes:
        times: shape (n,) [s], not falling; a time given twice is a jump.
        values: shape (n,).
        interpolate: "linear" between the points or "hold" (a staircase).
        unit: of the values; None: that of the input which they force. Analyses convert.

    Examples:
        >>> print(wb.Table([0.0, 1.0, 2.0], [0.0, 4.0, 4.0])(0.25))
        1.0
    """

    times: Sequence[float]
    values: Sequence[float]
    interpolate: Literal["linear", "hold"] = "linear"
    unit: str | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        times, values = tuple(map(float, _column("times", self.times))), _column("values", self.values)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)
        if not times and not values:
            raise InputError("table: is empty; give at least one time and its value")
        if len(times) != len(values):
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
    time, value, duration = map(plain, (time, value, duration))
    check_positive("pulse", duration=duration)
    check_finite("pulse", time=time, value=value)
    end = time + duration
    return Table([time, time, end, end], [0.0, value, value, 0.0])
