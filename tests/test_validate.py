"""Validation: figures in closed form, bands by Monte Carlo with fixed seeds, verdicts on systems that are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, chi2

from scripts.reproduce.error_figures import ERROR_FIGURES, error_figure
from tests.random_systems import Plant, random_plant
from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment, make_experiment, read_experiment
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.validate.pole_zero import near_cancellations
from workbench.identification.validate.residuals import (
    LEVEL,
    _each,
    _probability,
    autocorrelation,
    cross_correlation,
    fit_of,
)
from workbench.identification.validate.validate import validate

DT = 0.1


def model_of(
    A: object, B: object, C: object, D: object, K: object | None = None, *, u0: float = 0.0, y0: float = 0.0
) -> IdentifiedModel:
    a, b, c, d = (np.atleast_2d(np.asarray(x, dtype=np.float64)) for x in (A, B, C, D))
    (n, m), p = b.shape, len(c)
    gain = np.zeros((n, p)) if K is None else np.asarray(K, dtype=np.float64).reshape(n, p)
    return IdentifiedModel(
        A=a.reshape(n, n), B=b, C=c, D=d, K=gain, x0=np.zeros(n), dt=DT, u0=np.full(m, u0), y0=np.full(p, y0),
        covariance=np.eye(p), input_names=("u", "v")[:m], output_names=("y", "z")[:p], input_units=(None,) * m,
        output_units=("deg",) * p,
    )  # fmt: skip


def lag(K: float | None = None) -> IdentifiedModel:
    return model_of([[0.8]], [[0.2]], [[1.0]], [[0.0]], None if K is None else [[K]])


def binary(rng: np.random.Generator, samples: int, inputs: int = 1) -> Floats:
    return np.asarray(np.sign(rng.normal(size=(samples, inputs))))


def record(u: Floats, y: Floats) -> Experiment:
    names = {"input_names": ("u", "v")[: u.shape[1]], "output_names": ("y", "z")[: y.shape[1]]}
    return make_experiment(DT, u, y, input_names=names["input_names"], output_names=names["output_names"])


# -- figures -----------------------------------------------------------------------------------


def test_fit_and_error_in_closed_form() -> None:
    y = np.array([1.0, -1.0, 1.0, -1.0]) + 5.0
    half = 0.5 * (y - 5.0) + 5.0
    good = fit_of("y", y, half + 1.0)  # half the deflection is missed, and an offset of 1
    assert good.fit_percent == pytest.approx(100.0 * (1.0 - np.sqrt(0.25 + 1.0)))
    assert good.error_percent == pytest.approx(50.0)
    assert [good.rms, good.offset] == pytest.approx([np.sqrt(1.25), -1.0])
    assert fit_of("y", y, half).fit_percent == pytest.approx(100.0 - fit_of("y", y, half).error_percent)


def test_every_error_figure_in_closed_form() -> None:
    y, computed = np.array([3.0, 1.0, 3.0, 1.0]), np.array([2.5, 1.5, 2.5, 1.5])
    expected = {
        "detrended": 50.0, "fit": 50.0, "raw": 100.0 * np.sqrt(1.0 / 20.0), "variance": 25.0, "absolute": 50.0,
        "range": 25.0, "peak": 50.0,
    }  # fmt: skip
    assert {n: error_figure(y, computed, n) for n in ERROR_FIGURES} == pytest.approx(expected)


def test_figures_that_do_not_exist_are_not_numbers() -> None:
    flat = fit_of("y", np.ones(4), np.zeros(4))
    assert np.isnan(flat.fit_percent)
    assert np.isnan(fit_of("y", np.arange(4.0), np.full(4, np.inf)).error_percent)
    with pytest.raises(InputError, match="error figure 'best' is unknown; known: detrended, fit"):
        error_figure(np.arange(3.0), np.arange(3.0), "best")


def test_the_mean_has_fit_zero() -> None:
    y = np.array([2.0, 4.0, 9.0])
    assert fit_of("y", y, np.full(3, 5.0)).fit_percent == pytest.approx(0.0)


# -- bands -------------------------------------------------------------------------------------


def test_autocorrelation_is_the_direct_sum() -> None:
    e = np.array([[1.0], [-2.0], [0.5], [3.0], [-2.5]])
    found = autocorrelation(e, 2)
    assert found.values[:, 0] == pytest.approx([1.0, (-2.0 - 1.0 + 1.5 - 7.5) / 20.5, (0.5 - 6.0 - 1.25) / 20.5])
    assert found.band == pytest.approx(1.959964 / np.sqrt(5.0))


def test_one_output_has_ljung_and_box_statistic() -> None:
    e = np.random.default_rng(1).normal(size=(200, 1))
    found = autocorrelation(e, 10)
    r = found.values[1:, 0]
    assert found.statistic == pytest.approx(200 * 202 * np.sum(r**2 / (200 - np.arange(1, 11))) * 200 / 202)
    assert found.degrees == 10


@pytest.mark.parametrize("outputs", [1, 2])
def test_white_residuals_cross_the_band_at_5_percent_of_lags_and_alarm_in_5_percent_of_cases(outputs: int) -> None:
    rng = np.random.default_rng(7)
    mixed = np.array([[1.0, 0.8], [0.0, 0.6]])[:outputs, :outputs]
    found = [autocorrelation(rng.normal(size=(800, outputs)) @ mixed, 20) for _ in range(600)]
    lags = np.mean([sum(a.outside) for a in found]) / (20.0 * outputs)
    alarms = sum(not a.white for a in found)
    assert lags == pytest.approx(0.05, abs=0.006)
    assert binom.ppf(0.001, 600, 0.05) <= alarms <= binom.ppf(0.999, 600, 0.05)


@pytest.mark.parametrize("pole", [0.0, 0.9], ids=["white residuals", "coloured residuals"])
def test_independent_input_crosses_the_band_at_5_percent_of_lags_and_alarms_in_5_percent_or_less(pole: float) -> None:
    rng = np.random.default_rng(8)

    def one() -> tuple[float, bool, bool]:
        u = np.repeat(binary(rng, 201), 4, axis=0)[:800]
        test = cross_correlation(lfilter([1.0], [1.0, -pole], rng.normal(size=(800, 1)), axis=0), u, 20)
        return sum(test.outside) / 41.0, test.undermodelled, test.feedback

    lags, missed, feedback = np.mean([one() for _ in range(600)], axis=0)
    assert lags == pytest.approx(0.05, abs=0.008)
    assert max(missed, feedback) <= 0.05


def test_several_channels_alarm_in_5_percent_or_less() -> None:
    rng = np.random.default_rng(9)
    found = [cross_correlation(rng.normal(size=(500, 2)), binary(rng, 500, 2), 15) for _ in range(300)]
    assert np.mean([c.undermodelled for c in found]) <= 0.05
    assert np.mean([c.feedback for c in found]) <= 0.05


def test_cross_correlation_knows_which_came_first() -> None:
    rng = np.random.default_rng(3)
    u = binary(rng, 1000)
    late = np.roll(u, 3, axis=0) + rng.normal(size=u.shape)
    test = cross_correlation(late, u, 10)
    assert test.lags[np.argmax(test.values[:, 0, 0])] == 3.0
    assert (test.undermodelled, test.feedback) == (True, False)
    early = cross_correlation(np.roll(u, -3, axis=0) + rng.normal(size=u.shape), u, 10)
    assert (early.undermodelled, early.feedback) == (False, True)


def test_a_small_correlation_that_lasts_is_seen_where_no_lag_stands_out() -> None:
    rng = np.random.default_rng(4)
    u = binary(rng, 1000)
    e = lfilter(0.10 * np.ones(20), [1.0], u, axis=0) + rng.normal(size=u.shape)
    test = cross_correlation(e, u, 25)
    assert test.undermodelled
    assert np.sum(np.abs(test.values[test.lags >= 0]) > test.band_all) <= 6


def test_the_rates_of_several_numbers_together_make_half_the_level() -> None:
    for count in (1, 7, 60):
        assert 1.0 - (1.0 - _each(count)) ** count == pytest.approx(0.5 * LEVEL, rel=1e-12)


def test_equal_covariances_of_white_signals_are_judged_by_the_chi_squared_of_their_number() -> None:
    """Eight at 1.5 standard deviations each: no peak, but Σ = 18 with 8 degrees of freedom; twice for two tests."""
    c = np.zeros((8, 1, 1))
    c[0] = 4.0
    assert _probability(np.full((8, 1, 1), 3.0), c) == pytest.approx(2.0 * chi2.sf(18.0, 8))


def test_a_constant_input_has_no_correlation() -> None:
    rng = np.random.default_rng(5)
    test = cross_correlation(rng.normal(size=(300, 1)), np.ones((300, 1)), 10)
    assert not test.values.any()
    assert (test.undermodelled, test.feedback) == (False, False)


# -- verdicts ----------------------------------------------------------------------------------


def noisy(rng: np.random.Generator, samples: int = 1500) -> tuple[Floats, Floats]:
    """The lag with innovations of 0.1 that enter by K = 0.5."""
    u, e = binary(rng, samples), 0.1 * rng.normal(size=(samples, 1))
    return u, lag().simulate(u) + lfilter([1.0, 0.5 - 0.8], [1.0, -0.8], e, axis=0)  # 1 + K/(q − 0.8)


def test_the_true_model_passes() -> None:
    true = lag(0.5)
    u, y = noisy(np.random.default_rng(11))
    found = validate(true, record(u, y))
    assert found.prediction.autocorrelation is not None
    assert found.prediction.cross is not None
    assert found.simulation.autocorrelation is not None
    assert found.prediction.autocorrelation.white
    assert found.prediction.cross.inside
    assert not found.simulation.autocorrelation.white  # the disturbance is coloured
    assert found.simulation.cross is not None
    assert found.simulation.cross.inside
    assert found.prediction.fits[0].rms == pytest.approx(0.1, rel=0.05)
    assert found.prediction.fits[0].fit_percent > found.simulation.fits[0].fit_percent


def test_a_wrong_model_does_not() -> None:
    u, y = noisy(np.random.default_rng(12))
    found = validate(model_of([[0.6]], [[0.4]], [[1.0]], [[0.0]]), record(u, y))
    assert found.simulation.cross is not None
    assert found.simulation.cross.undermodelled
    assert any("order too low" in line for line in found.words)
    assert any("K = 0" in line for line in found.notes)


def test_feedback_is_seen_at_negative_lags() -> None:
    rng = np.random.default_rng(13)
    x, u, y = 0.0, np.zeros(1500), np.zeros(1500)
    e, v = 0.3 * rng.normal(size=1500), binary(rng, 1500)[:, 0]
    for k in range(1500):
        y[k] = x + e[k]
        if k + 1 < 1500:
            u[k + 1] = v[k] - 0.5 * y[k]
        x = 0.8 * x + 0.2 * u[k]
    found = validate(lag(), record(u[:, None], y[:, None]))
    assert found.prediction.cross is not None
    assert found.prediction.cross.feedback
    assert not found.prediction.cross.undermodelled


def test_noise_free_data_of_the_model_itself_leave_nothing_to_test() -> None:
    true = replace(lag(), u0=np.array([2.0]), y0=np.array([-3.0]))
    u = binary(np.random.default_rng(5), 200)
    found = validate(true, record(u, true.simulate(u, np.array([1.0]))))
    assert found.fit_percent["y"] == pytest.approx(100.0, abs=1e-9)
    assert found.prediction.autocorrelation is None
    assert "rounding" in found.words[1]
    with pytest.raises(InputError, match="no residual picture"):
        found.plot_residuals()


def test_starts_differ_as_they_should() -> None:
    true = lag()
    u = binary(np.random.default_rng(6), 300)
    data = record(u, true.simulate(u, np.array([5.0])) + 1e-3 * np.random.default_rng(0).normal(size=u.shape))
    fits = {s: validate(true, data, start=s).fit_percent["y"] for s in ("fit", "rest", "model")}
    assert fits["fit"] > 99.5
    assert fits["rest"] == fits["model"] < 50.0
    right = replace(true, x0=np.array([5.0]))
    assert validate(right, data, start="model").fit_percent["y"] > 99.5


def test_an_unstable_model_is_judged_by_its_prediction() -> None:
    rng = np.random.default_rng(14)
    e = 0.1 * rng.normal(size=400)
    u = binary(rng, 400)
    y = (lfilter([0.2], [1.0, -0.9], np.roll(u[:, 0], 1)) + e)[:, None]
    found = validate(model_of([[1.2]], [[0.2]], [[1.0]], [[0.0]], [[0.4]]), record(u, y))
    assert np.isnan(found.fit_percent["y"])
    assert "grows without bound" in found.simulation.remark
    assert np.isfinite(found.prediction.fits[0].fit_percent)
    assert any("unstable" in line for line in found.notes)
    json.dumps(found.to_dict(), allow_nan=False)
    found.plot()


def test_columns_are_found_by_name_and_refused_in_one_line() -> None:
    u, y = noisy(np.random.default_rng(15))
    more = make_experiment(DT, np.hstack([y, u]), y, input_names=("z", "u"), output_names=("y",))
    assert validate(lag(), more).data.input_names == ("u",)
    renamed = make_experiment(DT, u, y, input_names=("stick",), output_names=("flap",))
    found = validate(lag(), renamed)
    assert found.data.output_names == ("y",)
    assert "stick, flap are used as u, y of the model" in found.notes
    with pytest.raises(InputError, match="no column 'u' of the model; did you mean U2"):
        validate(lag(), make_experiment(DT, u, y, input_names=("U2",), output_names=("y",)))


def test_several_channels_with_other_names_are_refused() -> None:
    """Which of r and s is p nothing tells: taken by their place, fits of exchanged outputs would be told."""
    u, y = noisy(np.random.default_rng(15))
    both = model_of([[0.8]], [[0.2]], [[1.0], [2.0]], [[0.0], [0.0]])
    data = make_experiment(DT, u, np.hstack([2.0 * y, y]), input_names=("x",), output_names=("r", "s"))
    with pytest.raises(InputError, match="has x → r, s, none of them of the model, u → y, z; rename them"):
        validate(both, data)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"lags": 0}, "lags: 0 is not between 1 and 10"),
        ({"lags": 11}, "a quarter of the 40 samples"),
        ({"start": "ft"}, "start 'ft' is unknown; did you mean fit"),
        ({"steps": 0}, "steps must be 1 or more"),
    ],
)
def test_wrong_settings_are_refused(options: dict[str, object], words: str) -> None:
    u = binary(np.random.default_rng(0), 40)
    with pytest.raises(InputError, match=words):
        validate(lag(), record(u, lag().simulate(u)), **options)  # type: ignore[arg-type]


def test_wrong_data_are_refused() -> None:
    u = binary(np.random.default_rng(0), 40)
    y = lag().simulate(u)
    with pytest.raises(InputError, match=r"sampled every 0\.2 s, the model every 0\.1 s"):
        validate(lag(), make_experiment(2.0 * DT, u, y))
    with pytest.raises(InputError, match="5 samples are too few"):
        validate(lag(), make_experiment(DT, u[:5], y[:5]))


# -- poles and zeros ---------------------------------------------------------------------------


def from_poles(poles: list[complex], zeros: list[complex]) -> IdentifiedModel:
    den, num = np.real(np.poly(poles)), np.real(np.poly(zeros))
    n = len(den) - 1
    num = np.concatenate([np.zeros(n + 1 - len(num)), num])
    A = np.vstack([-den[1:], np.eye(n)[:-1]])
    return model_of(A, np.eye(n)[:, :1], (num[1:] - num[0] * den[1:])[None], [[num[0]]])


def test_near_cancellations_are_listed_with_their_effect() -> None:
    model = from_poles([0.9, 0.5 + 0.4j, 0.5 - 0.4j, -0.2], [0.89, 0.5 + 0.41j, 0.5 - 0.41j])
    found = near_cancellations(model)
    assert [c.pole for c in found] == [pytest.approx(0.5 + 0.4j), pytest.approx(0.9)]
    assert found[0].effect == pytest.approx(0.01 / (1.0 - abs(0.5 + 0.4j)))
    assert found[1].effect == pytest.approx(0.1)
    assert "nearly cancel: they change the gain by 10 % at most" in found[1].words
    assert near_cancellations(model, near=0.05) == found[:1]


def test_the_effect_bounds_the_change_of_the_gain() -> None:
    pole, zero = 0.9, 0.88
    found = near_cancellations(from_poles([pole], [zero]))
    z = np.exp(1j * np.linspace(0.0, np.pi, 2001))
    change = np.max(np.abs(np.abs((z - zero) / (z - pole)) - 1.0))
    assert found[0].effect == pytest.approx(change, rel=1e-6)


def test_a_slow_pole_needs_a_nearer_zero() -> None:
    assert near_cancellations(from_poles([0.999], [0.99])) == ()
    assert len(near_cancellations(from_poles([0.5], [0.491]))) == 1


def test_of_several_channels_all_must_cancel() -> None:
    A, B = np.diag([0.5, 0.8]), np.array([[1.0], [1.0]])
    one = model_of(A, B, np.array([[1.0, 1e-3]]), [[0.0]])
    both = model_of(A, B, np.array([[1.0, 1e-3], [1.0, -1e-3]]), [[0.0], [0.0]])
    seen = model_of(A, B, np.array([[1.0, 1e-3], [1.0, 1.0]]), [[0.0], [0.0]])
    assert [c.pole for c in near_cancellations(one)] == [pytest.approx(0.8)]
    assert [c.pole for c in near_cancellations(both)] == [pytest.approx(0.8)]
    assert near_cancellations(seen) == ()


def test_a_zero_that_chance_explains_lies_in_the_region_of_its_pole() -> None:
    """The model's zero is 0.01 off its pole; the pole is known to ±0.002 or to ±0.1 (95 % of one number: 1.96 σ)."""
    known = model_of([[0.5]], [[1.0]], [[0.01]], [[1.0]])
    for sigma, inside in ((0.001, False), (0.05, True)):
        spread = np.zeros((4, 1))
        spread[0] = sigma
        (pair,) = near_cancellations(replace(known, spread=spread))
        assert pair.distance == pytest.approx(0.01)
        assert pair.within_confidence is inside
    (alone,) = near_cancellations(known)
    assert alone.within_confidence is None


