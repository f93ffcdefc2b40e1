"""Is the record long enough, against the response's memory and the number of parameters?

Rule of thumb: 5 to 10 times the largest time constant (R. Johansson, System Modeling and Identification, section 8).
"""

from __future__ import annotations

import numpy as np

from workbench.analysis.advice.result import Finding
from workbench.analysis.advice.study import DataStudy

__all__ = ["judge_length", "slowest_time_constant"]

_WANTED = 10.0  # time constants
_LEAST = 5.0
_SAMPLES_EACH = 10  # per parameter
_DEFAULT_ORDER = 4


def slowest_time_constant(study: DataStudy) -> float:
    """Return the time in which the tail of the impulse responses falls to 1/e [s]; inf where it does not fall."""
    memory = study.memory
    if memory >= len(study.u) - 1:
        return float("inf")
    # The energy falls to 0.1 % within the memory: e^(−2T/τ) = 0.001.
    return float(memory * study.dt * 2.0 / np.log(1000.0))


def judge_length(study: DataStudy) -> Finding:
    """Judge the duration in time constants and the samples in parameters."""
    n, m, p = study.experiment.n_samples, study.experiment.n_inputs, study.experiment.n_outputs
    order = study.order or _DEFAULT_ORDER
    parameters = order * (m + p) + p * m
    tau, duration = slowest_time_constant(study), n * study.dt
    times = duration / tau
    values = {"duration_s": duration, "time_constant_s": tau if np.isfinite(tau) else None, "parameters": parameters}
    if not study.varying_inputs or not study.varying_outputs:
        return Finding("length", "unknown", "nothing moves", "", values)
    evidence = f"{duration:.3g} s are {times:.3g} times the largest time constant, about {tau:.2g} s"
    if times < _WANTED:
        verdict = "poor" if times < _LEAST else "watch"
        return Finding("length", verdict, evidence, f"record {_WANTED * tau:.3g} s at least", values)
    if n * p < _SAMPLES_EACH * parameters:
        few = f"{n} samples for {parameters} parameters of order {order}"
        return Finding("length", "watch", few, f"record {_SAMPLES_EACH * parameters} samples or more", values)
    return Finding("length", "good", evidence, "", values)
