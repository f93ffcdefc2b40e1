"""Does the sampling interval fit the response?

Sampled too fast, all poles lie near 1 and look like integrators; too slowly, the response is over within a sample
and what lies above the Nyquist frequency is folded down (L. Ljung, System Identification, 2nd ed., section 13.7).
"""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.advice.result import Finding
from workbench.data.advice.shared_estimates import DataStudy

__all__ = ["judge_sampling", "output_hold"]

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
