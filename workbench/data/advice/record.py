"""How the record was made: wrong samples, its length, beginnings and drifts that no input explains."""

from __future__ import annotations

import numpy as np
from scipy import stats

from workbench.core.values.arrays import Floats
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import CHANCE, DataStudy

__all__ = [
    "drifts",
    "judge_length",
    "judge_outliers",
    "judge_settling",
    "judge_trend",
    "slowest_time_constant",
]


def judge_outliers(study: DataStudy) -> Finding:
    """Judge by `preprocess.remove_outliers`; the other questions are asked about repaired data."""
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


# -- is it long enough, against memory and number of parameters -----------------------------------

# Rule of thumb: 5 to 10 times the largest time constant (R. Johansson, System Modeling and Identification, section 8).
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


# -- is there an offset or a drift that the inputs do not explain ---------------------------------

# The identified model is linear around an operating point; the operating point has to be taken out first. A drift is
# tested as a further, linearly growing input of the long equation.
_LARGE = 0.3  # of a standard deviation over the whole record
_OFFSET = 0.05  # of a standard deviation
_BLOCKS = 12  # of which the scatter of the mean is taken


def drifts(study: DataStudy) -> tuple[Floats, Floats]:
    """Return the change over the record that no input explains, and its standard deviation, shape (p,) each."""
    start = min(study.memory, len(study.u) // 4)
    rest = study.y[start:] - study.explained[start:]
    clock = np.linspace(-0.5, 0.5, len(rest))
    rest = rest - rest.mean(axis=0)
    size = clock @ rest / (clock @ clock)
    left = rest - clock[:, None] * size
    return np.asarray(size), np.asarray(_long_run(left) / np.sqrt(clock @ clock))


def judge_trend(study: DataStudy) -> Finding:
    """Judge offsets and drifts of the outputs."""
    data = study.experiment
    size, error = drifts(study)
    significant = float(stats.t.isf(0.5 * CHANCE, _BLOCKS - 1))
    relative = np.abs(size) / study.spread
    real = [i for i in study.varying_outputs if relative[i] > _LARGE and abs(size[i]) > significant * error[i]]
    means = np.hstack([data.u.mean(axis=0), data.y.mean(axis=0)])
    spreads = np.hstack([np.std(data.u, axis=0), np.std(data.y, axis=0)])
    names = (*data.input_names, *data.output_names)
    off = [n for n, m, s in zip(names, means, spreads, strict=True) if abs(m) > _OFFSET * s > 0.0]
    values = {"drift": dict(zip(data.output_names, size.tolist(), strict=True)), "offsets": off}
    if real:
        worst = max(real, key=lambda i: relative[i])
        evidence = f"{data.output_names[worst]} drifts by {size[worst]:.3g} over the record, whatever the inputs do"
        return Finding("trend", "watch", evidence, "remove it with detrend(kind='linear')", values)
    if off:
        return Finding(
            "trend", "good", f"no drift; {', '.join(off)} with an offset, which is removed before fitting", "", values
        )
    return Finding("trend", "good", "no drift, no offset", "", values)


def _long_run(x: Floats) -> Floats:
    """Return √(spectral density at 0) of each column, by means of blocks, so that slow noise counts in full."""
    length = len(x) // _BLOCKS
    means = x[: _BLOCKS * length].reshape(_BLOCKS, length, -1).mean(axis=1)
    return np.asarray(np.std(means, axis=0, ddof=1) * np.sqrt(length))
