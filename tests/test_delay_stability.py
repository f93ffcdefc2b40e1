"""Poles of systems with transport delays: counted exactly, against closed forms, and what is said of them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.special import lambertw

import workbench as wb
from workbench.cli.app import run
from workbench.loops.loop.result import LoopResult
from workbench.point.lin.delay_roots import count_right_of, delay_roots
from workbench.point.lin.page import lin_page
from workbench.point.lin.result import DelayFreePart
from workbench.show.terminal import text_of

LOOP = """
[components]
P = {{ numerator = {num}, denominator = {den} }}
d = {{ block = "delay", delay = {delay} }}
e = {{ sum = "+-" }}
[connections]
"e.u2" = "P.y"
"d.u" = "e.y"
"P.u" = "d.y"
[inputs]
r = "e.u1"
[outputs]
y = "P.y"
"""


def scalar(a: float, k: float, delay: float) -> DelayFreePart:
    """dx/dt = a x - k x(t - T)."""
    return DelayFreePart(np.array([[a]]), np.array([[-k]]), np.array([[1.0]]), np.zeros((1, 1)), np.array([delay]))


@pytest.mark.parametrize("turn", [0.1, 1.5, 1.6, 7.8, 7.9, 30.0, 300.0])
@pytest.mark.parametrize("delay", [1e-4, 1.0, 1e3])
def test_the_poles_of_a_delayed_integrator_are_counted(turn: float, delay: float) -> None:
    """s + k e^(−sT): a pair passes the axis at kT = π/2 + 2πm; all poles are branches of Lambert's W(−kT)/T."""
    part = scalar(0.0, turn / delay, delay)
    pairs = max(math.floor((turn - math.pi / 2.0) / (2.0 * math.pi)) + 1, 0)
    found = delay_roots(part, np.array([-1.0 / delay + 0j]))
    assert found.right.number == 2 * pairs
    assert found.roots[0] == pytest.approx(complex(lambertw(-turn, 0)) / delay, rel=1e-9)
    assert found.complete_to < found.roots[0].real
    assert count_right_of(part, found.complete_to).number == np.sum(found.roots.real > found.complete_to)


def test_an_unstable_plant_with_a_delay() -> None:
    """s − 1 + k e^(−sT): for T < 1 stable for k between 1 and the gain at ω T = atan ω."""
    counts = [count_right_of(scalar(1.0, k, 0.5)).number for k in (0.9, 1.1, 1.9, 2.6)]
    omega = 2.331122370414423  # tan(ω/2) = ω
    assert counts[:2] == [1, 0]
    assert counts[2:] == [0 if k < math.hypot(1.0, omega) else 2 for k in (1.9, 2.6)]


def test_a_pole_on_the_axis_is_said_to_be_there() -> None:
    found = delay_roots(scalar(0.0, math.pi / 2.0, 1.0), np.array([1.5j]))
    assert found.border
    assert "on the border" in found.right.why
    assert math.isnan(found.right.number)


def test_a_direct_part_in_a_delayed_loop_makes_a_chain_of_poles() -> None:
    """1 + D e^(−sT) = 0: all poles have the real part ln |D|/T."""

    def of(direct: float) -> DelayFreePart:
        return DelayFreePart(
            np.array([[-1.0]]), np.array([[1.0]]), np.array([[0.1]]), np.array([[-direct]]), np.array([0.2])
        )

    assert count_right_of(of(0.9)).number == 0
    assert count_right_of(of(1.1)).number == math.inf
    assert math.isnan(count_right_of(of(1.0)).number)


def test_two_delays_that_are_no_multiples_of_each_other() -> None:
    """Truth: the argument of s + e^(−s) + k e^(−s√2) on a dense grid, two turns for each pair."""
    for k in (0.1, 0.6, 2.0, 9.0):
        part = DelayFreePart(
            np.zeros((1, 1)), np.array([[-1.0, -k]]), np.ones((2, 1)), np.zeros((2, 2)), np.array([1.0, math.sqrt(2.0)])
        )
        s = 1j * np.linspace(0.0, 2000.0, 2_000_001)
        turned = np.unwrap(np.angle(s + np.exp(-s) + k * np.exp(-math.sqrt(2.0) * s)))
        assert count_right_of(part).number == round(0.5 - (turned[-1] - turned[0]) / math.pi)


# -- loops with a resonance beyond where the Padé approximation is good ------------------------------------------------


def resonant(seed: int) -> tuple[list[float], list[float], float]:
    rng = np.random.default_rng(seed)
    w, z, delay = 10 ** rng.uniform(1, 2), 10 ** rng.uniform(-2.5, -1), rng.uniform(0.03, 0.4)
    k, g = rng.uniform(0.3, 0.8) / delay * 0.8, rng.uniform(0.3, 2.5) * 2.0 * z * w
    own = [1.0, 2.0 * z * w, w * w]
    return np.polyadd(k * np.array(own), [g, 0.0, 0.0]).tolist(), np.polymul([1.0, 0.0], own).tolist(), delay


