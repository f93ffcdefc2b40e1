"""Spectra and advice on data recorded from the bundled models: chapters 6.3 and 7.2 of the source report."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import pytest

import workbench as wb
from workbench.core.values.arrays import Floats
from workbench.data.advice.advise import advise
from workbench.data.experiment.experiment import Experiment, make_experiment
from workbench.data.spectra.coherence import coherence
from workbench.data.spectra.density import sdf
from workbench.model.load import load
from workbench.signals.kinds import Constant, Prbs, Table

FAILED = (("elevator_failed", 1.0),)


def record(fmu: str, source: str, target: str, dt: float, u: Floats, constants: Mapping[str, float]) -> Experiment:
    """Run a model under held values and take the output right after each of them took effect."""
    at: Floats = dt * np.arange(len(u), dtype=np.float64)
    signals = {source: Table(at.tolist(), u.tolist(), "hold"), **{n: Constant(v) for n, v in constants.items()}}
    with load(fmu) as model, model.open_session(signals=signals) as session:
        found = session.advance(float(at[-1]) + 0.3 * dt, signals=signals, record=[target], points=at[1:])
    last = np.searchsorted(found.time, at + 1e-9 * dt, side="right") - 1
    return make_experiment(
        dt, found.inputs[source][last], found.values[target][last], input_names=[source], output_names=[target]
    )


def held_prbs(dt: float, n: int, rate: float, seed: int = 1234) -> Floats:
    """Levels ±1 that change at the first sample after each 1/rate."""
    bits = np.array(Prbs(hold=1.0 / rate, order=15, seed=seed).bits())
    return np.where(bits[np.floor(dt * np.arange(n) * rate + 1e-9).astype(int)], 1.0, -1.0)


@lru_cache
def elevator(amplitude: float = 1.0, offset: float = 0.0, constants: tuple[tuple[str, float], ...] = ()) -> Experiment:
    stick = offset + amplitude * held_prbs(0.022, 3000, 30.0)
    return record("fmu:ElevatorLaw", "side_stick", "elevator", 0.022, stick, dict(constants))


@lru_cache
def rudder(amplitude: float) -> Experiment:
    return record("fmu:Rudder", "delC", "del", 0.01, amplitude * held_prbs(0.01, 3000, 50.0), {})


def test_coherence_of_the_elevator_law_stays_clearly_below_one() -> None:
    """The source report shows just over 0.8 at best with 20 segments; plain ones, without window and overlap."""
    found = coherence(elevator(), segments=20, overlap=0.0, window="boxcar")
    values = found.multiple[1:, 0]
    assert 0.78 < values.max() < 0.88
    assert np.mean(values < 0.8) > 0.9
    # Much of that is leakage; what a window leaves is the rate limiter's share, at low frequency.
    windowed = coherence(elevator(), segments=20)
    low = (windowed.frequency_hz > 0.2) & (windowed.frequency_hz < 1.0)
    assert np.max(windowed.multiple[low, 0]) < 0.9
    assert np.median(windowed.multiple[1:, 0]) > 0.9


def test_only_low_frequencies_pass_the_elevator_law() -> None:
    found = sdf(elevator(), length=128)
    stick, elevator_density = 10.0 * np.log10(found.density[2:, 0]), 10.0 * np.log10(found.density[2:, 1])
    assert elevator_density[0] - elevator_density[-2] > 25.0
    assert stick[0] - stick[-2] < 15.0
    assert found.frequency_hz[-1] == pytest.approx(0.5 / 0.022)


def test_the_rate_limiter_is_told_as_distortion() -> None:
    found = advise(elevator())
    assert found.finding("linearity").verdict == "poor"
    assert found.finding("noise").verdict == "poor"
    assert found.finding("delay").values == {"side_stick → elevator": 0}
    assert found.finding("saturation").verdict == "watch"
    for topic in ("excitation", "length", "feedback", "outliers", "trend"):
        assert found.finding(topic).verdict == "good", topic


def test_at_small_amplitude_the_law_is_linear() -> None:
    found = advise(elevator(0.02, 0.5))
    assert found.finding("linearity").verdict == "good"
    assert found.finding("noise").values["elevator"] > 80.0
    assert found.finding("saturation").verdict == "good"
    assert found.finding("settling").verdict == "watch"  # from neutral to the offset by the rate limiter


def test_one_elevator_failed_saturates() -> None:
    failed = elevator(1.0, 0.0, FAILED)
    assert failed.y.max() == pytest.approx(15.0)
    found = advise(failed).finding("saturation")
    # A two-level input cannot tell a limit from the settled response, but the place is shown ...
    assert found.verdict == "watch"
    assert "15" in found.evidence
    # ... known limits tell, and so does an input that moves on.
    limited = advise(failed, limits={"elevator": (-30.0, 15.0)}).finding("saturation")
    assert (limited.verdict, "known limit" in limited.evidence) == ("poor", True)
    stick = np.sin(2.0 * np.pi * 0.1 * 0.022 * np.arange(3000))
    for constants, verdict in ((FAILED, "poor"), ((), "good")):
        moving = record("fmu:ElevatorLaw", "side_stick", "elevator", 0.022, stick, dict(constants))
        assert advise(moving).finding("saturation").verdict == verdict


def test_rudder_data_are_fit_for_a_model_of_sixth_order() -> None:
    found = advise(rudder(2.0), order=6)
    found.refuse(6)
    assert {f.topic for f in found.concerns} == {"linearity"}
    assert found.finding("noise").values["del"] > 25.0
    assert found.finding("delay").values == {"delC → del": 1}
    assert found.finding("linearity").verdict == "watch"


def test_the_rudder_bends_more_at_a_larger_amplitude() -> None:
    levels = [advise(rudder(a)).finding("noise").values["del"] for a in (0.5, 2.0, 8.0)]
    assert levels[0] > levels[1] + 6.0
    assert levels[1] > levels[2] + 6.0


def test_an_equation_with_too_many_lags_does_not_make_good_data_poor() -> None:
    """At this point of the rudder both long equations are unstable, though a linear model explains all but 4e-6."""
    with load("fmu:Rudder") as model:
        at = wb.trim(model, u0={"delC": 2.0})
        data = wb.excite(
            model, "delC", "del", multisine="band=0.5:20,amplitude=0.25", dt=0.01, samples=2000, at=at
        ).identification
    verdicts = {one.topic: one.verdict for one in advise(data).findings}
    assert verdicts["noise"] == "good"
    assert verdicts["linearity"] == "good"
