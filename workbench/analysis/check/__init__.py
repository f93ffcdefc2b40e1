"""The health card of an FMU: one check a file, a table of them in `registry`."""

from workbench.analysis.check.card import DEFAULT_PATIENCE, check
from workbench.analysis.check.registry import CHECKS
from workbench.analysis.check.result import VERDICTS, Finding, HealthCard, HealthLine

__all__ = ["CHECKS", "DEFAULT_PATIENCE", "VERDICTS", "Finding", "HealthCard", "HealthLine", "check"]
