"""Forced inputs as the kernel's structures."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

from workbench.fmi.variable import Variable
from workbench.kernel.native_access import join_access, native_access, value_type
from workbench.kernel.native_signals import native_signal
from workbench.kernel.native_system import NativeSystem
from workbench.kernel.structs import Access, Forcing, Signal
from workbench.signals import Signal as PythonSignal

__all__ = ["ForcedInput", "NativeForcing"]

Ports = Sequence[tuple[int, Variable]]  # components, and their variables
ForcedInput = tuple[Variable, PythonSignal, float, Ports]  # variable, signal, bias, what is written


def _array(ctype: type[Any], values: Sequence[object]) -> ctypes.Array[Any]:
    array: ctypes.Array[Any] = (ctype * max(len(values), 1))(*values)
    return array


class NativeForcing:
    """The signals in force; made once for each set of signals.

    Attributes:
        written: what the FMUs see now, in the order of the inputs; an array of c_double.
    """

    def __init__(self, system: NativeSystem, inputs: Sequence[ForcedInput], *, longest_step: float) -> None:
        self._system = system
        self._inputs = inputs
        self._kept: list[Any] = []
        self.n = n = len(inputs)
        discrete = [not variable.is_continuous_input for variable, *_ in inputs]
        self.written = self._keep(ctypes.c_double, [0.0] * n)
        self._signals = self._keep(Signal, [self._signal(i) for i in range(n)])
        self.structure = Forcing(
            signals=ctypes.addressof(self._signals),
            bias=self._address(ctypes.c_double, [bias for _, _, bias, _ in inputs]),
            types=self._address(ctypes.c_int32, [self._type(i) for i in range(n)]),
            owners=self._address(ctypes.c_int32, [ports[0][0] for *_, ports in inputs]),
            discrete=self._address(ctypes.c_int32, [int(d) for d in discrete]),
            written=ctypes.addressof(self.written),
            wanted=self._address(ctypes.c_double, [0.0] * n),
            seen=self._address(ctypes.c_double, [0.0] * n),
            slopes=self._address(ctypes.c_double, [0.0] * n),
            orders=self._address(ctypes.c_int32, [1] * n),
            n=n,
            n_discrete=sum(discrete),
            fast=self._access([i for i in range(n) if not discrete[i]]),
            slow=self._access([i for i in range(n) if discrete[i]]),
            longest_step=longest_step,
        )
        self.address = ctypes.addressof(self.structure)

    def _keep(self, ctype: type[Any], values: Sequence[object]) -> ctypes.Array[Any]:
        array = _array(ctype, values)
        self._kept.append(array)
        return array

    def _address(self, ctype: type[Any], values: Sequence[object]) -> int:
        return ctypes.addressof(self._keep(ctype, values))

    def _signal(self, i: int) -> Signal:
        native, kept = native_signal(self._inputs[i][1], self._system.trouble)
        self._kept.append(kept)
        return native

    def _type(self, i: int) -> int:
        variable, _, _, ports = self._inputs[i]
        owner = next(number for number, found in ports if found.type == variable.type)
        return value_type(self._system.instances[owner].TYPES[variable.type])

    def _access(self, chosen: Sequence[int]) -> Access:
        parts = []
        ports = [(i, owner, variable) for i in chosen for owner, variable in self._inputs[i][3]]
        for owner in dict.fromkeys(number for _, number, _ in ports):
            own = [(i, variable) for i, number, variable in ports if number == owner]
            access = self._system.instances[owner].access([variable for _, variable in own])
            parts.append(native_access(access, columns=[i for i, _ in own], component=owner))
        native, kept = join_access(parts)
        self._kept.append(kept)
        return native

    def apply(self) -> None:
        """Put it in force."""
        self._system.structure.forcing = self.address
