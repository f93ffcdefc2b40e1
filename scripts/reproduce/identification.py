"""Identification experiments on the elevator law and the rudder, over several binary sequences."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from workbench.data.advice.advise import advise
from workbench.data.excite.request import excite
from workbench.data.excite.result import ExciteResult
from workbench.data.excite.signals import MultisineDesign, PrbsDesign
from workbench.data.experiment.experiment import Experiment
from workbench.data.spectra.coherence import coherence
from workbench.identification.identify.request import identify
from workbench.identification.identify.result import IdentifyResult
from workbench.system.load import load

__all__ = [
    "PERIOD", "SEEDS", "SEGMENTS", "a_gain", "coherence_of", "crossing", "first_order", "law", "limited", "outside",
    "rudder", "swept",
]  # fmt: skip

PERIOD = 0.022  # of the law [s]
RATE = 30.0  # bits a second of the sequence [Hz]
SEGMENTS = 20  # of the coherence
SAMPLES = 3000  # of each part
SEEDS = (1, 2, 3, 4, 5)  # the bits of the source report are not printed


def law(
    seed: int, *, amplitude: float, offset: float = 0.0, settings: Mapping[str, float] | None = None
) -> ExciteResult:
    """Record the elevator law under a binary sequence of the side stick, from rest at the offset.

    Args:
        seed: of the sequence.
        amplitude: of the stick.
        offset: of the stick.
        settings: other inputs and parameters.
    """
    signal = PrbsDesign(amplitude=amplitude, offset=offset, rate=RATE, order=15, seed=seed)
    with load("fmu:ElevatorLaw", "me", start_values={"side_stick": offset, **(settings or {})}) as model:
        return excite(model, ["side_stick"], ["elevator"], signal=signal, dt=PERIOD, samples=SAMPLES, settle=1.0)


def swept(seed: int, offset: float) -> ExciteResult:
    """Record the law under slow sines with many levels, which leave the rate limiter idle.

    Args:
        seed: of their phases.
        offset: of the stick.
    """
    signal = MultisineDesign(amplitude=0.4, band=(0.05, 0.5), offset=offset, seed=seed)
    with load("fmu:ElevatorLaw", "me", start_values={"side_stick": offset}) as model:
        return excite(model, ["side_stick"], ["elevator"], signal=signal, dt=PERIOD, samples=SAMPLES, settle=1.0)


def limited(failed: float, seed: int) -> float:
    """Return 1 where the advice sees a limit under slow full stick, else 0; two levels cannot tell it from rest.

    Args:
        failed: 1 for one elevator failed, else 0.
        seed: of the sines' phases.
    """
    signal = MultisineDesign(amplitude=1.0, band=(0.05, 0.2), seed=seed)
    with load("fmu:ElevatorLaw", "me", start_values={"elevator_failed": failed}) as model:
        data = excite(model, ["side_stick"], ["elevator"], signal=signal, dt=PERIOD, samples=SAMPLES, settle=2.0)
    return float(advise(data.identification).finding("saturation").verdict != "good")


def rudder(seed: int) -> ExciteResult:
    """Record the rudder under a binary sequence of its command of ±2°.

    Args:
        seed: of the sequence.
    """
    with load("fmu:Rudder", "me", tolerance=1e-8) as model:
        return excite(model, ["delC"], ["del"], signal=PrbsDesign(amplitude=2.0, seed=seed), dt=0.01, samples=SAMPLES)


def first_order(data: ExciteResult) -> IdentifyResult:
    """Identify a model of first order."""
    return identify(data.identification, order=1, validation=data.validation, refine="never")


def a_gain(data: ExciteResult) -> IdentifyResult:
    """Identify a gain: what the law is while its rate limiter rests."""
    return identify(data.identification, order=0, validation=data.validation, refine="never")


def coherence_of(data: Experiment, window: str, overlap: float) -> NDArray[np.float64]:
    """Return the coherence above 0 Hz, shape (n,).

    Args:
        data: one input, one output.
        window: its name.
        overlap: of the segments, as a share.
    """
    found = coherence(data, segments=SEGMENTS, window=window, overlap=overlap)
    values = np.asarray(found.ordinary).reshape(len(found.frequency_hz), -1)[:, 0]
    return values[np.isfinite(values) & (found.frequency_hz > 0.0)]


def outside(model: IdentifyResult) -> float:
    """Return how many lags of the simulation's residuals lie outside their band."""
    found = model.own.simulation.autocorrelation
    return float(found.outside[0]) if found is not None else float("nan")


def crossing(model: IdentifyResult) -> float:
    """Return how many lags ≥ 0 of the cross-correlation lie outside their band."""
    found = model.own.simulation.cross
    return float(found.outside[1]) if found is not None else float("nan")
