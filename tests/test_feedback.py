"""Gains of a scalar feedback at which poles reach the border of stability: closed forms, and other methods."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from scipy.linalg import matrix_balance

from tests.random_systems import pole_error
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.limit_cycles.feedback.gains import CriticalGain, crossings, fixed_modes, intervals, stable_gains
from workbench.limit_cycles.feedback.initial_motion import InitialMotion, mean_magnitude
from workbench.limit_cycles.feedback.locus import fastest, locus
from workbench.limit_cycles.feedback.settling import GainRun, SettlingStudy, with_optimum

ALL = (-math.inf, math.inf)
HZ = 2.0 * math.pi


def plant(system: control.TransferFunction | control.StateSpace) -> LinearPart:
    s = control.ss(system)
    return LinearPart(s.A, s.B, s.C, s.D, dt=float(s.dt or 0.0))


def found(system: LinearPart) -> tuple[tuple[CriticalGain, ...], tuple[tuple[float, float], ...]]:
    every = crossings(system)
    return every, stable_gains(intervals(system, [c.gain for c in every]), ALL)


def assert_stable(system: LinearPart, expected: list[tuple[float, float]], at: list[tuple[float, float]]) -> None:
    """Compare stable intervals and (gain, frequency) of all crossings with what they must be."""
    every, stable = found(system)
    assert np.array(stable).reshape(-1, 2) == pytest.approx(np.array(expected).reshape(-1, 2), rel=1e-9)
    assert [c.gain for c in every] == pytest.approx([g for g, _ in at], rel=1e-9, abs=1e-12)
    assert [c.frequency_hz for c in every] == pytest.approx([f for _, f in at], rel=1e-7, abs=1e-9)


# -- closed forms ------------------------------------------------------------------------------


def test_third_order_lag() -> None:
    """(s + 1)³ = g: Hurwitz gives −8 < g < 1; at −8 the poles are ±j√3."""
    lag = plant(control.tf([1.0], [1.0, 3.0, 3.0, 1.0]))
    assert_stable(lag, [(-8.0, 1.0)], [(-8.0, math.sqrt(3.0) / HZ), (1.0, 0.0)])
    every, _ = found(lag)
    assert [(c.unstable_below, c.unstable_above) for c in every] == [(2, 0), (0, 1)]
    assert [c.real for c in every] == pytest.approx([-1.0 / 8.0, 1.0])
    assert max(c.residual for c in every) < 1e-7  # three poles at −1 without feedback: the square root of rounding


def test_unstable_first_order() -> None:
    assert_stable(plant(control.tf([1.0], [1.0, -1.0])), [(-math.inf, -1.0)], [(-1.0, 0.0)])


def test_double_integrator_with_derivative() -> None:
    """(1 + 2s)/s²: s² − 2gs − g; both open-loop poles stand at 0."""
    assert_stable(plant(control.tf([2.0, 1.0], [1.0, 0.0, 0.0])), [(-math.inf, 0.0)], [(0.0, 0.0)])


def test_double_integrator_alone_is_never_stable() -> None:
    every, stable = found(plant(control.tf([1.0], [1.0, 0.0, 0.0])))
    assert stable == ()
    assert [c.gain for c in every] == [0.0]


def turned(system: LinearPart, seed: int = 0) -> LinearPart:
    """Return the same G in coordinates of no meaning: rounding moves its poles on the border off it."""
    T = np.random.default_rng(seed).normal(size=system.A.shape)
    C = np.asarray(np.linalg.solve(T.T, system.c), dtype=np.float64)
    return LinearPart(T @ system.A @ np.linalg.inv(T), T @ system.B, C, system.D, dt=system.dt)


def test_integrators_that_rounding_moved() -> None:
    """1/(z − 1): z = 1 + g. z/(z − 1)²: z² − (2 + g) z + 1, on the circle for −4 < g < 0."""
    single = plant(control.tf([1.0], [1.0, -1.0], 1.0))
    assert_stable(turned(single), [(-2.0, 0.0)], [(-2.0, 0.5), (0.0, 0.0)])
    double = plant(control.tf([1.0, 0.0], [1.0, -2.0, 1.0], 1.0))
    assert_stable(turned(double), [], [(-4.0, 0.5), (0.0, 0.0)])
    assert_stable(turned(plant(control.tf([1.0], [1.0, 0.0, 0.0]))), [], [(0.0, 0.0)])


def test_undamped_structure_in_any_coordinates() -> None:
    """1/(s² + 1) + 1/(s² + 4) is real for all ω; the one gain that counts is 1/G(0) = 0.8, where it diverges."""
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag([1.0, 4.0]), np.zeros((2, 2))]])
    structure = LinearPart(A, np.array([0.0, 0.0, 1.0, 1.0]), np.array([1.0, 1.0, 0.0, 0.0]))
    assert_stable(turned(structure), [], [(0.0, 1.0 / HZ), (0.0, 2.0 / HZ), (0.8, 0.0)])


def test_repeated_undamped_pair() -> None:
    """(s² + 2s + 3)/(s² + 1)²: a double pair on the border, and G(0) = 3."""
    double = plant(control.tf([1.0, 2.0, 3.0], np.polymul([1.0, 0.0, 1.0], [1.0, 0.0, 1.0])))
    assert_stable(turned(double), [], [(0.0, 1.0 / HZ), (1.0 / 3.0, 0.0)])


@pytest.mark.parametrize("seed", range(4))
def test_an_integrator_that_is_not_seen_hides_no_crossing(seed: int) -> None:
    """1/(s + 1) + 1/(s + 2) + 1/(s + 3) beside an integrator that y does not see: G(0) = 11/6."""
    one = np.ones(4)
    hidden = LinearPart(np.diag([0.0, -1.0, -2.0, -3.0]), one, np.array([0.0, 1.0, 1.0, 1.0]))
    assert_stable(turned(hidden, seed), [], [(0.0, 0.0), (6.0 / 11.0, 0.0)])


def test_poles_that_cross_at_one_gain_have_the_same_sides() -> None:
    """1/z³: z³ = g; at ±1 a real pole and a pair cross together, a rounding error apart."""
    delay = turned(LinearPart(np.eye(3, k=1), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), dt=1.0))
    every, _ = found(delay)
    assert [(round(c.gain), c.unstable_below, c.unstable_above) for c in every] == [(-1, 3, 0)] * 2 + [(1, 0, 3)] * 2


def test_undamped_oscillator_with_rate_feedback() -> None:
    assert_stable(plant(control.tf([3.0, 0.0], [1.0, 0.0, 4.0])), [(-math.inf, 0.0)], [(0.0, 2.0 / HZ)])


@pytest.mark.parametrize("mu", [0.1, 1.0])
def test_negative_damping_needs_more_than_itself(mu: float) -> None:
    """s² − (μ + g)s + 1."""
    assert_stable(plant(control.tf([1.0, 0.0], [1.0, -mu, 1.0])), [(-math.inf, -mu)], [(-mu, 1.0 / HZ)])


def test_direct_part_and_a_pole_through_infinity() -> None:
    """(s + 2)/(s + 1): the pole is (2g − 1)/(1 − g), infinite at g = 1/D = 1."""
    assert_stable(
        plant(control.tf([1.0, 2.0], [1.0, 1.0])),
        [(-math.inf, 0.5), (1.0, math.inf)],
        [(0.5, 0.0), (1.0, math.inf)],
    )


def test_direct_part_of_second_order() -> None:
    """(s² + 1)/(s² + s + 4): (1 − g)s² + s + 4 − g is stable for g < 1 and for no g between 1 and 4, nor above.

    At g > 4 both outer coefficients are negative and the middle one is positive.
    """
    every, stable = found(plant(control.tf([1.0, 0.0, 1.0], [1.0, 1.0, 4.0])))
    assert np.array(stable) == pytest.approx(np.array([[-math.inf, 1.0]]))
    assert [c.gain for c in every] == pytest.approx([1.0, 4.0])


@pytest.mark.parametrize(("a", "dt"), [(0.5, 1.0), (1.3, 0.02)])
def test_sampled_lag(a: float, dt: float) -> None:
    """The pole is a + g."""
    lag = LinearPart(np.array([[a]]), np.ones(1), np.ones(1), dt=dt)
    assert_stable(lag, [(-1.0 - a, 1.0 - a)], [(-1.0 - a, 0.5 / dt), (1.0 - a, 0.0)])


def test_two_delays() -> None:
    """z² = g: stable for |g| < 1; at 1 both z = 1 and z = −1, at −1 z = ±j."""
    delays = LinearPart(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([1.0, 0.0]), np.array([0.0, 1.0]), dt=0.1)
    every, stable = found(delays)
    assert np.array(stable) == pytest.approx(np.array([[-1.0, 1.0]]))
    assert [c.gain for c in every] == pytest.approx([-1.0, 1.0, 1.0])
    assert [c.frequency_hz for c in every] == pytest.approx([2.5, 0.0, 5.0])
    assert [(c.unstable_below, c.unstable_above) for c in every] == [(2, 0), (0, 2), (0, 2)]


def test_no_states() -> None:
    gain = LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 2.0)
    every, _ = found(gain)
    assert [c.gain for c in every] == [0.5]


# -- poles that stay ---------------------------------------------------------------------------


def test_a_hidden_unstable_pole_is_named_and_nothing_is_stable() -> None:
    hidden = LinearPart(np.diag([-1.0, 0.5]), np.array([1.0, 1.0]), np.array([1.0, 0.0]))
    every, stable = found(hidden)
    assert stable == ()
    assert [c.gain for c in every] == pytest.approx([1.0])
    assert fixed_modes(hidden, [-5.0, 0.5, 3.0]) == pytest.approx((0.5,))


def test_a_hidden_undamped_oscillation_is_named_once() -> None:
    a = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 3.0], [0.0, -3.0, 0.0]])
    hidden = LinearPart(a, np.array([1.0, 0.0, 0.0]), np.array([1.0, 1.0, 0.0]))
    assert found(hidden)[1] == ()
    assert fixed_modes(hidden, [-5.0, 0.5]) == pytest.approx((3.0j,))


def test_an_unstable_pole_that_the_feedback_moves_is_not_fixed() -> None:
    assert fixed_modes(plant(control.tf([1.0], [1.0, -1.0])), [-2.0, 1.0]) == ()


# -- other methods -----------------------------------------------------------------------------


def random_plant(seed: int, *, sampled: bool = False) -> LinearPart:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 9))
    a = rng.normal(size=(n, n))
    a = a / np.abs(np.linalg.eigvals(a)).max() * 1.1 if sampled else a - 0.5 * np.eye(n)
    d = 0.0 if seed % 2 else float(rng.normal())
    return LinearPart(a, rng.normal(size=n), rng.normal(size=n), d, dt=0.05 if sampled else 0.0)


@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_counts_agree_with_a_scan_over_the_gain(seed: int, sampled: bool) -> None:
    system = random_plant(seed, sampled=sampled)
    every = crossings(system)
    parts = intervals(system, [c.gain for c in every])
    size = np.geomspace(1e-3, 1e3, 250)
    for gain in np.concatenate([-size, size]).tolist():
        if any(abs(gain / c.gain - 1.0) < 1e-4 for c in every if c.gain):
            continue
        values = np.linalg.eigvals(system.closed(gain))
        beyond = int(np.sum(np.abs(values) > 1.0 if sampled else values.real > 0.0))
        inside = next(p for p in parts if p.low <= gain <= p.high)
        assert inside.unstable == beyond, gain


@pytest.mark.parametrize("seed", range(12))
def test_frequencies_are_the_roots_of_a_polynomial(seed: int) -> None:
    """Im(num(jω)·conj(den(jω))) is an odd polynomial in ω; its positive roots are all crossings of the real axis."""
    system = random_plant(seed)
    (ne, no), (de, do) = (_parts(p) for p in _polynomials(system))
    odd = np.polysub(np.polymul(no, de), np.polymul(ne, do))  # in ω
    roots = np.roots(np.trim_zeros(odd, "f"))
    expected = sorted(r.real / HZ for r in roots if abs(r.imag) < 1e-7 * (1.0 + abs(r)) and r.real > 1e-6)
    got = sorted(c.frequency_hz for c in crossings(system) if 0.0 < c.frequency_hz < math.inf)
    assert got == pytest.approx(expected, rel=1e-6)


def _polynomials(system: LinearPart) -> tuple[Floats, Floats]:
    den = np.poly(system.A)
    num = np.poly(system.A - np.outer(system.b, system.c)) - den + system.d * den
    return np.real(num), np.real(den)


def _parts(p: Floats) -> tuple[Floats, Floats]:
    """Return real and imaginary part of p(jω) as polynomials in ω."""
    n = len(p) - 1
    turned = [c * 1j ** (n - k) for k, c in enumerate(p)]
    return np.array([t.real for t in turned]), np.array([t.imag for t in turned])


@pytest.mark.parametrize("seed", range(1, 12, 2))
def test_negative_gains_agree_with_python_controls_gain_margins(seed: int) -> None:
    system = random_plant(seed)
    model = control.ss(system.A, system.B, system.C, system.D)
    margins, _, _, at, *_ = control.stability_margins(model, returnall=True)
    expected = sorted((f / HZ, -m) for f, m in zip(at, margins, strict=True))
    got = sorted((c.frequency_hz, c.gain) for c in crossings(system) if c.gain < 0.0)
    assert np.array(got).reshape(-1, 2) == pytest.approx(np.array(expected).reshape(-1, 2), rel=1e-5, abs=1e-9)


def test_each_crossing_has_a_pole_on_the_border() -> None:
    for seed in range(12):
        assert all(c.residual < 1e-8 for c in crossings(random_plant(seed)) if math.isfinite(c.frequency_hz))


def test_scaling_of_the_states_changes_nothing() -> None:
    system = random_plant(3)
    t = np.diag(np.geomspace(1e-6, 1e6, len(system.A)))
    inverse = np.linalg.inv(t)
    other = LinearPart(t @ system.A @ inverse, t @ system.B, system.C @ inverse, system.D)
    balanced, (scale, _) = matrix_balance(other.A, permute=False, separate=True)
    again = LinearPart(balanced, other.b / scale, other.c * scale, other.D)
    assert [c.gain for c in crossings(again)] == pytest.approx([c.gain for c in crossings(system)], rel=1e-7)


# -- along the gain ----------------------------------------------------------------------------


def test_root_locus_of_two_lags() -> None:
    """(s + 1)(s + 3) = g: real poles until they meet at −2 for g = −1, then −2 ± j√(−1 − g)."""
    found_locus = locus(plant(control.tf([1.0], [1.0, 4.0, 3.0])), -5.0, 2.0)
    for gain, poles in zip(found_locus.gains, found_locus.poles, strict=True):
        assert pole_error(poles, np.roots([1.0, 4.0, 3.0 - gain])) < 1e-7
    # Each pole is followed: none jumps farther than where they meet demands.
    assert np.abs(np.diff(found_locus.poles, axis=0)).max() < 0.3


def test_fastest_decay_where_two_oscillations_are_alike() -> None:
    """Two oscillators, one damped and one driven by the gain: growth −1 + g/2 and −2 − g/2 meet at g = −1."""
    first = control.tf([1.0, 0.0], [1.0, 2.0, 101.0])
    second = control.tf([-1.0, 0.0], [1.0, 4.0, 40004.0])
    best = fastest(plant(first + second), -10.0, 5.0)
    assert best is not None
    assert best.gain == pytest.approx(-1.0, abs=5e-3)
    assert best.growth == pytest.approx(-1.5, abs=5e-3)


def test_fastest_of_a_first_order_system_is_none() -> None:
    assert fastest(plant(control.tf([1.0], [1.0, -1.0])), -5.0, -1.0) is None


def test_mean_magnitude_of_a_sine_is_two_over_pi() -> None:
    time = np.linspace(0.0, 3.0, 3001)
    size = mean_magnitude(time, 2.0 * np.sin(2.0 * np.pi * 5.0 * time), 0.2)
    assert size[time > 0.2] == pytest.approx(4.0 / math.pi, rel=1e-4)


# -- settling ----------------------------------------------------------------------------------


def gain_run(gain: float, seconds: float) -> GainRun:
    none = np.zeros(0)
    return GainRun(
        gain=gain, settling_seconds=seconds, seconds=100.0, left=0.0, peak_deflection=0.0, peak_rate=0.0,
        deflection_limited=None, rate_limited=None, why="", time=none, magnitude=none,
    )  # fmt: skip


@pytest.mark.parametrize("order", [2, 4, 6])
def test_optimum_of_an_exact_parabola_by_polynomials_of_any_order(order: int) -> None:
    """Coefficients that are rounding have roots far away, which must not spoil the near one."""
    none = np.zeros(0)
    motion = InitialMotion(0.0, 0.0, {}, {}, 1.0, 1.0, 0.0, "", none, none)
    runs = tuple(gain_run(g, 3.0 + (g - 0.4) ** 2) for g in np.linspace(-1.0, 2.0, 13).tolist())
    study = SettlingStudy(
        variable="y", unit=None, target="u", target_unit=None, threshold=0.01, polynomial_order=order, motion=motion,
        actuator=None, runs=runs,
    )  # fmt: skip
    found = with_optimum(study)
    assert (found.optimum, found.optimum_seconds) == pytest.approx((0.4, 3.0), abs=1e-9)
    assert not found.optimum_at_end
