"""Prepared reading and writing of a fixed list of variables through preallocated buffers."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, Protocol

from workbench.errors import InputError
from workbench.fmi.c_array import array_type
from workbench.fmi.variable import NEGATED, Value, Variable

if TYPE_CHECKING:
    from workbench.fmi.description import ModelDescription
    from workbench.fmi.library import Library

__all__ = ["TypeCalls", "VariableAccess", "VariableBlock", "is_good", "laid_out"]

_WARNING = 1


def is_good(status: int) -> bool:
    """Return whether a status of FMI is "OK" or "warning"; an FMU may return any number."""
    return 0 <= status <= _WARNING


def _same(value: Any) -> Any:
    return value


def _utf8(raw: bytes | None) -> str:
    return (raw or b"").decode("utf-8", "replace")


def decode_flag(raw: Any) -> bool:
    """Return a Boolean from what C gave: number, bool, or one byte (FMI 1.0)."""
    return raw not in (0, False, b"\0")


@dataclass(frozen=True)
class TypeCalls:
    """How one FMI type is read and written.

    Attributes:
        getter, setter: function names.
        ctype: C type of one value.
        decode, encode: C value → Python value and back.
    """

    getter: str
    setter: str
    ctype: Any
    decode: Callable[[Any], Any] = _same
    encode: Callable[[Any], Any] = _same

    @classmethod
    def text(cls, getter: str, setter: str) -> TypeCalls:
        """Return the calls for strings."""
        return cls(getter, setter, ctypes.c_char_p, _utf8, lambda s: str(s).encode())


class _InstanceCalls(Protocol):
    """What is needed of an instance to read and write its variables."""

    TYPES: ClassVar[Mapping[str, TypeCalls]]
    version: ClassVar[int]
    description: ModelDescription
    library: Library
    component: Any

    @property
    def ticks_so_far(self) -> tuple[Any, Mapping[str, int]] | None: ...

    def fail(self, name: str, status: int) -> NoReturn: ...


class VariableBlock:
    """Variables of one type: one C call reads or writes them all.

    Attributes:
        calls, instance: how, and of which instance, they are read and written.
        slots: where in `buffer` each of them stands.
        plain: whether they are the whole buffer, in its order, and need no decoding.
        buffer, references: C arrays of the values and of the value references.
        partial: whether the buffer holds array elements that are none of them.
        counts: whether they are clocks, whose ticks so far stand in `buffer`: the FMU is not asked.
    """

    counts = False

    def __init__(self, instance: _InstanceCalls, calls: TypeCalls, variables: Sequence[Variable]) -> None:
        references, self.slots, total = laid_out(instance.description.shapes, variables)
        self.calls = calls
        self.instance = instance
        self.plain = self.slots == list(range(total)) and calls.decode is _same
        self.buffer: Any = array_type(calls.ctype, total)()
        self.references: Any = array_type(ctypes.c_uint, len(references))(*references)
        # FMI 3.0 functions also take the number of values, which differs for arrays.
        tail = (total,) if instance.version == 3 else ()
        self.arguments = (self.references, len(references), self.buffer, *tail)
        self.partial = len(self.slots) < total
        library = instance.library
        self.get = library[calls.getter]
        self.set = library[calls.setter]

    def read(self) -> list[Any]:
        status = self.get(self.instance.component, *self.arguments)
        if not is_good(status):
            self.instance.fail(self.calls.getter, status)
        if self.plain:
            return self.buffer[:]  # type: ignore[no-any-return]
        return [self.calls.decode(self.buffer[s]) for s in self.slots]

    def write(self, values: Sequence[Any]) -> None:
        if self.partial:  # the other elements of an array keep what they have, which others may have written since
            self.read()
        if self.plain:
            self.buffer[:] = values
        else:
            for slot, value in zip(self.slots, values, strict=True):
                self.buffer[slot] = self.calls.encode(value)
        status = self.set(self.instance.component, *self.arguments)
        if not is_good(status):
            self.instance.fail(self.calls.setter, status)


class ClockTicks(VariableBlock):
    """Clocks: how often each has ticked so far."""

    counts = True

    def __init__(self, instance: _InstanceCalls, variables: Sequence[Variable]) -> None:  # no FMI function reads it
        result = instance.ticks_so_far
        if result is None:
            raise InputError(f"{variables[0].name}: clocks tick in event mode, which this interface does not have")
        self.calls = TypeCalls("", "", ctypes.c_double)
        self.instance, (self.buffer, places) = instance, result
        self.slots = [places[v.name] for v in variables]
        self.references: Any = array_type(ctypes.c_uint, 1)()
        self.plain = self.partial = False

    def read(self) -> list[Any]:
        return [self.buffer[s] for s in self.slots]

    def write(self, values: Sequence[Any]) -> None:
        raise InputError("clocks cannot be set")


def laid_out(shapes: Mapping[int, tuple[int, ...]], variables: Sequence[Variable]) -> tuple[list[int], list[int], int]:
    """Return the value references of variables, each once, where their values stand, and how many values there are.

    Arrays are taken as wholes: all their elements stand there, whatever of them is in `variables`.

    Args:
        shapes: value reference → shape, of arrays.
        variables: in any order.
    """
    references = list(dict.fromkeys(v.value_reference for v in variables))
    offsets, total = {}, 0
    for reference in references:
        offsets[reference] = total
        total += _size(shapes, reference)
    return references, [offsets[v.value_reference] + v.element for v in variables], total


def _size(shapes: Mapping[int, tuple[int, ...]], reference: int) -> int:
    size = 1
    for extent in shapes.get(reference, ()):
        size *= extent
    return size


class VariableAccess:
    """Reading and writing a fixed list of variables.

    `read` returns values in the list's order; `write` takes them so. Lists of one type only, the
    usual case inside an integration, cost one C call.

    Attributes:
        blocks: one for each C function.
        order: for each block, where its variables stand in the list.
    """

    def __init__(self, instance: _InstanceCalls, variables: Sequence[Variable]) -> None:
        self.variables = tuple(variables)
        groups: dict[str, list[int]] = {}
        for i, variable in enumerate(self.variables):
            groups.setdefault(_getter(instance, variable), []).append(i)
        self.order = list(groups.values())
        self.blocks = [_block(instance, [self.variables[i] for i in indices]) for indices in self.order]

    def read(self) -> list[Any]:
        """Return the present values."""
        if len(self.blocks) == 1:
            return self.blocks[0].read()
        values: list[Any] = [None] * len(self.variables)
        for block, indices in zip(self.blocks, self.order, strict=True):
            for i, value in zip(indices, block.read(), strict=True):
                values[i] = value
        return values

    def write(self, values: Sequence[Value]) -> None:
        """Set the variables."""
        if len(self.blocks) == 1:
            self.blocks[0].write(values)
            return
        for block, indices in zip(self.blocks, self.order, strict=True):
            block.write([values[i] for i in indices])


def _block(instance: _InstanceCalls, variables: Sequence[Variable]) -> VariableBlock:
    """Return the block of variables that one function reads."""
    kind = variables[0].type
    return (
        ClockTicks(instance, variables) if kind == _CLOCK else VariableBlock(instance, instance.TYPES[kind], variables)
    )


_CLOCK = "Clock"


def _getter(instance: _InstanceCalls, variable: Variable) -> str:
    if variable.type == _CLOCK:
        return _CLOCK
    calls = instance.TYPES.get(variable.type)
    if calls is None:
        hint = ", which are only listed; use the one that it is minus of" if variable.type.startswith(NEGATED) else ""
        raise InputError(f"{variable.name}: variables of type {variable.type} are not supported{hint}")
    return calls.getter
