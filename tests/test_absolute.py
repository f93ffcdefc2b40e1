"""Circle and Popov criterion against sectors in closed form, dense grids, and simulated loops; sectors of blocks."""

from __future__ import annotations

import math
from pathlib import Path

import control
import numpy as np
import pytest

import workbench as wb
from tests.command_lines import LOOP
from workbench.core.values.linear import Linear, LinearPart
from workbench.loops.describing.sector import sector_of
from workbench.loops.nyquist.absolute import _best_of, lowest_real_part
from workbench.loops.nyquist.page import absolute_page

CUBE = control.tf([1], [1, 3, 3, 1])  # Re is smallest at 1 rad/s: −1/4; real at √3 rad/s: −1/8


def part(loop: control.TransferFunction) -> LinearPart:
    return LinearPart.from_lin(Linear.from_state_space(control.ss(loop)))


def test_three_lags() -> None:
    """Hurwitz: 8. Circle: 4. Popov: 8 with q = 1, as (1 + s)/(1 + s)³ has no smaller real part than −1/8."""
    found = wb.absolute_stability(CUBE)
    assert found.circle is not None
    assert found.popov is not None
    assert found.linear == pytest.approx(8.0, rel=1e-9)
    assert found.circle == pytest.approx(4.0, rel=2e-9)
    assert found.circle < 4.0
    assert found.circle_hz == pytest.approx(1.0 / (2.0 * math.pi), rel=1e-4)
    assert found.popov == pytest.approx(8.0, rel=1e-8)
    assert found.popov < 8.0
    assert found.popov_s == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(
    ("loop", "linear", "circle", "popov"),
    [
        (control.tf([1], [1, 1]), None, None, None),  # Re > 0 everywhere
        (control.tf([1], [1, 1, 1]), None, 3.0, None),  # Re is smallest at √2 rad/s; two poles: Popov has no bound
        (control.tf([-1], [1, 1]), 1.0, 1.0, 1.0),  # smallest at rest
        (control.tf([-1, 1], [1, 1]), 1.0, 1.0, 1.0),  # (1 − s)/(1 + s): at infinite frequency
        (control.tf([-2], [1]), 0.5, 0.5, 0.5),  # no states
        (control.tf([1], np.poly([-1.0] * 4)), 4.0, None, 4.0),  # (s + 1)⁴: 4 at 1 rad/s
    ],
)
def test_known_sectors(
    loop: control.TransferFunction, linear: float | None, circle: float | None, popov: float | None
) -> None:
    found = wb.absolute_stability(loop)
    for value, truth in ((found.linear, linear), (found.popov, popov)):
        assert (value is None) == (truth is None)
        assert value is None or value == pytest.approx(truth, rel=1e-7)
    if circle is not None or found.linear is None:
        assert (found.circle is None) == (circle is None)
        assert circle is None or found.circle == pytest.approx(circle, rel=1e-7)


def test_a_lower_end_above_zero_turns_the_loop() -> None:
    """An integrator has no sector from 0; from 0.2 on it is that of L/(1 + 0.2 L)."""
    loop = control.tf([1], [1, 2, 1, 0])
    assert "not stable with the gain 0" in wb.absolute_stability(loop).refused
    found = wb.absolute_stability(loop, low=0.2)
    inner = wb.absolute_stability(control.tf([1], [1, 2, 1, 0.2]))
    assert found.linear == pytest.approx(2.0, rel=1e-8)
    for name in ("linear", "circle", "popov"):
        assert getattr(found, name) == pytest.approx(0.2 + getattr(inner, name), rel=1e-7)


def test_popov_between_circle_and_hurwitz_where_the_conjecture_fails() -> None:
    """Fitts' example: between Popov's bound and Hurwitz' there are sectors with cycles."""
    loop = control.tf([1, 0, 0], np.polymul([1, 0.02, 0.0001 + 0.81], [1, 0.02, 0.0001 + 1.21]))
    found = wb.absolute_stability(loop)
    assert found.circle is not None
    assert found.popov is not None
    assert found.circle < found.popov
    assert found.linear is None or found.popov < 0.9 * found.linear
    assert found.popov == pytest.approx(popov_by_grid(loop), rel=2e-3)


