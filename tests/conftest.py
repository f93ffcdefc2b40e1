"""What holds for all tests."""

from __future__ import annotations

import signal

from tests.drivers import driver

__all__ = ["driver"]

# A shell starts background jobs with SIGINT ignored, and their children inherit that; tests that interrupt would
# then wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
