"""The error that each point states, against closed forms; responses that do not repeat from period to period."""

from __future__ import annotations

import cmath
import math
from functools import partial
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

import workbench as wb
from scripts.promises.nfr import Mode, Plant, measure
from scripts.promises.sampled import SampledPlant, good, trials, trials_of
from scripts.promises.trial import Trial, lines
from tests.fakes import FakeModel, Rows, SampledSession, StaticSession, lag
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.response.nfr.beats import Beat, repeats_every
from workbench.response.nfr.certificate import Certificate
from workbench.response.nfr.jumps import disagreements, jumps
from workbench.response.nfr.point import NfrPoint
from workbench.response.nfr.prior_knowledge import LinearStart, surroundings
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult
from workbench.response.nfr.settling import Settling, SettlingOutcome
from workbench.response.periodic.fourier import Period
from workbench.signals.kinds import Sine

HERE = wb.Workers(in_process=True)


def quick(model: wb.Model, frequencies: list[float], amplitude: float = 1.0, **options: Any) -> NfrResult:  # noqa: ANN401 - those of nfr
    return nfr(model, "u", "y", frequencies, amplitude, workers=HERE, drift_check=False, **options)


@pytest.mark.parametrize("blind", [False, True])
def test_settled_points_hold_the_truth_and_are_good_to_one_per_cent(blind: bool) -> None:
    # A few of what `scripts/evidence.py nfr` measures on hundreds.
    random = np.random.default_rng(11)
    found = [measure(Plant.random(random), tolerance=1e-8, max_periods=20, blind=blind) for _ in range(8)]
    settled = [t for t in found if t.status == "settled"]
    assert settled
    assert all(t.true <= min(t.stated, 0.01) for t in settled)
    assert blind or all(t.true <= t.stated for t in found if np.isfinite(t.stated))


def test_a_light_resonance_that_has_not_grown_is_not_settled() -> None:
    plant = Plant((Mode(1.0, 2e-4, 1.0),), 1.0001)
    assert abs(plant.truth) == pytest.approx(2235.87, rel=1e-5)
    with plant.model(tolerance=1e-8) as model:
        result = quick(model, [1.0001], method="settle")
    true = abs(result.response[0, 0] - plant.truth) / abs(plant.truth)
    assert result.status == (("averaged",),)
    assert true > 0.9
    assert result.error[0, 0] >= true
    assert "has not reached its amplitude" in result.warnings[0]


@pytest.mark.parametrize("solver", ["gear", "vkm"])
def test_near_a_resonance_the_integration_is_tightened(solver: str) -> None:
    # At the tolerance given the solvers' own damping might cost 0.4 % of this response, more than a share of its error.
    plant = Plant((Mode(1.0, 4e-3, 1.0),), 1.0003)
    trial = measure(plant, tolerance=1e-6, max_periods=200, blind=False, solver=solver)
    assert trial.status == "settled"
    assert trial.true <= trial.stated <= 0.01


def test_the_aircraft_covers_the_exact_response() -> None:
    names = ("outer_aileron", "z_wing_tip_acceleration")
    with wb.load("fmu:Aircraft", tolerance=1e-8) as model:
        exact = wb.lin(model, inputs=[names[0]], outputs=[names[1]])
        result = nfr(model, *names, [2.8, 4.0, 6.97, 8.0], 1e-3, workers=HERE, drift_check=False)
    truth = np.array([complex(exact(2j * math.pi * f)) for f in result.frequency_hz])
    true = np.abs(result.response[0] / truth - 1.0)
    assert np.all(true <= result.error[0])
    assert np.all(result.error[0] <= 5.0 * true + 1e-3)
    assert np.all((result.error[0] <= 0.01) | result.averaged[0])