def popov_by_grid(loop: control.TransferFunction) -> float:
    """By another method: the largest −1/min over a dense grid of ω, over a dense grid of q."""
    omega = np.concatenate([np.geomspace(1e-3, 1e3, 40001), np.linspace(0.85, 1.15, 40001)])
    value = loop(1j * omega)
    q = np.concatenate([-np.geomspace(1e3, 1e-3, 3000), [0.0], np.geomspace(1e-3, 1e3, 3000)])
    least = max(float(np.min(value.real - x * omega * value.imag)) for x in q)
    return -1.0 / least


@pytest.mark.parametrize("seed", range(12))
def test_no_resonance_is_missed(seed: int) -> None:
    """Modes with damping down to 1e-5, against values at and around each pole, where the dips are."""
    rng = np.random.default_rng(seed)
    loop: control.TransferFunction = control.tf([1], [1, 1])
    for _ in range(4):
        w, zeta = 10.0 ** rng.uniform(-1.0, 2.0), 10.0 ** rng.uniform(-5.0, -1.0)
        loop = loop + rng.normal() * control.tf([1, 0.0], [1, 2.0 * zeta * w, w * w])
    linear = part(loop)
    hz, floor = lowest_real_part(linear)
    poles = linear.poles[linear.poles.imag > 0.0]
    near = np.concatenate([np.abs(p.imag) + np.linspace(-6.0, 6.0, 2001) * abs(p.real) for p in poles])
    omega = np.concatenate([near[near > 0.0], np.geomspace(1e-3, 1e4, 4001)])
    seen = float(linear.response(omega / (2.0 * np.pi)).real.min())
    assert floor <= seen
    size = float(np.abs(linear.response(omega / (2.0 * np.pi))).max())
    assert linear.at(hz).real == pytest.approx(floor, rel=1e-6, abs=1e-9 * size)
    assert floor >= seen - 1e-3 * abs(seen) - 1e-9 * size


@pytest.mark.parametrize("kind", ["saturation", "dead_band", "cubic"])
def test_inside_the_circle_nothing_oscillates(kind: str) -> None:
    """A time-varying characteristic in the sector, the worst that a simple rule finds, lets every motion die."""
    found = wb.absolute_stability(CUBE)
    assert found.circle is not None
    a, b, c = (np.asarray(x) for x in control.ssdata(control.ss(CUBE))[:3])
    x, step = np.ones(3), 0.01
    size = np.linalg.norm(x)
    shapes = {
        "saturation": lambda v: np.clip(v, -0.3, 0.3),
        "dead_band": lambda v: v - np.clip(v, -0.1, 0.1),
        "cubic": lambda v: v * min(v * v, 1.0),
    }
    for k in range(6000):
        gain = 0.99 * found.circle * (0.5 + 0.5 * math.sin(1.7 * k * step) ** 2)
        v = float((c @ x).item())
        x = x + step * (a @ x - b[:, 0] * gain * shapes[kind](v))
    assert np.linalg.norm(x) < 0.02 * size


# -- sectors ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "parameters", "low", "high"),
    [
        ("saturation", {"limit": 0.5, "slope": 3.0}, 0.0, 3.0),
        ("dead_band", {"width": 1.0, "slope": 2.0}, 0.0, 2.0),
        ("relay", {}, 0.0, math.inf),
        ("relay", {"level": 2.0, "dead_zone": 0.5}, 0.0, 4.0),
        ("quantiser", {"resolution": 1.0}, 0.0, 2.0),
        ("preload", {"level": 1.0, "slope": 2.0}, 2.0, math.inf),
        ("dead_band", {"width": 1e-3, "slope": 2.0}, 0.0, 2.0),
    ],
)
def test_sectors_of_standard_blocks(kind: str, parameters: dict[str, float], low: float, high: float) -> None:
    found = sector_of(wb.standard_block(kind, parameters), 1e4)
    assert found.high == pytest.approx(high, rel=1e-6)
    assert found.low == pytest.approx(low, abs=1e-6)
    assert found.reach is None


def test_the_sector_of_a_cubic_ends_with_what_was_looked_at() -> None:
    assert sector_of(wb.standard_block("quadratic", {"coefficient": 7000.0}), 10.0).low == 0.0
    found = sector_of(wb.standard_block("cubic"), 3.0)
    assert found.low == 0.0
    assert found.high == pytest.approx(9.0)
    assert found.reach == 3.0