def test_no_poles_no_cancellations() -> None:
    assert near_cancellations(model_of(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[2.0]])) == ()


# -- results -----------------------------------------------------------------------------------


def two_by_two() -> tuple[Plant, Experiment, IdentifiedModel]:
    rng = np.random.default_rng(21)
    system = random_plant(rng, 3, 2, 2)
    u = binary(rng, 600, 2)
    y = system.output(u)
    model = model_of(system.A, system.B, system.C, system.D)
    return system, record(u, y + 0.05 * y.std(axis=0) * rng.normal(size=y.shape)), model


def test_several_channels_through_json_csv_and_pictures(tmp_path: Path) -> None:
    _, data, model = two_by_two()
    found = validate(model, data, lags=10)
    assert all(fit > 90.0 for fit in found.fit_percent.values())
    saved = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert np.shape(saved["simulation"]["cross_correlation"]["values"]) == (2, 2, 21)
    assert saved["fit_percent"] == found.fit_percent
    found.to_csv(tmp_path / "outputs.csv")
    back = read_experiment(tmp_path / "outputs.csv", inputs=["y measured"], outputs=["y simulated", "z predicted"])
    np.testing.assert_allclose(back.y[:, 0], found.simulation.computed[:, 0])
    found.plot(tmp_path / "fit.png", seconds=20.0)
    found.plot_residuals(tmp_path / "residuals.svg", kind="simulation")
    found.plot_poles(tmp_path / "poles.pdf")
    assert {p.suffix for p in tmp_path.iterdir()} == {".csv", ".png", ".svg", ".pdf"}


def test_pictures_name_every_axis_with_its_unit() -> None:
    _, data, model = two_by_two()
    found = validate(model, data)
    for figure in (found.plot(), found.plot_residuals()):
        axes = figure.get_axes()
        assert all(ax.get_ylabel() for ax in axes)
        assert "time [s]" in axes[-1].get_xlabel() or "lag [samples of 0.1 s]" in axes[-1].get_xlabel()
    assert found.plot_residuals().get_axes()[0].get_xlabel() == "time [s]"


def test_results_refuse_what_they_do_not_have(tmp_path: Path) -> None:
    _, data, model = two_by_two()
    found = validate(model, data)
    with pytest.raises(InputError, match="residuals 'both' are unknown; known: prediction, simulation"):
        found.plot_residuals(kind="both")
    with pytest.raises(InputError, match="seconds must be positive"):
        found.plot(seconds=0.0)
    with pytest.raises(InputError, match="is not a picture format"):
        found.plot(tmp_path / "fit.gif")
    with pytest.raises(InputError, match="cannot be written"):
        found.to_csv(tmp_path / "nowhere" / "outputs.csv")
