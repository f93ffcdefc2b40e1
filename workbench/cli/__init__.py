"""The command line: `workbench COMMAND MODEL …`."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence

TYPE_CHECKING = False  # as type checkers know it: until Ctrl-C is heard, little is imported
if TYPE_CHECKING:
    from typing import Any

    from workbench.requests.request import Request

__all__ = ["main"]


def main(
    arguments: Sequence[str] | None = None,
    own: type[Request[Any, Any]] | None = None,
    called: str = "workbench",
) -> None:
    """Run the program and end the process with its exit code.

    0 done, 1 a point failed, 2 bad input, or standard output did not take all (one line on standard error), 128 + a
    signal's number: interrupted by it (Ctrl-C: 130).

    Args:
        arguments: in place of the process's own.
        own: request of a command that is not one of the package's; None: all of these.
        called: how the program is called, as in a shell.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # until the program is there, Ctrl-C ends it without a traceback
    from workbench.core.machine.cycles import never_again, seldom

    seldom()
    from workbench.cli import app, interrupt, streams

    streams.guard()
    try:
        interrupt.insist_on_interrupts()
        interrupt.listen_for_endings()
        code = app.run(arguments, own, called, alone=True)
    except KeyboardInterrupt:  # once more, while it was told
        code = interrupt.exit_code()
    interrupt.ignore_endings()  # what is left is to clean up
    if why := streams.complaint():
        sys.stderr.write(f"workbench: {why}\n")
        code = code if interrupt.was_interrupted() else app.BAD_INPUT
    if interrupt.was_interrupted():
        interrupt.end(code)
    never_again()
    sys.exit(code)
