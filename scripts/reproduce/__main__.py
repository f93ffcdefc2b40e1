"""The source report's figures, measured now: what `dev.py reproduce [CHAPTER] [--json PATH] [--report PATH]` runs."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from scripts.reproduce.request import ReproduceCommand
from workbench.cli import main
from workbench.cli.app import run

__all__ = ["reproduce_command"]

CALLED = "python scripts/dev.py"


def reproduce_command(words: Sequence[str]) -> int:
    """Return the exit code of the command with these words behind its name."""
    return run([ReproduceCommand.command, *words], ReproduceCommand, CALLED)


if __name__ == "__main__":
    main([ReproduceCommand.command, *sys.argv[1:]], ReproduceCommand, CALLED)
