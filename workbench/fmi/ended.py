"""Instances that are closed, and not yet ended: what an FMU does then cannot spoil what is not yet told."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import ClassVar

__all__ = ["are_waiting", "end", "end_later", "end_now"]

_MOST = 768  # instances that wait for their end: a process has 1024 keys of thread-specific data


class _Ended:
    """What this process has closed.

    Attributes:
        most: so many may wait.
        room: whether more may.
        waiting: what terminates and frees each of them.
    """

    most = 0
    room: ClassVar[Callable[[], bool]] = staticmethod(lambda: False)
    waiting: ClassVar[deque[Callable[[], None]]] = deque()


def are_waiting() -> bool:
    """Return whether there are any."""
    return bool(_Ended.waiting)


def end(finish: Callable[[], None]) -> None:
    """End an instance: at once, or later where `end_later` asked for it.

    Args:
        finish: terminates and frees it.
    """
    _Ended.waiting.append(finish)
    count = len(_Ended.waiting)
    if count > _Ended.most and not (count <= _MOST and _Ended.room()):
        end_now(_Ended.most)


def end_later(most: int, room: Callable[[], bool]) -> None:
    """Let instances that are closed wait for `end_now`.

    Args:
        most: so many wait in any case.
        room: whether more may; where not, those that have waited longest are ended.
    """
    _Ended.most, _Ended.room = most, staticmethod(room)


def end_now(but: int = 0) -> None:
    """Terminate and free instances that are closed.

    Args:
        but: so many of the last ones may wait.
    """
    while len(_Ended.waiting) > but:
        _Ended.waiting.popleft()()
