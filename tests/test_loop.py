"""Loop analysis: margins against closed forms and python-control, places, refusals."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import tf2ss

import workbench as wb
from tests.loop_models import S, transfer, unity
from workbench.core.values.linear import LinearPart
from workbench.core.values.margins import Margins
from workbench.errors import InputError
from workbench.loops.loop.margins import margins_of, peak
from workbench.loops.loop.request import loop
from workbench.loops.loop.stability import stability_of
from workbench.loops.nyquist.level_crossings import gain_crossings, real_crossings
from workbench.point.trim.request import trim
from workbench.system.connect import connect
from workbench.system.description import SumComponent

LAGS = {"a": "fmu:FirstOrderLag", "b": "fmu:FirstOrderLag@3", "c": "fmu:FirstOrderLag"}
TWO_PI = 2.0 * math.pi


# -- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize("parts", [LAGS, {"p": 1 / (S + 1) ** 3}], ids=["fmus", "linear"])
def test_three_lags(parts: dict[str, object]) -> None:
    """K/(s+1)³: phase −180° at ω = √3, where |L| = K/8; |L| = 1 at ω = √(K^⅔ − 1)."""
    gain = 4.0
    with unity(parts, gain) as model:
        m = loop(model, "out").margins
    omega = math.sqrt(gain ** (2.0 / 3.0) - 1.0)
    phase = 180.0 - 3.0 * math.degrees(math.atan(omega))
    assert m.verdict == "stable"
    assert m.gain_margin == pytest.approx(8.0 / gain, rel=1e-9)
    assert m.phase_crossover_hz == pytest.approx(math.sqrt(3.0) / TWO_PI, rel=1e-9)
    assert m.gain_crossover_hz == pytest.approx(omega / TWO_PI, rel=1e-9)
    assert m.phase_margin_deg == pytest.approx(phase, rel=1e-9)
    assert m.delay_margin_s == pytest.approx(math.radians(phase) / omega, rel=1e-9)
    assert m.gain_reduction == 0.0
    near = f"gain 6.02 dB at {math.sqrt(3.0) / TWO_PI:.3g} Hz, phase {phase:.3g} deg at {omega / TWO_PI:.3g} Hz"
    assert str(m).startswith(f"margins: {near}, delay {math.radians(phase) / omega:.3g} s; the closed loop is stable")


def test_integrator_and_two_lags_of_fmus() -> None:
    """K/(s(s+1)(s+2)): phase −180° at ω = √2, where |L| = K/6."""
    parts = {"i": 1 / S, "a": "fmu:FirstOrderLag", "b": "fmu:FirstOrderLag"}
    with unity(parts, 1.5, start_values={"b.tau": 0.5}) as model:
        m = loop(model, "i.y").margins
    assert m.gain_margin == pytest.approx(2.0, rel=1e-9)
    assert m.phase_crossover_hz == pytest.approx(math.sqrt(2.0) / TWO_PI, rel=1e-9)
    _like_python_control(m, 3.0 / (S * (S + 1) * (S + 2)))


def test_the_delay_margin_of_several_crossovers_is_the_least_delay_not_that_of_the_phase_margin() -> None:
    """L = 1/s + 8s/(s² + 2s + 400) has |L| = 1 three times: the least delay at the resonance, the least lag not.

    Truth: |L|² = 1 as a polynomial in ω², the lag to the border there over ω; and the closed loop with the delay as a
    Padé approximation of order 8 is stable just below the margin and not just above.
    """
    function = 1 / S + 8 * S / (S**2 + 2 * S + 400)
    with unity({"p": function}, 1.0) as model:
        m = loop(model, "p.y").margins
    # N = 9s² + 2s + 400, D = s³ + 2s² + 400s: |N|² − |D|² with x = ω²
    even, odd = np.poly1d([-9.0, 400.0]), 2.0
    difference = even**2 + np.poly1d([odd**2, 0.0]) - np.poly1d([-2.0, 0.0]) ** 2 - _odd(np.poly1d([-1.0, 400.0]))
    omega = np.sqrt(np.sort(difference.roots.real))
    assert np.abs(difference.roots.imag).max() == 0.0
    lag = np.degrees(np.angle(function(1j * omega))) % 360.0 - 180.0
    lag = np.where(lag < 0.0, lag + 360.0, lag)
    delay = np.radians(lag) / omega
    assert len(m.gain_crossovers) == 3
    assert [c.frequency_hz * TWO_PI for c in m.gain_crossovers] == pytest.approx(omega, rel=1e-9)
    assert [c.delay_s for c in m.gain_crossovers] == pytest.approx(delay, rel=1e-7)
    assert [c.phase_margin_deg for c in m.gain_crossovers] == pytest.approx(
        np.where(lag > 180.0, lag - 360.0, lag), rel=1e-7
    )
    assert m.delay_margin_s == pytest.approx(delay.min(), rel=1e-7)
    assert m.phase_margin_deg == pytest.approx(lag.min(), rel=1e-7)
    assert delay.argmin() != lag.argmin()
    for factor, stable in ((0.99, True), (1.01, False)):
        delayed = function * control.tf(*control.pade(factor * m.delay_margin_s, 8))
        assert bool(np.all(control.feedback(delayed, 1).poles().real < 0.0)) is stable


def _odd(part: np.poly1d) -> np.poly1d:
    """Return x·part(x)², the square of an imaginary part ω·part(ω²)."""
    return np.poly1d([1.0, 0.0]) * part**2


def test_the_disk_margin_of_an_integrator_with_a_lag_has_a_closed_form() -> None:
    """L = K/(s(s+1)): S − T = (s² + s − K)/(s² + s + K); |S − T|² = 1 + 4Kω²/((K − ω²)² + ω²), largest at ω² = K."""
    gain = 5.0
    m = margins_of(transfer(gain / (S * (S + 1))))
    alpha = 2.0 / math.sqrt(1.0 + 4.0 * gain)
    assert m.disk is not None
    assert m.disk.alpha == pytest.approx(alpha, rel=1e-9)
    assert m.disk.low == pytest.approx((2.0 - alpha) / (2.0 + alpha), rel=1e-9)
    assert m.disk.high * m.disk.low == pytest.approx(1.0)
    assert m.disk.phase_deg == pytest.approx(2.0 * math.degrees(math.atan(alpha / 2.0)), rel=1e-9)
    assert m.disk.frequency_hz == pytest.approx(math.sqrt(gain) / TWO_PI, rel=1e-4)
    assert m.gain_margin == math.inf


def test_the_peak_of_a_resonance_is_exact() -> None:
    zeta = 1e-4
    value, where = peak(transfer(1 / (S**2 + 2.0 * zeta * S + 1.0)))
    assert value == pytest.approx(1.0 / (2.0 * zeta * math.sqrt(1.0 - zeta**2)), rel=1e-8)
    assert where == pytest.approx(math.sqrt(1.0 - 2.0 * zeta**2) / TWO_PI, rel=1e-6)


def test_a_conditionally_stable_loop_has_margins_both_ways() -> None:
    """K(s+1)²/s³: phase −180° at ω = 1, where |L| = 2K: the gain may fall to 1/(2K)."""
    m = margins_of(transfer(2.0 * (S + 1) ** 2 / S**3))
    assert (m.verdict, m.gain_margin) == ("stable", math.inf)
    assert m.gain_reduction == pytest.approx(0.25, rel=1e-9)
    assert m.gain_reduction_db == pytest.approx(-12.0412, abs=1e-4)


def test_a_positive_feedback_of_half_bears_a_gain_of_two_at_rest() -> None:
    with unity({"p": 1 / (S + 1)}, 0.5, signs=(1.0, 1.0)) as model:
        m = loop(model, "p.y").margins
    assert m.gain_margin == pytest.approx(2.0)
    assert m.phase_crossover_hz == 0.0
    assert m.phase_margin_deg == math.inf


def test_a_crossover_between_two_near_resonances_is_not_overlooked() -> None:
    """Peaks a few parts in 10⁵ wide: no grid would see their four gain crossovers."""
    f = transfer(1e-5 / (S**2 + 2e-6 * S + 1.0) + 1e-5 / (S**2 + 2e-6 * S + 4.0))
    found = gain_crossings(f)
    assert len(found) == 4
    assert all(abs(f.at(x)) == pytest.approx(1.0, abs=1e-6) for x in found)


# Lightly damped zeros below a large direct part, where |L| falls below 1 in a small stretch, numerator and denominator.
DIPS = {
    "one pair of zeros": (
        [19.80670622235799, 0.19176126135225874, 34.105707648953775],
        [0.00012513628933611087, 0.019538021875448112, 1.0],
    ),
    "direct part 20": (
        [20.5298749097, 1635.68725463, 195506.517435, 13882458.9944, 149619316.648, 424998515.222],
        [1.0, 84.0369455885, 1261.00597326, 5457.23040123, 2949.06743355, 1322.97886574],
    ),
    "direct part 34": (
        [34.0332165715, 107.234626148, 373296.318, 12641.2707014, 768755.652715],
        [1.0, 68.990099101, 1320.2819068, 26567.9879805, 352974.699124],
    ),
    "direct part 3434": (
        [3434.380700389654, 4267.51134636724, 206583.3184431255, 19462.570648602938, 112637.8065275716],
        [1.0, 72.26948661813677, 926.5494272549872, 6452.31227822739, 44563.26739033355],
    ),
    "far below": (
        [1.83909060059, 8.88524518679, 540.42673306, 1303.75926425, 29664.3358645, 40747.2982879],
        [1.0, 218.5257733, 13014.1276943, 209099.796661, 9654689.35936, 0.0],
    ),
}


@pytest.mark.parametrize("name", DIPS)
def test_no_crossover_at_a_dip_below_a_large_direct_part_is_overlooked(name: str) -> None:
    """Truth: changes of sign of |L| - 1 on a grid that is dense around each pole and zero of the polynomials."""
    num, den = DIPS[name]
    places = np.abs(np.concatenate([np.roots(num), np.roots(den)])) / TWO_PI
    near = (places[places > 0.0, None] * (1.0 + np.linspace(-0.1, 0.1, 4001))).ravel()
    f = np.unique(np.concatenate([np.geomspace(1e-5, 1e5, 200_001), near]))
    gain = np.log(np.abs(np.polyval(num, 1j * TWO_PI * f) / np.polyval(den, 1j * TWO_PI * f)))
    truth = f[:-1][np.diff(np.sign(gain)) != 0]
    loop_transfer = LinearPart(*tf2ss(num, den))
    assert len(truth) >= 2
    assert gain_crossings(loop_transfer) == pytest.approx(truth.tolist(), rel=2e-4)  # the grid's step
    value = np.polyval(num, 1j * TWO_PI * f) / np.polyval(den, 1j * TWO_PI * f)
    m = margins_of(loop_transfer)
    assert m.disk is not None
    assert m.disk.alpha == pytest.approx(2.0 / np.abs((1.0 - value) / (1.0 + value)).max(), rel=1e-5)


def test_the_crossover_of_a_companion_form_with_coefficients_of_all_sizes() -> None:
    num = [50738.025904966205, 606177.2482486382, 1685510805.3655336, 11053748322.76831, 8050263843.905396]
    den = [1.0, 22.156452093177933, 80538.14975661343, 1056246.174178162, 1618843095.0342557, 7323682936.168152]

    def gain(f: float) -> float:
        s = 1j * TWO_PI * f
        return math.log(abs(np.polyval(num, s) / np.polyval(den, s)))

    assert gain_crossings(LinearPart(*tf2ss(num, den))) == pytest.approx([brentq(gain, 7000.0, 9000.0)], rel=1e-9)


@pytest.mark.parametrize(("direct", "margin"), [(2.0, 0.0), (1.0, 0.0), (-1.5, math.nan), (0.5, None)])
def test_no_delay_is_tolerated_where_the_direct_part_is_not_below_one(direct: float, margin: float | None) -> None:
    """1 + D e^(−sT) has the zeros s = (ln |D| + jπ(2k + 1))/T: on the right, or on the axis, however small T is."""
    with unity({"p": (direct * S + 3.0) / (S + 1.0)}, 1.0) as model:
        result = loop(model, "p.y")
    m = result.margins
    if margin is None:  # |L| = 1 where 9 + ω²/4 = 1 + ω²
        omega = math.sqrt(32.0 / 3.0)
        lag = math.pi + np.angle((0.5j * omega + 3.0) / (1.0 + 1j * omega))
        assert m.delay_margin_s == pytest.approx(lag / omega, rel=1e-9)
    else:
        assert m.delay_margin_s == pytest.approx(margin, nan_ok=True)
    assert any("any delay" in note for note in result.notes) == (abs(direct) >= 1.0)


# -- python-control -------------------------------------------------------------------------------

LOOPS = {
    "third order": 4 / (S + 1) ** 3,
    "integrator": 3 / (S * (S + 1) * (S + 2)),
    "conditional": 200 * (S + 1) ** 2 / S**3 / (S + 50) * 50,
    "resonance": 0.2 * (S + 3) / ((S + 1) * (S**2 + 0.1 * S + 4)),
    "zero on the right": 0.8 * (2 - S) / ((S + 1) * (S + 2)),
    "unstable plant": 6 * (S + 1) / ((S - 1) * (S + 4)),
}


def _like_python_control(m: Margins, system: control.lti.LTI) -> None:
    gains, phases, _, at_gains, at_phases, _ = control.stability_margins(system, returnall=True, method="poly")
    up, mine = [g for g in gains if g > 1.0], [c for c in m.phase_crossovers if c.factor > 1.0]
    if up:
        assert m.gain_margin == pytest.approx(min(up), rel=1e-6)
        assert min(mine, key=lambda c: c.factor).frequency_hz == pytest.approx(
            at_gains[list(gains).index(min(up))] / TWO_PI, rel=1e-6, abs=1e-9
        )
    if len(phases):
        k = int(np.argmin(np.abs(phases)))
        assert m.phase_margin_deg == pytest.approx(phases[k], rel=1e-6)
        assert m.gain_crossover_hz == pytest.approx(at_phases[k] / TWO_PI, rel=1e-6)
    highest = math.pi / system.dt * (1.0 - 1e-9) if system.dt else 1e3
    omega = np.sort(np.append(np.geomspace(1e-3, highest, 2001), TWO_PI * (m.disk.frequency_hz if m.disk else 1.0)))
    disk, gain_db, phase = control.disk_margins(control.ss(system), omega[omega <= highest])
    assert m.disk is not None
    assert m.disk.alpha == pytest.approx(disk, rel=1e-5)
    assert 20.0 * math.log10(m.disk.high) == pytest.approx(gain_db, rel=1e-4)
    assert m.disk.phase_deg == pytest.approx(phase, rel=1e-5)


@pytest.mark.parametrize("name", LOOPS)
def test_margins_are_those_of_python_control(name: str) -> None:
    m = margins_of(transfer(LOOPS[name]))
    assert m.verdict == "stable"
    _like_python_control(m, LOOPS[name])


def test_sensitivities_go_to_python_control() -> None:
    with unity(LAGS, 4.0) as model:
        result = loop(model, "c.y")
    s, t = 1.3j, 4.0 / (1.0 + 1.3j) ** 3
    assert result.loop(s) == pytest.approx(t)
    assert result.sensitivity(s) == pytest.approx(1.0 / (1.0 + t))
    assert result.complementary(s) == pytest.approx(t / (1.0 + t))


# -- places ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", ["out", "c.y", "c.y -> e.u2", "c.y → e.u2", ("a.y", "b.u"), "k.u", "e.y"])
def test_one_loop_is_the_same_wherever_it_is_opened(at: str | tuple[str, str]) -> None:
    with unity(LAGS, 4.0) as model:
        assert loop(model, at).margins.gain_margin == pytest.approx(2.0, rel=1e-9)


def test_all_connections_of_a_source_or_one_of_two() -> None:
    """y feeds back at once (gain 1) and through a lag (gain 2); opened at one, the other stays closed."""
    with connect(
        {"p": 1 / (S + 1), "f": 2 / (S + 3), "g": -1.0, "e": _sum()},
        [("p.y", "g.u"), ("p.y", "f.u"), ("g.y", "e.u1"), ("f.y", "e.u2"), ("e.y", "p.u")],
        outputs={"y": "p.y"},
    ) as model:
        both, one = loop(model, "p.y"), loop(model, "p.y -> f.u")
    s = 0.7j
    assert both.place.destinations == ("g.u", "f.u")
    assert both.loop(s) == pytest.approx((1.0 + 2.0 / (s + 3.0)) / (s + 1.0))
    assert one.loop(s) == pytest.approx(2.0 / (s + 3.0) / (s + 2.0))


def _sum() -> object:
    return SumComponent(name="e", signs=(1.0, -1.0))


def test_gains_offsets_and_units_stay_behind_the_place() -> None:
    with connect(
        {"p": 1 / (S + 1) ** 3, "f": 1.0},
        [("p.y", "f.u", {"gain": 2.0, "offset": 0.5}), ("f.y", "p.u", {"gain": -2.0})],
        outputs=["p.y"],
    ) as model:
        point = trim(model).operating_point
        result = loop(model, "p.y", at=point)
    assert result.value == pytest.approx(-0.2)  # y = −4 y − 1
    assert result.margins.gain_margin == pytest.approx(2.0)
    assert result.notes == ()


def test_a_connection_that_closes_later_is_measured_as_closed() -> None:
    with connect(
        {"p": 1 / (S + 1) ** 3, "f": -4.0},
        [("p.y", "f.u"), ("f.y", "p.u", {"closes_at": 140.0})],
        outputs=["p.y"],
    ) as model:
        result = loop(model, "f.y")
    assert result.margins.gain_margin == pytest.approx(2.0)
    assert result.notes == ("f.y → p.u closes at 140 s and is measured as if it were closed (time 0 s)",)


# -- stability ------------------------------------------------------------------------------------


def test_margins_of_an_unstable_loop_mean_nothing() -> None:
    with unity(LAGS, 20.0) as model:
        m = loop(model, "c.y").margins
    assert m.verdict == "unstable"
    assert "margins are then meaningless" in m.words
    assert math.isnan(m.gain_margin)
    assert math.isnan(m.phase_margin_deg)
    assert math.isnan(m.delay_margin_s)
    assert m.disk is None
    assert m.phase_crossovers[0].factor == pytest.approx(0.4)
    assert m.to_dict()["gain_margin"] is None


def test_a_loop_at_the_border_is_told() -> None:
    m = margins_of(transfer(8 / (S + 1) ** 3))
    assert m.verdict == "at the border"
    assert not m.meaningful


def test_an_unstable_part_outside_the_loop_is_named() -> None:
    with connect(
        {"p": 1 / (S + 1), "f": -2.0, "x": 1 / (S - 0.3)},
        [("p.y", "f.u"), ("f.y", "p.u"), ("p.y", "x.u")],
        outputs=["p.y"],
    ) as model:
        words = loop(model, "f.y").margins.words
    assert "pole 0.3 1/s" in words
    assert "this loop does not affect it" in words


def test_a_loop_without_a_solution_is_refused() -> None:
    with (
        unity({"p": (S + 3) / (S + 1)}, -1.0, signs=(1.0, -1.0)) as model,
        pytest.raises(InputError, match="has no solution"),
    ):
        loop(model, "k.y")


# -- sampled loops --------------------------------------------------------------------------------


def test_a_sampled_loop_is_that_of_the_z_domain() -> None:
    """Law k(z − b)/(z − c) before a held 1/(s(s+1)): L(z) from the plant's step-invariant transform, by hand."""
    period, gain, b, c = 0.1, 2.4, 0.8, 0.5
    law = control.ss(control.tf([1.0, -b], [1.0, -c], period))
    with unity({"c": law, "p": control.ss(1 / (S * (S + 1)))}, gain) as model:
        results = {at: loop(model, at) for at in ("c.y", "p.y")}
    e = math.exp(-period)
    z = np.exp(1j * TWO_PI * np.array([0.05, 0.3, 1.0, 3.0, 4.9]) * period)
    held = ((period - 1.0 + e) * z + (1.0 - e - period * e)) / ((z - 1.0) * (z - e))
    truth = gain * (z - b) / (z - c) * held
    exact = gain * control.series(law, control.c2d(control.ss(1 / (S * (S + 1))), period))
    for result in results.values():
        assert result.linear is not None
        assert result.linear.transfer.dt == pytest.approx(period)
        assert result.linear.response(np.array([0.05, 0.3, 1.0, 3.0, 4.9])) == pytest.approx(truth, rel=1e-5)
        assert result.margins.verdict == "stable"
        _like_python_control(result.margins, control.ss(exact))


