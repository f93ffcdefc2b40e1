"""Limit cycles followed over a parameter: folds, ends, stability, parameters of FMUs."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import workbench as wb
from tests.limit_cycle_loops import LAG, chain
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError, StoppedError
from workbench.limit_cycles.limit_cycle.floquet import multipliers
from workbench.limit_cycles.limit_cycle.harmonic_balance import balance
from workbench.limit_cycles.limit_cycle.request import limit_cycle
from workbench.limit_cycles.limit_cycle.result import LimitCycleResult
from workbench.loops.describing.describe import standard_block
from workbench.model.described_model import DescribedModel
from workbench.response.periodic.place import Place
from workbench.response.periodic.special import Missed
from workbench.system.connect import connect

SCIPY = {"rtol": 1e-10, "atol": 1e-12, "max_step": 0.1}
ROUGH = {"rtol": 1e-6, "atol": 1e-9, "max_step": 0.5}  # to see where a motion goes


PLANT = control.ss(LAG)


def measured(
    slope: Callable[[float, Floats], Floats],
    start: Floats,
    until: float,
    factor: float,
    manner: dict[str, float] = SCIPY,
) -> tuple[float, ...]:
    """Return frequency and amplitude of factor times the output of the lags, over the last fifth of a run by SciPy."""
    run = solve_ivp(slope, (0.0, until), start, dense_output=True, **manner)

    def output(t: float | Floats) -> Floats:
        return np.asarray(PLANT.C[0] @ run.sol(t))

    t = np.arange(0.8 * until, until, 0.005)
    y = output(t)
    passes = [
        brentq(output, t[i], t[i + 1], xtol=1e-13) for i in np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0)).tolist()
    ]
    frequency = (len(passes) - 1) / (passes[-1] - passes[0]) if len(passes) > 1 else 0.0
    return frequency, abs(factor) * 0.5 * float(np.ptp(y))


def two_blocks(c1: float, c3: float, gain: float) -> DescribedModel:
    """Return c1 u + c3 u³, cut off at ±1 by another block, around three lags and a gain."""
    return connect(
        {"cubic": "fmu:AlgebraicExpression", "limits": "fmu:Saturation", "lags": control.ss(LAG)},
        [("lags.y", "cubic.u", {"gain": -gain}), ("cubic.y", "limits.u"), ("limits.y", "lags.u")],
        start_values={
            "limits.C[1]": 0.0, "limits.C[2]": 0.0, "limits.D": 1.0, "cubic.C[1]": 0.0, "cubic.C[2]": 0.0,
            "cubic.D": 1.0, "cubic.c0": 0.0, "cubic.c1": c1, "cubic.c2": 0.0, "cubic.c3": c3,
        },
    )  # fmt: skip


def cut_off(c1: float, c3: float, gain: float, factor: float = 1.0) -> Callable[[float, Floats], Floats]:
    """Return the same for SciPy, with a factor on the output of the cubic block."""

    def slope(_: float, x: Floats) -> Floats:
        v = -gain * float(PLANT.C[0] @ x)
        w = min(max(factor * (c1 * v + c3 * v**3), -1.0), 1.0)
        return np.asarray(PLANT.A @ x + PLANT.B[:, 0] * w)

    return slope


def test_two_blocks_are_balanced_together_and_their_fold_is_found() -> None:
    """The gain of the cubic block rises with the amplitude, and the limits take it back: two cycles, and a fold."""
    c1, c3, gain = 0.4, 1.0, 16.0
    with two_blocks(c1, c3, gain) as system:
        result = limit_cycle(
            system,
            block=("cubic", "limits"),
            methods=("describing function", "harmonic balance", "shooting"),
            band=(0.05, 2.0),
            vary={"gain": (0.1, 1.1)},
        )
    assert result.blocks == ("cubic", "limits")
    orbits = {c.stable: c for c in result.limit_cycles if c.method == "shooting"}
    balanced = {c.stable: c for c in result.limit_cycles if c.method == "harmonic balance"}
    predicted = {c.stable: c for c in result.limit_cycles if c.method == "describing function"}
    assert set(orbits) == set(balanced) == set(predicted) == {True, False}
    for stable, orbit in orbits.items():
        assert set(orbit.amplitudes) == set(balanced[stable].amplitudes) == {"cubic.u", "limits.u"}
        for found, error in ((predicted[stable], 0.1), (balanced[stable], 0.005)):
            assert found.frequency_hz == pytest.approx(orbit.frequency_hz, rel=error)
            assert found.fundamental == pytest.approx(orbit.fundamental, rel=error)
    # N of the small cycle: c1 + ¾ c3 A² = 8/16.
    assert predicted[False].amplitude == pytest.approx(math.sqrt(0.1 / 0.75), rel=1e-3)
    # By SciPy, from beside the cycle: 60 s are 16 of its periods, in each of which a disturbance shrinks.
    big = np.array([x for name, x in (orbits[True].states or {}).items() if name.startswith("lags.")])
    frequency, amplitude = measured(cut_off(c1, c3, gain), 1.01 * big, 60.0, gain)
    assert orbits[True].frequency_hz == pytest.approx(frequency, rel=1e-6)
    assert orbits[True].amplitude == pytest.approx(amplitude, rel=1e-5)
    # The unstable cycle divides what comes to rest from what grows.
    there = orbits[False].states or {}
    states = np.array([x for name, x in there.items() if name.startswith("lags.")])
    for share, grows in ((0.98, False), (1.02, True)):
        assert (measured(cut_off(c1, c3, gain), share * states, 60.0, gain, ROUGH)[1] > 1.0) is grows
    (fold,) = {round(f.value, 9): f for b in result.branches for f in b.folds}.values()
    for share, stays in ((0.99, False), (1.01, True)):
        assert (measured(cut_off(c1, c3, gain, share * fold.value), big, 150.0, gain, ROUGH)[1] > 0.1) is stays


def test_cycles_of_fmus_over_a_parameter(tmp_path: Path) -> None:
    """The limit of a saturation scales the amplitude and nothing else; a time constant moves the frequency."""
    with chain() as system:
        result = limit_cycle(
            system,
            block="block",
            methods=("harmonic balance",),
            vary={"c.tau": (0.5, 2.0), "gain": (0.85, 2.0)},
        )
    over_tau, over_gain = result.branches
    assert {c.method for c in result.limit_cycles} == {"harmonic balance"}  # shooting was not asked for
    assert (over_tau.parameter, over_gain.parameter) == ("c.tau", "gain")
    for p in over_tau.points:
        # Im of (jω + 1)²(jωτ + 1) is zero at ω² = (2 + τ)/τ.
        assert p.frequency_hz == pytest.approx(math.sqrt((2.0 + p.value) / p.value) / (2.0 * math.pi), rel=0.01)
        assert p.stable
    assert over_gain.points[0].fundamental < over_gain.points[-1].fundamental
    result.plot(tmp_path / "a.png")
    over_tau.plot(tmp_path / "b.png")
    over_tau.to_csv(tmp_path / "b.csv")
    assert len((tmp_path / "b.csv").read_text(encoding="utf-8").splitlines()) == len(over_tau.points) + 1


def test_orbits_are_followed_to_both_bounds() -> None:
    """Of a loop whose harmonics hardly return, the frequency is the describing function's to 1 %."""
    with chain() as system:
        methods = ("describing function", "harmonic balance", "shooting")
        result = limit_cycle(system, block="block", methods=methods, vary={"c.tau": (0.5, 2.0)})
    (branch,) = result.branches
    values = [p.value for p in branch.points]
    assert (min(values), max(values)) == (0.5, 2.0)
    assert branch.ends == ("the parameter's bound", "the parameter's bound")
    for p in branch.points:
        # Im of (jω + 1)²(jωτ + 1) is zero at ω² = (2 + τ)/τ.
        assert p.frequency_hz == pytest.approx(math.sqrt((2.0 + p.value) / p.value) / (2.0 * math.pi), rel=0.01)
        assert p.stable
    assert branch.bifurcations == ()
    rows = list(result.rows())
    assert len(rows) == 1 + len(result.limit_cycles) + len(branch.points)
    assert {len(row) for row in rows} == {len(rows[0])}


