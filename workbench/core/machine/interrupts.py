"""Ctrl-C that Python drops, in callbacks of weak references and finalisers, comes again."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Insist", "insisting"]

_LATER = 0.05  # [s]
_LATEST = 1.0  # [s]: by then it has come again, or somebody else has taken it


class Insist:
    """A hook for `sys.unraisablehook` that interrupts the main thread again where a KeyboardInterrupt was dropped.

    Without it, Ctrl-C at such a moment writes a traceback, and the program goes on as if nothing had been said.

    Args:
        before: the hook in place until now, which is told all else.
        wanted: whether the interrupt is to come again.
        renew: is called before it does.
    """

    def __init__(
        self,
        before: Callable[[sys.UnraisableHookArgs], object],
        *,
        wanted: Callable[[], bool] = lambda: True,
        renew: Callable[[], None] = lambda: None,
    ) -> None:
        self.before = before
        self._wanted, self._renew = wanted, renew
        self._waiting = False

    def __call__(self, what: sys.UnraisableHookArgs) -> None:
        if not issubclass(what.exc_type, KeyboardInterrupt) or not self._wanted():
            self.before(what)
            return
        if self._waiting:  # one is on its way
            return
        self._waiting = True
        # Not here, where it would be dropped, too; and without the locks of `threading`, which may be held here.
        _thread.start_new_thread(self._interrupt, ())

    def _interrupt(self) -> None:
        time.sleep(_LATER)
        self._renew()
        main = threading.main_thread().ident
        if hasattr(signal, "pthread_kill") and main is not None:
            signal.pthread_kill(main, signal.SIGINT)  # also ends what the main thread waits for
        else:  # Windows
            _thread.interrupt_main()
        self._waiting = False

    def wait(self) -> None:
        """Wait for an interrupt that is on its way, so that it ends what it was meant for."""
        until = time.monotonic() + _LATEST
        while self._waiting and time.monotonic() < until:
            time.sleep(_LATER)
        # Python raises it between two of its instructions, of which there are some here.


@contextmanager
def insisting() -> Iterator[None]:
    """Let Ctrl-C end what runs in here also where Python drops the first KeyboardInterrupt.

    Nothing changes in other threads, where Python raises none, nor for a signal handler of the user's own.
    """
    before = sys.unraisablehook
    if isinstance(before, Insist) or threading.current_thread() is not threading.main_thread():
        yield
        return
    hook = Insist(before, wanted=lambda: signal.getsignal(signal.SIGINT) is signal.default_int_handler)
    sys.unraisablehook = hook
    try:
        yield
        hook.wait()
    finally:
        if sys.unraisablehook is hook:
            sys.unraisablehook = before