def test_a_continuous_place_beside_a_sampler_is_told() -> None:
    """The inner loop is continuous: held over a period it is another one."""
    sampler = control.ss(control.tf([0.5], [1.0, -0.5], 0.1))
    with connect(
        {"p": 1 / (S + 1), "f": -2.0, "d": sampler, "e": _sum()},
        [("p.y", "f.u"), ("f.y", "e.u1"), ("p.y", "d.u"), ("d.y", "e.u2"), ("e.y", "p.u")],
        outputs=["p.y"],
    ) as model:
        notes = loop(model, "f.y").notes
        sampled = loop(model, "d.y").notes
    assert any("open the loop at a sampled signal" in note for note in notes)
    assert not any("open the loop at a sampled signal" in note for note in sampled)


def test_crossings_of_a_sampled_system_lie_below_its_nyquist_frequency() -> None:
    f = transfer(control.tf([0.2], [1.0, -1.2, 0.5], 0.5))
    found = [*gain_crossings(f), *real_crossings(f)]
    assert found
    assert all(0.0 < x < 1.0 for x in found)


# -- refusals, the method -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("at", "said"),
    [
        ("k.z", "open: no connection leaves 'k.z'; did you mean k.y?"),
        ("c.y -> e.u1", "open: there is no connection c.y -> e.u1; did you mean"),
        ("r", "open: no connection leaves 'r'; known: a.y, b.y, c.y, e.y, k.y"),
    ],
)
def test_an_unknown_place_is_refused(at: str, said: str) -> None:
    with unity(LAGS, 4.0) as model, pytest.raises(InputError) as caught:
        loop(model, at)
    assert str(caught.value).startswith(said)


