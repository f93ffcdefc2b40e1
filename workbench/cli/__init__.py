"""The command line: `workbench COMMAND MODEL …`."""

from __future__ import annotations

import signal
from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the program and end the process; see `workbench.cli.app.main`.

    Args:
        arguments: in place of the process's own.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # until the program is there, Ctrl-C ends it without a traceback
    from workbench.cli import app

    app.main(arguments)
