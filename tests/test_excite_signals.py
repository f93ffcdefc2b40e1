"""PRBS and multisine: closed forms of their correlations and spectra, and what does not fit is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from workbench.data.excite.design import crest_factors, cross_correlation
from workbench.data.excite.signals import MultisineDesign, PrbsDesign, low_crest, parse_design
from workbench.errors import InputError
from workbench.signals.kinds import Prbs
from workbench.signals.shift_register import TAPS, jump, register_bits


def prime_factors(n: int) -> list[int]:
    found, d = [], 2
    while d * d <= n:
        if n % d == 0:
            found.append(d)
            while n % d == 0:
                n //= d
        d += 1
    return [*found, n] if n > 1 else found


@pytest.mark.parametrize("order", TAPS)
def test_every_register_has_the_maximum_length(order: int) -> None:
    """The state returns after 2^n − 1 steps and after no proper divisor of that."""
    length = (1 << order) - 1
    assert jump(order, 1, length) == 1
    assert all(jump(order, 1, length // q) != 1 for q in prime_factors(length) if q != length)


@pytest.mark.parametrize("order", [5, 9, 12])
def test_the_sequence_is_balanced_and_uncorrelated_with_every_shift_of_itself(order: int) -> None:
    length = (1 << order) - 1
    levels = 2.0 * register_bits(order, length, state=3) - 1.0
    assert levels.sum() == 1.0
    correlation = np.fft.irfft(np.abs(np.fft.rfft(levels)) ** 2, length)
    np.testing.assert_allclose(correlation, [length, *[-1.0] * (length - 1)], atol=1e-8 * length)


@pytest.mark.parametrize("order", [2, 7, 11, 18])
def test_registers_are_those_of_the_signal(order: int) -> None:
    assert Prbs(hold=1.0, order=order, seed=2).bits() == tuple(register_bits(order, (1 << order) - 1, state=2) == 1)


@pytest.mark.parametrize("order", [4, 11, 31])
def test_a_jump_leads_where_the_steps_lead(order: int) -> None:
    bits = register_bits(order, 3000, state=5)
    np.testing.assert_array_equal(register_bits(order, 200, state=jump(order, 5, 2345)), bits[2345:2545])


def slow_clock(bits: list[float], dt: float, rate: float, count: int) -> list[float]:
    """The source report's way (appendix 11.3): the next value whenever the time modulo 1/rate has wrapped round."""
    played, i, before = [], 0, 0.0
    for k in range(count):
        # Rounding of the modulo at whole multiples would decide by chance.
        phase = round((k * dt * rate) % 1.0, 9) % 1.0
        i += phase < before
        before = phase
        played.append(bits[i])
    return played


@pytest.mark.parametrize("rate", [30.0, 45.0, 7.3, 1.0 / 0.066])
def test_a_rate_that_does_not_divide_the_sampling_rate(rate: float) -> None:
    design = PrbsDesign(rate=rate, order=11)
    held = design.sequences(1, dt=0.022, samples=400, validation=100)
    whole = PrbsDesign(order=11).sequences(1, dt=1.0, samples=500, validation=0)
    bits = whole.identification.values[:, 0].tolist()
    both = np.concatenate([held.identification.values, held.validation.values])  # type: ignore[union-attr]
    assert both[:, 0].tolist() == slow_clock(bits, 0.022, rate, 500)


def test_the_order_is_the_shortest_that_does_not_repeat() -> None:
    found = PrbsDesign(rate=30.0).sequences(1, dt=0.022, samples=3000, validation=3000)
    assert (found.order, found.notes) == (12, ())  # 3960 bits, 4095 are the period
    assert found.period == pytest.approx(4095 / 30.0)
    two = PrbsDesign(rate=30.0).sequences(2, dt=0.022, samples=3000, validation=3000)
    assert two.order == 13


