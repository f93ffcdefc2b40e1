"""Judgement of recorded data before a model is fitted: one question a file, a table of them in `advise`."""

from workbench.data.advice.advise import TOPICS, advise
from workbench.data.advice.result import VERDICTS, Advice, Finding

__all__ = ["TOPICS", "VERDICTS", "Advice", "Finding", "advise"]
