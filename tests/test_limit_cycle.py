"""Limit cycles on plants with known answers: van der Pol, relay with a lag, saturation around FMUs."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.limit_cycle_loops import LAG, around, chain
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.limit_cycles.limit_cycle.confirm import confirm
from workbench.limit_cycles.limit_cycle.floquet import multipliers, others
from workbench.limit_cycles.limit_cycle.harmonic_balance import balance
from workbench.limit_cycles.limit_cycle.request import limit_cycle
from workbench.limit_cycles.limit_cycle.result import LimitCycle, LimitCycleResult
from workbench.loops.describing.describe import standard_block
from workbench.loops.nyquist.nyquist import nyquist
from workbench.response.periodic.stability import is_stable
from workbench.system.connect import connect
from workbench.system.load import load

REFINED = ("harmonic balance", "shooting", "simulation")


def by_method(result: LimitCycleResult) -> dict[str, LimitCycle]:
    return {c.method: c for c in result.limit_cycles}


# -- van der Pol -----------------------------------------------------------------------------


@pytest.mark.parametrize("mu", [0.05, 0.2])
def test_van_der_pol_has_the_period_of_the_expansion(mu: float) -> None:
    """T = 2π(1 + μ²/16 − 5μ⁴/3072 + O(μ⁶)), maximum 2 + μ²/96 + O(μ⁴) [Andersen & Geer 1982]."""
    with around(lambda u: u**3 / 3.0, control.tf([mu, 0.0], [1.0, -mu, 1.0])) as system:
        found = by_method(limit_cycle(system, block="block"))
    assert found["describing function"].frequency_hz == pytest.approx(1.0 / (2.0 * math.pi), rel=1e-9)
    assert found["describing function"].amplitude == pytest.approx(2.0, rel=1e-9)
    exact = 1.0 / (2.0 * math.pi * (1.0 + mu**2 / 16.0 - 5.0 * mu**4 / 3072.0))
    for method in REFINED:
        assert found[method].frequency_hz == pytest.approx(exact, rel=2e-7 if method != "simulation" else 2e-6)
        assert found[method].amplitude == pytest.approx(2.0 + mu**2 / 96.0, abs=5e-5)
        assert found[method].stable
    # The multiplier of the averaged equation.
    assert found["shooting"].multiplier == pytest.approx(math.exp(-2.0 * math.pi * mu), rel=0.02)


def test_van_der_pol_at_1_and_the_negative_damping_in_the_block() -> None:
    """Period 6.66328686 and maximum 2.00861986 at μ = 1 (the same source); L has poles on the axis here."""
    with around(lambda u: u**3 / 3.0 - u, control.tf([1.0, 0.0], [1.0, 0.0, 1.0])) as system:
        found = by_method(limit_cycle(system, block="block", harmonics=25))
    for method in REFINED:
        assert 1.0 / found[method].frequency_hz == pytest.approx(6.66328686, rel=1e-6)
        assert found[method].amplitude == pytest.approx(2.00861986, rel=1e-4 if method == "simulation" else 1e-5)


# -- relay -----------------------------------------------------------------------------------


def relay_cycle(a: Floats, b: Floats, c: Floats, half_width: float = 0.0) -> tuple[float, float]:
    """Return frequency and peak of the symmetric cycle under a unit relay in closed form [Tsypkin; Åström 1995].

    Over half a period the plant's input is −1 and x(h) = −x(0), so that x(0) = (I + e^{Ah})⁻¹ (e^{Ah} − I) A⁻¹ b; that
    the relay switches there, C x(0) = half_width, gives h.
    """
    one = np.eye(len(a))

    def start(h: float) -> Floats:
        e = expm(a * h)
        return np.asarray(np.linalg.solve(one + e, (e - one) @ np.linalg.solve(a, b)), dtype=np.float64)

    h = float(brentq(lambda t: float(c @ start(t)) - half_width, 1.0, 5.0, xtol=1e-14))
    fixed = np.linalg.solve(a, b)
    times = np.linspace(0.0, h, 20001)
    step, x, peak = expm(a * times[1]), start(h) - fixed, 0.0
    for _ in times:
        peak = max(peak, abs(float(c @ (x + fixed))))
        x = step @ x
    return 0.5 / h, peak


def test_relay_with_a_third_order_lag_against_tsypkin() -> None:
    plant = control.ss(LAG)
    frequency, peak = relay_cycle(plant.A, plant.B[:, 0], plant.C[0])
    with around(np.sign, LAG) as system:
        found = by_method(limit_cycle(system, block="block"))
    # N(A) = 4M/πA = 8.
    assert found["describing function"].amplitude == pytest.approx(0.5 / math.pi, rel=1e-9)
    assert found["shooting"].frequency_hz == pytest.approx(frequency, rel=1e-6)
    assert found["shooting"].amplitude == pytest.approx(peak, rel=1e-5)
    assert found["simulation"].frequency_hz == pytest.approx(frequency, rel=1e-6)
    # The harmonics above 7 that a square wave has and harmonic balance leaves out cost 4e-4.
    assert found["harmonic balance"].frequency_hz == pytest.approx(frequency, rel=5e-4)
    assert all(c.stable for c in found.values())


@pytest.mark.parametrize(("half_width", "start"), [(0.0, {}), (0.0, {"plant.x3": 0.02}), (0.05, {})])
def test_the_block_relay_has_the_closed_form_that_its_page_promises(
    tmp_path: Path, half_width: float, start: dict[str, float]
) -> None:
    """Crossing: N(A) L(jω) = −1, N = (4/πA) e^(−j asin(h/A)) [Gelb & Vander Velde, appendix B]; cycle: Tsypkin."""
    file = tmp_path / "relay.toml"
    file.write_text(f"""
