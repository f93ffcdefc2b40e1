"""Ctrl-C as a wish, not as an exception in the middle of the FMU's code."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Self

__all__ = ["OnInterrupt", "insist_on_interrupts"]

_LATER = 0.05  # [s]


class OnInterrupt:
    """While it is entered, the first Ctrl-C calls `act`, the second one ends at once.

    An exception raised in a callback of the integrator would be swallowed there and spoil the
    numbers; so the work is asked to stop at a place where it can.

    Args:
        act: what to do; must be short.
    """

    def __init__(self, act: Callable[[], None]) -> None:
        self._act = act
        self._before: object = None
        self._active = threading.current_thread() is threading.main_thread()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        self._act()

    def __enter__(self) -> Self:
        if self._active:
            self._before = signal.signal(signal.SIGINT, self._handle)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._active:
            signal.signal(signal.SIGINT, self._before or signal.SIG_DFL)  # type: ignore[arg-type]


def insist_on_interrupts() -> None:
    """Raise a KeyboardInterrupt again where Python drops it: in callbacks of weak references and finalisers.

    Without this, Ctrl-C at such a moment writes a traceback, and the command goes on as if nothing had been said.
    """
    before = sys.unraisablehook

    def hook(what: sys.UnraisableHookArgs) -> None:
        if not issubclass(what.exc_type, KeyboardInterrupt):
            before(what)
            return
        again = threading.Timer(_LATER, _interrupt)  # not here, where it would be dropped, too
        again.daemon = True
        again.start()

    sys.unraisablehook = hook


def _interrupt() -> None:
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, signal.SIGINT)  # also ends what the main thread waits for
    else:  # Windows
        _thread.interrupt_main()