def test_an_unknown_parameter_is_one_line() -> None:
    with chain() as system, pytest.raises(InputError, match=r"did you mean .*c\.tau"):
        limit_cycle(system, block="block", methods=("harmonic balance",), vary={"c.tua": (0.5, 2.0)})


def test_splitting_gives_the_same_multipliers() -> None:
    """Large systems are split into the linear part and the block; here both ways on the same cycle."""
    plant = control.ss(10.0 * LAG)
    part, block = LinearPart(plant.A, plant.B[:, 0], plant.C[0]), standard_block("saturation")
    cycle = balance(part, (block,), frequency=0.2757, amplitude=1.4555)
    assert cycle is not None
    padded = LinearPart(
        np.block([[part.A, np.zeros((3, 30))], [np.zeros((30, 3)), -np.eye(30)]]),
        np.append(part.b, np.zeros(30)),
        np.append(part.c, np.zeros(30)),
    )
    small, large = multipliers(part, (block,), cycle), multipliers(padded, (block,), cycle)
    assert np.abs(large[:2]) == pytest.approx(np.abs(small[:2]), rel=1e-4)


def test_cycles_over_a_parameter_of_the_block() -> None:
    """A dead band's or a saturation's own limits are followed with the block alone opened again."""
    with chain() as system:
        result = limit_cycle(system, block="block", methods=("shooting",), vary={"block.D": (0.9, 1.2)})
    (branch,) = result.branches
    (cycle,) = result.limit_cycles
    # y = sat(D u): D u has the cycle of a loop with gain D.
    assert branch.points[0].value == pytest.approx(0.9)
    assert branch.points[-1].value == pytest.approx(1.2)
    assert branch.points[0].fundamental < cycle.fundamental < branch.points[-1].fundamental


