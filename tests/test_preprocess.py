"""Each step of pre-processing against what was put in."""

from __future__ import annotations

import numpy as np
import pytest

from tests.identification_data import DT, A, B, data, prbs, response, white, with_noise
from workbench.data.advice.saturation import stretches_at
from workbench.data.experiment.experiment import make_experiment
from workbench.data.preprocess.outliers import _without_gross, remove_outliers
from workbench.data.preprocess.settle import cut_settling, settling_samples
from workbench.data.preprocess.steps import detrend, remove_offset, resample, scale
from workbench.errors import InputError


def test_detrend_takes_the_line_out_and_tells_it() -> None:
    u = prbs(1000)
    clean = detrend(data(u, response(u)), kind="linear")
    time = np.arange(1000) * DT
    done = detrend(data(u + 5.0, response(u) + 2.0 + 0.3 * time), kind="linear")
    np.testing.assert_allclose(done.experiment.y, clean.experiment.y, atol=1e-10)
    assert done.slopes["y"] - clean.slopes["y"] == pytest.approx(0.3)
    assert done.u0[0] == pytest.approx(5.0 + np.mean(u))
    assert done.y0[0] - clean.y0[0] == pytest.approx(2.0 + 0.3 * np.mean(time))
    assert done.experiment.notes[-1] == done.what


def test_detrend_leaves_other_columns_and_the_given_data_alone() -> None:
    experiment = data(prbs(100) + 1.0, np.ones(100) * 2.0)
    before = experiment.u.copy()
    done = detrend(experiment, columns=["y"])
    np.testing.assert_array_equal(experiment.u, before)
    np.testing.assert_array_equal(done.experiment.u, before)
    assert done.offsets == {"u": 0.0, "y": 2.0}
    assert np.all(done.experiment.y == 0.0)


def test_offsets_by_value() -> None:
    done = remove_offset(data(np.full(10, 2.0), np.arange(10.0)), {"u": 2.0})
    assert np.all(done.experiment.u == 0.0)
    assert done.experiment.y[-1, 0] == 9.0


@pytest.mark.parametrize("by", ["deviation", "peak", "range"])
def test_scaling_brings_columns_to_one_and_is_undone(by: str) -> None:
    u = np.column_stack([100.0 * white(500, 1), 1e-4 * white(500, 2)])
    y = u @ [[3.0], [2e6]]
    done = scale(make_experiment(DT, u, y), by=by)
    new = done.experiment
    values = np.hstack([new.u, new.y])
    size = {
        "deviation": np.std(values, axis=0),
        "peak": np.max(np.abs(values), axis=0),
        "range": np.ptp(values, axis=0),
    }
    np.testing.assert_allclose(size[by], 1.0)
    gain = np.linalg.lstsq(new.u, new.y, rcond=None)[0].T
    _, _, D = done.undo(np.zeros((0, 2)), np.zeros((1, 0)), gain.astype(np.float64))
    np.testing.assert_allclose(D, [[3.0, 2e6]])


def test_a_constant_column_is_not_scaled() -> None:
    assert scale(data(np.full(10, 3.0), np.arange(10.0))).factors["u"] == 1.0
    assert scale(data(np.full(10, 3.0), np.arange(10.0)), by={"y": 2.0}).experiment.y[-1, 0] == 4.5


def test_settling_is_cut_and_settled_data_are_not() -> None:
    u = prbs(2000)
    start = np.zeros(2000)
    start[0] = 60.0  # a kick before the record: its response is not the input's
    for level in (80.0, 30.0):
        assert settling_samples(data(u, with_noise(response(u), level))) == 0
        kicked = data(u, with_noise(response(u) + response(start), level))
        done = cut_settling(kicked)
        left = np.abs(response(start)[done.samples :])
        assert 10 <= done.samples <= 60
        assert np.max(left) < np.std(response(u))
        assert done.experiment.n_samples == 2000 - done.samples
        assert done.experiment.time[0] == pytest.approx(done.samples * DT)


def test_settling_can_be_told() -> None:
    assert cut_settling(data(prbs(100), prbs(100)), samples=30).experiment.n_samples == 70
    with pytest.raises(InputError, match="cannot be cut off"):
        cut_settling(data(prbs(100), prbs(100)), samples=71)


