"""From recorded data to a validated linear model (source report, chapters 5.3 to 5.6)."""

from workbench.analysis.identify.identify import identify
from workbench.analysis.identify.prepare import DETRENDS
from workbench.analysis.identify.result import IdentifyResult

__all__ = ["DETRENDS", "IdentifyResult", "identify"]
