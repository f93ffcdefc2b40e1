"""Loops of systems: opened at a connection, their transfer, margins, and what sines of some amplitude see of them."""

from workbench.analysis.loop.loop import loop
from workbench.analysis.loop.margins import DiskMargin, GainCrossover, Margins, PhaseCrossover
from workbench.analysis.loop.measured import LoopCurve, LoopPoint
from workbench.analysis.loop.result import LoopResult
from workbench.analysis.loop.stability import Stability

__all__ = [
    "DiskMargin",
    "GainCrossover",
    "LoopCurve",
    "LoopPoint",
    "LoopResult",
    "Margins",
    "PhaseCrossover",
    "Stability",
    "loop",
]
