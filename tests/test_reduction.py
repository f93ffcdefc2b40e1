"""Balanced reduction, cancellation, mirrored poles, low-pass, sections: closed forms and a second method each."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.linalg import block_diag, eig, solve_continuous_lyapunov

from tests.random_systems import pole_error
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.point.reduction.balanced import balanced_reduction
from workbench.point.reduction.band_error import band_error
from workbench.point.reduction.cancel import cancel, mirror
from workbench.point.reduction.factored import Factored, factored, low_pass, to_state_space

F = np.geomspace(1e-3, 1e2, 400)


def part_of(system: control.StateSpace) -> LinearPart:
    return LinearPart(np.array(system.A), np.array(system.B)[:, 0], np.array(system.C)[0], float(system.D[0, 0]))


def modes(count: int = 6, *, seed: int = 3) -> LinearPart:
    """Lightly damped modes of mixed weights."""
    random = np.random.default_rng(seed)
    blocks, b, c = [], [], []
    for k in range(count):
        w, d = 2.0 * np.pi * 0.5 * 1.7**k, 0.02 + 0.05 * random.random()
        blocks.append(np.array([[0.0, w], [-w, -2.0 * d * w]]))
        b += [0.0, random.normal()]
        c += [random.normal(), random.normal()]
    A = np.zeros((2 * count, 2 * count))
    for k, block in enumerate(blocks):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    return LinearPart(A, np.array(b), np.array(c))


def hankel(part: LinearPart) -> Floats:
    """Square roots of the eigenvalues of the product of both Gramians."""
    P = solve_continuous_lyapunov(part.A, -np.outer(part.B, part.B))
    Q = solve_continuous_lyapunov(part.A.T, -np.outer(part.C, part.C))
    return np.asarray(np.sort(np.sqrt(np.abs(np.linalg.eigvals(P @ Q))))[::-1], dtype=np.float64)


def plain(*, zeros: list[complex], poles: list[complex], gain: float = 1.0) -> Factored:
    return Factored(zeros=np.array(zeros, dtype=complex), poles=np.array(poles, dtype=complex), gain=gain)


# -- balanced reduction ---------------------------------------------------------------------------


def test_hankel_values_of_a_lag_in_closed_form() -> None:
    # k/(τs + 1): both Gramians are known, the value is k/2.
    found = balanced_reduction(LinearPart(np.array([[-4.0]]), np.array([8.0]), np.array([3.0])), order=1)
    assert found.hankel == pytest.approx([3.0])
    assert found.bound == 0.0
    assert found.order == 1


def test_hankel_values_are_those_of_the_gramians() -> None:
    part = modes()
    assert balanced_reduction(part).hankel == pytest.approx(hankel(part), rel=1e-8)


@pytest.mark.parametrize("method", ["match-dc", "truncate"])
@pytest.mark.parametrize("order", [2, 4, 6, 10])
def test_the_error_keeps_its_bound_and_exceeds_the_first_value_left_out(method: str, order: int) -> None:
    part = modes()
    found = balanced_reduction(part, order=order, method=method)
    f = np.unique(np.concatenate([F, np.abs(part.poles) / (2.0 * np.pi), [0.0]]))
    error = float(np.max(np.abs(part.response(f) - found.part.response(f))))
    assert found.order == order
    assert error <= found.bound * (1.0 + 1e-9)
    # No model of this order does better than the first value left out; the grid misses its peak by little.
    assert error >= 0.98 * found.hankel[order]


def test_as_python_control_reduces() -> None:
    part = modes()
    for method, name in (("match-dc", "matchdc"), ("truncate", "truncate")):
        other = control.balred(control.ss(part.A, part.B, part.C, part.D), 6, method=name)
        ours = balanced_reduction(part, order=6, method=method).part.response(F)
        assert ours == pytest.approx(part_of(other).response(F), rel=1e-6, abs=1e-9)


def test_match_dc_keeps_the_gain_at_rest_and_a_zero_there() -> None:
    part = modes()
    rest = np.array([0.0])
    found = balanced_reduction(part, order=5)
    assert found.part.response(rest) == pytest.approx(part.response(rest), rel=1e-9)
    # The derivative of the same: C x' = C A x + C B u has a zero at 0.
    rate = LinearPart(part.A, part.A @ part.B, part.C, part.C @ part.B)
    reduced = balanced_reduction(rate, order=5).part
    assert abs(reduced.response(rest)[0]) < 1e-9 * np.max(np.abs(rate.response(F)))


def test_unstable_poles_are_kept_where_they_are() -> None:
    part = modes(4)
    A = np.block([[part.A, np.zeros((8, 2))], [np.zeros((2, 8)), np.array([[0.3, 5.0], [-5.0, 0.3]])]])
    both = LinearPart(A, np.concatenate([part.b, [1.0, 0.5]]), np.concatenate([part.c, [0.2, 1.0]]))
    found = balanced_reduction(both, order=6)
    unstable = found.part.poles[found.part.poles.real > 0.0]
    assert found.unstable == 2
    assert pole_error(unstable, np.array([0.3 - 5.0j, 0.3 + 5.0j])) < 1e-6
    # The stable part is reduced as it is alone.
    assert found.hankel == pytest.approx(hankel(part), rel=1e-6)
    error = float(np.max(np.abs(both.response(F) - found.part.response(F))))
    assert error <= found.bound * (1.0 + 1e-9)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("integrators", [1, 2])
def test_integrators_moved_by_rounding_count_as_unstable(seed: int, integrators: int) -> None:
    """In coordinates of no meaning an integrator stands a rounding error left or right of the axis."""
    rng = np.random.default_rng(seed)
    slow = np.diag(np.ones(integrators - 1), 1)
    A = block_diag(slow, *[np.array([[-0.1 * w, w], [-w, -0.1 * w]]) for w in (1.0, 3.0, 10.0)])
    T = rng.normal(size=A.shape)
    b, c = rng.normal(size=(2, len(A)))
    part = LinearPart(T @ A @ np.linalg.inv(T), T @ b, np.linalg.solve(T.T, c))
    found = balanced_reduction(part, order=len(A) - 1)
    assert found.unstable == integrators
    f = np.geomspace(1e-3, 1e2, 400)
    error = np.abs(part.response(f) - found.part.response(f)).max()
    assert 0.0 < error <= found.bound * (1.0 + 1e-3)


def test_order_by_tolerance() -> None:
    part = modes()
    values = hankel(part)
    relative = values / values[0]
    found = balanced_reduction(part, tolerance=float(np.sqrt(relative[5] * relative[6])))
    assert found.order == 6
    assert found.tolerance == pytest.approx(relative[5], rel=1e-6)
    assert found.bound == pytest.approx(2.0 * np.sum(values[6:]), rel=1e-6)


def test_units_of_input_and_output_do_not_matter() -> None:
    part = modes()
    other = LinearPart(part.A, 1e-7 * part.B, 1e5 * part.C)
    ours = balanced_reduction(part, order=4).part.response(F)
    assert 1e2 * balanced_reduction(other, order=4).part.response(F) == pytest.approx(ours, rel=1e-7)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"order": 0}, "between 1 and 12"),
        ({"order": 13}, "between 1 and 12"),
        ({"tolerance": 1.5}, "between 0 and 1"),
        ({"order": 3, "tolerance": 0.1}, "both given"),
        ({"order": 3, "method": "truncat"}, "did you mean truncate"),
    ],
)
def test_what_makes_no_sense_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        balanced_reduction(modes(), **options)  # type: ignore[arg-type]


def test_errors_in_a_band_of_two_lags() -> None:
    # 1/(s + 1) and 1/(s + 2): they differ by 1/|(s + 1)(s + 2)|, relatively by 1/|s + 2|, most at the lowest frequency.
    one, two = (LinearPart(np.array([[-a]]), np.ones(1), np.ones(1)) for a in (1.0, 2.0))
    found = band_error(one, two, (0.1, 10.0))
    s = 0.2j * np.pi
    assert (found.absolute_hz, found.relative_hz) == (0.1, 0.1)
    assert found.absolute == pytest.approx(1.0 / abs((s + 1.0) * (s + 2.0)))
    assert found.relative == pytest.approx(1.0 / abs(s + 2.0))
    with pytest.raises(InputError, match="lower frequency first"):
        band_error(one, two, (10.0, 0.1))


def test_errors_in_a_band_stay_below_those_at_all_frequencies() -> None:
    part = modes()
    found = balanced_reduction(part, order=6)
    inside = band_error(part, found.part, (0.1, 1.0))
    assert inside.absolute < 0.2 * found.bound
    assert band_error(part, found.part, (0.01, 100.0)).absolute <= found.bound


# -- zeros and poles ------------------------------------------------------------------------------


def test_zeros_poles_and_gain_of_a_known_function() -> None:
    # 3 (s + 2)(s² + 0.2 s + 9) / ((s + 1)(s + 5)(s² + s + 30))
    numerator = 3.0 * np.polymul([1.0, 2.0], [1.0, 0.2, 9.0])
    denominator = np.polymul(np.polymul([1.0, 1.0], [1.0, 5.0]), [1.0, 1.0, 30.0])
    found = factored(part_of(control.tf2ss(numerator, denominator)))
    assert found.gain == pytest.approx(3.0)
    assert pole_error(found.zeros, np.roots(numerator)) < 1e-6
    assert pole_error(found.poles, np.roots(denominator)) < 1e-6


def test_zeros_are_the_eigenvalues_of_the_system_pencil() -> None:
    part = modes()
    n = len(part.A)
    pencil = np.block([[part.A, part.B], [part.C, np.zeros((1, 1))]])
    mass = np.diag([*np.ones(n), 0.0])
    other = eig(pencil, mass, right=False)
    other = other[np.isfinite(other) & (np.abs(other) < 1e6)]
    found = factored(part)
    assert len(found.zeros) == len(other)
    for zero in other:
        assert np.min(np.abs(found.zeros - zero)) < 1e-7 * abs(zero)
    assert found.response(F) == pytest.approx(part.response(F), rel=1e-7)


def test_quotient_of_known_functions() -> None:
    # H = 1/(s + 1), G = (s − 2)/(s + 3)²: F = (s + 3)²/((s + 1)(s − 2))
    h = plain(zeros=[], poles=[-1.0])
    g = plain(zeros=[2.0], poles=[-3.0, -3.0])
    quotient = h.over(g)
    s = np.array([0.7 + 1.1j, -4.0 + 0.2j])
    assert quotient.at(s) == pytest.approx((s + 3.0) ** 2 / ((s + 1.0) * (s - 2.0)))
    assert quotient.unstable_poles == pytest.approx([2.0])
    assert quotient.times(g).at(s) == pytest.approx(h.at(s))


# -- cancellation ---------------------------------------------------------------------------------


def test_exact_pairs_cancel_and_nothing_changes() -> None:
    found = plain(zeros=[-1.0, -2.0 + 3.0j, -2.0 - 3.0j, 0.0], poles=[-2.0 + 3.0j, -2.0 - 3.0j, 0.0, -5.0, -7.0])
    left, gone = cancel(found)
    assert left.zeros == pytest.approx([-1.0])
    assert np.sort(left.poles.real) == pytest.approx([-7.0, -5.0])
    assert len(gone) == 3
    assert left.response(F) == pytest.approx(found.response(F), rel=1e-12)


def test_cancelled_order_is_that_of_a_minimal_realisation() -> None:
    # Two systems that share a pole: their product with the inverse of one has pairs to cancel.
    rng = np.random.default_rng(5)
    poles = [-1.0, -3.0, -0.4 + 6.0j, -0.4 - 6.0j]
    zeros = [-3.0, -0.4 + 6.0j, -0.4 - 6.0j, float(-8.0 - rng.random())]
    found = plain(zeros=zeros, poles=poles, gain=2.0)
    part = to_state_space(found)
    minimal = control.minreal(control.ss(part.A, part.B, part.C, part.D), 1e-8, verbose=False)
    left, _ = cancel(found)
    assert left.order == minimal.nstates == 1
    assert left.response(F) == pytest.approx(part_of(minimal).response(F), rel=1e-6)


def test_tolerance_decides_and_the_response_changes_by_as_much() -> None:
    z = -0.5 + 10.0j
    p = z * (1.0 + 2e-4)
    found = plain(zeros=[z, z.conjugate(), -1.0], poles=[p, p.conjugate(), -2.0, -4.0])
    assert cancel(found, tolerance=1e-4)[0].order == 4
    left, _ = cancel(found, tolerance=3e-4)
    assert left.order == 2
    change = np.abs(left.response(F) / found.response(F) - 1.0)
    # |p − z| over the distance of the axis, twice for the pair, and the correction at frequency 0.
    assert np.max(change) < 2.5 * abs(p - z) / 0.5
    assert change[0] < 1e-4


def test_a_tolerance_of_cancellation_is_a_part() -> None:
    found = plain(zeros=[1.0], poles=[1.0, -2.0])
    assert cancel(found)[0].order == 1
    with pytest.raises(InputError, match="between 0 and 1"):
        cancel(found, tolerance=2.0)


@pytest.mark.parametrize(("pole", "zero"), [(5e-6, -5e-6), (-2e-5, -9e-5), (0.0, 1e-5), (0.0, 0.0)])
def test_slow_pairs_leave_what_is_above_them_as_it_was(pole: float, zero: float) -> None:
    whole = Factored(zeros=np.array([zero + 0j]), poles=np.array([pole + 0j, -1.0]), gain=2.0)
    left = cancel(whole, tolerance=1e-4)[0]
    s = 2j * np.pi * np.array([0.1, 1.0, 10.0])
    assert left.order == 1
    assert left.at(s) == pytest.approx(whole.at(s), rel=1e-3)


def test_a_real_pole_never_takes_half_a_pair() -> None:
    found = plain(zeros=[-1.0 + 1e-7j, -1.0 - 1e-7j], poles=[-1.0, -1.0, -3.0])
    left = cancel(found, tolerance=1e-3)[0]
    assert np.sum(left.poles.imag) == np.sum(left.zeros.imag) == 0.0
    assert np.isreal(left.at(np.array([0.5 + 0.0j]))[0].imag)


# -- mirroring ------------------------------------------------------------------------------------


def test_mirroring_keeps_the_gain_and_turns_the_phase_by_an_all_pass() -> None:
    found = plain(zeros=[-1.0, 4.0], poles=[2.0, 0.3 + 5.0j, 0.3 - 5.0j, -7.0], gain=-3.0)
    turned = mirror(found)
    s = 2j * np.pi * F
    assert np.max(turned.factored.poles.real) < 0.0
    assert np.abs(turned.factored.response(F)) == pytest.approx(np.abs(found.response(F)), rel=1e-12)
    all_pass = (s - 2.0) / (s + 2.0) * (s**2 - 0.6 * s + 25.09) / (s**2 + 0.6 * s + 25.09)
    assert turned.factored.response(F) == pytest.approx(found.response(F) * all_pass, rel=1e-12)
    assert len(turned.poles) == 3


def test_the_sign_at_rest_follows_the_number_of_real_poles() -> None:
    rest = np.array([1e-9])
    for poles, sign in (
        ([2.0], -1),
        ([2.0, 3.0], 1),
        ([0.3 + 5.0j, 0.3 - 5.0j], 1),
        ([1.0, 0.3 + 5.0j, 0.3 - 5.0j], -1),
    ):
        found = plain(zeros=[], poles=[complex(p) for p in poles])
        turned = mirror(found)
        assert turned.dc_sign == sign
        assert turned.factored.response(rest) / found.response(rest) == pytest.approx([sign], abs=1e-6)


def test_poles_on_the_axis_stay() -> None:
    turned = mirror(plain(zeros=[], poles=[0.0, 1.0]))
    assert turned.on_axis == pytest.approx([0.0])
    assert np.sort(turned.factored.poles.real) == pytest.approx([-1.0, 0.0])


# -- low-pass and realisation ---------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_low_pass_is_butterworths(order: int) -> None:
    found = low_pass(5.0, order=order)
    gain = np.abs(found.response(F))
    assert gain == pytest.approx(1.0 / np.sqrt(1.0 + (F / 5.0) ** (2 * order)), rel=1e-10)
    assert np.max(found.poles.real) < 0.0
    assert found.order == order


@pytest.mark.parametrize(("frequency", "order"), [(0.0, 1), (-5.0, 1), (5.0, 0), (5.0, 9)])
def test_low_pass_refuses(frequency: float, order: int) -> None:
    with pytest.raises(InputError):
        low_pass(frequency, order=order)


def random_roots(random: np.random.Generator, real: int, pairs: int) -> Complex:
    sizes = 10.0 ** random.uniform(-1.0, 3.0, real + pairs)
    complex_ones = [
        r for w in sizes[real:] for z in [w * np.exp(1j * random.uniform(1.7, 3.0))] for r in (z, z.conjugate())
    ]
    return np.concatenate([-sizes[:real], np.array(complex_ones, dtype=complex)])


@pytest.mark.parametrize(("real", "pairs", "less"), [(1, 0, 1), (0, 1, 0), (3, 4, 0), (4, 9, 2), (5, 18, 1)])
def test_sections_realise_what_was_factored(real: int, pairs: int, less: int) -> None:
    random = np.random.default_rng(real + pairs)
    poles = random_roots(random, real, pairs)
    zeros = random_roots(random, max(0, real - less), pairs) * 1.1 if len(poles) > less else np.zeros(0, dtype=complex)
    found = Factored(zeros=zeros, poles=poles, gain=0.01)
    part = to_state_space(found)
    f = np.geomspace(1e-2, 1e3, 200)
    assert len(part.A) == len(poles)
    assert part.response(f) == pytest.approx(found.response(f), rel=1e-6)  # order 41 over four decades: 2e-7
    assert np.sort(np.abs(part.poles)) == pytest.approx(np.sort(np.abs(poles)), rel=1e-5)  # the same: 2e-6


def test_differentiators_are_refused() -> None:
    with pytest.raises(InputError, match="add a low-pass"):
        to_state_space(plain(zeros=[-1.0, -2.0], poles=[-3.0]))


def test_factored_functions_are_calculated_with_as_their_values_are() -> None:
    f: Floats = np.array([0.0, 0.1, 1.0, 7.0])
    one = Factored(zeros=np.array([-2.0 + 0j]), poles=np.array([-1.0 + 3j, -1.0 - 3j]), gain=3.0)
    other = Factored(zeros=np.array([4.0 + 0j]), poles=np.array([-5.0 + 0j, -0.5]), gain=-0.5)
    s = 2j * np.pi * f
    a = 3.0 * (s + 2.0) / ((s + 1.0) ** 2 + 9.0)
    b = -0.5 * (s - 4.0) / ((s + 5.0) * (s + 0.5))
    assert one.response(f) == pytest.approx(a)
    assert one.times(other).response(f) == pytest.approx(a * b)
    assert one.over(other).response(f) == pytest.approx(a / b)
    assert other.negated().response(f) == pytest.approx(-b)
