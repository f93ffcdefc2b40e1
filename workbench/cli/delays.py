"""`workbench delays`: what the master of a system with co-simulation components costs."""

from __future__ import annotations

from workbench.analysis.delays.request import Delays
from workbench.cli.derive import command

__all__ = ["delays"]

delays = command(Delays)
