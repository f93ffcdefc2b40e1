"""The signals by which a person or the system asks a program to end, and what a command returns then."""

from __future__ import annotations

import signal

__all__ = ["ENDING", "INTERRUPTED"]

# Ctrl-C; the system or a batch queue; a terminal that is closed; Ctrl-Break on Windows.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")

ENDING: tuple[signal.Signals, ...] = tuple(getattr(signal, name) for name in _NAMES if hasattr(signal, name))
"""Those that this platform has, Ctrl-C first."""

INTERRUPTED = 130
"""What a command returns that was interrupted, whichever signal it was; the process adds which."""