def opened(folder: Path, seed: int) -> LoopResult:
    num, den, delay = resonant(seed)
    path = folder / "loop.toml"
    path.write_text(LOOP.format(num=num, den=den, delay=delay), encoding="utf-8")
    with wb.load(path) as model:
        return wb.loop(model, "P.y", in_process=True)


@pytest.mark.parametrize("seed", [51, 52, 62, 69, 74, 53])  # of all but the last Padé of order 4 has another verdict
def test_a_resonance_behind_a_delay_has_the_stability_and_margins_of_the_delay(seed: int, tmp_path: Path) -> None:
    num, den, delay = resonant(seed)
    result = opened(tmp_path, seed)
    m, corner = result.margins, math.sqrt(den[2])
    beside = corner * np.linspace(0.8, 1.2, 40_001)
    omega = np.unique(np.concatenate([np.geomspace(1e-3, 1e4, 400_001), beside]))
    s = 1j * omega
    value = np.polyval(num, s) / np.polyval(den, s) * np.exp(-s * delay)
    turned = np.unwrap(np.angle((np.polyval(den, s) + np.polyval(num, s) * np.exp(-s * delay)) / (s + 1.0) ** 3))
    right = round(-(turned[-1] - turned[0]) / math.pi)
    assert m.verdict == ("unstable" if right else "stable")
    assert result.linear is not None
    assert result.linear.stability.unstable == right
    crossed = omega[:-1][np.diff(np.sign(np.abs(value) - 1.0)) != 0] / (2.0 * math.pi)
    assert [c.frequency_hz for c in m.gain_crossovers] == pytest.approx(crossed.tolist(), rel=1e-4)
    if right:
        return
    at = 2j * math.pi * np.array([c.frequency_hz for c in m.gain_crossovers])
    lags = np.angle(np.polyval(num, at) / np.polyval(den, at) * np.exp(-at * delay)) + math.pi
    assert m.delay_margin_s == pytest.approx((lags / np.abs(at)).min(), rel=1e-9)
    negative = (np.diff(np.sign(value.imag)) != 0) & (value[:-1].real < 0.0) & (np.abs(value[:-1]) < 1.0)
    assert m.gain_margin == pytest.approx(1.0 / np.abs(value[:-1][negative]).max(), rel=1e-3)
    assert m.peak_sensitivity == pytest.approx((1.0 / np.abs(1.0 + value)).max(), rel=1e-5)
    assert m.disk is not None
    assert m.disk.alpha == pytest.approx(2.0 / np.abs((1.0 - value) / (1.0 + value)).max(), rel=1e-5)