def test_the_twin_goes_through_the_periods_of_the_closed_form() -> None:
    # A lag from rest under sin ωt: y = |G| sin(ωt + φ) − Im(G)·e^(−t/τ).
    tau, f = 0.7, 1.3
    part = LinearStart(
        LinearPart(np.array([[-1.0 / tau]]), np.array([1.0 / tau]), np.array([1.0])), np.zeros(1), np.ones(1)
    )
    twin = part.twin(f, 2.0)
    assert twin is not None
    omega = 2.0 * math.pi * f
    g = 1.0 / (1.0 + 1j * omega * tau)
    assert twin.forced.response == pytest.approx(g)
    t = np.linspace(0.0, 1.0 / f, 20001)
    y = -g.imag * np.exp(-t / tau)
    expected = [np.trapezoid(w * y, t) * f for w in (1.0 + 0.0 * t, 2.0 * np.sin(omega * t), 2.0 * np.cos(omega * t))]
    np.testing.assert_allclose(twin.free(3)[0], expected, atol=1e-7)
    np.testing.assert_allclose(twin.free(3)[2], twin.free(3)[0] * math.exp(-2.0 / (tau * f)), rtol=1e-9)
    assert twin.end(3)[0] == pytest.approx(2.0 * g.imag * (1.0 - math.exp(-3.0 / (tau * f))))
    assert twin.forced.sensitivity == pytest.approx(abs(tau * g) * f)
    # A defect d in each period stands as d/(1 − μ), and is d·τ·f of the mean: the periodic motion's share.
    np.testing.assert_allclose(twin.forced.smallest, 2.0 * f / abs(1j * omega + 1.0 / tau))


def test_integrators_in_series_have_a_twin_without_eigenvectors() -> None:
    double = LinearPart(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([0.0, 1.0]), np.array([1.0, 0.0]))
    part = LinearStart(double, np.zeros(2), np.zeros(2))
    twin = part.twin(0.5, 1.0)
    assert part.modes is None
    assert twin is not None
    assert twin.forced.response == pytest.approx(-1.0 / math.pi**2)
    # From rest y = t/ω − sin(ωt)/ω²: the mean of period k is T(k + 1/2)/ω.
    np.testing.assert_allclose(twin.free(3)[:, 0], 2.0 * (np.arange(3) + 0.5) / math.pi, rtol=1e-9)


@pytest.mark.parametrize("around", [3e-12, -3e-12])
def test_slow_poles_of_a_nearly_symmetric_model_are_not_moved_by_what_is_not_symmetric(around: float) -> None:
    """Three storages in a ring, around which a little more goes one way than the other, and a leak."""
    g, leak = 1e6, 1e-6
    A = g * np.array([[0.0, 1.0, 1.0 + around], [1.0 + around, 0.0, 1.0], [1.0, 1.0 + around, 0.0]])
    A -= np.diag(A.sum(axis=0)) + np.diag([0.0, 0.0, leak])
    start = LinearStart(LinearPart(A, np.eye(3)[0], np.eye(3)[2], 0.0), np.zeros(3), np.zeros(3))
    assert start.modes is not None
    assert start.modes.poles.real.max() == pytest.approx(-leak / 3.0, abs=1e-8)


@pytest.mark.parametrize("bias", [0.0, 0.5])
def test_the_twin_is_forced_about_what_the_sine_moves_about(bias: float) -> None:
    # The sine moves about the start value and the bias, which the lag feels from rest at x = 0.
    with wb.load("fmu:FirstOrderLag", start_values={"u": 1.0, "tau": 1.0}, bias={"u": bias}) as model:
        part = surroundings(model, "u", "y").linear
        found = quick(model, [2.0])
    assert part is not None
    assert part.dx0 == pytest.approx(1.0 + bias)
    exact = 1.0 / (1.0 + 4j * math.pi)
    assert abs(found.response[0, 0] / exact - 1.0) <= found.error[0, 0] <= 0.01
    assert found.periods[0, 0] <= 4


