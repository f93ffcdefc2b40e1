"""`workbench trim`: an operating point."""

from __future__ import annotations

from workbench.analysis.trim.request import Trim
from workbench.cli.derive import command

__all__ = ["trim"]

trim = command(Trim)