[components]
plant = {{block = "transfer_function", numerator = [5.0], denominator = [1.0, 2.0, 2.0, 1.0]}}
relay = {{block = "relay", off_below = {-half_width}, on_above = {half_width}}}
[connections]
"relay.u" = {{from = "plant.y", gain = -1.0}}
"plant.u" = "relay.y"
""")
    with load(file, start_values=start) as system:
        found = by_method(limit_cycle(system, block="relay"))
    first = found["describing function"]
    s = 2j * math.pi * first.frequency_hz
    gain = 4.0 / (math.pi * first.amplitude) * np.exp(-1j * math.asin(half_width / first.amplitude))
    assert abs(1.0 + gain * 5.0 / (((s + 2.0) * s + 2.0) * s + 1.0)) < 1e-6
    plant = control.ss(control.tf([5.0], [1.0, 2.0, 2.0, 1.0]))
    frequency, peak = relay_cycle(plant.A, plant.B[:, 0], plant.C[0], half_width)
    assert found["simulation"].frequency_hz == pytest.approx(frequency, rel=1e-5)
    assert found["simulation"].amplitude == pytest.approx(peak, rel=1e-4)
    assert found["harmonic balance"].frequency_hz == pytest.approx(frequency, rel=2e-3)
    assert found["simulation"].stable


def test_more_harmonics_come_closer() -> None:
    plant = control.ss(LAG)
    frequency, _ = relay_cycle(plant.A, plant.B[:, 0], plant.C[0])
    part, block = LinearPart(plant.A, plant.B[:, 0], plant.C[0]), standard_block("relay")
    errors = []
    for count in (1, 3, 7, 15, 31):
        cycle = balance(part, (block,), frequency=0.2757, amplitude=0.159, count=count)
        assert cycle is not None
        errors.append(abs(cycle.frequency / frequency - 1.0))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-5


def test_a_relay_with_hysteresis_is_balanced_too() -> None:
    plant = control.ss(LAG)
    part = LinearPart(plant.A, plant.B[:, 0], plant.C[0])
    frequency, peak = relay_cycle(part.A, part.b, part.c, 0.05)
    block = standard_block("relay_with_hysteresis", {"half_width": 0.05})
    cycle = balance(part, (block,), frequency=0.24, amplitude=0.2, count=15)
    assert cycle is not None
    assert cycle.frequency == pytest.approx(frequency, rel=2e-4)
    assert cycle.amplitude == pytest.approx(peak, rel=2e-3)


# -- saturation --------------------------------------------------------------------------------


def test_saturation_and_lags_that_are_fmus_are_the_same_as_formulas() -> None:
    with around(lambda u: np.clip(u, -1.0, 1.0), 10.0 * LAG) as one, chain() as other:
        formulas, fmus = (by_method(limit_cycle(s, block="block")) for s in (one, other))
    for method, c in formulas.items():
        assert fmus[method].frequency_hz == pytest.approx(c.frequency_hz, rel=1e-7)
        assert fmus[method].amplitude == pytest.approx(c.amplitude, rel=1e-5)
    assert formulas["harmonic balance"].frequency_hz == pytest.approx(formulas["shooting"].frequency_hz, rel=5e-6)
    assert formulas["describing function"].frequency_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-9)


def test_a_block_with_a_memory_needs_amplitudes() -> None:
    with (
        connect(
            {"block": "fmu:Hysteresis", "a": control.ss(LAG)},
            [("a.y", "block.u", {"gain": -8.0}), ("block.y", "a.u")],
        ) as system,
        pytest.raises(InputError, match="must be measured"),
    ):
        limit_cycle(system, block="block")


def test_a_measured_block_gives_the_closed_form_of_backlash() -> None:
    """fmu:Hysteresis with a fast cut-off is a backlash: the same cycles, the same stability."""
    plant = control.tf([6.0], [1.0, 1.5, 1.0, 0.0])
    with connect(
        {"block": "fmu:Hysteresis", "a": control.ss(plant)},
        [("a.y", "block.u", {"gain": -0.5}), ("block.y", "a.u", {"gain": 0.2})],
        outputs={"y": "a.y"},
        start_values={"block.halfWidth": 0.05, "block.k": 2.0, "block.omegaC": 5000.0},
    ) as system:
        result = limit_cycle(
            system, block="block", band=(0.03, 0.5), amplitudes=(0.06, 1.0), methods=("describing function",),
            workers=Workers(in_process=True),
        )  # fmt: skip
    exact = nyquist(control.ss(0.1 * plant), standard_block("backlash", {"half_width": 0.05, "slope": 2.0}))
    wanted = [(c.frequency_hz, c.amplitude, c.stable) for c in exact.crossings if c.amplitude is not None]
    found = [(c.frequency_hz, c.amplitude, c.stable) for c in result.limit_cycles]
    assert len(found) == len(wanted) > 0
    # The sizes of the harmonics are measured with it, and with them what comes back to the block.
    for c, other in zip(result.crossings, (x for x in exact.crossings if x.amplitude is not None), strict=False):
        assert c.distortion == pytest.approx(other.distortion, rel=0.02)
    for (f, a, stable), (g, b, same) in zip(found, wanted, strict=True):
        assert f == pytest.approx(g, rel=0.01)
        assert a == pytest.approx(b, rel=0.02)
        assert stable == same


def test_harmonic_balance_drives_a_block_that_can_only_be_measured() -> None:
    """The same backlash: balanced with its closed form; the FMU driven by the motion; shooting and simulation."""
    plant = control.tf([6.0], [1.0, 1.5, 1.0, 0.0])
    with connect(
        {"block": "fmu:Hysteresis", "a": control.ss(plant)},
        [("a.y", "block.u", {"gain": -0.5}), ("block.y", "a.u", {"gain": 0.2})],
        outputs={"y": "a.y"},
        start_values={"block.halfWidth": 0.05, "block.k": 2.0, "block.omegaC": 5e4},
    ) as system:
        result = limit_cycle(
            system, block="block", band=(0.03, 0.5), amplitudes=(0.06, 1.0), workers=Workers(in_process=True)
        )
    plain = control.ss(0.1 * plant)
    part, block = (
        LinearPart(plain.A, plain.B[:, 0], plain.C[0]),
        standard_block("backlash", {"half_width": 0.05, "slope": 2.0}),
    )
    table = {(c.crossing, c.method): c for c in result.limit_cycles}
    for number, stable in ((0, False), (1, True)):
        first, found = table[number, "describing function"], table[number, "harmonic balance"]
        exact = balance(part, (block,), frequency=first.frequency_hz, amplitude=first.amplitude)
        assert exact is not None
        # The FMU's cut-off of 5000 rad/s is what they differ in.
        assert found.frequency_hz == pytest.approx(exact.frequency, rel=2e-4)
        assert found.fundamental == pytest.approx(exact.fundamental, rel=1e-3)
        assert (found.residual or 0.0) < 1e-6
        assert found.stable is None
        orbit = table[number, "shooting"]
        assert orbit.stable is stable
        # Seven harmonics against all: the balance with the closed form is off by 2.2e-3 and 4.4e-5.
        assert found.frequency_hz == pytest.approx(orbit.frequency_hz, rel=2.3e-3)
        assert abs(found.frequency_hz - orbit.frequency_hz) < 0.1 * abs(first.frequency_hz - orbit.frequency_hz)
    assert table[1, "simulation"].frequency_hz == pytest.approx(table[1, "shooting"].frequency_hz, rel=1e-6)
    assert (0, "simulation") not in table
    assert result.simulated is not None
    assert result.simulated.steady


# -- an FMU that is not ours -------------------------------------------------------------------


@needs_gemseo
def test_a_third_party_fmu_in_a_loop_with_a_saturation() -> None:
    """Mass, spring and damper y/f = 1/(s² + 10 s + 10⁴) of the package gemseo-fmu, 5000/(0.01 s + 1), a limited force.

    By Routh the loop's critical gain is 2100, at ω² = 11000.
    """
    with connect(
        {
            "block": lambda u: np.clip(u, -1.0, 1.0),
            "lag": control.tf([5000.0], [0.01, 1.0]),
            "body": str(gemseo_fmu("Mass_Damper")),
        },
        # The output is -0.5 m at rest.
        [("body.y", "lag.u", {"offset": 0.5}), ("lag.y", "block.u"), ("block.y", "body.f", {"gain": -1.0})],
        outputs={"y": "body.y"},
    ) as system:
        result = limit_cycle(system, block="block")
    found = by_method(result)
    (crossing,) = result.crossings
    assert crossing.frequency_hz == pytest.approx(math.sqrt(11000.0) / (2.0 * math.pi), rel=1e-4)
    assert crossing.real == pytest.approx(-5000.0 / 2100.0, rel=1e-4)
    assert crossing.amplitude is not None
    assert standard_block("saturation").gain(crossing.amplitude).real == pytest.approx(0.42, rel=1e-4)
    # This FMU's initial equations override start values: its states are set after initialisation.
    assert found["shooting"].frequency_hz == pytest.approx(found["simulation"].frequency_hz, rel=1e-5)
    refined, simulated = found["harmonic balance"], found["simulation"]
    assert simulated.frequency_hz == pytest.approx(refined.frequency_hz, rel=1e-5)
    assert simulated.fundamental == pytest.approx(refined.fundamental, rel=2e-4)
    assert refined.stable
    assert result.simulated is not None
    assert result.simulated.steady


# -- mathematics -------------------------------------------------------------------------------


def test_multipliers_of_a_linear_motion_are_exponentials() -> None:
    """A linear block that makes an undamped oscillator: the multipliers are 1, 1 and those of the other pole."""
    a = np.diag([0.0, 0.0, -0.5])
    a[0, 1], a[1, 0] = 1.0, -1.0
    part = LinearPart(a, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))
    block = standard_block("saturation")
    cycle = balance(part, (block,), frequency=0.16, amplitude=0.5)
    if cycle is not None:
        found = multipliers(part, (block,), cycle)
        assert np.abs(found) == pytest.approx([1.0, 1.0, math.exp(-math.pi)], rel=1e-4)
        across, doubt = others(found)
        assert is_stable(across, doubt=doubt)


def test_a_block_without_symmetry_moves_the_mean() -> None:
    """A relay with levels 1 and −0.5: the mean of the cycle by harmonic balance is that of the simulation."""
    with around(lambda u: np.where(u > 0.0, 1.0, -0.5), LAG) as system:
        found = by_method(limit_cycle(system, block="block", harmonics=15))
    assert found["shooting"].mean < -0.01
    assert found["harmonic balance"].mean == pytest.approx(found["shooting"].mean, rel=0.02)


def test_the_sign_may_be_in_the_block_or_in_the_connection() -> None:
    results = []
    for block, gain in ((lambda u: np.clip(u, -1.0, 1.0), -1.0), (lambda u: -np.clip(u, -1.0, 1.0), 1.0)):
        with around(block, 10.0 * LAG, gain=gain) as system:
            results.append(limit_cycle(system, block="block", methods=("describing function",)))
    assert results[0].crossings[0].real == pytest.approx(results[1].crossings[0].real, rel=1e-9)
    assert results[1].crossings[0].real < 0.0


@pytest.mark.parametrize("periods", [60, 600])
@pytest.mark.parametrize("begin", [1.6, 2.5])
def test_a_slow_approach_is_not_steady_before_it_has_arrived(periods: int, begin: float) -> None:
    """x'' − μ(1 − x²) x' + x = 0, μ = 0.004: a(t) = 2/√(1 + (4/a₀² − 1) e^(−μt)) by averaging, 2 in the end.

    Twenty periods take off 40 % of what is missing: after 60 periods the amplitude changes still.
    """
    mu = 0.004
    plant = control.ss([[mu, 1.0], [-1.0, 0.0]], [[mu], [0.0]], [[1.0, 0.0]], [[0.0]])
    with connect(
        {"block": "fmu:AlgebraicExpression", "plant": plant},
        [("plant.y", "block.u"), ("block.y", "plant.u", {"gain": -1.0})],
        outputs={"y": "plant.y"},
        start_values={
            "block.c0": 0.0, "block.c1": 0.0, "block.c2": 0.0, "block.c3": 1.0 / 3.0,
            "block.C[1]": 0.0, "block.C[2]": 0.0, "block.D": 1.0,
        },
    ) as system:  # fmt: skip
        states = {"plant.x1": begin, "plant.x2": mu * (begin**3 / 3.0 - begin)}
        found = confirm(
            system, None, states=states, inputs={}, frequency=1.0 / (2.0 * math.pi), amplitude=2.0, watch="y",
            outputs=["y"], time=0.0, periods=periods,
        )  # fmt: skip
    assert not isinstance(found, str)
    middle = 2.0 * math.pi * (found.periods - 10)  # of the last twenty periods
    expected = 2.0 / math.sqrt(1.0 + (4.0 / begin**2 - 1.0) * math.exp(-mu * middle))
    assert found.fundamental["y"] == pytest.approx(expected, rel=3e-3)
    assert found.steady is (periods == 600)
    if found.steady:
        assert found.fundamental["y"] == pytest.approx(2.0, rel=5e-4)
        assert found.periods < 600


def test_an_unstable_cycle_is_found_by_shooting_and_not_simulated() -> None:
    """A dead band: small motions die, large ones grow."""
    with around(lambda u: u - np.clip(u, -1.0, 1.0), 10.0 * LAG) as system:
        result = limit_cycle(system, block="block")
    found = by_method(result)
    assert found["shooting"].stable is False
    assert found["shooting"].frequency_hz == pytest.approx(found["harmonic balance"].frequency_hz, rel=1e-4)
    assert (found["shooting"].multiplier or 0.0) > 1.0
    assert "simulation" not in found
    assert result.simulated is None


# -- surroundings ------------------------------------------------------------------------------


def test_result_picture_and_table(tmp_path: Path) -> None:
    with around(lambda u: np.clip(u, -1.0, 1.0), 10.0 * LAG) as system:
        result = limit_cycle(system, block="block", outputs=["plant.x1", "y"])
    result.plot(tmp_path / "cycle.png")
    result.to_csv(tmp_path / "cycle.csv")
    data = result.to_dict()
    json.dumps(data)
    assert set(data["simulated"]["amplitude"]) == {"block.u", "plant.x1", "y"}
    assert {"method", "frequency_hz", "amplitude", "stable"} <= set(data["limit_cycles"][0])
    assert (tmp_path / "cycle.csv").read_text(encoding="utf-8").count("\n") == 5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"block": "blok"}, "did you mean block"),
        ({"block": "block", "methods": ("shoting",)}, "did you mean shooting"),
        ({"block": "block", "outputs": ["z"]}, "has no variable 'z'"),
        ({"block": "block", "harmonics": 0}, "harmonics: 0 is too small; take at least 1"),
        ({"block": "block", "band": (2.0, 1.0)}, "the lower first"),
    ],
)
def test_mistakes_are_one_line(options: dict[str, Any], message: str) -> None:
    with around(np.sign, LAG) as system, pytest.raises(InputError, match=message):
        limit_cycle(system, **options)


def test_no_system_no_loop() -> None:
    with load("fmu:Saturation") as model, pytest.raises(InputError, match="is not a system"):
        limit_cycle(model, block="x")
    with (
        connect({"block": np.sign, "plant": control.ss(LAG)}, [("plant.y", "block.u")]) as system,
        pytest.raises(InputError, match="0 connected outputs"),
    ):
        limit_cycle(system, block="block")


@pytest.mark.parametrize(("mu", "period"), [(0.1, 6.287111), (3.0, 8.859096), (10.0, 19.078370)])
def test_van_der_pol_from_a_sine_to_a_relaxation(mu: float, period: float) -> None:
    """Periods computed by others; at 10 harmonic balance finds nothing, and the cycle is taken from a run."""
    with around(lambda u: u**3 / 3.0 - u, control.tf([mu, 0.0], [1.0, 0.0, 1.0])) as system:
        found = by_method(limit_cycle(system, block="block", harmonics=25))
    assert 1.0 / found["shooting"].frequency_hz == pytest.approx(period, rel=1.5e-7)
    assert found["shooting"].stable


def test_cycles_of_a_measured_block_are_followed_and_scale_with_its_width() -> None:
    # All of the loop but the block is linear, and the block's width is the only length.
    plant = control.tf([6.0], [1.0, 1.5, 1.0, 0.0])
    with connect(
        {"block": "fmu:Hysteresis", "a": control.ss(plant)},
        [("a.y", "block.u", {"gain": -0.5}), ("block.y", "a.u", {"gain": 0.2})],
        outputs={"y": "a.y"},
        start_values={"block.halfWidth": 0.05, "block.k": 2.0, "block.omegaC": 100.0},
    ) as system:
        result = limit_cycle(
            system, block="block", band=(0.03, 0.5), amplitudes=(0.06, 1.0), workers=Workers(in_process=True),
            vary={"block.halfWidth": (0.03, 0.09)}, methods=("describing function", "shooting"),
        )  # fmt: skip
    assert len(result.branches) == 2
    for branch in result.branches:
        values = np.array([p.value for p in branch.points])
        assert (values.min(), values.max()) == pytest.approx((0.03, 0.09))
        for of in ("amplitude", "fundamental"):
            scaled = np.array([getattr(p, of) for p in branch.points]) / values
            assert np.ptp(scaled) < 1e-6 * scaled.mean()
        frequency = np.array([p.frequency_hz for p in branch.points])
        assert np.ptp(frequency) < 1e-6 * frequency.mean()
        assert not branch.folds
    assert {p.stable for b in result.branches for p in b.points} == {True, False}


@pytest.mark.parametrize("along", [1.02, 0.97 + 0.05j])
def test_the_multiplier_along_the_orbit_is_the_one_that_is_left_out(along: complex) -> None:
    across, off = others(np.array([-1.6, along, 0.3]))
    assert across is not None
    assert across.tolist() == [-1.6, 0.3]
    assert off == pytest.approx(abs(along - 1.0), rel=1e-12)
