"""`workbench lin`: linear models."""

from __future__ import annotations

from workbench.analysis.lin.request import LinCommand
from workbench.cli.derive import command

__all__ = ["lin"]

lin = command(LinCommand)