def test_a_connection_in_no_loop_is_refused() -> None:
    with (
        connect({"a": LAGS["a"], "b": LAGS["b"]}, [("a.y", "b.u")], ["a.u"], ["b.y"]) as model,
        pytest.raises(
            InputError, match=r"open: a\.y → b\.u is not in a loop: it leads to b, and nothing leads back to a"
        ),
    ):
        loop(model, "a.y")


def test_one_model_is_refused() -> None:
    with wb.load("fmu:FirstOrderLag") as model, pytest.raises(InputError, match="is a single model"):
        loop(model, "y")


def test_co_simulation_parts_are_refused() -> None:
    with (
        wb.load("fmu:FirstOrderLag", interface="cs") as part,
        connect({"a": part, "k": -1.0}, [("a.y", "k.u"), ("k.y", "a.u")], outputs=["a.y"]) as model,
        pytest.raises(InputError, match="co-simulation parts"),
    ):
        loop(model, "a.y")


def test_the_band_that_shows_a_loop_goes_round_its_poles_and_crossovers_but_not_to_an_almost_integrator() -> None:
    """1/((s + 1)(s + 1e-9)): poles at 1 and, closed, at 1 rad/s; |L| = 1 where ω²(1 + ω²) = 1; 1e-9 rad/s is rest."""
    with unity({"p": 1 / (S + 1), "i": 1 / (S + 1e-9)}, 1.0) as model:
        linear = loop(model, "out").linear
    assert linear is not None
    crossover = math.sqrt((math.sqrt(5.0) - 1.0) / 2.0)
    shown = TWO_PI * linear.frequencies(9)
    assert (shown[0], shown[-1]) == (pytest.approx(crossover / 10.0, rel=1e-6), pytest.approx(10.0, rel=1e-6))


