"""Ctrl-C and the system's requests to end as a wish, not as an exception in the middle of the FMU's code."""

from __future__ import annotations

import _thread
import atexit
import math
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import FrameType, TracebackType
from typing import Any, NoReturn, Self

from workbench.core.machine.interrupts import Insist
from workbench.jobs.end_signals import ENDING

__all__ = [
    "OnInterrupt",
    "end",
    "exit_code",
    "ignore_endings",
    "insist_on_interrupts",
    "interrupted",
    "listen_for_endings",
    "was_interrupted",
]

_LATER = 0.05  # [s]

# Signals that follow so soon are one wish: `timeout` and batch queues tell the process, and then its whole group [s].
_ONE_WISH = 1.0

_STANDARD_OUTPUT, _STANDARD_ERROR = 1, 2

# Longest time that an FMU's code in this process may run before Python hears of a signal [s].
_PATIENCE = 5.0


class OnInterrupt:
    """While it is entered, the first Ctrl-C (or SIGTERM, SIGHUP) calls `act`, the second one ends at once.

    An exception raised in a callback of the integrator would be swallowed there and spoil the
    numbers; so the work is asked to stop at a place where it can.

    It is left when what there is was written: between the work and that a signal must not lose the result.

    Args:
        act: what to do; must be short.

    Attributes:
        came: whether one was heard.
        act: see above; another one may be put in its place.
    """

    def __init__(self, act: Callable[[], None] = lambda: None) -> None:
        self.came, self.act = False, act
        self._before: dict[signal.Signals, Any] = {}
        self._active = threading.current_thread() is threading.main_thread()

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        _hear(number)
        self.came = True
        for listened in self._before:
            signal.signal(listened, _end_at_once)
        self.act()

    def __enter__(self) -> Self:
        if self._active:
            known = {number: signal.getsignal(number) for number in ENDING}
            self._before = {n: before for n, before in known.items() if before in _OURS}
            for number in self._before:
                signal.signal(number, self._handle)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)


# -- every signal that asks to end ---------------------------------------------------------------


class _Heard:
    """What this process heard of such signals.

    Attributes:
        first: the first of them; None: none yet.
        last: when Python heard the last one (`time.monotonic`).
        terminals: of standard output and error, those that are terminals.
    """

    first: int | None = None
    last = -math.inf
    terminals: tuple[int, ...] = ()


def _hear(number: int) -> None:
    _Heard.last = time.monotonic()
    _Heard.first = _Heard.first or number
    for stream in _Heard.terminals:
        if not os.isatty(stream):  # it was closed: writing there would fail, before the files are written
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    _Heard.terminals = tuple(filter(os.isatty, _Heard.terminals))


def _end_at_once(number: int, _frame: FrameType | None) -> None:
    before = _Heard.last
    _hear(number)
    if _Heard.last - before > _ONE_WISH:
        raise KeyboardInterrupt


_OURS = (signal.default_int_handler, _end_at_once)


def was_interrupted() -> bool:
    """Return whether this process was asked to end."""
    return _Heard.first is not None


def ignore_endings() -> None:
    """Hear no more of such signals: the process ends."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)


def end(code: int) -> NoReturn:
    """End the process with this code.

    Where the signal came while Python ran code that was made of text, as that of a dataclass, it would end the process
    by SIGINT in place of the code, even though the exception was caught.

    Args:
        code: exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    atexit._run_exitfuncs()  # noqa: SLF001 - temporary folders, worker processes
    os._exit(code)


def interrupted() -> str:
    """Return "interrupted", and by which signal if it was not Ctrl-C."""
    number = _Heard.first or signal.SIGINT
    return "interrupted" if number == signal.SIGINT else f"interrupted by {signal.Signals(number).name}"


def exit_code() -> int:
    """Return the exit code of a process that was interrupted: 128 + the signal's number."""
    return 128 + (_Heard.first or signal.SIGINT)


def listen_for_endings() -> None:
    """Let SIGTERM and SIGHUP (on Windows Ctrl-Break) end a command as Ctrl-C does, where they are not ignored.

    Python hears of a signal when the code of an FMU that runs in this process returns. If it does not, the process is
    ended all the same, without a result.
    """
    _Heard.terminals = tuple(filter(os.isatty, (_STANDARD_OUTPUT, _STANDARD_ERROR)))
    for number in ENDING:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):  # not ignored, as under nohup
            signal.signal(number, _end_at_once)
    ear, mouth = socket.socketpair()
    mouth.setblocking(False)
    signal.set_wakeup_fd(mouth.fileno())
    threading.Thread(target=_watch, args=(ear, mouth), daemon=True).start()


def _watch(ear: socket.socket, _mouth: socket.socket) -> None:
    """End the process some time after a signal that the main thread does not hear."""
    while True:
        number = ear.recv(1)[0]
        arrived = time.monotonic()
        while number in ENDING and _Heard.last < arrived - _PATIENCE:
            if time.monotonic() > arrived + _PATIENCE:
                _end_without_result(number)
            time.sleep(_LATER)


def _end_without_result(number: int) -> None:
    _thread.start_new_thread(_exit_later, (128 + number,))  # whatever the functions below wait for
    name = signal.Signals(number).name
    with suppress(OSError):
        what = "the code of an FMU, or of a library, does not return; there is no result"
        os.write(_STANDARD_ERROR, f"note: interrupted by {name}: {what}\n".encode())
    atexit._run_exitfuncs()  # noqa: SLF001 - temporary folders, worker processes
    os._exit(128 + number)


def _exit_later(code: int) -> None:
    time.sleep(_PATIENCE)
    os._exit(code)


def insist_on_interrupts() -> None:
    """Raise a KeyboardInterrupt again where Python drops it: in callbacks of weak references and finalisers.

    Without this, Ctrl-C at such a moment writes a traceback, and the command goes on as if nothing had been said.
    """
    sys.unraisablehook = Insist(sys.unraisablehook, renew=_forget_last)


def _forget_last() -> None:
    _Heard.last = -math.inf  # it was heard, but it did not take