@pytest.mark.parametrize("order", [19, 31, 40])
def test_long_registers_begin_as_good_as_they_go_on(order: int) -> None:
    values = PrbsDesign(order=order).sequences(2, dt=0.01, samples=2000, validation=0).identification.values
    assert np.all(np.abs(values.mean(axis=0)) < 0.1)
    found = cross_correlation(values)
    assert found is not None
    assert found[0] < 0.12  # 1000 lags: 4 standard deviations of chance are 0.09; fixed seed


def test_the_band_is_where_the_spectrum_has_fallen_by_3_db() -> None:
    """Held over n samples: power ∝ (sin(π f n dt)/sin(π f dt))²/n²."""
    for n in (2, 3, 5):
        upper = PrbsDesign(rate=100.0 / n).sequences(1, dt=0.01, samples=1000, validation=0).band[1]
        angle = np.pi * upper * 0.01
        assert (np.sin(n * angle) / (n * np.sin(angle))) ** 2 == pytest.approx(0.5, abs=1e-4)
    assert PrbsDesign().sequences(1, dt=0.01, samples=1000, validation=0).band[1] == 50.0


def test_the_expected_spectrum_is_that_of_the_sequence() -> None:
    """A whole period at 30 Hz and 0.022 s: power in the upper half of the band against the closed form."""
    design = PrbsDesign(rate=30.0, order=13)
    found = design.sequences(1, dt=0.022, samples=12000, validation=0)
    power = np.abs(np.fft.rfft(found.identification.values[:, 0])) ** 2
    frequency = np.fft.rfftfreq(12000, 0.022)
    near = np.abs(frequency - found.band[1]) < 1.0
    low = (frequency > 0.0) & (frequency < 2.0)
    assert power[near].mean() / power[low].mean() == pytest.approx(0.5, rel=0.1)


def test_a_sequence_that_repeats_within_the_record_is_told() -> None:
    note = PrbsDesign(rate=50.0, order=11).sequences(1, dt=0.01, samples=3000, validation=3000).notes
    assert "repeats after 40.94 s" in note[0]
    two = PrbsDesign(order=10).sequences(2, dt=0.01, samples=800, validation=0).notes
    assert "one sequence, shifted by 5.11 s" in two[0]
    assert "above the sampling rate" in PrbsDesign(rate=200.0).sequences(1, dt=0.01, samples=80, validation=0).notes[0]


def test_each_input_has_its_amplitude() -> None:
    values = PrbsDesign(amplitude=(2.0, 0.5)).sequences(2, dt=0.01, samples=100, validation=0).identification.values
    assert set(values[:, 0]) == {-2.0, 2.0}
    assert set(values[:, 1]) == {-0.5, 0.5}


def test_another_seed_is_another_part_of_the_same_period() -> None:
    a, b = (PrbsDesign(order=7, seed=s).sequences(1, dt=1.0, samples=127, validation=0) for s in (1, 2))
    first, second = a.identification.values[:, 0], b.identification.values[:, 0]
    assert not np.array_equal(first, second)
    assert any(np.array_equal(np.roll(first, k), second) for k in range(127))


# -- multisine ---------------------------------------------------------------------------------


def test_the_multisine_has_equal_power_at_its_lines_and_none_elsewhere() -> None:
    found = MultisineDesign(amplitude=3.0, band=(0.5, 20.0), periods=4).sequences(
        1, dt=0.01, samples=4000, validation=0
    )
    part = found.identification
    assert (part.skip, len(part.kept), found.lines) == (1000, 4000, 196)
    assert np.abs(part.kept).max() == pytest.approx(3.0)
    spectrum = np.abs(np.fft.rfft(part.kept[:, 0]))
    lines = np.arange(5, 201) * 4
    np.testing.assert_allclose(spectrum[lines], spectrum[lines[0]], rtol=1e-9)
    assert np.delete(spectrum, lines).max() < 1e-9 * spectrum[lines[0]]
    assert found.band == (0.5, 20.0)


