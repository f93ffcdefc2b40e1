"""Locks that survive `fork`: in the copy of a process the thread that held one is not there to let it go."""

from __future__ import annotations

import os
import threading
from contextlib import AbstractContextManager

__all__ = ["forkable_lock"]


def forkable_lock() -> AbstractContextManager[bool]:
    """Return a lock of a module, which its thread may take again; in a copy made by fork nobody holds it."""
    lock = threading.RLock()
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=lock._at_fork_reinit)  # type: ignore[attr-defined]  # noqa: SLF001 - as `logging`
    return lock
