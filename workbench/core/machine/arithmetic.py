"""How the processor computes in this thread, kept and put back: rounding, denormal numbers, traps.

Libraries compiled with -ffast-math set it when they are loaded, and other native code where it likes; whoever computes
in the thread afterwards computes like that, too.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

__all__ = ["Arithmetic", "kept_arithmetic"]

_SIZE = 256  # larger than any system's fenv_t [byte]


class Arithmetic:
    """The arithmetic of this thread, as it was when this was made; nothing on Windows."""

    def __init__(self) -> None:
        self._kept = ctypes.create_string_buffer(_SIZE)
        if (libc := _functions()) is not None:
            libc.fegetenv(self._kept)

    def put_back(self) -> None:
        """Let the thread compute as it did then."""
        if (libc := _functions()) is not None:
            libc.fesetenv(self._kept)


@contextmanager
def kept_arithmetic() -> Iterator[None]:
    """Leave the arithmetic of this thread as it was, whatever is done inside."""
    before = Arithmetic()
    try:
        yield
    finally:
        before.put_back()


@lru_cache(maxsize=1)
def _functions() -> Any:  # noqa: ANN401 - a library, whose functions ctypes cannot type
    """Return the C library with fegetenv and fesetenv; None where it has none."""
    result = None if sys.platform == "win32" else ctypes.CDLL(None)
    return result if hasattr(result, "fegetenv") and hasattr(result, "fesetenv") else None
