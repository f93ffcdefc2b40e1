"""The program as a process of its own, for tests that end it; what they wait for is told, not guessed."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

__all__ = ["PATIENCE", "ended", "start", "wait_for"]

ROOT = Path(__file__).resolve().parent.parent

# Nothing takes so long that works, however busy the machine is [s].
PATIENCE = 300.0

# So often is looked [s].
_PAUSE = 0.02


def start(arguments: Sequence[str], **environment: str) -> subprocess.Popen[str]:
    """Start `python` in a process group of its own, the project on its path and its outputs in pipes."""
    return subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        start_new_session=True,
        preexec_fn=_listen,  # noqa: PLW1509 - one call, no locks
    )


def _listen() -> None:
    """Let a closed terminal end the process, also where the tests themselves run under nohup."""
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def wait_for(there: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Wait until something is there that a process makes.

    Raises:
        AssertionError: the process ended before.
    """
    deadline = time.monotonic() + PATIENCE
    while not there():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(_PAUSE)


def ended(pid: int) -> bool:
    """Wait for the end of a process that need not be a child of this one; return whether it came."""
    if not hasattr(os, "pidfd_open"):  # not Linux
        return _ended_at_last(pid)
    try:
        handle = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([handle], [], [], PATIENCE)[0])
    finally:
        os.close(handle)


def _ended_at_last(pid: int) -> bool:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(_PAUSE)
    return False
