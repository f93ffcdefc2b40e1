"""Forced inputs as the kernel's structures."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

from workbench.fmi.c_array import c_array
from workbench.fmi.variable import Variable
from workbench.kernel.native_access import join_access, native_access, value_type
from workbench.kernel.native_signals import native_signal
from workbench.kernel.native_system import NativeSystem
from workbench.kernel.structs import Access, ForcingStruct, SignalStruct
from workbench.signals.kinds import Signal

__all__ = ["ForcedInput", "NativeForcing"]

Ports = Sequence[tuple[int, Variable]]  # components, and their variables
ForcedInput = tuple[Variable, Signal, float, Ports]  # variable, signal, bias, what is written


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
        self.signals = self._keep(SignalStruct, [self._signal(i) for i in range(n)])
        biases = [bias for _, _, bias, _ in inputs]
        bias, wanted, seen, slopes = self._columns(ctypes.c_double, biases, *[[0.0] * n] * 3)
        owned = [ports[0][0] for *_, ports in inputs]
        kinds = [self._type(i) for i in range(n)]
        types, owners, held, orders = self._columns(ctypes.c_int32, kinds, owned, discrete, [1] * n)
        self.structure = ForcingStruct(
            signals=ctypes.addressof(self.signals),
            bias=bias,
            types=types,
            owners=owners,
            discrete=held,
            written=ctypes.addressof(self.written),
            wanted=wanted,
            seen=seen,
            slopes=slopes,
            orders=orders,
            n=n,
            n_discrete=sum(discrete),
            fast=self._access([i for i in range(n) if not discrete[i]]),
            slow=self._access([i for i in range(n) if discrete[i]]),
            longest_step=longest_step,
        )
        self.address = ctypes.addressof(self.structure)

    def _keep(self, ctype: type[Any], values: Sequence[object]) -> ctypes.Array[Any]:
        array = c_array(ctype, values)
        self._kept.append(array)
        return array

    def _columns(self, ctype: type[Any], *columns: Sequence[float]) -> list[int]:
        """Keep columns of equal length in one array and return where each begins."""
        array = self._keep(ctype, [value for column in columns for value in column])
        step = len(columns[0]) * ctypes.sizeof(ctype)
        return [ctypes.addressof(array) + i * step for i in range(len(columns))]

    def _signal(self, i: int) -> SignalStruct:
        native, kept = native_signal(self._inputs[i][1], self._system.trouble)
        self._kept.append(kept)
        return native

    def _type(self, i: int) -> int:
        variable, _, _, ports = self._inputs[i]
        owner = next(number for number, result in ports if result.type == variable.type)
        return value_type(self._system.instances[owner].TYPES[variable.type])

    def _access(self, chosen: Sequence[int]) -> Access:
        if not chosen:
            return Access()
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
        self._system.answer(port for v, _, _, ports in self._inputs if v.is_continuous_input for port in ports)
