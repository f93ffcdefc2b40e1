"""How the record was made: sampling, wrong samples, its length, beginnings and drifts that no input explains.

Sampled too fast, all poles lie near 1 and look like integrators; too slowly, the response is over within a sample
and what lies above the Nyquist frequency is folded down (L. Ljung, System Identification, 2nd ed., section 13.7).
"""

from __future__ import annotations

import numpy as np
from scipy import special

from workbench.core.values.arrays import Floats
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import CHANCE, DataStudy

__all__ = ["drifts", "judge_length", "judge_outliers", "judge_sampling", "judge_settling", "judge_trend"]

_TOO_FAST = 1.0 / 12.0  # of the Nyquist frequency: most of the response lies below
_POWER = 0.95
_STRONG_AT_NYQUIST = 10.0 ** (-6.0 / 20.0)  # of the largest gain
_SHORT_MEMORY = 2  # samples


def judge_sampling(study: DataStudy) -> Finding:
    """Judge the sampling interval by the response's bandwidth, its memory and its gain at the Nyquist frequency."""
    if not study.varying_inputs or not study.varying_outputs:
        return Finding("sampling", "unknown", "nothing moves")
    gain = _gains(study)
    nyquist = 0.5 / study.dt
    frequency = np.linspace(0.0, nyquist, len(gain))
    band = float(max(_bandwidth(frequency, g) for g in gain.reshape(len(gain), -1).T))
    top = float(np.max(_at_nyquist(gain)))
    hold = output_hold(study)
    memory = study.memory
    values = {"response_band_hz": band, "nyquist_hz": nyquist, "gain_at_nyquist": top, "memory_samples": memory}
    if hold > 1:
        evidence = f"the outputs change at every {_ordinal(hold)} sample only: the model works at {hold * study.dt:g} s"
        return Finding("sampling", "watch", evidence, f"record at its own interval, {hold * study.dt:g} s", values)
    if memory <= _SHORT_MEMORY:
        evidence = f"the response ends within {memory} sample{'s' if memory > 1 else ''}: no dynamics is seen"
        return Finding("sampling", "watch", evidence, "a gain is enough, or sample faster", values)
    if band < _TOO_FAST * nyquist:
        better = 1.0 / (6.0 * max(band, 1e-12))
        evidence = (
            f"{100 * _POWER:.0f} % of the response lies below {band:.3g} Hz, far below Nyquist, {nyquist:.3g} Hz: "
            "poles will look like integrators"
        )
        return Finding("sampling", "watch", evidence, f"resample to about {better:.2g} s", values)
    if top > _STRONG_AT_NYQUIST:
        evidence = f"the gain at Nyquist, {nyquist:.3g} Hz, is still {100 * top:.0f} % of its largest: aliasing"
        return Finding("sampling", "watch", evidence, "sample faster, unless the system is a sampled one", values)
    return Finding(
        "sampling", "good", f"the response lies below {band:.3g} Hz, Nyquist is {nyquist:.3g} Hz", "", values
    )


def output_hold(study: DataStudy) -> int:
    """Return after how many samples the outputs change, 1 unless they do so at regular distances only."""
    moved = np.any(np.abs(np.diff(study.raw.y, axis=0)) > 1e-12 * study.spread, axis=1)
    at = np.flatnonzero(moved)
    if len(at) < 10:
        return 1
    hold = int(np.gcd.reduce(np.diff(at)))
    inputs = np.flatnonzero(np.any(np.diff(study.u, axis=0) != 0.0, axis=1))
    together = len(inputs) > 1 and hold == int(np.gcd.reduce(np.diff(inputs)))
    return 1 if together or len(at) < 0.5 * len(moved) / max(hold, 1) else hold


def _gains(study: DataStudy) -> Floats:
    """Return the magnitude of the long equation's response, shape (n_f, p, m), in spreads; 0 where nothing excites."""
    count = int(np.clip(2 * study.memory, 64, 4096))
    response = np.abs(np.fft.rfft(study.model.impulse(count), axis=0))
    grid = np.linspace(0.0, 1.0, len(response))
    excited = study.excited.copy()
    excited[0] = excited[1]  # the mean is not excitation, but what is next to it tells
    known = np.interp(grid, np.linspace(0.0, 1.0, len(excited)), excited) > 0.5
    size = np.std(study.u, axis=0)[study.varying_inputs] / study.spread[study.varying_outputs][:, None]
    return np.asarray(response[:, study.varying_outputs][:, :, study.varying_inputs] * size * known[:, None, None])


def _bandwidth(frequency: Floats, gain: Floats) -> float:
    power = np.cumsum(gain**2)
    return float(frequency[np.searchsorted(power, _POWER * power[-1])]) if power[-1] > 0.0 else 0.0


def _at_nyquist(gain: Floats) -> Floats:
    """Return the gain over the last tenth of the band relative to the largest of the same pair."""
    last = gain[int(0.9 * len(gain)) :]
    return np.asarray(np.sqrt(np.mean(last**2, axis=0)) / np.maximum(np.max(gain, axis=0), 1e-300))


def _ordinal(n: int) -> str:
    return f"{n}{ {2: 'nd', 3: 'rd'}.get(n, 'th') }"


def judge_outliers(study: DataStudy) -> Finding:
    """Judge by `preprocess.remove_outliers`; the other questions are asked about repaired data."""
    result = study.outliers
    values = {name: len(at) for name, at in result.items()}
    if not result:
        return Finding("outliers", "good", "none", "", values)
    name, at = max(result.items(), key=lambda pair: len(pair[1]))
    when = ", ".join(f"{study.experiment.time[k]:.6g}" for k in at[:3])
    more = ", …" if len(at) > 3 else ""
    some = f"{len(at)} samples of {name} stand out" if len(at) > 1 else f"1 sample of {name} stands out"
    evidence = f"{some}, at {when}{more} s"
    marks = {n: tuple(k + study.settling for k in a) for n, a in result.items()}
    share = max(len(a) for a in result.values()) / study.experiment.n_samples
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
    significant = float(-special.stdtrit(_BLOCKS - 1, 0.5 * CHANCE))
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