def test_a_fold_of_cycles_that_cannot_be_located_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def one_missed(_: object, a: Place, b: Place) -> list[Missed]:
        return [Missed("fold", (a.p, b.p))]

    monkeypatch.setattr("workbench.response.periodic.continuation.between", one_missed)
    with chain() as system:
        result = limit_cycle(
            system, block="block", methods=("shooting",), vary={"block.D": (0.9, 1.2)}, in_process=True
        )
    assert [n for n in result.notes if n.startswith("block.D: a fold between the places at ")]


def cubic_loop() -> DescribedModel:
    """Return c1 u + c3 u³, c3 < 0, around three lags and a gain of 16."""
    return connect(
        {"block": "fmu:AlgebraicExpression", "lags": control.ss(LAG)},
        [("lags.y", "block.u", {"gain": -16.0}), ("block.y", "lags.u")],
        start_values={
            "block.C[1]": 0.0, "block.C[2]": 0.0, "block.D": 1.0,
            "block.c0": 0.0, "block.c1": 0.7, "block.c2": 0.0, "block.c3": -0.1,
        },
    )  # fmt: skip


def test_shooting_follows_a_cycle_to_its_hopf_point() -> None:
    """y = c1 u + c3 u³ around three lags: the equilibrium begins to oscillate at c1 = 1/2, 16 c1 = 8."""
    with cubic_loop() as system:
        result = limit_cycle(
            system, block="block", methods=("describing function", "shooting"), vary={"block.c1": (0.4, 0.72)}
        )
    (branch,) = result.branches
    (hopf,) = branch.hopf
    assert hopf.value == pytest.approx(0.5, abs=1e-6)
    assert hopf.frequency_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-6)
    assert branch.ends[0] == "the cycle shrinks to a point"
    assert branch.points[-1].value == pytest.approx(0.72)
    assert all(p.stable for p in branch.points)


@pytest.mark.parametrize("after", [2, 9], ids=["on the way up", "on the way down"])
def test_what_was_followed_is_kept_when_it_is_stopped(after: int) -> None:
    told: list[str] = []

    def stop_later(what: object, _: int, __: int) -> None:
        told.append(str(what))
        if sum(w.startswith("block.D = ") for w in told) > after:
            raise KeyboardInterrupt

    with chain() as system, pytest.raises(StoppedError) as stopped:
        limit_cycle(
            system, block="block", methods=("shooting",), vary={"block.D": (0.9, 1.2)}, progress=stop_later,
            in_process=True,
        )  # fmt: skip
    result = stopped.value.before
    assert isinstance(result, LimitCycleResult)
    (branch,) = result.branches
    assert branch.truncated
    assert "stopped; not followed further" in branch.ends
    values = [p.value for p in branch.points]
    assert values == sorted(values)
    assert 1.0 in values
    assert (max(values) == 1.2) == (branch.ends[1] == "the parameter's bound") == (min(values) < 1.0)
    assert result.operating_point is not None


def test_stopped_before_a_cycle_is_followed_what_is_known_is_kept() -> None:
    def stop(what: object, _: int, __: int) -> None:
        if what == "crossings":
            raise KeyboardInterrupt

    with chain() as system, pytest.raises(StoppedError) as stopped:
        limit_cycle(system, block="block", vary={"block.D": (0.9, 1.2)}, progress=stop, in_process=True)
    result = stopped.value.before
    assert isinstance(result, LimitCycleResult)
    assert result.crossings