def test_limit_cycle_compares_the_block_with_what_is_proven(tmp_path: Path) -> None:
    """Three lags and a saturation of the slope 5: above the circle's 4, below Popov's 8; of a relay nothing is."""
    text = LOOP.replace('"c.y", gain = -10.0', '"c.y", gain = -1.0')
    (tmp_path / "loop.toml").write_text(text.replace("D = 1.0", "D = 5.0"), encoding="utf-8")
    with wb.load(tmp_path / "loop.toml") as system:
        found = wb.limit_cycle(system, block="block", methods=["describing function"])
    assert found.absolute is not None
    assert found.absolute.sector is not None
    assert (found.absolute.sector.low, found.absolute.sector.reach) == (0.0, None)
    assert found.absolute.sector.high == pytest.approx(5.0)
    assert found.absolute.circle == pytest.approx(4.0)
    assert found.absolute.proven_by == "Popov"
    assert "proven stable by the criterion of Popov" in absolute_page(found.absolute).lead
    assert wb.LimitCycleResult.from_dict(found.to_dict()).absolute is not None


def test_loop_tells_what_is_proven_and_the_picture_shows_it(tmp_path: Path) -> None:
    """3.5/(s + 1)³: constant gains and Popov up to 8/3.5, the circle to 4/3.5; a sampled or delayed loop: nothing."""
    text = (
        '[components]\nlags = {block = "transfer_function", numerator = [3.5], denominator = [1, 3, 3, 1]}\n'
        'limit = {block = "saturation"}\nerror = {sum = "+-"}\nLATE\n[connections]\n"error.u2" = "BACK"\n'
        '"limit.u" = "error.y"\n"lags.u" = "limit.y"\n[inputs]\nr = "error.u1"\n'
    )
    file = tmp_path / "three.toml"
    file.write_text(text.replace("LATE", "").replace("BACK", "lags.y"), encoding="utf-8")
    with wb.load(file) as system:
        found = wb.loop(system, "lags.y")
        cycles = wb.limit_cycle(system, block="limit", methods=["describing function"])
    assert found.linear is not None
    absolute = found.linear.absolute
    assert absolute is not None
    assert (absolute.linear, absolute.popov, absolute.circle) == pytest.approx((8 / 3.5, 8 / 3.5, 4 / 3.5))
    again = wb.LoopResult.from_dict(found.to_dict())
    assert again.linear is not None
    assert again.linear.absolute is not None
    assert again.linear.absolute.circle == absolute.circle
    plane = cycles.plot().axes[0]
    labels = plane.get_legend_handles_labels()[1]
    assert "circle criterion, slopes 0 … 1.143" in labels
    assert "Popov, slopes 0 … 2.286" in labels
    assert plane.get_xlim()[0] < -3.5 / 4
    late = (
        text.replace("LATE", 'late = {block = "delay", delay = 0.1}').replace("BACK", "late.y")
        + '"late.u" = "lags.y"\n'
    )
    file.write_text(late.replace('[inputs]\nr = "error.u1"\n', "") + '[inputs]\nr = "error.u1"\n', encoding="utf-8")
    with wb.load(file) as system:
        delayed = wb.loop(system, "late.y").linear
    assert delayed is not None
    assert delayed.absolute is None


def test_what_is_proven_follows_from_the_sector() -> None:
    for gain, proven in ((3.9, "circle"), (7.9, "Popov"), (8.1, "")):
        block = wb.standard_block("saturation", {"slope": gain})
        assert wb.absolute_stability(CUBE, block).proven_by == proven
    with pytest.raises(wb.InputError, match="is not static"):
        wb.absolute_stability(CUBE, wb.standard_block("backlash"))
    with pytest.raises(wb.InputError, match="reach: -1 is not positive"):
        wb.absolute_stability(CUBE, wb.standard_block("saturation"), reach=-1.0)


def test_the_best_multiplier_is_found_where_several_lines_meet_in_one_point() -> None:
    """There each is lower than the others by rounding only, and taking one for another had no end."""
    for seed in range(100):
        random = np.random.default_rng(seed)
        q, level = random.standard_normal(2)
        slope = random.standard_normal(int(random.integers(3, 7))) * 10.0 ** random.integers(-2, 3)
        slope[0], slope[1] = abs(slope[0]), -abs(slope[1])
        found = _best_of(np.full(len(slope), 0.5 / np.pi), level - q * slope - 1j * slope, 1.0)
        assert found == pytest.approx((q, level), rel=1e-9, abs=1e-9)