def test_requirements_on_poles_are_judged_with_the_delays_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of seed 52 the Padé approximation is stable; the loop has a pair on the right."""
    opened(tmp_path, 52)
    (tmp_path / "study.toml").write_text(
        'name = "s"\nmodels.m = "loop.toml"\n'
        'analyses.l = {command = "lin", model = "m", inputs = "r", outputs = "y"}\n'
        '[[requirements]]\nname = "stable"\nanalysis = "l"\nkind = "stability"\nmax = 0.0\n'
        '[[requirements]]\nname = "size"\nanalysis = "l"\nkind = "h-infinity norm"\nmax = 1e9\n',
        encoding="utf-8",
    )
    assert run(["run", str(tmp_path / "study.toml"), "--no-store"]) == 1
    said = capsys.readouterr().out
    assert "violated" in said
    assert "not that of the model" in said
    with wb.load(tmp_path / "loop.toml") as model:
        linear = wb.lin(model, in_process=True).result
    assert (linear.poles.real < 0.0).all()
    assert linear.to_dict()["delay_poles"][0][0] > 0.0


def test_nothing_is_proved_of_the_loops_of_a_family_with_delays(tmp_path: Path) -> None:
    opened(tmp_path, 53)
    with wb.load(tmp_path / "loop.toml") as model:
        several = wb.loop(model, ["P.y", "e.y"], in_process=True)
    assert several.disk_margins == ()
    assert any("common disk margins would be those of approximations" in n for n in several.notes)


ROBUST = """
[components]
P = { numerator = [1.0], denominator = [1.0, 0.0] }
d = { block = "delay", delay = 1.0 }
k = { gain = 1.0 }
e = { sum = "+-" }
[connections]
"e.u2" = "P.y"
"k.u" = "e.y"
"d.u" = "k.y"
"P.u" = "d.y"
[inputs]
r = "e.u1"
[outputs]
y = "P.y"
"""


def test_a_family_with_delays_is_not_said_to_be_stable(tmp_path: Path) -> None:
    path = tmp_path / "family.toml"
    path.write_text(ROBUST, encoding="utf-8")
    with wb.load(path) as model:
        found = wb.robust(model, uncertain={"k.gain": (0.5, 1.0)}, in_process=True)
        assert found.stability.verdict == "unknown"
        with pytest.raises(wb.InputError, match="stable in the middle"):
            wb.robust(model, uncertain={"k.gain": (1.5, 2.5)}, in_process=True)


def test_the_gains_of_a_feedback_are_counted_with_the_delay(tmp_path: Path) -> None:
    """1/s behind a delay of 1 s, fed back by -g: stable for 0 < g < π/2."""
    path = tmp_path / "plant.toml"
    path.write_text(
        '[components]\nP = { numerator = [1.0], denominator = [1.0, 0.0] }\nd = { block = "delay", delay = 1.0 }\n'
        '[connections]\n"P.u" = "d.y"\n[inputs]\nu = "d.u"\n[outputs]\ny = "P.y"\n',
        encoding="utf-8",
    )
    with wb.load(path) as model:
        found = wb.feedback(model, source="y", target="u", in_process=True)
    (pair,) = found.stable_gains
    assert pair == pytest.approx((-math.pi / 2.0, 0.0), rel=1e-5, abs=1e-9)


def test_an_interval_of_gains_ends_where_that_of_the_delay_does(tmp_path: Path) -> None:
    """1/s behind a delay of 1 s that is approximated by order 1."""
    path = tmp_path / "plant.toml"
    path.write_text(
        "[components]\nP = { numerator = [1.0], denominator = [1.0, 0.0] }\n"
        'd = { block = "delay", delay = 1.0, pade = 1 }\n'
        '[connections]\n"P.u" = "d.y"\n[inputs]\nu = "d.u"\n[outputs]\ny = "P.y"\n',
        encoding="utf-8",
    )
    with wb.load(path) as model:
        found = wb.feedback(model, source="y", target="u", in_process=True)
    (pair,) = found.stable_gains  # the approximation is stable down to -2
    assert pair == pytest.approx((-math.pi / 2.0, 0.0), rel=1e-5, abs=1e-9)


def test_no_interval_of_gains_is_stable_that_only_the_approximation_makes_so(tmp_path: Path) -> None:
    """Of the loop of seed 52 the approximation is stable, the loop is not: the gain -1 is in no stable interval."""
    num, den, delay = resonant(52)
    path = tmp_path / "plant.toml"
    path.write_text(
        f'[components]\nP = {{ numerator = {num}, denominator = {den} }}\nd = {{ block = "delay", delay = {delay} }}\n'
        '[connections]\n"P.u" = "d.y"\n[inputs]\nu = "d.u"\n[outputs]\ny = "P.y"\n',
        encoding="utf-8",
    )
    with wb.load(path) as model:
        found = wb.feedback(model, source="y", target="u", in_process=True)
    assert not any(low <= -1.0 <= high for low, high in found.stable_gains)


def test_points_that_have_not_settled_do_not_tell_that_a_loop_is_stable(tmp_path: Path) -> None:
    """A mode of 0.15 1/s takes longer than 20 periods: the averages of an unstable loop lie on the safe side of -1."""
    system = tmp_path / "light.toml"
    system.write_text(
        'components.p = {block = "transfer_function", numerator = [30.0], denominator = [1.0, 0.3, 900.0]}\n'
        'components.d = {block = "delay", delay = 2.0}\ncomponents.e = {sum = "+-"}\n'
        'connections = {"e.u2" = "p.y", "d.u" = "e.y", "p.u" = "d.y"}\ninputs.r = "e.u1"\noutputs.y = "p.y"\n'
    )
    with wb.load(system) as model:
        found = wb.loop(model, "p.y", amplitudes=[0.1], band=(4.6, 4.9), ratio=1.03, in_process=True)
    (curve,) = found.curves
    assert found.linear is not None
    assert found.linear.stability.verdict == "unstable"
    assert {p.status for p in curve.points} == {"averaged"}
    assert curve.margins.verdict == "unknown"


def test_the_page_of_a_linear_model_shows_the_poles_with_the_delays_themselves(tmp_path: Path) -> None:
    """s + 1 + e^(−0.5 s): its poles are branches of Lambert's W, the second pair is not that of order 4."""
    file = tmp_path / "loop.toml"
    file.write_text(LOOP.format(num=[1.0], den=[1.0, 1.0], delay=0.5))
    with wb.load(file) as model:
        page = text_of(lin_page(wb.lin(model, in_process=True).result), None)
    for branch in (0, 1):
        pole = complex(lambertw(-0.5 * math.exp(0.5), branch)) / 0.5 - 1.0
        assert f"{pole.real:.6g} + {pole.imag:.6g}j" in page
    assert "damping ratio 0.343" in page