@pytest.mark.parametrize("level", [200.0, 40.0, 20.0])
@pytest.mark.parametrize("hold", [1, 3])
def test_outliers_are_found_alone_and_repaired(level: float, hold: int) -> None:
    u = prbs(1500, hold=hold)
    clean = with_noise(response(u), level)
    assert remove_outliers(data(u, clean)).samples["y"] == ()
    at = (200, 433, 434, 900)
    spoilt = clean.copy()
    spoilt[list(at)] += np.array([3.0, -4.0, 5.0, 2.5]) * np.std(clean)
    done = remove_outliers(data(u, spoilt))
    assert done.samples["y"] == at
    left = np.abs(done.experiment.y[:, 0] - clean)
    assert np.max(left) < 1e-6 + 6.0 * np.std(clean) * 10.0 ** (-level / 20.0)
    assert np.count_nonzero(left) == len(at)


def test_a_value_off_by_orders_of_magnitude_is_found() -> None:
    u = prbs(1500)
    y = response(u)
    y[700] = 1e30
    done = remove_outliers(data(u, y))
    assert done.samples["y"] == (700,)
    assert np.max(np.abs(done.experiment.y)) < 10.0
    assert remove_outliers(data(u, response(u))).what == "0 outliers replaced"


def test_the_pulse_of_a_signal_at_rest_is_not_far_outside_a_range_that_is_none() -> None:
    y = np.zeros(3000)
    y[1000:1010] = 2.0
    left, gross = _without_gross(y)
    assert gross == set()
    assert np.array_equal(left, y)


def test_flat_extremes_are_found() -> None:
    u = white(2000)
    y = response(u)
    limit = 1.3 * float(np.std(y))
    assert not stretches_at(y, y.max())
    stretches = stretches_at(np.clip(y, None, limit), limit)
    assert stretches
    assert all(np.all(y[first:last] >= limit) and last - first >= 3 for first, last in stretches)


def test_decimation_without_a_filter_is_exact_for_held_inputs() -> None:
    u = prbs(1200, hold=3)
    done = resample(data(u, response(u)), dt=3 * DT, antialias=False)
    np.testing.assert_array_equal(done.experiment.y[:, 0], response(u)[::3])
    assert done.experiment.dt == pytest.approx(3 * DT)
    assert done.ratio == 3
    assert not done.filtered


def test_resampling_keeps_slow_signals_and_removes_what_would_be_folded() -> None:
    time = np.arange(4000) * DT
    slow, fast = np.sin(2.0 * np.pi * 1.5 * time), np.sin(2.0 * np.pi * 24.0 * time)
    for dt in (4 * DT, 2.5 * DT):
        done = resample(data(slow, slow + fast), dt=dt).experiment
        inner = slice(40, -40)
        expected = np.sin(2.0 * np.pi * 1.5 * done.time[inner])
        np.testing.assert_allclose(done.u[inner, 0], expected, atol=0.01)
        assert np.max(np.abs(done.y[inner, 0] - expected)) < (0.02 if dt > 2 * DT * 1.9 else 0.2)
    folded = resample(data(slow, fast), dt=4 * DT, antialias=False).experiment
    assert np.std(folded.y) > 0.5


@pytest.mark.parametrize(
    ("dt", "message"),
    [(0.005, "shorter"), (0.0, "positive"), (DT * np.pi, "not a simple ratio"), (DT * 90, "would be left")],
)
def test_awkward_intervals_are_refused(dt: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        resample(data(prbs(1000), prbs(1000)), dt=dt)


def test_wrong_options_are_refused_in_one_line() -> None:
    experiment = data(prbs(100), response(prbs(100)))
    with pytest.raises(InputError, match="did you mean linear"):
        detrend(experiment, kind="liner")
    with pytest.raises(InputError, match="no column 'x'"):
        detrend(experiment, columns=["x"])
    with pytest.raises(InputError, match="finite"):
        remove_offset(experiment, {"u": np.nan})
    with pytest.raises(InputError, match="did you mean peak"):
        scale(experiment, by="peek")
    with pytest.raises(InputError, match="must be positive"):
        scale(experiment, by={"u": 0.0})
    with pytest.raises(InputError, match="must be positive"):
        remove_outliers(experiment, threshold=0.0)
    with pytest.raises(InputError, match="multiple of the sampling"):
        resample(experiment, dt=1.5 * DT, antialias=False)


def test_the_known_system_is_what_the_tests_think() -> None:
    assert np.max(np.abs(np.roots(A))) < 1.0
    assert B[0] == 0.0


def test_the_share_of_a_level_is_that_of_its_samples() -> None:
    ((first, last),) = stretches_at(np.concatenate([np.arange(300.0), np.full(100, 300.0)]), 300.0)
    assert last - first == pytest.approx(100, abs=4)
