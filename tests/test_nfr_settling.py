"""When a point is settled, averaged or failed; the sampled example; carrying the state."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.fakes import DeadTimeSession, FakeModel, LinearSession, Rows, SampledSession, StaticSession, lag, linear
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.jobs.runner import InProcess
from workbench.response.nfr.request import nfr
from workbench.response.nfr.run import NfrSweep
from workbench.response.nfr.settling import Settling, SettlingOutcome
from workbench.response.nfr.transient import remove_transient
from workbench.response.periodic.fourier import Period
from workbench.session import Session
from workbench.signals.kinds import Sine

HERE = wb.Workers(in_process=True)


def two_rates() -> FakeModel:
    """Example 4-2: one input through two sampled quantisers of different rate and resolution."""
    return FakeModel(lambda: SampledSession([(1 / 208, 0.05), (1 / 131, 0.01)]))


HOLD = """
components.h = {block = "zero_order_hold", period = 0.1}
inputs.u = "h.u"
outputs.y = "h.y"
"""


def test_a_hold_that_outlasts_the_sine_is_no_model_without_response(tmp_path: Path) -> None:
    """The gain of a hold is |sinc(f T)|; many periods of a sine above its rate see one value only."""
    (tmp_path / "hold.toml").write_text(HOLD, encoding="utf-8")
    f = np.array([11.0, 13.7, 17.0, 23.0, 47.0])
    with wb.load(tmp_path / "hold.toml") as model:
        result = nfr(model, "u", "y", f, 1.0, workers=HERE)
    assert not result.no_effect.any()
    known = np.isfinite(result.gain[0])
    assert known[:2].all()
    assert np.all(np.isfinite(result.error[0][known]))
    off = np.abs(result.gain[0] - np.abs(np.sinc(0.1 * f))) / np.abs(np.sinc(0.1 * f))
    assert np.all(off[known] <= result.error[0][known])
    assert len(result.failed) == np.sum(~known)


def test_two_rates_beat_at_15_407_hz_and_settle_beside_it() -> None:
    with wb.load("fmu:TwoRateQuantizer") as model:
        result = nfr(model, "u", "y", [15.39, 15.407, 15.42], 1.0, errcrit=0.08, workers=HERE)
    assert result.averaged[0].tolist() == [False, True, False]
    assert result.periods[0, 1] == 20
    assert np.ptp(result.gain_db) < 1.0
    assert np.ptp(result.phase_deg) < 10.0
    assert not result.failed


def test_periods_that_wander_are_not_settled_where_nothing_tells_of_a_sampler() -> None:
    # The same responses; the model does not show that it samples, so it may as well be chaos.
    result = nfr(two_rates(), "u", "y", [15.39, 15.407, 15.42], 1.0, errcrit=0.08)
    assert result.averaged[0].tolist() == [True, True, True]
    assert "irregular" in result.warnings[0]


@pytest.mark.parametrize("rounding", [-1e-15, 0.0, 1e-15])
def test_a_rise_that_is_rounding_asks_for_no_further_period(rounding: float) -> None:
    """After a dead time of 2.5 periods the response comes in two equal steps, which rounding makes rise or fall."""
    settling = Settling(errcrit=0.1, most=20)
    sizes = [0.0, 0.0, 0.5 + rounding, 1.0, 1.0, 1.0]
    outcomes = [settling.add(Period(np.array([0.0, size, *[0.0] * 9]), 1.0 + 0j, 1.0)) for size in sizes]
    assert [outcome is not None for outcome in outcomes] == [False] * 5 + [True]


def test_an_averaged_point_is_the_mean_of_the_last_half() -> None:
    settling = Settling(errcrit=1e-3, most=20)
    random = np.random.default_rng(1)
    rows = np.concatenate([[2.0, 1.0, -1.0], np.zeros(8)]) + 0.1 * random.standard_normal((20, 11))
    outcomes = [settling.add(Period(row, 1.0 + 0j, 2.0)) for row in rows]
    assert all(outcome is None for outcome in outcomes[:-1])
    response = outcomes[-1]
    assert response is not None
    assert response.outcome is SettlingOutcome.AVERAGED
    mean = rows[10:].mean(axis=0)
    assert response.value == pytest.approx(complex(mean[1], mean[2]))
    assert response.offset == pytest.approx(mean[0])


@pytest.mark.parametrize(("decay", "extrapolated"), [(0.7, True), (0.8, False)])
@pytest.mark.parametrize("seed", range(2))
def test_an_averaged_point_is_what_its_periods_tend_to_where_that_is_known_twice_as_well_as_their_mean(
    decay: float, extrapolated: bool, seed: int
) -> None:
    """Of a transient that decays irregularly: known three times as well, and not quite twice."""
    random, settling = np.random.default_rng(seed), Settling(errcrit=1e-3, most=20)
    rows = 0.003 * decay ** np.arange(20.0)[:, None] * random.standard_normal((20, 11))
    rows[:, 1] += 1.0 + 0.3 * decay ** np.arange(20.0)
    *earlier, response = [settling.add(Period(row, 1.0 + 0j, 1.5)) for row in rows]
    assert not any(earlier)
    assert response is not None
    assert response.outcome is SettlingOutcome.AVERAGED
    assert abs(response.value - 1.0) <= response.error
    mean = complex(*rows[10:, 1:3].mean(axis=0))
    if extrapolated:
        assert abs(response.value - 1.0) < 0.2 * abs(mean - 1.0)
    else:
        assert response.value == pytest.approx(mean)


def test_what_cannot_be_described_settles_by_the_published_rule_in_the_second_half() -> None:
    # A wander as small as a solver's noise; with more of it nothing tells it from chaos.
    random = np.random.default_rng(3)
    settling = Settling(errcrit=0.1, most=20)
    response, h = None, np.zeros(11)
    while response is None:
        h = np.concatenate([[0.0, 1.0], np.zeros(9)]) + 0.0015 * random.standard_normal(11)
        response = settling.add(Period(h, 1.0 + 0j, 1.0))
    assert response.outcome is SettlingOutcome.SETTLED
    assert len(settling.periods) >= 11
    assert response.value == pytest.approx(1.0, abs=0.02)


def test_the_phase_of_two_periods_is_compared_modulo_a_turn() -> None:
    settling, response, random = Settling(errcrit=0.1, most=20), None, np.random.default_rng(0)
    # Periods on both sides of 180 degrees, closer to each other than the error of 1 % that errcrit 0.1 asks for.
    while response is None:
        angle = 0.006 * random.uniform(-1.0, 1.0)
        h = np.array([0.0, -math.cos(angle), math.sin(angle), *(0.001 * random.standard_normal(2))])
        response = settling.add(Period(h, 1.0 + 0j, 1.0))
    assert response.outcome is SettlingOutcome.SETTLED
    assert abs(response.value + 1.0) <= response.error <= 0.01


def outcome_of(size: Callable[[int], float], *, most: int = 40) -> tuple[SettlingOutcome, int]:
    """Return how 2 + a disturbance of each period ends, and after how many periods.

    The disturbance turns in an irregular way from period to period, so that no few exponentials describe it, and its
    changes have the size that is asked for.
    """
    settling, h = Settling(errcrit=1e-3, most=most), np.concatenate([[0.0, 2.0], np.zeros(9)])
    for k in range(most):
        turned = np.zeros(11)
        turned[[3 + k % 7, 3 + (k * k) % 5]] += 1.0
        h = h + size(k) * turned / np.linalg.norm(turned)
        response = settling.add(Period(h, 1.0 + 0j, float(np.abs(h).sum())))
        if response is not None:
            return response.outcome, k + 1
    raise AssertionError


@pytest.mark.parametrize(
    ("name", "size", "diverges"),
    [
        ("exponential", lambda k: 1e-3 * 1.2**k, True),
        ("slow exponential, faster than 10 % in a quarter of the periods", lambda k: 1e-2 * 1.015**k, True),
        ("exponential of its own exponent", lambda k: 1e-2 * math.exp(0.003 * k * k), True),
        ("too slow to be told from a beat", lambda k: 1e-2 * 1.005**k, False),
        ("a ramp: an integrator", lambda k: 1e-2, False),
        ("a parabola: two integrators", lambda k: 1e-2 * (k + 1), False),
        ("the cube of time: three integrators", lambda k: 1e-3 * (k + 1) ** 2, False),
        ("growth that ends half way", lambda k: 1e-3 * 1.3 ** min(k, 28), False),
        ("growth after a calm, at the end only", lambda k: 1e-2 * 0.9**k if k < 38 else 1e-2 * 0.9**36 * 2.0**k, False),
        ("a beat that ends on a rise", lambda k: 1e-2 * (1.5 + math.sin(2.9 * k)), False),
        ("a transient that dies away", lambda k: 0.9**k, False),
    ],
)
def test_only_changes_that_grow_exponentially_to_the_end_are_divergence(
    name: str, size: Callable[[int], float], diverges: bool
) -> None:
    outcome, periods = outcome_of(size)
    assert (outcome is SettlingOutcome.DIVERGED) is diverges, f"{name}: {outcome} after {periods}"


def test_extrapolation_is_exact_for_two_modes() -> None:
    multipliers = 0.9 * np.exp(2j * np.array([1.0, -1.0]))
    limit, direction = np.array([0.3, 1.0, -2.0, 0.1, 0.2]), np.array([1.0, 2.0 + 1j, -1j, 0.5, 0.3j])
    periods = np.array([limit + 2.0 * (direction * multipliers[0] ** k).real for k in range(8)])
    found = remove_transient(periods)
    assert found.modes == 2
    assert found.defect < 1e-4
    np.testing.assert_allclose(found.harmonics, limit, atol=1e-4)


def test_an_undamped_alternation_is_no_transient() -> None:
    periods = np.array([[0.0, 1.0 + 0.1 * (-1) ** k, 0.05 * (-1) ** k, 0.0, 0.0] for k in range(12)])
    assert remove_transient(periods).modes == 0
    assert remove_transient(periods).defect > 0.1


@pytest.mark.parametrize("pole", [0.3, 1.0, 5.0, 80.0])
def test_divergence_fails_with_its_reason_and_the_rest_goes_on(pole: float) -> None:
    model = linear([[pole, 0.0], [0.0, -3.0]], [1.0, 3.0], [1.0, 1.0])
    result = nfr(model, "u", "y", [0.05, 0.1, 0.2], 1.0)
    assert np.isnan(result.gain).all()
    assert len(result.failed) == 3
    assert all("grows from period to period" in f.reason or "not finite" in f.reason for f in result.failed)


def test_a_point_that_fails_leaves_the_others() -> None:
    class FailsAbove(LinearSession):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            if sine.frequency > 1.5:
                raise SimulationError("y is not finite", time=0.25)
            return super().rows(time, sine)

    make = FakeModel(lambda: FailsAbove(np.array([[-5.0]]), np.array([5.0]), np.array([1.0]), 0.0))
    for carry in (False, True):
        result = nfr(make, "u", "y", [1.0, 2.0, 3.0], 1.0, carry=carry)
        assert np.isfinite(result.gain[0]).tolist() == [True, False, False]
        assert [f.frequency_hz for f in result.failed] == [2.0, 3.0]
        assert "0.25 s" in result.failed[0].reason


def test_no_response_has_gain_zero_and_no_phase() -> None:
    result = nfr(FakeModel(lambda: StaticSession(lambda u: 0.0 * u + 5.0)), "u", "y", [1.0], 1.0)
    assert result.gain[0, 0] == 0.0
    assert np.isnan(result.phase_deg[0, 0])
    assert result.to_dict()["phase_deg"] == [[None]]
    assert result.to_dict()["gain_db"] == [[None]]
    assert result.averaged[0, 0]
    assert result.offset[0, 0] == pytest.approx(5.0)


def test_an_output_that_ignores_the_input_fails_instead_of_giving_any_phase() -> None:
    class Hum(StaticSession):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            _, _, u = super().rows(time, sine)
            return time, np.sin(2.0 * math.pi * 0.83 * time), u

    result = nfr(FakeModel(lambda: Hum(lambda u: u)), "u", "y", [1.0], 1.0)
    assert "does not follow the input" in result.failed[0].reason


def test_an_input_that_does_not_move_fails() -> None:
    class Deaf(StaticSession):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            return time, 0.0 * time, 0.0 * time

    result = nfr(FakeModel(lambda: Deaf(lambda u: u)), "u", "y", [1.0], 0.2)
    assert "u does not move" in result.failed[0].reason


def test_a_model_that_cannot_start_ends_the_sweep() -> None:
    def refuse() -> Session:
        raise SimulationError("initialisation failed")

    with pytest.raises(SimulationError, match="initialisation failed"):
        nfr(FakeModel(refuse), "u", "y", [1.0, 2.0], 1.0)


@pytest.mark.parametrize("frequencies", [[8.0, 4.0, 2.0, 1.0], [1.0, 2.0, 4.0, 8.0]])
def test_carry_keeps_one_session_and_gives_the_same_answer(frequencies: list[float]) -> None:
    model = lag(0.3)
    carried = nfr(model, "u", "y", frequencies, [1.0, 2.0], carry=True, drift_check=False)
    assert model.sessions == 1 + 2  # where it stands, then the amplitudes
    fresh = nfr(model, "u", "y", frequencies, [1.0, 2.0], drift_check=False)
    assert model.sessions == 3 + 1 + 8
    np.testing.assert_array_equal(carried.frequency_hz, [1.0, 2.0, 4.0, 8.0])
    np.testing.assert_allclose(carried.response, fresh.response, rtol=1e-3)


def test_carry_runs_the_input_on_without_a_jump() -> None:
    seen: list[tuple[float, float]] = []

    class Watched(DeadTimeSession):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            _, y, u = super().rows(time, sine)
            seen.extend(zip(time, u, strict=True))
            return time, y, u

    model = FakeModel(lambda: Watched(0.01))
    nfr(model, "u", "y", None, 1.0, band=(4.0, 1.0), ratio=2.0, carry=True, drift_check=False)
    times, inputs = np.array(seen).T
    assert np.all(np.diff(times) >= 0.0)
    assert np.max(np.abs(np.diff(inputs))) < 2.0 * math.pi / 200.0 * 1.01


def test_points_and_calls_are_counted() -> None:
    model = lag(1e-3)
    told: list[tuple[float, int, int]] = []
    nfr(
        model, "u", "y", [1.0, 2.0], [2.0, 1.0], progress=lambda p, done, total: told.append((p.amplitude, done, total))
    )
    assert told == [(1.0, 1, 4), (1.0, 2, 4), (2.0, 3, 4), (2.0, 4, 4)]
    assert model.sessions == 1 + 4  # where it stands and zero input, then the points


def test_a_sweep_that_is_stopped_keeps_what_it_measured() -> None:
    sweep = NfrSweep(lag(0.1), "u", "y", [1.0, 2.0, 4.0], 1.0)
    points = sweep.run()
    next(points)
    next(points)
    result = sweep.result()
    assert np.isfinite(result.gain[0]).tolist() == [True, True, False]
    assert "interrupted" in result.failed[0].reason


def test_what_its_fmu_printed_is_told_of_a_sweep_that_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(InProcess, "remarks", lambda _: ["the FMU printed: low"])
    sweep = NfrSweep(lag(0.1), "u", "y", [1.0, 2.0, 4.0], 1.0)
    with suppress(KeyboardInterrupt), sweep.under_way() as points:
        next(points)
        raise KeyboardInterrupt
    assert sweep.result().warnings.count("the FMU printed: low") == 1
