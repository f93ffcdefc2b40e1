"""One thread for many small matrix products."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from threading import Lock
from typing import Any

__all__ = ["one_thread"]

_BRINGING = ("numpy", "scipy.linalg", "slycot")  # packages that come with a BLAS of their own


@dataclass
class _Hold:
    """What is held to one thread in this process, and for how many contexts that overlap."""

    lock: Lock = field(default_factory=Lock)
    inside: int = 0
    loaded: tuple[str, ...] = ()
    limits: list[Any] = field(default_factory=list)


_HOLD = _Hold()


@contextmanager
def one_thread() -> Iterator[None]:
    """Let BLAS and LAPACK work in the calling thread alone, as far as they are loaded by now.

    Factorisations of a few hundred columns gain nothing from more threads; on a machine that has other work they
    wait for each other, and take several times as long. Contexts may be nested, and overlap in several threads: the
    last one gives the threads back.
    """
    with _HOLD.lock:
        loaded = tuple(name for name in _BRINGING if name in sys.modules)
        if loaded != _HOLD.loaded:
            _HOLD.limits.append(_libraries(loaded).limit(limits=1, user_api="blas"))
            _HOLD.loaded = loaded
        _HOLD.inside += 1  # last: what fails above holds nothing
    try:
        yield
    finally:
        with _HOLD.lock:
            _HOLD.inside -= 1
            while not _HOLD.inside and _HOLD.limits:
                _HOLD.limits.pop().restore_original_limits()
                _HOLD.loaded = ()


@lru_cache(maxsize=len(_BRINGING) + 1)
def _libraries(_: tuple[str, ...]) -> Any:  # noqa: ANN401 - threadpoolctl is untyped
    """Return what limits the libraries that these packages have brought: a new one, a new look."""
    import threadpoolctl  # noqa: PLC0415  it looks through all loaded libraries

    return threadpoolctl.ThreadpoolController()