def test_co_simulation_and_python_models_have_no_linear_part() -> None:
    assert surroundings(lag(1.0), "u", "y").linear is None
    with wb.load("fmu:FirstOrderLag", "cs") as model:
        assert surroundings(model, "u", "y").linear is None


@pytest.mark.parametrize("amplitude", [1.3, 3.0, 1e6])
def test_jumps_and_kinks_are_in_the_error(amplitude: float) -> None:
    found = quick(FakeModel(lambda: StaticSession(lambda u: np.clip(u, -1.0, 1.0))), [1.0], amplitude)
    r = 1.0 / amplitude
    exact = 2.0 / math.pi * (math.asin(r) + r * math.sqrt(1.0 - r * r))
    true = abs(found.response[0, 0] - exact) / exact
    assert true <= found.error[0, 0] <= 0.01


@pytest.mark.parametrize("seed", range(6))
def test_noise_settles_and_the_mean_of_the_last_half_is_as_good_as_it_says(seed: int) -> None:
    # No model foretells it and no mode describes it: what settles are periods that wander about their mean.
    random, settling, response = np.random.default_rng(seed), Settling(errcrit=0.1, most=20), None
    while response is None:
        h = np.concatenate([[0.0, 1.0], np.zeros(9)]) + 0.005 * random.standard_normal(11)
        response = settling.add(Period(h, 1.0 + 0j, 1.0))
    assert abs(response.value - 1.0) <= response.error
    assert response.error <= (0.01 if response.outcome is SettlingOutcome.SETTLED else 0.02)


def test_slow_modes_do_not_pass_for_wandering() -> None:
    # Several light modes without a linear model: whatever is stated holds the truth.
    random = np.random.default_rng(5)
    found = [
        measure(Plant.random(random), tolerance=1e-8, max_periods=20, blind=True, method="settle") for _ in range(12)
    ]
    averaged = [t for t in found if t.status == "averaged"]
    assert len(averaged) >= 6
    assert all(t.true <= t.stated for t in averaged if np.isfinite(t.stated))
    assert sum(np.isnan(t.stated) for t in averaged) >= 3


def test_two_quantisers_are_known_as_well_as_it_says() -> None:
    # Two hidden sampling rates; the truth is the mean over 200 000 periods, by the integrals of what is held.
    model = FakeModel(lambda: SampledSession([(1 / 208, 0.05), (1 / 131, 0.01)]))
    result = quick(model, [15.39, 15.407, 15.42], errcrit=0.08)
    truth = np.array([1.8772827 - 0.5812301j, 1.8770052 - 0.5818252j, 1.8768071 - 0.5822816j])
    assert np.all(np.abs(result.response[0] / truth - 1.0) <= result.error[0])
    assert np.all(result.error[0] <= 0.008)


# -- no effect ------------------------------------------------------------------------------------------------------


def plain(a: list[list[float]], b: list[float], c: list[float], d: float = 0.0, **how: Any) -> wb.Model:  # noqa: ANN401 - those of connect
    plant = control.ss(a, np.reshape(b, (-1, 1)), np.reshape(c, (1, -1)), d)
    return wb.connect({"p": plant}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}, **how)


def hidden() -> tuple[list[list[float]], list[float], list[float]]:
    """Return A, B, C of a plant whose output sees nothing of what the input moves, in random coordinates."""
    t = np.random.default_rng(0).standard_normal((4, 4))
    a = np.array([[-3.0, 1.0, 0.3, 0.2], [-1.0, -2.0, 0.5, 1.0], [0.0, 0.0, -4.0, 1.0], [0.0, 0.0, 0.7, -2.0]])
    b, c = np.array([1.0, 2.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, -0.5])
    back = np.linalg.inv(t)
    return (t @ a @ back).tolist(), (t @ b).tolist(), (c @ back).tolist()


NOTHING = {
    "not connected": ([[-1.0, 0.0], [0.0, -2.0]], [1.0, 0.0], [0.0, 1.0]),
    "two ways that cancel": ([[-1.0, 0.0], [0.0, -1.0]], [1e3, 1 / 3], [1 / 3e3, -1.0]),
    "hidden": hidden(),
}


