"""Spectral density and coherence against closed forms and against each other."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from tests.identification_data import DT, A, B, data, prbs, response, white, with_noise
from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import make_experiment
from workbench.data.spectra.coherence import Coherence, coherence
from workbench.data.spectra.density import SpectralDensity, sdf
from workbench.data.spectra.window import WINDOWS, choose_window, cross_spectra, shape_of
from workbench.errors import InputError


def test_density_of_white_noise_is_flat_and_its_integral_the_variance() -> None:
    u = 3.0 * white(20_000)
    found = sdf(data(u, u), columns=["u"], length=200)
    level = found.density[2:-2, 0]
    assert np.mean(level) == pytest.approx(9.0 * 2.0 * DT, rel=0.03)
    # The scatter is the one that the settings promise.
    assert np.std(level) / np.mean(level) == pytest.approx(found.settings.random_error, rel=0.25)
    integral = np.sum(found.density[:, 0]) * (found.frequency_hz[1] - found.frequency_hz[0])
    assert integral == pytest.approx(np.var(u), rel=0.03)
    low, high = found.settings.interval_95
    assert np.mean((low * level < 9.0 * 2.0 * DT) & (high * level > 9.0 * 2.0 * DT)) > 0.9


def test_spectra_end_at_nyquist() -> None:
    u = white(1000)
    assert sdf(data(u, u), segments=10).frequency_hz[-1] == pytest.approx(0.5 / DT)
    assert coherence(data(u, u), segments=10).frequency_hz[-1] == pytest.approx(0.5 / DT)


def test_output_density_is_input_density_times_gain_squared() -> None:
    u = white(60_000)
    found = sdf(data(u, response(u)), length=600)
    _, h = signal.freqz(B, A, worN=found.frequency_hz, fs=1.0 / DT)
    ratio = found.density[3:-3, 1] / found.density[3:-3, 0] / np.abs(h[3:-3]) ** 2
    assert np.max(np.abs(10.0 * np.log10(ratio))) < 0.3


def test_coherence_of_noise_has_its_closed_form_and_scatter() -> None:
    """γ² = |H|²Φu/(|H|²Φu + Φv)."""
    u = white(60_000)
    noise = 0.5 * white(60_000, seed=9)
    found = coherence(data(u, response(u) + noise), length=1000)
    _, h = signal.freqz(B, A, worN=found.frequency_hz, fs=1.0 / DT)
    expected = np.abs(h) ** 2 / (np.abs(h) ** 2 + 0.25)
    error = (found.multiple[2:-2, 0] - expected[2:-2]) / np.maximum(found.standard_deviation[2:-2, 0], 1e-3)
    assert np.sqrt(np.mean(error**2)) < 1.3
    assert np.max(np.abs(found.response[2:-2, 0, 0] - h[2:-2])) < 0.15


def test_two_inputs_explain_together_what_neither_explains_alone() -> None:
    u = np.column_stack([white(20_000, 1), white(20_000, 2)])
    found = coherence(make_experiment(DT, u, u[:, 0] + u[:, 1]), segments=100)
    assert np.median(found.multiple) > 0.999
    assert np.median(found.ordinary[:, 0, 0]) == pytest.approx(0.5, abs=0.05)
    chance = coherence(make_experiment(DT, u, white(20_000, 3)), segments=100)
    assert np.mean(chance.multiple > chance.significance_95) == pytest.approx(0.05, abs=0.03)


def test_one_input_twice_is_no_more_than_once() -> None:
    u = white(10_000)
    y = with_noise(response(u), 10.0)
    once = coherence(data(u, y))
    twice = coherence(make_experiment(DT, np.column_stack([u, 2.0 * u]), y))
    np.testing.assert_allclose(twice.multiple, once.multiple, atol=1e-6)


def test_multiple_coherence_of_one_input_is_the_ordinary_one_and_does_not_depend_on_units() -> None:
    u, y = white(4000), with_noise(response(white(4000)), 10.0)
    found = coherence(data(u, y))
    np.testing.assert_allclose(found.multiple, found.ordinary[:, :, 0], rtol=1e-9)
    _, direct = signal.coherence(u, y, nperseg=200)
    np.testing.assert_allclose(found.multiple[1:-1, 0], direct[1:-1], rtol=1e-9)
    np.testing.assert_allclose(coherence(data(1e6 * u, 1e-3 * y)).multiple, found.multiple, rtol=1e-6)


def test_without_excitation_there_is_no_coherence() -> None:
    u, y = np.ones(1000), white(1000)
    assert np.all(np.isnan(coherence(data(u, y)).multiple))
    assert coherence(data(u, y)).to_dict()["multiple"]["y"][3] is None


def test_settings_say_what_was_done() -> None:
    u = white(3000)
    settings = coherence(data(u, u), segments=20, overlap=0.0, window="boxcar").settings
    assert (settings.length, settings.averages, settings.used) == (150, 20, 3000)
    assert settings.effective_averages == pytest.approx(20.0)
    assert settings.resolution_hz == pytest.approx(1.0 / (150 * DT))
    overlapping = coherence(data(u, u), segments=20).settings
    assert overlapping.averages == 39
    assert 20.0 < overlapping.effective_averages < 39.0
    assert overlapping.to_dict()["interval_95"][0] < 1.0


def test_band_of_a_held_input() -> None:
    """The density of levels held for h samples falls by 3 dB at 0.443/(h·dt)."""
    u = prbs(40_000, hold=5)
    assert sdf(data(u, u), length=400).band_hz("u", 3.9) == pytest.approx(0.443 / (5 * DT), rel=0.35)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": "han"}, "did you mean hann"),
        ({"segments": 20, "length": 10}, "not both"),
        ({"overlap": 1.0}, "overlap must be"),
        ({"segments": 900}, "fewer segments"),
        ({"segments": 0}, "at least 1"),
        ({"length": 2000}, "at most all"),
    ],
)
def test_wrong_settings_are_refused(options: dict[str, object], message: str) -> None:
    u = white(1000)
    with pytest.raises(InputError, match=message):
        coherence(data(u, u), **options)  # type: ignore[arg-type]


def test_too_few_segments_and_unknown_columns_are_refused() -> None:
    u = white(1000)
    with pytest.raises(InputError, match="would always be 1"):
        coherence(data(u, u), segments=1, overlap=0.0)
    with pytest.raises(InputError, match="no column 'x'"):
        sdf(data(u, u), columns=["x"])
    with pytest.raises(InputError, match="not a column of this spectrum"):
        sdf(data(u, u)).band_hz("z")


def test_pictures_and_tables(tmp_path: Path) -> None:
    u = np.column_stack([white(2000, 1), white(2000, 2)])
    experiment = make_experiment(DT, u, u @ [[1.0, 0.2], [0.0, 1.0]])
    results: tuple[SpectralDensity | Coherence, ...] = (sdf(experiment), coherence(experiment))
    for number, result in enumerate(results):
        result.plot(tmp_path / f"{number}.png")
        result.to_csv(tmp_path / f"{number}.csv")
        lines = (tmp_path / f"{number}.csv").read_text(encoding="utf-8").splitlines()
        assert lines[0].startswith("frequency [Hz],")
        assert len(lines) == 1 + len(result.frequency_hz)
    with pytest.raises(InputError, match="cannot be written"):
        sdf(experiment).to_csv(tmp_path)


# -- what the stated errors promise, against closed forms and counted -----------------------------


def uncorrelated(inputs: int, segments: int, share: float, seed: int) -> Coherence:
    """White inputs, an output of which they explain `share` of the power; segments side by side, no taper."""
    random = np.random.default_rng(seed)
    u = random.standard_normal((segments * 64, inputs))
    y = np.sqrt(share / inputs) * u.sum(axis=1) + np.sqrt(1.0 - share) * random.standard_normal(len(u))
    return coherence(make_experiment(DT, u, y), segments=segments, overlap=0.0, window="boxcar")


def inner(values: Floats) -> Floats:
    """Without 0 Hz, whose mean is taken out, and Nyquist, which has half the freedom."""
    return values[1:-1, 0]


def test_deviation_and_bias_of_a_coherence_have_their_closed_forms() -> None:
    """√2 γ (1 − γ²)/√n and (1 − γ²)² m/n (Bendat & Piersol, Random Data, 9.2)."""
    found = replace(uncorrelated(2, 25, 0.5, 0), multiple=np.full((33, 1), 0.64))
    assert found.standard_deviation[5, 0] == pytest.approx(np.sqrt(2.0) * 0.8 * 0.36 / 5.0)
    assert found.bias[5, 0] == pytest.approx(0.36**2 * 2.0 / 25.0)


def test_a_coherence_scatters_as_it_says() -> None:
    many = [uncorrelated(1, 40, 0.5, seed) for seed in range(60)]
    scatter = np.std(np.concatenate([inner(c.multiple) for c in many]))
    said = np.mean(np.concatenate([inner(c.standard_deviation) for c in many]))
    assert scatter == pytest.approx(said, rel=0.08)  # 1,860 values: 1.6 % by chance, the formula is of first order


@pytest.mark.parametrize("inputs", [1, 2, 3])
@pytest.mark.parametrize("segments", [12, 40])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.15, 0.5, 0.9, 0.99])
def test_the_interval_of_a_coherence_holds_the_true_one(inputs: int, segments: int, share: float) -> None:
    """620 values for each case: 0.9 % by chance."""
    held = []
    for seed in range(20):
        low, high = uncorrelated(inputs, segments, share, 1000 + seed).interval_95
        held.append((inner(low) <= share) & (share <= inner(high)))
    assert 0.93 < np.mean(held) <= 1.0


def test_the_interval_of_a_coherence_is_two_sided() -> None:
    """Misses on both sides about as often, and it is no wider than the scatter: ±1.96 σ, σ² = 1/(2 (n − 1)), in z."""
    many = [uncorrelated(1, 40, 0.5, seed) for seed in range(60)]
    low, high = (np.concatenate([inner(c.interval_95[side]) for c in many]) for side in (0, 1))
    assert np.mean(low > 0.5) == pytest.approx(0.025, abs=0.01)  # 1,860 values: 0.0036
    assert np.mean(high < 0.5) == pytest.approx(0.025, abs=0.01)
    width = np.arctanh(np.sqrt(high)) - np.arctanh(np.sqrt(low))
    assert np.median(width) == pytest.approx(2.0 * 1.96 / np.sqrt(78.0), rel=1e-3)


def test_unrelated_data_exceed_the_level_of_chance_in_five_per_cent() -> None:
    """With m inputs and n averages the multiple coherence of unrelated data is Beta(m, n − m): mean m/n."""
    many = [uncorrelated(3, 8, 0.0, seed) for seed in range(120)]
    values = np.concatenate([inner(c.multiple) for c in many])
    assert np.mean(values > many[0].significance_95) == pytest.approx(0.05, abs=0.012)  # 3,720 values: 0.0036
    assert np.mean(values) == pytest.approx(3.0 / 8.0, abs=0.012)


def test_the_interval_of_a_density_holds_the_true_one() -> None:
    held = []
    for seed in range(60):
        noise = white(10 * 64, seed)
        found = sdf(data(noise, noise), segments=10, overlap=0.0, window="boxcar")
        low, high = found.settings.interval_95
        estimated = inner(found.density)
        held.append((low * estimated < 2.0 * DT) & (high * estimated > 2.0 * DT))  # unit variance up to 1/(2 dt)
    assert np.mean(held) == pytest.approx(0.95, abs=0.015)


def test_overlapping_hann_segments_are_worth_what_welch_says() -> None:
    """Neighbours of 50 % overlap correlate by 1/6: n/(1 + 2 (1 − 1/n)/36)."""
    settings = sdf(data(white(3200), white(3200)), segments=20).settings
    n = settings.averages
    assert n == 39
    assert settings.effective_averages == pytest.approx(n / (1.0 + 2.0 * (1.0 - 1.0 / n) / 36.0), rel=1e-3)


@pytest.mark.parametrize("window", [*WINDOWS, "blackmanharris"])
@pytest.mark.parametrize("length", [64, 65])
def test_windows_and_averaged_spectra_are_those_of_scipy(window: str, length: int) -> None:
    """Its package is not imported by the workbench itself: that takes longer than a small identification."""
    assert shape_of(window, length) == pytest.approx(signal.get_window(window, length), abs=1e-15)
    channels = np.column_stack([white(1000, seed) for seed in (1, 2, 3)])
    settings = replace(choose_window(1000, DT, segments=None, length=length, overlap=0.5, window="hann"), window=window)
    frequency, density = cross_spectra(channels, settings)
    wanted = signal.csd(
        channels.T[:, None],
        channels.T[None],
        fs=1.0 / DT,
        window=window,
        nperseg=length,
        noverlap=settings.overlapping,
        detrend="constant",
    )
    assert frequency == pytest.approx(wanted[0])
    assert np.abs(density - np.moveaxis(wanted[1], -1, 0)).max() < 1e-12 * np.abs(density).max()


def test_an_identification_brings_no_statistics_package() -> None:
    words = "import sys, numpy as np, workbench as wb; u = np.random.default_rng(1).standard_normal(500); "
    words += "wb.identify(wb.make_experiment(0.1, u, np.convolve(u, [0.0, 1.0, 0.5])[:500])); "
    words += "sys.exit(any(name in sys.modules for name in ('scipy.stats', 'scipy.signal', 'control', 'matplotlib')))"
    done = subprocess.run([sys.executable, "-c", words], check=False)
    assert done.returncode == 0
