"""Prepared access to variables as the kernel's structures; buffers are those of the façade."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

from workbench.fmi.access import TypeCalls, VariableAccess, decode_flag
from workbench.fmi.access import VariableBlock as Variables
from workbench.fmi.c_array import array_type, c_array
from workbench.kernel.structs import Access as Native
from workbench.kernel.structs import BlockStruct, CType

__all__ = ["indices", "join_access", "native_access", "value_type"]


def indices(values: Sequence[int]) -> ctypes.Array[ctypes.c_size_t]:
    """Return an array of size_t."""
    return c_array(ctypes.c_size_t, values)


def value_type(calls: TypeCalls) -> int:
    """Return the ValueType of one FMI type."""
    if calls.decode is decode_flag:
        return CType.BOOLEAN32 if calls.ctype is ctypes.c_int else CType.BOOLEAN8
    return CType.NUMBERS[calls.ctype]


def native_access(access: VariableAccess, *, columns: Sequence[int], component: int = 0) -> tuple[Native, Any]:
    """Return the structure, and what must live as long as it.

    Args:
        access: the façade's.
        columns: where each variable stands in the caller's list.
        component: number of the FMU in the system.
    """
    pairs = [
        _block(block, [columns[i] for i in order], component)
        for block, order in zip(access.blocks, access.order, strict=True)
    ]
    return _native([block for block, _ in pairs], [access, *(kept for _, kept in pairs)])


def join_access(parts: Sequence[tuple[Native, Any]]) -> tuple[Native, Any]:
    """Return one access to the variables of several components."""
    if len(parts) == 1:
        return parts[0]
    blocks: list[BlockStruct] = []
    for native, _ in parts:
        blocks.extend(array_type(BlockStruct, native.n_blocks).from_address(native.blocks) if native.n_blocks else ())
    return _native(blocks, list(parts))


def _native(blocks: Sequence[BlockStruct], kept: list[Any]) -> tuple[Native, Any]:
    array = c_array(BlockStruct, blocks)
    return Native(ctypes.addressof(array), len(blocks)), (array, kept)


def _block(block: Variables, columns: Sequence[int], component: int) -> tuple[BlockStruct, Any]:
    calls, library = block.calls, block.instance.library
    slots, places = indices(block.slots), indices(columns)
    kind = CType.TICKS if block.counts else value_type(calls)
    contiguous = list(columns) == list(range(columns[0], columns[0] + len(columns)))
    native = BlockStruct(
        get=library.address(calls.getter),
        set=library.address(calls.setter),
        get_name=calls.getter.encode(),
        set_name=calls.setter.encode(),
        references=ctypes.addressof(block.references),
        n_references=len(block.references),
        buffer=ctypes.addressof(block.buffer),
        n_values=len(block.buffer),
        slots=ctypes.addressof(slots),
        columns=ctypes.addressof(places),
        n=len(columns),
        type=kind,
        component=component,
        partial=block.partial,
        plain=block.plain and contiguous and kind == CType.FLOAT64,
    )
    return native, (slots, places)
