"""C arrays for ctypes calls."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

__all__ = ["array_type", "c_array"]


@lru_cache(maxsize=256)
def array_type(ctype: Any, length: int) -> type[ctypes.Array[Any]]:
    """Return the type of C arrays of `length` values.

    ctypes forgets such a type with its last array, and making it again takes longer than all else that is
    done with a short array.
    """
    wanted: type[ctypes.Array[Any]] = ctype * length
    return wanted


def c_array(ctype: Any, values: Sequence[object]) -> ctypes.Array[Any]:
    """Return a C array of `values`; of one element where there are none, so that it has an address."""
    return array_type(ctype, max(len(values), 1))(*values)
