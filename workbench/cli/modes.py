"""`workbench modes`: frequency and damping of every mode over a parameter."""

from __future__ import annotations

from workbench.analysis.modes.request import Modes
from workbench.cli.derive import command

__all__ = ["modes"]

modes = command(Modes)
