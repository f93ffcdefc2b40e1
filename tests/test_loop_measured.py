"""Loops measured with sines: against describing functions, and breaking against injecting."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest

from tests.loop_models import SATURATION, S, saturation_gain, transfer, unity
from workbench.core.values.linear import Linear, LinearPart
from workbench.core.values.response import Response
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.loops.loop.injecting import first_guess
from workbench.loops.loop.margins import curve_margins, margins_of
from workbench.loops.loop.page import loop_page, margin_tables, margin_verdict
from workbench.loops.loop.request import loop
from workbench.loops.loop.result import LoopResult
from workbench.point.trim.request import trim
from workbench.study.requirements import read_requirement
from workbench.study.requirements.base import NotMeasured
from workbench.system.connect import connect

HERE = Workers(in_process=True)
LAGS = {"a": "fmu:FirstOrderLag", "b": "fmu:FirstOrderLag", "c": "fmu:FirstOrderLag"}
GAIN = 6.0


@pytest.fixture(scope="module")
def saturated() -> LoopResult:
    with unity({"s": "fmu:Saturation", **LAGS}, GAIN, start_values=SATURATION) as model:
        return loop(model, "s.u", [0.5, 2.0, 5.0], band=(0.06, 0.6), ratio=1.4, how="both", workers=HERE)


def _truth(amplitude: float) -> tuple[float, float]:
    """Return gain margin and phase margin [deg] of N(A)·K/(s+1)³."""
    gain = GAIN * saturation_gain(amplitude)
    return 8.0 / gain, 180.0 - 3.0 * math.degrees(math.atan(math.sqrt(gain ** (2.0 / 3.0) - 1.0)))


@pytest.mark.parametrize("amplitude", [0.5, 2.0, 5.0])
def test_margins_of_the_broken_loop_are_those_of_the_describing_function(
    saturated: LoopResult, amplitude: float
) -> None:
    gain, phase = _truth(amplitude)
    m = saturated.curve(amplitude, "break").margins
    assert m.verdict == "stable"
    assert m.gain_margin == pytest.approx(gain, rel=1e-3)
    assert m.phase_margin_deg == pytest.approx(phase, abs=0.05)
    assert m.phase_crossover_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-3)
    at = np.array([p.frequency_hz for p in saturated.curve(amplitude, "break").points])
    truth = GAIN * saturation_gain(amplitude) / (1.0 + 2j * np.pi * at) ** 3
    assert saturated.curve(amplitude, "break").value == pytest.approx(truth, rel=2e-3)


def test_far_beyond_the_limits_the_gain_is_four_over_pi_by_the_amplitude(saturated: LoopResult) -> None:
    ratio = saturated.curve(5.0, "break").margins.gain_margin / saturated.margins.gain_margin
    assert 1.0 / ratio == pytest.approx(4.0 / (math.pi * 5.0), rel=1e-2)


def test_margins_beyond_the_band_are_to_be_watched_and_extremes_at_its_edge_are_bounds() -> None:
    """L = 6/(s+1)³ is 1 at 0.242 Hz and real at 0.276 Hz: a band from 0.25 Hz sees the gain margin only."""
    with unity({"s": "fmu:Saturation", **LAGS}, 6.0, start_values=SATURATION) as model:
        result = loop(model, "s.u", [0.5], band=(0.25, 0.6), ratio=1.4, how="break", workers=HERE)
    m = result.curve(0.5).margins
    assert m.gain_margin == pytest.approx(8.0 / 6.0, rel=1e-3)
    assert math.isnan(m.phase_margin_deg)
    linear, measured = loop_page(result).summary
    assert (linear.word, measured.word) == ("stable", "watch")
    assert "phase and delay margin not seen in the band" in measured.text
    (table, _) = margin_tables(m, (0.25, 0.6))
    told = {row[0]: row[1] for row in table.rows}
    assert told["phase margin"] == "not seen in the band"
    at_edge = {
        "largest |S|": m.peak_sensitivity_hz, "largest |T|": m.peak_complementary_hz,
        "disk margin": m.disk.frequency_hz if m.disk else math.nan,
    }  # fmt: skip
    assert any(f == pytest.approx(0.25) for f in at_edge.values())
    for name, f in at_edge.items():
        sign = "≤" if name == "disk margin" else "≥"
        assert told[name].startswith(sign) == (f == pytest.approx(0.25)), name
        assert told[name].endswith("(edge of the band)") == (f == pytest.approx(0.25)), name
    (drawn,) = (s for s in loop_page(result).sections if s.title.startswith("Measured"))
    assert drawn.tables[0].rows == table.rows


@pytest.mark.parametrize("amplitude", [0.5, 2.0, 5.0])
def test_injecting_agrees_with_breaking(saturated: LoopResult, amplitude: float) -> None:
    """At the crossovers, where the loop filters harmonics well; the distortion tells where it does not."""
    broken, injected = (saturated.curve(amplitude, how) for how in ("break", "inject"))
    assert injected.margins.gain_margin == pytest.approx(broken.margins.gain_margin, rel=1e-2)
    assert injected.margins.gain_margin == pytest.approx(_truth(amplitude)[0], rel=1e-2)
    assert injected.margins.phase_margin_deg == pytest.approx(broken.margins.phase_margin_deg, abs=0.7)
    assert not injected.failed
    assert all(p.amplitude == pytest.approx(amplitude, rel=1.5e-3) for p in injected.points)
    assert max(p.balance or 0.0 for p in injected.points) < 2e-3
    assert injected.margins.verdict == "stable"


def test_distortion_tells_where_a_describing_function_says_little(saturated: LoopResult) -> None:
    assert all(p.thd_passed == 0.0 for c in saturated.curves if c.how == "break" for p in c.points)
    small, large = (saturated.curve(a, "inject").points for a in (0.5, 2.0))
    assert max(p.thd_passed or 0.0 for p in small) < 1e-3
    assert (large[0].thd_passed or 0.0) > 0.1
    assert (large[-1].thd_passed or 0.0) < 0.01
    assert any("is not a sine" in note for note in saturated.curve(2.0, "inject").notes)
    assert (large[-1].harmonics[1] or 0.0) > 0.9 * (large[-1].thd_returned or 0.0)  # the third


def test_in_its_linear_range_the_loop_is_the_linear_one(saturated: LoopResult) -> None:
    for how in ("break", "inject"):
        curve = saturated.curve(0.5, how)
        assert saturated.linear is not None
        assert curve.value == pytest.approx(saturated.linear.response(curve.frequency_hz), rel=1e-3)
        assert curve.margins.disk is not None
        assert saturated.margins.disk is not None
        assert curve.margins.disk.alpha == pytest.approx(saturated.margins.disk.alpha, rel=1e-2)


def test_a_loop_of_gain_nine_is_unstable_small_and_stable_large() -> None:
    """K = 12 > 8: the limit cycle has the amplitude at which N(A) K = 8; beyond it the quasi-linear loop is stable."""
    with unity({"s": "fmu:Saturation", **LAGS}, 12.0, start_values=SATURATION) as model:
        result = loop(model, "s.u", [0.5, 3.0], [0.15, 0.2, 0.3, 0.4], workers=HERE)
    assert result.margins.verdict == "unstable"
    small, large = (result.curve(a).margins for a in (0.5, 3.0))
    assert (small.verdict, large.verdict) == ("unstable", "stable")
    assert math.isnan(small.gain_margin)
    assert large.gain_margin == pytest.approx(8.0 / (12.0 * saturation_gain(3.0)), rel=1e-3)


def test_the_operating_point_counts() -> None:
    """At rest at 0.64 of a limit of 1: linear up to an amplitude of 0.36, unsymmetric beyond."""
    with unity({"s": "fmu:Saturation", **LAGS}, 4.0, start_values=SATURATION) as model:
        point = trim(model, u0={"r": 0.8}).operating_point
        result = loop(model, "k.y", [0.3, 1.0], [0.15, 0.22, 0.3], at=point, how="both", workers=HERE)
        beyond = loop(model, "k.y", at=trim(model, u0={"r": 5.0}).operating_point)
    assert result.value == pytest.approx(0.64)
    for how in ("break", "inject"):
        assert result.curve(0.3, how).margins.gain_margin == pytest.approx(2.0, rel=1e-3)
    assert all(p.mean == pytest.approx(0.64) for p in result.curve(1.0, "break").points)
    assert any("moves the mean" in note for note in result.curve(1.0, "inject").notes)
    assert any("L is 0" in note for note in beyond.notes)


def test_an_integrator_is_measured_in_closed_loop() -> None:
    with unity({"i": 1 / S, "a": "fmu:FirstOrderLag", "b": "fmu:FirstOrderLag"}, 1.5, start_values={"b.tau": 0.5}) as m:
        result = loop(m, "a.u", 1.0, workers=HERE, ratio=1.5)
    assert "would run away" in result.why
    curve = result.curve()
    assert curve.how == "inject"
    assert curve.margins.gain_margin == pytest.approx(2.0, rel=1e-3)
    assert curve.margins.phase_margin_deg == pytest.approx(result.margins.phase_margin_deg, abs=0.05)


def test_a_sampled_loop_is_measured_below_its_nyquist_frequency() -> None:
    law = control.ss(control.tf([2.4, -2.0], [1.0, -0.5], 0.1))
    with unity({"c": law, "p": control.ss(1 / (S * (S + 1)))}, 1.0) as model:
        result = loop(model, "c.y", 1.0, [0.05, 0.1, 0.2, 0.5], how="inject", refine=0, workers=HERE)
    assert result.linear is not None
    assert result.curve().value == pytest.approx(result.linear.response(np.array([0.05, 0.1, 0.2, 0.5])), rel=1e-2)
    assert any("the loop is sampled" in note for note in result.notes)


def test_worker_processes_measure_as_this_one() -> None:
    values = []
    for workers in (HERE, Workers(jobs=2)):
        with unity(LAGS, 4.0, tolerance=1e-8) as model:
            values.append(loop(model, "c.y", 1.0, [0.2, 0.3], refine=0, workers=workers).curve().value)
    assert np.array_equal(values[0], values[1])


def test_points_that_fail_are_told() -> None:
    """Injected into an unstable loop nothing repeats."""
    with unity({"p": 1 / (S + 1) ** 3}, 20.0) as model:
        curve = loop(model, "p.y", 1.0, [0.2, 0.3], how="inject", workers=HERE).curve()
    assert len(curve.failed) == 2
    told = "points failed, the first at 0.2 Hz: loop.passed grows from period to period"
    assert any(told in note for note in curve.notes)
    assert math.isnan(curve.margins.gain_margin)
    assert curve.to_dict()["points"][0]["gain"] is None


def test_a_python_function_in_the_loop() -> None:
    with connect(
        {"p": 1 / (S + 1) ** 3, "k": -4.0, "f": np.tanh},
        [("p.y", "k.u"), ("k.y", "f.u"), ("f.y", "p.u")],
        outputs=["p.y"],
        tolerance=1e-8,
    ) as model:
        result = loop(model, "k.y", [0.01], [0.2, 0.25, 0.3], how="break")
    assert result.margins.gain_margin == pytest.approx(2.0, rel=1e-5)
    assert result.curve().margins.gain_margin == pytest.approx(2.0, rel=1e-3)


def test_margins_of_a_curve_are_those_of_its_transfer_function() -> None:
    loop_transfer = transfer(200 * (S + 1) ** 2 / S**3 / (S + 50) * 50)
    exact = margins_of(loop_transfer)
    f = np.geomspace(0.01, 100.0, 120)
    m = Response(f, loop_transfer.response(f)).margins()
    assert m.verdict == "not judged"
    assert m.gain_reduction == pytest.approx(exact.gain_reduction, rel=1e-3)
    assert m.phase_margin_deg == pytest.approx(exact.phase_margin_deg, abs=0.05)
    assert m.delay_margin_s == pytest.approx(exact.delay_margin_s, rel=2e-3)
    assert m.peak_sensitivity == pytest.approx(exact.peak_sensitivity, rel=2e-3)
    assert math.isnan(m.gain_margin)  # not seen is not infinite


def test_margins_are_unknown_where_the_verdict_is(saturated: LoopResult) -> None:
    """In numbers, record, page and requirements, as of a linear loop of which is not known whether it is stable."""
    curve = saturated.curve(2.0, "break")
    m = curve_margins(
        curve.frequency_hz, curve.value, linear=saturated.margins, stability=saturated.linear.stability,  # type: ignore[union-attr]
        doubt="their errors may reach -1",
    )  # fmt: skip
    assert m.verdict == "unknown"
    told = replace(saturated, curves=(replace(curve, margins=m),)).to_dict()
    record = told["measured"][0]["margins"]
    assert all(record[name] is None for name in (*m.derived(), "disk_margin", "peak_sensitivity"))
    shown = {row[0] for table in margin_tables(m) for row in table.rows}
    assert shown == {"gain crossover", "phase crossover"}
    assert "margin" not in margin_verdict("break", m).text
    for kind in ("gain margin", "phase margin", "delay margin", "disk margin", "peak sensitivity"):
        asked = {"name": "r", "analysis": "a", "kind": kind, "source": "measured", "max": 1e9}
        with pytest.raises(NotMeasured, match="is not known"):
            read_requirement(asked, "here").find([told])
    value = {"name": "r", "analysis": "a", "kind": "value", "path": "measured[0].margins.gain_margin_db", "max": 1e9}
    with pytest.raises(NotMeasured, match="there is no value"):
        read_requirement(value, "here").find([told])


@pytest.mark.parametrize("doubt", ["", "their errors may reach -1"])
def test_a_curve_of_which_nothing_is_known_has_crossovers_and_no_margins(doubt: str) -> None:
    loop_transfer = transfer(4.0 / (S + 1) ** 3)
    f = np.geomspace(0.01, 10.0, 60)
    m = curve_margins(f, loop_transfer.response(f), linear=None, stability=None, doubt=doubt)
    assert m.verdict == "unknown"
    assert m.phase_crossovers[0].factor == pytest.approx(2.0, rel=1e-3)
    assert np.isnan([m.gain_margin_db, m.phase_margin_deg, m.delay_margin_s, m.peak_sensitivity]).all()
    assert m.disk is None
    assert "margin" not in str(m)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"amplitudes": 1.0, "how": "brake"}, "how 'brake' is unknown; did you mean break"),
        ({"amplitudes": -1.0}, "amplitude"),
        ({"band": (0.1, 1.0)}, "band: is for measuring"),
        ({"amplitudes": 1.0, "refine": 99}, "refine: 99 is too large; it must be below 11"),
        ({"amplitudes": 1.0, "max_periods": 1}, "max_periods: 1 is too small; take at least 2"),
        ({"method": "exat"}, "method 'exat' is unknown"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, object], said: str) -> None:
    with unity(LAGS, 4.0) as model, pytest.raises(InputError) as caught:
        loop(model, "c.y", **options)  # type: ignore[arg-type]
    assert said in str(caught.value)


def test_what_was_measured_before_an_end_is_kept() -> None:
    stops: list[int] = []
    with unity(LAGS, 4.0) as model:
        result = loop(
            model, "c.y", 1.0, band=(0.1, 1.0), workers=HERE,
            progress=lambda _, done, __: stops.append(done), stopped=lambda: len(stops) >= 4,
        )  # fmt: skip
    assert [len(c.points) for c in result.curves] == [4]
    assert any("interrupted" in note for note in result.curve().notes)
    assert result.margins.gain_margin == pytest.approx(2.0)


def test_only_a_sampled_loop_is_told_to_be_sampled(saturated: LoopResult) -> None:
    assert not any("the loop is sampled" in note for note in saturated.notes)


@pytest.mark.parametrize("back", [-0.9985, -0.7, 4.0, 700.0])
def test_the_injected_amplitude_is_sought_where_a_linear_loop_has_it(back: float) -> None:
    """Injected is z + L z where z is passed on."""
    part = LinearPart.from_lin(Linear.from_state_space(control.ss([], [], [], [[back]])))
    assert first_guess(part, 0.3) == pytest.approx(abs(1.0 + back), rel=1e-9)
