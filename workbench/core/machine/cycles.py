"""The collector of cycles, held off where much is made that has none."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["seldom", "undisturbed"]


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
    gc.set_threshold(50_000, 20, 20)
