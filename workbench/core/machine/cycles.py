"""The collector of cycles, held off where much is made that has none, or all ends."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["never_again", "seldom", "undisturbed"]

# A command has imported up to 80 000 objects that could be in a cycle, and none is; a look at them takes 10 ms.
_IMPORTED = 100_000


@contextmanager
def undisturbed() -> Iterator[None]:
    """Hold the collector of cycles off, which would look through all that is made, again and again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def seldom() -> None:
    """Let the collector look less often, in a process of our own: a tenth of its start went to looks for nothing."""
    gc.set_threshold(_IMPORTED, 20, 20)


def never_again() -> None:
    """Let the collector look at nothing that there is: the process ends, and Python would look through all of it."""
    gc.freeze()
