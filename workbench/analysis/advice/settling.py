"""Does the record begin with motion that its inputs do not explain?"""

from __future__ import annotations

from workbench.analysis.advice.result import Finding
from workbench.analysis.advice.study import Study

__all__ = ["judge_settling"]


def judge_settling(study: Study) -> Finding:
    """Judge by `preprocess.settling_samples`; the other questions are asked about the rest of the record."""
    count = study.settling
    if not count:
        return Finding("settling", "good", "the record begins settled, or nearly so", "", {"samples": 0})
    evidence = f"the first {count} samples ({count * study.dt:.3g} s) still contain a transient from before the record"
    advice = f"cut them off: cut_settling(samples={count})"
    return Finding("settling", "watch", evidence, advice, {"samples": count})