@pytest.mark.parametrize("lines", [np.arange(1, 151), np.arange(3, 300), np.arange(20, 40), np.arange(1, 300, 2)])
def test_clipping_lowers_the_crest_factor_well_below_schroeders(lines: NDArray[np.intp]) -> None:
    rng = np.random.default_rng(4)
    signal = low_crest(750, lines, start=rng.uniform(-1.0, 1.0, len(lines)))
    order = np.arange(len(lines))
    spectrum = np.zeros(376, dtype=complex)
    spectrum[lines] = np.exp(-1j * np.pi * order * (order + 1) / len(lines))
    schroeder = crest_factors(np.fft.irfft(spectrum, 750)[:, None])[0]
    assert crest_factors(signal[:, None])[0] < 0.93 * schroeder


def test_several_inputs_are_orthogonal_over_whole_periods_at_every_lag() -> None:
    found = MultisineDesign(band=(0.2, 30.0), periods=2).sequences(3, dt=0.01, samples=3000, validation=0)
    alike = cross_correlation(found.identification.kept)
    assert alike is not None
    assert alike[0] < 1e-12


def test_odd_lines_leave_even_ones_empty_and_validation_is_another_signal() -> None:
    found = MultisineDesign(band=(0.2, 30.0), periods=1, lines="odd").sequences(
        1, dt=0.01, samples=1000, validation=500
    )
    spectrum = np.abs(np.fft.rfft(found.identification.kept[:, 0]))
    assert spectrum[::2].max() < 1e-9
    assert found.validation is not None
    assert found.validation.kept.shape == (500, 1)
    assert not np.allclose(found.validation.kept, found.identification.kept[:500])


# -- words -------------------------------------------------------------------------------------


def test_designs_in_words() -> None:
    assert parse_design("prbs", "amplitude=2, rate=50,order=11,seed=3,offset=1") == PrbsDesign(
        amplitude=2.0, rate=50.0, order=11, seed=3, offset=1.0
    )
    assert parse_design("prbs", "amplitude=2:0.5,offset=0:1") == PrbsDesign(amplitude=(2.0, 0.5), offset=(0.0, 1.0))
    assert parse_design("prbs", "") == PrbsDesign()
    assert parse_design("multisine", "band=0.1:20,periods=2,lines=odd") == MultisineDesign(
        band=(0.1, 20.0), periods=2, lines="odd"
    )


@pytest.mark.parametrize(
    ("kind", "text", "words"),
    [
        ("prbss", "", "did you mean prbs"),
        ("prbs", "amplitud=2", "did you mean amplitude"),
        ("prbs", "amplitude", "needs a value"),
        ("prbs", "amplitude=a", "needs a number"),
        ("prbs", "amplitude=0", "must be positive"),
        ("prbs", "amplitude=nan", "must be positive"),
        ("prbs", "amplitude=1,amplitude=2", "given twice"),
        ("prbs", "order=41", "order must be 2 … 40"),
        ("prbs", "order=1.5", "whole number"),
        ("prbs", "rate=-1", "rate must be positive"),
        ("prbs", "seed=-1", "seed must be 0 or more"),
        ("prbs", "offset=inf", "offset must be a finite number"),
        ("multisine", "amplitude=1", "band is missing"),
        ("multisine", "band=1", "LOW:HIGH"),
        ("multisine", "band=2:1", "must rise"),
        ("multisine", "band=1:2,periods=0", "periods must be 1"),
        ("multisine", "band=1:2,lines=even", "known: all, odd"),
    ],
)
def test_wrong_words_are_refused_in_one_line(kind: str, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_design(kind, text)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: MultisineDesign(band=(1.0, 60.0)).sequences(1, dt=0.01, samples=400, validation=0),
            "half the sampling",
        ),
        (lambda: MultisineDesign(band=(1.0, 2.0)).sequences(1, dt=0.01, samples=401, validation=0), "take 400 samples"),
        (lambda: MultisineDesign(band=(0.1, 0.5)).sequences(1, dt=0.01, samples=400, validation=0), "holds 0 lines"),
        (
            lambda: PrbsDesign(amplitude=(1.0, 2.0)).sequences(1, dt=0.1, samples=9, validation=0),
            "2 values, but 1 input;",
        ),
    ],
)
def test_a_design_that_does_not_fit_is_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert words in str(caught.value)
