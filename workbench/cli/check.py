"""`workbench check`: whether an FMU keeps its promises, and what that means for the analyses here."""

from __future__ import annotations

from workbench.analysis.check.request import Check
from workbench.cli.derive import command

__all__ = ["check"]

check = command(Check)
