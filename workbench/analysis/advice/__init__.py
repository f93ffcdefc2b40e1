"""Judgement of recorded data before a model is fitted: one question a file, a table of them in `advise`."""

from workbench.analysis.advice.advise import TOPICS, advise
from workbench.analysis.advice.result import VERDICTS, Advice, Finding

__all__ = ["TOPICS", "VERDICTS", "Advice", "Finding", "advise"]