@pytest.mark.parametrize("solver", ["gear", "vkm"])
@pytest.mark.parametrize("name", NOTHING)
def test_rounding_is_no_response(name: str, solver: str, tmp_path: Path) -> None:
    with plain(*NOTHING[name], solver=solver) as model:
        result = quick(model, [0.3, 1.0, 3.0])
    found = result.to_dict()
    assert found["gain"] == [[0.0] * 3]
    assert found["gain_db"] == found["phase_deg"] == found["error"] == [[None] * 3]
    assert np.isnan(result.thd).all()
    assert result.no_effect.all()
    assert [w for w in result.warnings if "no effect of u on y at this amplitude" in w] == list(result.warnings)
    assert not result.failed
    result.plot(tmp_path / "nothing.png")


@pytest.mark.parametrize("solver", ["gear", "vkm"])
def test_a_zero_on_the_imaginary_axis_is_one(solver: str) -> None:
    # (s² + ω²)/(s² + ωs + ω²) is 0 at 1 Hz, and what the integration leaves there is no response.
    w = 2.0 * math.pi
    with plain([[0.0, 1.0], [-w * w, -w]], [0.0, 1.0], [0.0, -w], 1.0, solver=solver) as model:
        result = quick(model, [1.0, 1.0001])
    s = 2j * math.pi * 1.0001
    truth = (s * s + w * w) / (s * s + w * s + w * w)
    assert result.no_effect.tolist() == [[True, False]]
    assert abs(result.response[0, 1] / truth - 1.0) <= result.error[0, 1] <= 0.01


@pytest.mark.parametrize("solver", ["gear", "vkm"])
def test_small_gains_are_responses(solver: str) -> None:
    # s⁴/(s + 1)⁴, the difference of terms near 1, is −200 dB at 5e-4 Hz.
    with plain((-np.tril(np.ones((4, 4)))).tolist(), [1.0] * 4, [-1.0] * 4, 1.0, solver=solver) as model:
        steep = quick(model, [5e-4, 2e-3])
    # An output in units of 1e-15.
    with plain([[-1.0]], [1.0], [1e-15], solver=solver) as model:
        tiny = quick(model, [1.0])
    s = 2j * math.pi * np.array([5e-4, 2e-3, 1.0])
    truth = np.array([*((s / (s + 1.0)) ** 4)[:2], 1e-15 / (s[2] + 1.0)])
    true = np.abs(np.append(steep.response[0], tiny.response[0]) / truth - 1.0)
    assert np.all(true <= np.append(steep.error[0], tiny.error[0]))
    assert np.all(true <= 0.01)
    assert steep.gain_db[0, 0] == pytest.approx(-200.23, abs=0.01)
    assert steep.status == (tuple("settled" if e <= 0.01 else "averaged" for e in steep.error[0].tolist()),)
    assert tiny.status == (("settled",),)


@pytest.mark.parametrize("f", [10.0, 30.0])
def test_a_transient_larger_than_the_response_is_named_and_in_the_error(f: float) -> None:
    # 1/(s + 1)⁴ from rest: 20 periods are 2 s and less, and show a transient that is thousands of times the response.
    a = np.diag(-np.ones(4)) + np.diag(np.ones(3), -1)
    with plain(a.tolist(), [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]) as model:
        found = quick(model, [f], method="settle")
    truth = (1.0 + 2j * math.pi * f) ** -4
    true = abs(found.response[0, 0] / truth - 1.0)
    assert found.status == (("averaged",),)
    assert 10.0 < true <= found.error[0, 0]
    assert "the initial transient is larger than the response" in found.warnings[0]


def test_an_output_that_moves_at_other_frequencies_only_is_not_dead() -> None:
    result = quick(FakeModel(lambda: StaticSession(lambda u: u * u)), [1.0])
    assert result.gain[0, 0] == 0.0
    assert not result.no_effect.any()
    assert "not at the frequency of the input" in result.warnings[0]


