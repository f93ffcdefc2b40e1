"""Are there single samples that fit neither their neighbours nor the inputs?"""

from __future__ import annotations

from workbench.analysis.advice.result import Finding
from workbench.analysis.advice.study import Study

__all__ = ["judge_outliers"]


def judge_outliers(study: Study) -> Finding:
    """Judge by `preprocess.find_outliers`; the other questions are asked about repaired data."""
    found = study.outliers
    values = {name: len(at) for name, at in found.items()}
    if not found:
        return Finding("outliers", "good", "none", "", values)
    name, at = max(found.items(), key=lambda pair: len(pair[1]))
    when = ", ".join(f"{study.experiment.time[k]:.6g}" for k in at[:3])
    more = ", …" if len(at) > 3 else ""
    some = f"{len(at)} samples of {name} stand out" if len(at) > 1 else f"1 sample of {name} stands out"
    evidence = f"{some}, at {when}{more} s"
    marks = {n: tuple(k + study.settling for k in a) for n, a in found.items()}
    share = max(len(a) for a in found.values()) / study.experiment.n_samples
    advice = "repair them with remove_outliers, or cut the record there"
    return Finding("outliers", "poor" if share > 0.01 else "watch", evidence, advice, values, marks)
