"""`workbench limit-cycle`: limit cycles of a system with one nonlinear block."""

from __future__ import annotations

from workbench.analysis.limit_cycle.request import LimitCycles
from workbench.cli.derive import command

__all__ = ["limit_cycle"]

limit_cycle = command(LimitCycles)