def test_a_sampled_loop_is_shown_up_to_just_below_its_nyquist_frequency() -> None:
    """Its pole 0.1 is one of 2.3 per period, and ten times that is beyond half a turn per period."""
    with unity({"d": control.ss(control.tf([0.5], [1.0, -0.1], 0.2))}, 1.0) as model:
        result = loop(model, "d.y")
    assert result.linear is not None
    last = result.linear.frequencies()[-1]
    assert last < 2.5
    assert last == pytest.approx(2.5, rel=1e-5)
    assert not any("what is measured" in note for note in result.notes)


def test_a_gain_crossing_just_below_the_nyquist_frequency_is_found() -> None:
    """k/(z − 0.5): |z − 0.5|² = 1.25 − cos θ is k² at one θ only."""
    theta = 0.995 * math.pi
    one, k = np.eye(1), math.sqrt(1.25 - math.cos(theta))
    part = LinearPart(0.5 * one, one, k * one, 0.0 * one, dt=0.1)
    assert gain_crossings(part) == pytest.approx([theta / (TWO_PI * 0.1)], rel=1e-9)


def test_a_verdict_does_not_depend_on_the_units_of_the_states() -> None:
    """A slow mode beside pressures in pascals: the norm of A in raw units says nothing of what rounding may do."""
    A = np.array([[-200.0, 5.0, 0.0], [0.01, -0.01, 0.0], [3.0, 1.0, -30.0]])
    b, c, d = np.array([[0.0], [0.005], [1.0]]), np.array([[1.0, 1.0, 1.0]]), np.zeros((1, 1))
    unit = np.array([1.0, 1e14, 1e-5])
    for scale in (np.ones(3), unit):
        part = LinearPart(A * scale[:, None] / scale, b * scale[:, None], c / scale, d)
        assert stability_of(part).verdict == "stable"
