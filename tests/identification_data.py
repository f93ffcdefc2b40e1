"""Made data for the tests of spectra, pre-processing and advice: known systems, fixed seeds."""

from __future__ import annotations

import numpy as np
from scipy import signal

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment, make_experiment

DT = 0.01
# A damped oscillation at 10 Hz and a lag of 0.05 s, sampled at 100 Hz.
_POLES = [np.exp((-12.0 + 2j * np.pi * 10.0) * DT), np.exp((-12.0 - 2j * np.pi * 10.0) * DT), np.exp(-DT / 0.05)]
A = np.real(np.poly(_POLES))
B = np.array([0.0, 0.2, 0.1, -0.05])


def prbs(n: int, *, hold: int = 2, seed: int = 1) -> Floats:
    """Random levels ±1, each held for some samples."""
    bits = np.random.default_rng(seed).choice(np.array([-1.0, 1.0]), n // hold + 1)
    return np.repeat(bits, hold)[:n]


def white(n: int, seed: int = 2) -> Floats:
    """Normal numbers."""
    return np.random.default_rng(seed).standard_normal(n)


def response(u: Floats, *, delay: int = 0) -> Floats:
    """The known system's output, delayed further."""
    y = np.asarray(signal.lfilter(B, A, u))
    return np.concatenate([np.zeros(delay), y[: len(y) - delay]]) if delay else y


def with_noise(y: Floats, level_db: float, *, seed: int = 3, pole: float = 0.0) -> Floats:
    """The output with noise so far below it, white or coloured by one pole."""
    noise = np.asarray(signal.lfilter([1.0], [1.0, -pole], white(len(y), seed)))
    return np.asarray(y + noise * np.std(y) / np.std(noise) * 10.0 ** (-level_db / 20.0))


def data(u: Floats, y: Floats) -> Experiment:
    """An experiment with the sampling interval of the known system."""
    return make_experiment(DT, u, y)
