"""Signals as the kernel's structures."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from workbench.fmi.c_array import array_type, c_array
from workbench.kernel.structs import PARAMETERS
from workbench.kernel.structs import SignalStruct as Native
from workbench.signals.kinds import Constant, Prbs, Signal, Sine, Step, Table

__all__ = ["Trouble", "native_signal"]

_OF_TIME = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)


class Trouble:
    """Holds the exception that was raised in a callback, where C code lies between it and the caller."""

    def __init__(self) -> None:
        self.error: BaseException | None = None

    def guard(self, function: Callable[[float], float]) -> Callable[[float], float]:
        """Return `function`, which now gives NaN and leaves the exception here."""

        def guarded(t: float) -> float:
            try:
                return float(function(t))
            except BaseException as error:  # noqa: BLE001  raised again by `check`
                self.error = self.error or error
                return math.nan

        return guarded

    def check(self) -> None:
        """Raise what was raised."""
        error, self.error = self.error, None
        if error is not None:
            raise error


def _doubles(values: Sequence[float]) -> ctypes.Array[ctypes.c_double]:
    return c_array(ctypes.c_double, values)


def _constant(s: Constant, _trouble: Trouble) -> tuple[Native, Any]:
    return _plain(0, s.value), None


def _sine(s: Sine, _trouble: Trouble) -> tuple[Native, Any]:
    omega, phi = s._omega, s._phi  # noqa: SLF001  equal to the last bit
    return _plain(1, s.amplitude, omega, phi, s.offset, s.start), None


def _step(s: Step, _trouble: Trouble) -> tuple[Native, Any]:
    return _plain(2, s.time, s.value, s.initial), None


def _prbs(s: Prbs, _trouble: Trouble) -> tuple[Native, Any]:
    native = _plain(3, s.hold, s.amplitude, s.offset, s.start)
    bits = bytes(s.bits())
    kept = ctypes.create_string_buffer(bits, len(bits))
    native.bits, native.n = ctypes.addressof(kept), len(bits)
    return native, kept


def _table(s: Table, _trouble: Trouble) -> tuple[Native, Any]:
    native = _plain(4 if s.interpolate == "linear" else 5)
    times, values = _doubles(s.times), _doubles(s.values)
    native.times, native.values, native.n = ctypes.addressof(times), ctypes.addressof(values), len(times)
    return native, (times, values)


def _python(s: Signal, trouble: Trouble) -> tuple[Native, Any]:
    """A signal that the kernel does not know: two callbacks, slow but right."""
    native = _plain(6)
    calls = _OF_TIME(trouble.guard(s)), _OF_TIME(trouble.guard(s.next_break))
    native.evaluate, native.following = (ctypes.cast(c, ctypes.c_void_p).value for c in calls)
    return native, calls


def _plain(kind: int, *parameters: float) -> Native:
    return Native(kind=kind, p=array_type(ctypes.c_double, PARAMETERS)(*parameters))


_Maker = Callable[[Any, Trouble], tuple[Native, Any]]
_KINDS: Mapping[type[Signal], _Maker] = {
    Constant: _constant,
    Sine: _sine,
    Step: _step,
    Prbs: _prbs,
    Table: _table,
}


def native_signal(signal: Signal, trouble: Trouble) -> tuple[Native, Any]:
    """Return the structure, and what must live as long as it."""
    # The exact type: a subclass may force differently.
    make: _Maker = _KINDS.get(type(signal), _python)
    return make(signal, trouble)
