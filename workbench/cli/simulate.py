"""`workbench simulate`: a time history."""

from __future__ import annotations

from workbench.analysis.simulate.request import Simulate
from workbench.cli.derive import command

__all__ = ["simulate"]

simulate = command(Simulate)
