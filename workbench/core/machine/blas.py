"""One thread for many small matrix products."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Any

__all__ = ["one_thread"]

_BRINGING = ("numpy", "scipy.linalg", "slycot")  # packages that come with a BLAS of their own


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which BLAS and LAPACK work in the calling thread alone, as far as they are loaded by now.

    Factorisations of a few hundred columns gain nothing from more threads; on a machine that has other work they
    wait for each other, and take several times as long.
    """
    limits: AbstractContextManager[Any] = _libraries(*_loaded()).limit(limits=1, user_api="blas")
    return limits


def _loaded() -> list[str]:
    return [name for name in _BRINGING if name in sys.modules]


@lru_cache(maxsize=len(_BRINGING) + 1)
def _libraries(*_: str) -> Any:  # noqa: ANN401 - threadpoolctl is untyped
    """Return what limits the libraries that these packages have brought: a new one, a new look."""
    import threadpoolctl  # noqa: PLC0415  it looks through all loaded libraries

    return threadpoolctl.ThreadpoolController()