def test_the_cycle_of_the_failed_aileron_over_its_damper() -> None:
    """71 states, and a damper with the moment alpha2·w·|w|: the cycle keeps its form and alpha2 times its amplitude."""
    begin = 7000.0
    with wb.load("system:failed_aileron") as system:
        result = limit_cycle(
            system, block="damper", methods=("describing function", "shooting"), band=(2.6, 2.7),
            vary={"damper.alpha2": (6500.0, 7500.0)},
        )  # fmt: skip
    (cycle,) = (c for c in result.limit_cycles if c.method == "shooting")
    (branch,) = result.branches
    assert branch.ends == ("the parameter's bound", "the parameter's bound")
    for p in branch.points:
        assert p.amplitude * p.value == pytest.approx(cycle.amplitude * begin, rel=1e-4)
        assert p.frequency_hz == pytest.approx(cycle.frequency_hz, rel=1e-6)
        assert p.stable
    assert len(branch.points) < 30  # a branch of many states takes no more places than one of few


def test_a_cycle_that_grows_without_bound_has_no_folds_by_rounding() -> None:
    """A play around 3/(s (s + 1)): without it s (s + 1)(s + 10) + 60 g is unstable from g = 110/60 on."""
    plant = control.ss(control.tf([1.0], [1.0, 1.0, 0.0]))
    with connect(
        {"block": "fmu:Hysteresis", "plant": plant},
        [("plant.y", "block.u", {"gain": -3.0}), ("block.y", "plant.u")],
    ) as system:
        result = limit_cycle(
            system, block="block", methods=("describing function", "shooting"), band=(0.02, 10.0),
            amplitudes=(0.55, 50.0), vary={"block.halfWidth": (0.4, 0.6), "gain": (0.9, 3.0)}, in_process=True,
        )  # fmt: skip
    (cycle,) = (c for c in result.limit_cycles if c.method == "shooting")
    over_play, over_gain = result.branches
    for p in over_play.points:  # nothing else has a size
        assert p.amplitude / p.value == pytest.approx(cycle.amplitude / 0.5, rel=1e-6)
        assert p.frequency_hz == pytest.approx(cycle.frequency_hz, rel=1e-6)
    assert over_gain.folds == over_gain.bifurcations == ()
    assert over_gain.ends == ("the parameter's bound", "the cycle grows beyond 1000 times the first one")
    values = [p.value for p in over_gain.points]
    assert values == sorted(values)
    assert values[-1] == pytest.approx(110.0 / 60.0, rel=1e-3)
    assert values[-1] < 110.0 / 60.0


def test_two_blocks_whose_cycle_no_crossing_predicts_to_their_hopf_point() -> None:
    """x' = y − F(x), y' = −x − x³/2 with F = c x + x³/3: at the cycle the gain of F is zero, and L infinite there."""
    cubic = "fmu:AlgebraicExpression"
    both = {f"{n}.{name}": value for n in "fg" for name, value in (("C[1]", 0.0), ("C[2]", 0.0), ("D", 1.0))}
    plant = control.ss([[0.0]], [[1.0, -1.0]], [[1.0]], [[0.0, 0.0]], inputs=["a", "b"], outputs=["y"])
    with connect(
        {"f": cubic, "g": cubic, "x": plant, "y": control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]])},
        [("x.y", "f.u"), ("x.y", "g.u"), ("f.y", "x.b"), ("y.y", "x.a"), ("g.y", "y.u", {"gain": -1.0})],
        start_values={
            **both, "f.c0": 0.0, "f.c1": -0.5, "f.c2": 0.0, "f.c3": 1.0 / 3.0,
            "g.c0": 0.0, "g.c1": 1.0, "g.c2": 0.0, "g.c3": 0.5,
        },
    ) as system:  # fmt: skip
        result = limit_cycle(system, block=("f", "g"), band=(0.02, 5.0), vary={"f.c1": (-0.7, 0.3)}, in_process=True)
    assert result.crossings == () or all(c.amplitude is None for c in result.crossings)
    (cycle,) = (c for c in result.limit_cycles if c.method == "shooting")
    run = solve_ivp(
        lambda _, z: [z[1] + 0.5 * z[0] - z[0] ** 3 / 3.0, -z[0] - 0.5 * z[0] ** 3], (0.0, 120.0), [1.0, 0.0],
        method="DOP853", rtol=1e-10, atol=1e-12, events=lambda _, z: z[1],
    )  # fmt: skip
    assert run.t_events is not None
    assert cycle.frequency_hz == pytest.approx(10.0 / (run.t_events[0][-1] - run.t_events[0][-21]), rel=1e-6)
    (hopf,) = result.branches[0].hopf
    assert hopf.value == pytest.approx(0.0, abs=1e-6)
    assert hopf.frequency_hz == pytest.approx(0.5 / math.pi, rel=1e-6)
