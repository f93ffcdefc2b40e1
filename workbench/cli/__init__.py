"""The command line: `workbench COMMAND MODEL …`."""

from __future__ import annotations

from workbench.cli.app import main

__all__ = ["main"]
