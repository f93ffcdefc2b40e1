"""One thread for many small matrix products."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Any

__all__ = ["one_thread"]


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which BLAS and LAPACK work in the calling thread alone.

    Factorisations of a few hundred columns gain nothing from more threads; on a machine that has other work they
    wait for each other, and take several times as long.
    """
    limits: AbstractContextManager[Any] = _libraries().limit(limits=1, user_api="blas")
    return limits


@lru_cache(maxsize=1)
def _libraries() -> Any:  # noqa: ANN401 - threadpoolctl is untyped
    import threadpoolctl  # noqa: PLC0415  it looks through all loaded libraries

    return threadpoolctl.ThreadpoolController()
