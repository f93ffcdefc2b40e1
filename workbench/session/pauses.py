"""Places in a run at which Python is asked: to tell how far it is, or to end it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["at_pauses", "pause"]

_listening: list[Callable[[float], None]] = []  # to the pauses of runs under way


@contextmanager
def at_pauses(call: Callable[[float], None]) -> Iterator[None]:
    """Call a function now and then while sessions advance; what it raises ends the run.

    Args:
        call: is given the session time [s].
    """
    _listening.append(call)
    try:
        yield
    finally:
        _listening.remove(call)


def pause(time: float) -> None:
    """Call those functions.

    Args:
        time: session time [s].
    """
    for call in _listening:
        call(time)
