"""The elevator law linearised with the perturbation sets of figure 31 (source report, chapter 6.2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from scripts.reproduce.chapter6 import draw_widths
from scripts.reproduce.law_widths import ELEVATOR, FREQUENCIES, LAW, PUBLISHED, STICK, WidthComparison, study
from scripts.reproduce.targets import read_targets
from workbench.show.figure import save

TARGETS = read_targets()
TRAVEL = 2.0 * 30.0 * 0.022  # [deg]: from limit to limit of the rate, in one sample


@pytest.fixture(scope="module")
def done() -> WidthComparison:
    return study()


def shift(done: WidthComparison, name: str, frequency: float) -> float:
    return abs(done.trials[name, frequency].phase_shift)


def test_there_are_infinitely_many_equilibria(done: WidthComparison) -> None:
    assert done.trim.converged
    assert {n for d in done.trim.null_directions for n in d.components} == {"positiveGain", "negativeGain", "normalFor"}
    assert TARGETS["law-equilibria"].accepts(len(done.trim.null_directions))
    assert "family of equilibria" in done.trim.message
    assert done.trim.operating_point.discrete["deflection"] == pytest.approx(2.0)  # the one state that is not free


@pytest.mark.parametrize(
    "moved", [{"positiveGain": 11.0}, {"negativeGain": 3.0, "normalFor": 25.0}, {"normalFor": 400.0}]
)
def test_other_members_of_the_family_stay_where_they_are(done: WidthComparison, moved: dict[str, float]) -> None:
    start = {**done.trim.operating_point.discrete, **moved}
    with wb.load(LAW, "me", start_values=start) as law:
        result = wb.simulate(law, stop=2.0, outputs=[*start])
    for name, value in start.items():
        assert np.ptp(result.signals[name]) == 0.0, name
        assert result.signals[name][0] == value


@pytest.mark.parametrize("name", PUBLISHED)
def test_only_the_fourth_state_and_the_fifth_input_depend_on_the_set(done: WidthComparison, name: str) -> None:
    """Beyond the rate limit the step of the elevator is the limit's, in either direction."""
    model, (dx, du) = done.models[name], PUBLISHED[name]
    assert model.method == "kalman-bertram"
    assert TARGETS["law-period"].accepts(model.dt)
    assert model.state_names[:3] == ("positiveGain", "negativeGain", "normalFor")
    assert model.A[:3, :3] == pytest.approx(np.eye(3))
    assert not model.A[:3, 3:].any()
    assert not model.A[3:, :3].any()
    assert not model.B[:3].any()
    assert not model.B[:, :4].any()
    assert model.D[0] == pytest.approx([0.0, 0.0, 0.0, 0.0, TRAVEL / du[4]])
    kept = 1.0 - min(TRAVEL / dx[3], 1.0)
    assert model.A[3:, 3:].ravel() == pytest.approx([kept] if kept else [])
    assert model.C[0, 3:] == pytest.approx([kept] if kept else [])


def test_at_5_hz_no_published_set_is_without_a_phase_shift(done: WidthComparison) -> None:
    shifts = {name: shift(done, name, 5.0) for name in PUBLISHED}
    assert TARGETS["figure-31-phase-5hz"].accepts(list(shifts.values()))
    assert shifts["30a"] == pytest.approx(62.9, abs=0.5)
    assert shifts["30b"] == pytest.approx(shifts["30a"])
    assert shifts["30c"] == pytest.approx(3.8, abs=0.5)
    assert shifts["30d"] == pytest.approx(shifts["30c"])


def test_from_set_to_set_the_model_at_5_hz_gets_better(done: WidthComparison) -> None:
    errors = [done.trials[name, 5.0].error for name in PUBLISHED]
    assert errors[0] == pytest.approx(errors[1])
    assert errors[1] > errors[2] > errors[3]
    assert TARGETS["figure-31-errors"].accepts(np.diff(errors))
    assert done.trials["30d", 5.0].gain_ratio == pytest.approx(1.1, abs=0.05)


def test_at_lower_frequencies_the_phase_shift_nearly_vanishes(done: WidthComparison) -> None:
    fastest, half, slow = (min(shift(done, name, f) for name in PUBLISHED) for f in (5.0, 0.5, 0.05))
    assert TARGETS["figure-31-phase-best"].accepts([half / fastest, slow / fastest])


@pytest.mark.parametrize(("frequency", "target"), [(0.5, "figure-31-phase-half-hz"), (0.05, "figure-31-phase-slow")])
def test_it_does_so_for_the_sets_without_dynamics_only(done: WidthComparison, frequency: float, target: str) -> None:
    ratios = [shift(done, name, frequency) / shift(done, name, 5.0) for name in PUBLISHED]
    assert [r <= np.max(TARGETS[target].limits[1]) for r in ratios] == [True, True, False, False]
    assert TARGETS[target].expects(ratios)
    # The low-pass of sets c and d, by its pole.
    pole = 1.0 - TRAVEL / PUBLISHED["30c"][0][3]
    lag = np.degrees(np.angle(1.0 / (np.exp(2j * np.pi * frequency * 0.022) - pole)))
    assert shift(done, "30c", frequency) == pytest.approx(-lag, abs=0.1 + 360.0 * frequency * 0.022)


def test_the_phase_shift_at_5_hz_comes_from_the_rate_limit(done: WidthComparison) -> None:
    """Where nothing is limited, narrow widths are right, and wrong where the limiter works all the time."""
    slow, fast = (done.trials["narrow", f] for f in (0.5, 5.0))
    assert abs(slow.phase_shift) < 0.1
    assert slow.gain_ratio == pytest.approx(1.0, abs=0.05)  # the law pulls and pushes by different gains
    assert slow.error < 0.1
    assert abs(fast.phase_shift) > 60.0
    assert fast.gain_ratio > 4.0


def test_a_set_fitted_to_5_hz_holds_there_alone(done: WidthComparison) -> None:
    """One frequency and amplitude can be bought, in the fundamental: beyond the published sets."""
    there, elsewhere = (done.trials["fitted", f] for f in (5.0, 0.5))
    assert abs(there.phase_shift) < 0.5
    assert there.gain_ratio == pytest.approx(1.0, abs=0.02)
    assert there.error > 0.5  # a triangle is no sine
    assert abs(elsewhere.phase_shift) > 30.0


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_the_law_measured_by_its_frequency_response_has_the_same_phase(done: WidthComparison, frequency: float) -> None:
    """The hold between the samples, half a period, is in the measured response and not in the samples."""
    law = done.trials["30a", frequency].law
    with wb.load(LAW, "me") as model:
        measured = wb.nfr(model, STICK, ELEVATOR, [frequency], [1.0], errcrit=0.001)
    hold = -180.0 * frequency * 0.022
    assert measured.phase_deg[0, 0] == pytest.approx(np.degrees(np.angle(law.fundamental)) + hold, abs=1.0)
    assert measured.gain[0, 0] == pytest.approx(abs(law.fundamental), rel=0.03)


def test_picture(done: WidthComparison, tmp_path: Path) -> None:
    save(draw_widths(done), tmp_path / "figure31.svg")
    assert (tmp_path / "figure31.svg").stat().st_size > 10_000
