"""How the record was made: single samples that are wrong, coarse steps, a beginning that inputs do not explain."""

from __future__ import annotations

import numpy as np

from workbench.analysis.advice.result import Finding
from workbench.analysis.advice.study import DataStudy
from workbench.session.base import Floats

__all__ = ["judge_outliers", "judge_quantisation", "judge_settling", "resolution"]


def judge_outliers(study: DataStudy) -> Finding:
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


# -- does the record begin with motion that its inputs do not explain ------------------------------


def judge_settling(study: DataStudy) -> Finding:
    """Judge by `preprocess.settling_samples`; the other questions are asked about the rest of the record."""
    count = study.settling
    if not count:
        return Finding("settling", "good", "the record begins settled, or nearly so", "", {"samples": 0})
    evidence = f"the first {count} samples ({count * study.dt:.3g} s) still contain a transient from before the record"
    advice = f"cut them off: cut_settling(samples={count})"
    return Finding("settling", "watch", evidence, advice, {"samples": count})


# -- is an output recorded in coarse steps ---------------------------------------------------------

_COARSE = 20.0  # steps in a standard deviation; noise of 1.4 % of the signal
_VERY_COARSE = 5.0
_FEW_LEVELS = 64  # of an input: more are a continuous one
_EVEN = 1e-3  # of a step


def resolution(y: Floats) -> float:
    """Return the step of which all differences of values are multiples; 0 where there is none to be seen.

    Args:
        y: shape (n,).
    """
    levels = np.unique(y)
    if not 3 <= len(levels) <= len(y) // 4:
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * (levels[-1] - levels[0])]
    if not steps.size:
        return 0.0
    step = float(np.min(steps))
    multiples = (levels - levels[0]) / step
    # Even steps by chance are unlikely with many levels only.
    even = np.max(np.abs(multiples - np.round(multiples))) < _EVEN
    return step if even and len(levels) > 5 else 0.0


def judge_quantisation(study: DataStudy) -> Finding:
    """Judge the steps of each output against its standard deviation."""
    data = study.raw  # repaired samples lie on no step
    inputs = max(len(np.unique(data.u[:, j])) for j in range(data.n_inputs))
    steps = {n: resolution(data.y[:, i]) for i, n in enumerate(data.output_names)}
    # A gain passes the few levels of its input on: that is not quantisation.
    fine = {
        n: float(study.spread[i]) / steps[n]
        for i, n in enumerate(data.output_names)
        if steps[n] > 0.0 and (inputs > _FEW_LEVELS or len(np.unique(data.y[:, i])) > inputs)
    }
    coarse = {n: v for n, v in fine.items() if v < _COARSE}
    if not coarse:
        return Finding("quantisation", "good", "no coarse steps", "", {"steps": steps})
    name = min(coarse, key=lambda n: coarse[n])
    evidence = f"{name} has steps of {steps[name]:.4g}, {coarse[name]:.2g} in a standard deviation"
    verdict = "poor" if coarse[name] < _VERY_COARSE else "watch"
    return Finding("quantisation", verdict, evidence, "raise the amplitude or the resolution", {"steps": steps})
