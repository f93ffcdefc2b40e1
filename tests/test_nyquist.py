"""Crossings of Nyquist curves: textbook loops, and lightly damped modes against a brute-force scan."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.loops.describing.describe import standard_block
from workbench.loops.describing.static import StaticBlock
from workbench.loops.nyquist.grid import adaptive_grid
from workbench.loops.nyquist.nyquist import _distortion, nyquist

THIRD = control.tf([1.0], [1.0, 3.0, 3.0, 1.0])


def loop(gain: float = 1.0) -> control.StateSpace:
    return control.ss(gain * THIRD)


def test_relay_with_a_third_order_lag() -> None:
    """1/(s + 1)³ is −1/8 at √3 rad/s; N = 4M/πA gives A = M/2π; stable."""
    (c,) = nyquist(loop(), standard_block("relay", {"level": 2.0})).crossings
    assert c.frequency_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-12)
    assert c.real == pytest.approx(-0.125, rel=1e-12)
    assert c.amplitude == pytest.approx(1.0 / math.pi, rel=1e-12)
    assert (c.stable, c.unstable_below, c.unstable_above) == (True, 0, 2)


def test_integrators_are_on_the_axis_in_any_coordinates() -> None:
    """A chain of m integrators beside stable poles, and an unstable one or none, mixed by a random transformation."""
    random = np.random.default_rng(0)
    for _ in range(60):
        chain, stable, unstable = (int(random.integers(*ends)) for ends in ((1, 4), (0, 6), (0, 2)))
        poles = [*(0.0 for _ in range(chain)), *(-(10.0 ** random.uniform(-1.0, 2.0, stable))), *([0.3] * unstable)]
        size = len(poles)
        plain = np.diag(poles) + np.diag([1.0] * (chain - 1) + [0.0] * (size - chain), 1)
        mixed = np.linalg.qr(random.normal(size=(size, size)))[0] * 10.0 ** random.uniform(-0.5, 0.5, size)
        part = LinearPart(mixed @ plain @ np.linalg.inv(mixed), np.ones(size), np.ones(size))
        assert part.unstable(0.0) == unstable


def test_the_count_of_unstable_poles_is_that_of_the_characteristic_polynomial() -> None:
    """Random loops, integrators and dead times (Padé) among them: den + k·num at gains beside every crossing found."""
    random = np.random.default_rng(7)
    crossings = 0
    for _ in range(12):
        real = -(10.0 ** random.uniform(-1.0, 1.0, int(random.integers(1, 4))))
        w, damping = 10.0 ** random.uniform(-0.5, 1.0), random.uniform(0.02, 0.9)
        poles = [
            *real,
            w * complex(-damping, math.sqrt(1.0 - damping**2)),
            w * complex(-damping, -math.sqrt(1.0 - damping**2)),
        ]
        poles[: int(random.integers(0, 2))] = [0.0] * int(random.integers(1, 3))
        num, den = np.array([10.0 ** random.uniform(-1.0, 1.5)]), np.poly(poles).real
        if random.random() < 0.3:
            late, early = control.pade(10.0 ** random.uniform(-1.5, 0.0), 3)
            num, den = np.polymul(num, late), np.polymul(den, early)
        for c in nyquist(control.ss(control.tf(num, den)), band=(1e-4, 1e3)).crossings:
            if c.gain > 0.0:
                beside = [np.roots(np.polyadd(den, c.gain * (1.0 + e) * num)).real for e in (-1e-3, 1e-3)]
                assert [int(np.sum(p > 1e-9)) for p in beside] == [c.unstable_below, c.unstable_above]
                crossings += 1
    assert crossings > 6


def test_a_saturation_needs_more_than_the_critical_gain() -> None:
    (c,) = nyquist(loop(7.9), standard_block("saturation")).crossings
    assert c.amplitude is None
    assert c.stable is None
    (c,) = nyquist(loop(10.0), standard_block("saturation")).crossings
    assert c.amplitude is not None
    assert standard_block("saturation").gain(c.amplitude).real == pytest.approx(0.8, rel=1e-12)
    assert c.stable


def test_a_dead_band_has_an_unstable_cycle() -> None:
    """Small motions die, large ones grow: N rises from 0 to 1 past the critical 0.8."""
    (c,) = nyquist(loop(10.0), standard_block("dead_band")).crossings
    assert (c.stable, c.unstable_below, c.unstable_above) == (False, 0, 2)


def test_a_relay_with_a_dead_zone_has_two_cycles() -> None:
    """N rises to 2M/πδ at A = δ√2 and falls again; the larger cycle is stable."""
    small, large = nyquist(loop(), standard_block("relay", {"level": 2.0, "dead_zone": 0.1})).crossings
    assert small.amplitude is not None
    assert large.amplitude is not None
    if small.amplitude > large.amplitude:
        small, large = large, small
    assert (small.stable, large.stable) == (False, True)
    for c in (small, large):
        assert c.amplitude is not None
        assert math.sqrt(1.0 - (0.1 / c.amplitude) ** 2) / (math.pi * c.amplitude) == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("mu", [0.1, 1.0])
def test_van_der_pol_in_both_forms(mu: float) -> None:
    """Amplitude 2 at 1 rad/s, with the negative damping in the linear part or in the block."""
    first = nyquist(
        control.ss(control.tf([mu, 0.0], [1.0, -mu, 1.0])), standard_block("cubic", {"coefficient": 1.0 / 3.0})
    )
    # Here L has poles on the imaginary axis: the crossing lies at infinity.
    second = nyquist(control.ss(control.tf([mu, 0.0], [1.0, 0.0, 1.0])), StaticBlock(lambda x: x**3 / 3.0 - x))
    for result in (first, second):
        (c,) = result.crossings
        assert c.amplitude == pytest.approx(2.0, rel=1e-9)
        assert c.frequency_hz == pytest.approx(1.0 / (2.0 * math.pi), rel=1e-9)
        assert (c.stable, c.unstable_below, c.unstable_above) == (True, 2, 0)


def test_a_relay_with_hysteresis_oscillates_slower() -> None:
    block = standard_block("relay_with_hysteresis", {"half_width": 0.1})
    c = next(c for c in nyquist(loop(), block).crossings if c.amplitude is not None)
    assert c.amplitude is not None
    value = 1.0 / (2j * math.pi * c.frequency_hz + 1.0) ** 3
    assert abs(1.0 + block.gain(c.amplitude) * value) < 1e-9
    assert c.frequency_hz < math.sqrt(3.0) / (2.0 * math.pi)
    assert c.stable


def test_a_rate_limiter_around_an_integrator() -> None:
    """5/(s(s + 1)) is stable without the limiter; the cycle is the border beyond which motions grow."""
    block = standard_block("rate_limiter")
    c = next(
        c for c in nyquist(control.ss(control.tf([5.0], [1.0, 1.0, 0.0])), block).crossings if c.amplitude is not None
    )
    assert c.amplitude is not None
    s = 2j * math.pi * c.frequency_hz
    assert abs(1.0 + block.gain(c.amplitude, c.frequency_hz) * 5.0 / (s * (s + 1.0))) < 1e-8


def modes(seed: int, count: int) -> LinearPart:
    """Lightly damped modes over five decades with residues of both signs."""
    random = np.random.default_rng(seed)
    omega, zeta = 2.0 * np.pi * np.geomspace(0.02, 900.0, count), 10.0 ** random.uniform(-4.0, -1.0, count)
    a, b, c = np.zeros((2 * count, 2 * count)), np.zeros(2 * count), np.zeros(2 * count)
    for i in range(count):
        a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[0.0, 1.0], [-(omega[i] ** 2), -2.0 * zeta[i] * omega[i]]]
    b[1::2], c[1::2] = random.standard_normal(count) * omega, random.standard_normal(count)
    return LinearPart(a, b, c)


@pytest.mark.parametrize("seed", [1, 2])
def test_no_crossing_of_lightly_damped_modes_is_missed(seed: int) -> None:
    part = modes(seed, 16)
    found = np.array([c.frequency_hz for c in nyquist(part).negative])
    f = np.geomspace(0.01, 1000.0, 60_001)
    with one_thread():
        value = np.concatenate([part.response(x) for x in np.array_split(f, 20)])
    brute = f[np.flatnonzero((value.imag[1:] * value.imag[:-1] < 0.0) & (value.real[1:] < 0.0))]
    assert len(brute) > 3
    assert len(found) >= len(brute)
    for x in brute:
        assert np.min(np.abs(found / x - 1.0)) < 4e-4
    assert len(adaptive_grid(part, (0.01, 1000.0))[0]) < 8000


def test_a_mode_of_damping_1e_6_is_found() -> None:
    """Between two points of any usual grid the curve makes a circle of diameter 0.5 over the negative axis."""
    w = 2.0 * math.pi * 7.7
    circle = control.tf([1e-6 * w, 0.0], [1.0, 2e-6 * w, w * w])
    found = nyquist(control.ss(loop(1.0) - circle)).crossings
    assert any(c.frequency_hz == pytest.approx(7.7, rel=1e-6) and c.real == pytest.approx(-0.5, 1e-3) for c in found)
    assert any(c.frequency_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-4) for c in found)


def test_direct_feed_through_counts_in_the_poles() -> None:
    """(s − 1)/(s + 1) with gain k: pole (k − 1)/(1 + k)."""
    part = LinearPart(np.array([[-1.0]]), np.array([1.0]), np.array([-2.0]), 1.0)
    for gain in (0.5, 2.0, 5.0):
        assert part.closed_poles(gain) == pytest.approx([(gain - 1.0) / (1.0 + gain)])
    assert (part.unstable(0.5), part.unstable(2.0)) == (0, 1)


def _matrices(system: control.StateSpace) -> tuple[Floats, Floats, Floats]:
    return system.A, system.B[:, 0], system.C[0]


def test_a_complex_gain_is_realised_at_its_frequency() -> None:
    """A gain e^{−jφ} that puts a pair on the axis does so in the realisation, too."""
    part, f = LinearPart(*_matrices(loop())), 0.21
    gain = -1.0 / complex(part.response(np.array([f]))[0])
    poles = part.closed_poles(gain, f)
    assert np.min(np.abs(poles - 2j * math.pi * f)) < 1e-9


def test_picture_and_table(tmp_path: Path) -> None:
    result = nyquist(loop(10.0), standard_block("saturation"), name="loop")
    result.plot(tmp_path / "n.png")
    result.to_csv(tmp_path / "n.csv")
    assert "frequency_hz,real,imag,gain,amplitude" in (tmp_path / "n.csv").read_text(encoding="utf-8")
    assert set(result.to_dict()["crossings"][0]) >= {
        "frequency_hz", "real", "amplitude", "stable", "unstable_below", "unstable_above",
    }  # fmt: skip
    assert result.band(1.0, 2.0).crossings == ()


def test_mistakes_are_one_line() -> None:
    with pytest.raises(InputError, match="the lower first"):
        nyquist(loop(), band=(10.0, 1.0))
    with pytest.raises(InputError, match="continuous"):
        nyquist(control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1))
    with pytest.raises(InputError, match="rising"):
        nyquist(loop(), standard_block("relay"), amplitudes=(1.0, 0.5))


def test_a_transfer_function_is_a_loop_too() -> None:
    (c,) = nyquist(THIRD, standard_block("relay", {"level": 2.0})).crossings
    assert c.real == pytest.approx(-0.125, rel=1e-12)
    with pytest.raises(InputError, match=r"no realisation in state space"):
        nyquist(control.tf([1.0, 0.0, 0.0], [1.0, 1.0]))
    with pytest.raises(InputError, match=r"FrequencyResponseData is not a linear model: give a StateSpace"):
        nyquist(control.frd([1.0, 2.0], [1.0, 2.0]))


def test_the_distortion_is_the_third_harmonic_that_comes_round_the_loop() -> None:
    """A relay's third harmonic is a third of its first; the loop passes it on by |L(3jω)|, and the first by |L(jω)|."""
    (c,) = nyquist(loop(), standard_block("relay", {"level": 2.0})).crossings
    w = math.sqrt(3.0)  # where |L| is (1 + w²)^(−3/2) = 1/8
    assert c.distortion == pytest.approx((1.0 + 9.0 * w**2) ** -1.5 / 3.0 * 8.0, rel=1e-6)


def test_where_one_harmonic_meets_an_undamped_pole_the_distortion_is_not_known() -> None:
    w = 2.0
    undamped = LinearPart(np.array([[0.0, 3.0 * w], [-3.0 * w, 0.0]]), np.array([0.0, 1.0]), np.array([1.0, 0.0]))
    block = standard_block("relay")
    assert _distortion(undamped, block, 1.0, w / (2.0 * math.pi)) is None
    assert _distortion(undamped, block, 1.0, 1.1 * w / (2.0 * math.pi)) is not None


def test_the_grid_of_a_sampled_loop_does_not_depend_on_the_unit_of_time() -> None:
    part = LinearPart(np.array([[1.2, -0.5], [1.0, 0.0]]), np.array([1.0, 0.0]), np.array([0.1, 0.3]), dt=0.5)
    slower = replace(part, dt=4.0)
    f, value = adaptive_grid(part, (1e-3, 0.99))
    other, same = adaptive_grid(slower, (1e-3 / 8.0, 0.99 / 8.0))
    assert len(other) == len(f)
    assert 8.0 * other == pytest.approx(f, rel=1e-9)
    assert same == pytest.approx(value, rel=1e-9)