# -- chaos ----------------------------------------------------------------------------------------------------------


def logistic(r: float, x: float, count: int) -> Floats:
    found = np.empty(count)
    for k in range(count):
        found[k], x = x, r * x * (1.0 - x)
    return found


def is_chaotic(r: float) -> bool:
    """Whether the Lyapunov exponent of the logistic map is clearly positive."""
    return float(np.mean(np.log(np.abs(r * (1.0 - 2.0 * logistic(r, 0.3, 3000)))))) > 0.03


def test_a_chaotic_response_is_seldom_settled() -> None:
    # y = x(k)·sin and harmonics of it, x(k + 1) = r·x·(1 − x); each passes near an unstable periodic response at times.
    random, settled, count = np.random.default_rng(1), 0, 0
    for _ in range(80):
        r = random.uniform(3.57, 4.0)
        if not is_chaotic(r):
            continue
        x, count = logistic(r, random.uniform(0.1, 0.9), 20), count + 1
        settling, response = Settling(errcrit=0.1, most=20), None
        for value in x:
            h = np.zeros(11)
            h[1], h[4], h[6] = value, 0.3 * value**2, 0.1 * math.cos(3.0 * value)
            response = response or settling.add(Period(h, 1.0 + 0j, 1.0))
        settled += response is not None and response.outcome in (SettlingOutcome.RESOLVED, SettlingOutcome.SETTLED)
    assert count > 50
    # Some pass so close to a periodic response that 20 periods do not tell: 2 of 76, of all kinds of chaos about 1 %.
    assert settled <= 0.04 * count


def test_a_weak_wander_about_a_periodic_response_is_not_settled() -> None:
    # Chaos of 0.5 … 5 % (the logistic map's) on a periodic response, with a transient in every second one.
    random, settled, marked, count = np.random.default_rng(4), 0, 0, 0
    while count < 80:
        r, size = random.uniform(3.6, 4.0), 10.0 ** random.uniform(math.log10(0.005), math.log10(0.05))
        if not is_chaotic(r):
            continue
        x, count = logistic(r, random.uniform(0.1, 0.9), 20), count + 1
        x = (x - x.mean()) / x.std()
        direction, decaying = random.standard_normal((2, 11))
        transient = 0.3 * (count % 2) * np.outer(random.uniform(0.1, 0.9) ** np.arange(20), decaying)
        periodic = np.eye(11)[1] + 0.1 * np.eye(11)[3]
        weak = size * (np.outer(x, direction / np.hypot(*direction[1:3])) + np.outer(x * x - 1.0, 0.3 * np.eye(11)[2]))
        settling, response = Settling(errcrit=0.1, most=20), None
        for h in periodic + transient + weak:
            response = response or settling.add(Period(h, 1.0 + 0j, 1.0))
        assert response is not None
        if response.outcome in (SettlingOutcome.RESOLVED, SettlingOutcome.SETTLED):
            settled += 1
        else:
            marked += "irregular" in str(response.why) or "subharmonic" in str(response.why)
    # Some happen to be calm in the newest periods. Once half of them settled.
    assert settled <= 0.1 * count
    assert marked >= 0.7 * count


# -- sampled models ------------------------------------------------------------------------------------------------

DT = 0.1


def held_response(pole: float, f: float) -> complex:
    """Of (1 − p)/(z − p), sampled every DT, its output held: what a Fourier integral over all time finds."""
    step = cmath.exp(2j * math.pi * f * DT)
    return (1.0 - pole) / (step - pole) * (1.0 - 1.0 / step) / (2j * math.pi * f * DT)


