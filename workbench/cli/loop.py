"""`workbench loop`: margins of a system's loop."""

from __future__ import annotations

from workbench.analysis.loop.request import Loop
from workbench.cli.derive import command

__all__ = ["loop"]

loop = command(Loop)