def sampled(pole: float) -> wb.Model:
    plant = control.ss([[pole]], [[1.0 - pole]], [[1.0]], [[0.0]], DT)
    return wb.connect({"p": plant}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"})


@pytest.mark.parametrize("pole", [0.3, 0.9])
def test_a_sampled_model_is_measured_over_its_beats(pole: float) -> None:
    frequencies = [0.7, 2.0, 4.0, 4.7, 4.9, 4.99, 5.3]
    with sampled(pole) as model:
        result = quick(model, frequencies)
        longer = quick(model, [4.9], max_periods=60)
    truth = np.array([held_response(pole, f) for f in frequencies])
    true = np.abs(result.response[0] / truth - 1.0)
    settled = ~result.averaged[0]
    assert settled.tolist() == [True, True, True, True, False, False, True]
    assert np.all(true[settled] <= np.minimum(result.error[0, settled], 0.01))
    assert np.isnan(result.error[0, ~settled]).all()  # a beat of 24.5 and one of 249.5 periods
    assert any(
        "4.9 Hz, amplitude 1 and 1 more: not settled (the error is not known): sampling" in w for w in result.warnings
    )
    assert any("at or above 5 Hz, half the rate at which the model samples" in w for w in result.warnings)
    assert longer.status == (("settled",),)
    assert abs(longer.response[0, 0] / held_response(pole, 4.9) - 1.0) <= longer.error[0, 0]


@pytest.mark.parametrize("f", [4.698, 4.707, 4.762, 4.8, 4.803])
def test_the_slow_lag_behind_a_sampler_is_in_the_error(f: float) -> None:
    # Twenty periods are four time constants of the lag, and once taken for a beat.
    plant = SampledPlant(dt=DT, pole=0.9, order=1, before=0.0, behind=1.0)
    _, found = trials_of(plant, f, max_periods=20)
    assert found.true <= found.stated
    assert found.status == "averaged" or found.true <= 0.01


def test_sampled_models_between_lags_are_known_as_well_as_it_says() -> None:
    # A few of what `scripts/evidence.py sampled` measures on thousands.
    found = list(trials(8, 2, frequencies=8))
    assert good(found)
    assert sum(t.status == "settled" for t in found) >= 0.6 * len(found)


@pytest.mark.parametrize(("periods", "samples"), [(2, 5), (2, 9), (3, 7), (3, 8), (4, 9)])
def test_a_short_common_period_of_forcing_and_sampling_is_measured_over(periods: int, samples: int) -> None:
    # Every `periods` periods of the forcing the samples fall on the same phases; then only the transient is left.
    assert Beat(periods / samples, 1.0).common == periods
    for order, pole in ((1, 0.3), (2, 0.5)):
        plant = SampledPlant(dt=0.1, pole=pole, order=order, before=0.0, behind=0.3)
        for found in trials_of(plant, periods / samples / 0.1, max_periods=20):
            assert found.status == "settled"
            assert found.true <= min(found.stated, 0.01)


def test_an_averaged_point_tells_how_far_a_beat_spreads_its_periods() -> None:
    assert Beat(2 / 5, 1.0).words(0.33, 20, known=True) == (
        "sampling and forcing beat, together every 2 periods: the periods differ from their mean by 33 %"
    )
    unseen = Beat(1 / 2.06, 1.0)
    assert unseen.common is None
    assert "is not known: a whole beat takes" in unseen.words(0.33, 20, known=False)
    assert "is not known: a transient decays slowly" in Beat(2 / 5, 1.0).words(0.33, 20, known=False)


# -- responses that repeat in another rhythm, or not at all ----------------------------------------------------------


class InAnotherRhythm(StaticSession):
    """y = u·a(k) in period k."""

    def __init__(self, factors: Floats) -> None:
        super().__init__(lambda u: u)
        self.factors = factors

    def rows(self, time: Floats, sine: Sine) -> Rows:
        time, y, u = super().rows(time, sine)
        k = round(float(time[0]) * sine.frequency)
        return time, y * self.factors[k % len(self.factors)], u


@pytest.mark.parametrize("factors", [[1.2, 0.8], [1.0, 1.3, 0.7], [1.5, 0.9, 1.0, 0.6], [1.0, 1.2, 0.9, 1.3, 0.6]])
def test_a_subharmonic_is_named_with_its_order_and_its_mean_is_right(factors: list[float]) -> None:
    result = quick(FakeModel(lambda: InAnotherRhythm(np.array(factors))), [1.0])
    assert f"a subharmonic of order {len(factors)}: it repeats only every {len(factors)} periods" in result.warnings[0]
    assert result.status == (("averaged",),)
    assert abs(result.response[0, 0] - 1.0) <= result.error[0, 0] + 1e-12 < 1e-6


def test_the_logistic_map_doubles_its_period() -> None:
    for r, order in {3.2: 2, 3.5: 4, 3.55: 8, 3.83: 3}.items():
        x = [0.3]
        for _ in range(600):
            x.append(r * x[-1] * (1.0 - x[-1]))
        result = quick(FakeModel(partial(InAnotherRhythm, np.array(x[-120:]))), [1.0], max_periods=40)
        words = f"a subharmonic of order {order}"
        assert any(words in w for w in result.warnings), r
    assert repeats_every(np.ones((20, 5))) == 2  # nothing differs; asked only where periods do


def test_a_jump_and_an_earlier_run_tell_of_two_responses() -> None:
    def point(f: float, gain: float, thd: float = 0.03, error: float = 0.001) -> NfrPoint:
        certificate = Certificate(errcrit=0.1, max_periods=20, thd=thd)
        return NfrPoint(frequency=f, amplitude=0.1, response=gain + 0j, error=error, certificate=certificate)

    up = [
        point(f, g)
        for f, g in zip((0.20, 0.21, 0.22, 0.23, 0.25, 0.26), (9.3, 10.3, 11.2, 12.1, 0.7, 0.65), strict=True)
    ]
    assert len(jumps(up)) == 1
    assert "between 0.23 and 0.25 Hz, amplitude 0.1, the response jumps from gain 12.1 to 0.7" in jumps(up)[0]
    assert jumps(up)[0].endswith("`branches` shows all")
    assert "--branches" not in jumps(up, interface="cs")[0]  # which refuses co-simulation
    assert not jumps([point(p.frequency, abs(p.response or 0.0), thd=1e-6) for p in up])  # linear: a steep flank
    known = {(0.1, p.frequency): p for p in up}
    down = {(0.1, 0.21): point(0.21, 1.48), (0.1, 0.25): point(0.25, 0.7)}
    assert disagreements(down, known) == [
        "0.21 Hz, amplitude 0.1: two stable responses: gain 1.48 in this run, 10.3 in the earlier one"
    ]


# -- where it is shown -------------------------------------------------------------------------------------------------


def test_the_error_goes_through_json_and_old_results_have_none() -> None:
    result = quick(lag(0.1), [1.0, 2.0])
    data = result.to_dict()
    assert data["stable"] == [[True, True]]
    again = NfrResult.from_dict(data)
    np.testing.assert_array_equal(again.error, result.error)
    del data["error"], data["stable"]
    assert np.isnan(NfrResult.from_dict(data).error).all()


def test_an_unstable_point_says_so() -> None:
    unstable = wb.connect(
        {"p": control.ss([[2.0]], [[1.0]], [[1.0]], [[0.0]])}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}
    )
    with unstable as model:
        data = quick(model, [1.0]).to_dict()
    assert data["stable"] == [[False]]
    assert data["error"] == [[None]]


def test_the_coverage_script_tells_what_fell_short() -> None:
    found = [Trial("settled", 0.01, 0.02, 3), Trial("settled", 0.01, 0.001, 3), Trial("averaged", math.nan, 0.5, 20)]
    first, second = lines(found)
    assert "covers the truth   50.0 %" in first
    assert "more than 1 % off    1" in first
    assert "error stated for    0" in second
