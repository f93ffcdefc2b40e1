"""Parameters that meet requirements: derivatives, the search beside closed forms, points, conflicts, files."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag

import workbench as wb
from scripts.promises.conflicts import feasible, named, planted
from scripts.promises.tune import (  # fmt: skip
    best_of_grid,
    disturbance_limit,
    published,
    random_loop,
    tuned_loop,
    two_requirements,
    worst_of,
)
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.study.requirements import KINDS
from workbench.study.requirements.margins import DelayMargin, GainMargin
from workbench.study.requirements.norms import HInfinityNorm
from workbench.study.requirements.response import Mask
from workbench.study.tune.family import LinearFamily, Member
from workbench.study.tune.minimax import SmoothPiece, minimax
from workbench.study.tune.page import tune_page
from workbench.study.tune.readings import closed_poles, readings
from workbench.system.description import BlockComponent, GainComponent

HERE = Workers(in_process=True)
LIMITS = (np.full(2, -10.0), np.full(2, 10.0))


def piece(value: float, slope: list[float], owner: int = 0, place: complex = 1.0) -> SmoothPiece:
    return SmoothPiece(value, np.array(slope), place, owner)


# -- the least maximum -----------------------------------------------------------------------------


def charalambous(z: Floats) -> list[SmoothPiece]:
    """Charalambous and Conn's second problem, whose least maximum is 1.9522245."""
    a, b = z.tolist()
    e = 2.0 * math.exp(b - a)
    return [
        piece(a * a + b**4, [2.0 * a, 4.0 * b**3], place=1.0),
        piece((2.0 - a) ** 2 + (2.0 - b) ** 2, [2.0 * (a - 2.0), 2.0 * (b - 2.0)], place=2.0),
        piece(e, [-e, e], place=3.0),
    ]


def curved(z: Floats) -> list[SmoothPiece]:
    """Rosenbrock's function with a kink along its valley."""
    a, b = z.tolist()
    return [
        piece(s * 8.0 * (b - a * a) + (1.0 - a) ** 2, [-16.0 * s * a - 2.0 * (1.0 - a), 8.0 * s], place=s)
        for s in (1.0, -1.0)
    ]


def smooth(z: Floats) -> list[SmoothPiece]:
    a, b = z.tolist()
    return [piece(100.0 * (b - a * a) ** 2 + (1.0 - a) ** 2,
                  [-400.0 * a * (b - a * a) - 2.0 * (1.0 - a), 200.0 * (b - a * a)])]  # fmt: skip


@pytest.mark.parametrize(("problem", "least"), [(charalambous, 1.9522245), (curved, 0.0), (smooth, 0.0)])
def test_the_least_maximum_of_known_problems(problem: Callable[[Floats], list[SmoothPiece]], least: float) -> None:
    found = minimax(problem, np.array([-1.2, 1.0]), LIMITS)
    assert found is not None
    assert found.converged
    assert found.value == pytest.approx(least, abs=1e-5)


def test_hard_pieces_are_met_and_their_multipliers_are_known() -> None:
    def problem(z: Floats) -> list[SmoothPiece]:
        a, b = z.tolist()
        distance = piece((a - 2.0) ** 2 + (b - 1.0) ** 2, [2.0 * (a - 2.0), 2.0 * (b - 1.0)])
        return [distance, piece(a * a - b, [2.0 * a, -1.0], 1), piece(a + b - 2.0, [1.0, 1.0], 2)]

    found = minimax(problem, np.array([3.0, 3.0]), LIMITS, hard=frozenset([1, 2]))
    assert found is not None
    assert found.z == pytest.approx([1.0, 1.0], abs=1e-5)
    assert found.hard <= 1e-8
    assert [found.weights[k] for k in (1, 2)] == pytest.approx([2.0 / 3.0, 2.0 / 3.0], rel=1e-3)


def test_where_nothing_is_defined_is_not_entered() -> None:
    def problem(z: Floats) -> list[SmoothPiece] | None:
        return None if z[0] < 0.5 else [piece(float(z[0] ** 2 + z[1] ** 2), (2.0 * z).tolist())]

    found = minimax(problem, np.array([3.0, 3.0]), LIMITS)
    assert found is not None
    assert 0.5 <= found.z[0] < 0.51
    assert minimax(problem, np.array([0.0, 3.0]), LIMITS) is None


# -- derivatives -----------------------------------------------------------------------------------

VALUES = {"c.proportional": 0.3, "c.integral": 0.2, "c.derivative": 0.05, "c.filter": 0.1, "l.lead": 0.2, "g.gain": 0.4}
KINDS_OF_LIN: dict[str, dict[str, Any]] = {
    "stability": {"max": 0.0}, "damping": {"min": 0.5}, "pole frequency": {"min": 1.0},
    "h-infinity norm": {"max": 1.0}, "h2 norm": {"max": 1.0},
    "gain": {"max": 1.0, "frequency": 0.3}, "phase": {"max": 1.0, "frequency": 0.3},
    "mask": {"upper": [[0.01, -3.0], [1.0, 3.0], [10.0, -20.0]]},
    "bandwidth": {"min": 1.0, "reference": -20.0}, "bandwidth by phase": {"min": 1.0, "criterion": "phase"},
}  # fmt: skip
KINDS_OF_LOOP: dict[str, dict[str, Any]] = {
    "gain margin": {"min": 6.0}, "phase margin": {"min": 45.0}, "delay margin": {"min": 0.1},
    "disk margin": {"min": 0.5}, "peak sensitivity": {"max": 2.0},
}  # fmt: skip


def family(*, loop: bool) -> LinearFamily:
    """A random stable system of order 4 with a PID controller, a lead–lag and a gain in it; a loop of order 3."""
    random = np.random.default_rng(3)
    n = 4
    a, b, c = random.normal(size=(n, n)) - 5.0 * np.eye(n), random.normal(size=(n, 4)), random.normal(size=(4, n))
    d = np.zeros((4, 4))
    d[1:, 1:] = 0.1 * random.normal(size=(3, 3))
    c[1] *= -np.sign((c[1] @ np.linalg.solve(-a, b[:, 1])) or 1.0)  # so that the integral is stable
    if loop:  # 20/(s + 1)³ beside it
        a, b, c = (np.asarray(m) for m in (np.diag([1.0, 1.0], 1) - np.eye(3), np.zeros((3, 4)), np.zeros((4, 3))))
        b[2, 0], b[2, 1:], c[0, 0], c[1:, 0] = 5.0, [1.0, 0.5, 0.5], -1.0, [-0.5, 0.3, 0.2]
    rest = wb.Linear(
        a, b, c, d, input_names=("u", "v1", "v2", "v3"), output_names=("y", "e1", "e2", "e3")
    )  # fmt: skip
    blocks = (BlockComponent(name="c", kind="pid"), BlockComponent(name="l", kind="lead_lag"), GainComponent(name="g"))
    return LinearFamily(rest, blocks, {}, -1.0 if loop else 1.0)


def least(kind: str, options: dict[str, Any], member: Member) -> tuple[float, Floats]:
    """The least distance from the limit, and its derivative by [A B; C D]."""
    name = kind.removesuffix(" by phase")
    requirement = KINDS[name](name="r", analysis="a", kind=name, **options)
    found = min(readings(requirement, member), key=lambda r: r.value)
    return found.value, found.weight


@pytest.mark.parametrize(
    ("kind", "options", "loop"),
    [*((k, o, False) for k, o in KINDS_OF_LIN.items()), *((k, o, True) for k, o in KINDS_OF_LOOP.items())],
)
def test_derivatives_are_those_of_differences(kind: str, options: dict[str, Any], loop: bool) -> None:
    of = family(loop=loop)
    assert all(r.value < 0.0 for r in closed_poles(of.at(VALUES), loop=loop))
    _, weight = least(kind, options, of.at(VALUES))
    exact = of.at(VALUES).slope(weight, list(VALUES))
    width = 1e-4
    for k, name in enumerate(VALUES):
        ends = [least(kind, options, of.at({**VALUES, name: VALUES[name] + s * width}))[0] for s in (1.0, -1.0)]
        assert exact[k] == pytest.approx((ends[0] - ends[1]) / (2.0 * width), abs=1e-3 * np.abs(exact).max() + 1e-9)


@pytest.mark.parametrize(("kind", "options", "loop"), [
    *((k, KINDS_OF_LIN[k], False) for k in ("h-infinity norm", "mask")),
    *((k, o, True) for k, o in KINDS_OF_LOOP.items()),
])  # fmt: skip
def test_modes_that_nothing_moves_change_no_reading(kind: str, options: dict[str, Any], loop: bool) -> None:
    """With them the grids of the open and the closed loop are one but for rounding, so that no point is highest."""
    for seed in range(20):
        value = 0.05 + 0.9 * np.random.default_rng(seed).random(len(VALUES))
        of = family(loop=loop)
        member = of.at(dict(zip(VALUES, value.tolist(), strict=True)))
        if any(r.value >= 0.0 for r in closed_poles(member, loop=loop)):
            continue
        rest, n = of.rest, len(of.rest.A) + 2
        turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))
        A = turn @ block_diag(rest.A, [[-1e-2]], [[-1e3]]) @ turn.T
        B, C = turn[:, : n - 2] @ rest.B, np.hstack([rest.C, np.ones((len(rest.C), 2))]) @ turn.T
        hidden = replace(of, rest=replace(rest, A=A, B=B, C=C))
        besides = hidden.at(dict(zip(VALUES, value.tolist(), strict=True)))
        assert least(kind, options, besides)[0] == pytest.approx(least(kind, options, member)[0], rel=1e-4, abs=1e-5)


def test_poles_of_a_closed_loop_move_as_differences_say() -> None:
    of = family(loop=True)

    def rightmost(values: dict[str, float]) -> Any:  # noqa: ANN401
        return max(closed_poles(of.at(values), loop=True), key=lambda r: r.value)

    exact = of.at(VALUES).slope(rightmost(VALUES).weight, list(VALUES))
    for k, name in enumerate(VALUES):
        ends = [rightmost({**VALUES, name: VALUES[name] + s}).value for s in (1e-5, -1e-5)]
        assert exact[k] == pytest.approx((ends[0] - ends[1]) / 2e-5, abs=1e-5)


# -- beside what is known --------------------------------------------------------------------------


def test_the_published_feedback_of_a_helicopter() -> None:
    assert published("HE1", starts=0) == pytest.approx(0.1538, rel=1e-3)


def test_a_loop_that_is_unstable_at_first_is_as_good_as_a_grid() -> None:
    loop = random_loop(3, 3)
    limit = disturbance_limit(loop)
    found = tuned_loop(loop, two_requirements(loop))
    at = np.array([[p.value for p in found.parameters]])
    assert found.objective == pytest.approx(float(worst_of(loop, at, limit)[0]), rel=1e-3)
    grid, _ = best_of_grid(loop, lambda gains: worst_of(loop, gains, limit), 2)
    assert found.objective is not None
    assert 1.0 + found.objective <= 1.02 * (1.0 + grid)


@pytest.mark.parametrize("number", [0, 7])
def test_requirements_that_exclude_each_other_are_named(number: int) -> None:
    case = planted(number)
    pair, excess = named(case)
    assert pair == case.pair
    assert excess == pytest.approx(case.excess, abs=0.05)  # beside a grid


def test_no_conflict_is_told_where_there_is_none() -> None:
    case = feasible(0)
    assert case.excess < 0.0
    assert named(case) == (frozenset(), 0.0)


# -- whole tunings ---------------------------------------------------------------------------------

SYSTEM = """# A lag with a gain.
[components]
error = {sum = "+-"}
gain = 1.0   # to be tuned
lag = {model = "fmu:FirstOrderLag", set = {tau = 1.0}}
[connections]
"gain.u" = "error.y"
"lag.u" = "gain.y"
"error.u2" = "lag.y"
[inputs]
r = "error.u1"
[outputs]
y = "lag.y"
e = "error.y"
"""
STUDY = """
[models]
loop = "loop.toml"
[analyses]
linear = {command = "lin", model = "loop"}
"""
QUICK = '[[requirements]]\nname = "quick"\nanalysis = "linear"\nkind = "stability"\nmax = -4.0\n'


@pytest.fixture
def tuned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., wb.TuneResult]:
    monkeypatch.chdir(tmp_path)

    def made(study: str, free: dict[str, Any] | None = None, **asked: Any) -> wb.TuneResult:  # noqa: ANN401
        Path("loop.toml").write_text(SYSTEM, encoding="utf-8")
        Path("wanted.toml").write_text(STUDY + study, encoding="utf-8")
        given = {"keep": False, "workers": HERE, "starts": 0, **asked}
        return wb.tune(
            "loop.toml", free={"gain.gain": (0.1, 10.0)} if free is None else free, study="wanted.toml", **given
        )

    return made


def test_several_points_and_a_file_with_its_comments(tuned: Callable[..., wb.TuneResult]) -> None:
    # The pole is −(1 + k)/τ; the error of a step 1/(1 + k), its gain 20 log10 of that. The slowest counts.
    effort = '[[requirements]]\nname = "soft"\nanalysis = "linear"\nkind = "gain"\ninput = "r"\noutput = "y"\n'
    study = QUICK + effort + "frequency = 1e-4\nmax = -1.0\n" + '[grid]\nloop."lag.tau" = [0.5, 2.0]\n'
    found = tuned(study, out="tuned.toml")
    k = found.values["gain.gain"]
    slow = next(r for r in found.requirements if r.name == "quick" and "2" in r.at)
    assert slow.after == pytest.approx(-(1.0 + k) / 2.0, rel=1e-9)
    soft = 20.0 * math.log10(k / (1.0 + k))
    assert -(1.0 + k) / 2.0 / 4.0 + 1.0 == pytest.approx((soft + 1.0) / 6.0, abs=1e-4)  # both are equally far
    assert found.objective == pytest.approx((soft + 1.0) / 6.0, abs=1e-4)
    assert {r.name for r in found.requirements if r.active} == {"quick", "soft"}
    text = Path("tuned.toml").read_text()
    assert "# to be tuned" in text
    with wb.load("tuned.toml") as system:
        assert wb.lin(system).result.poles == pytest.approx([-(1.0 + k)])
    assert wb.TuneResult.from_dict(found.to_dict()).to_dict() == found.to_dict()
    # The page: no column without a heading, units behind both values, and a parameter at its limit is not green.
    (only,) = found.parameters
    held = replace(found, parameters=(replace(only, at_bound=True),))
    assert "watch" not in {v.word for v in tune_page(found).summary}
    assert [v.text for v in tune_page(held).summary if v.word == "watch"] == [
        f"gain.gain = {k:.5g} is held by its limit"
    ]
    tables = [t for s in tune_page(found).sections for t in s.tables]
    assert all(heading for t in tables for heading in t.headings)
    row = next(r for t in tables for r in t.rows if r[0].startswith("soft"))
    assert row[1].endswith(" dB")
    assert row[2].endswith(" dB")


def test_where_nothing_is_measured_no_file_is_written(tuned: Callable[..., wb.TuneResult]) -> None:
    with pytest.raises(
        wb.SimulationError, match=r"no requirement could be measured, and tuned\.toml was not written"
    ) as e:
        tuned(
            QUICK.replace("stability", "damping").replace("max = -4.0", "min = 0.5\nband = [100.0, 200.0]"),
            out="tuned.toml",
        )
    assert isinstance(e.value.before, wb.TuneResult)
    assert not Path("tuned.toml").exists()


def test_a_parameter_of_an_fmu_is_linearised_anew(tuned: Callable[..., wb.TuneResult]) -> None:
    found = tuned(QUICK, {"lag.tau": (0.05, 2.0)})
    assert found.passed
    assert found.values["lag.tau"] <= 0.5  # the pole is −2/τ
    assert found.requirements[0].linear


def test_measured_requirements_are_searched_for(tuned: Callable[..., wb.TuneResult]) -> None:
    # After one second y = k/(1 + k) (1 − exp(−(1 + k))): at least 0.8 with k = 4.13.
    study = (
        'step = {command = "simulate", model = "loop", stop = 1.0, input = {r = 1.0}, output = ["y"]}\n'
        '[[requirements]]\nname = "there"\nanalysis = "step"\nkind = "final value"\nmin = 0.8\n'
    )
    found = tuned(study)
    k = found.values["gain.gain"]
    assert found.passed
    assert not found.requirements[0].linear
    assert found.requirements[0].after == pytest.approx(k / (1.0 + k) * (1.0 - math.exp(-1.0 - k)), abs=1e-5)


def test_the_worst_of_an_envelope_is_added(tuned: Callable[..., wb.TuneResult]) -> None:
    spread = '[envelope]\nsearch = 0\nparameters = {"loop.lag.tau" = {range = [0.5, 3.0], steps = 3}}\n'
    found = tuned(QUICK + spread)
    assert found.added == ("loop.lag.tau = 3",)
    assert found.conflict is not None
    assert found.conflict.requirements == ("quick",)
    slowest = next(r for r in found.requirements if r.at)
    assert slowest.after == pytest.approx(-(1.0 + found.values["gain.gain"]) / 3.0, rel=1e-9)
    assert float(found.values["gain.gain"]) == pytest.approx(10.0)  # −11/3 is as near as it can come


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"free": {"gain.gian": None}}, "gian"),
        ({"hard": ["fast"]}, "there is no requirement 'fast'"),
        ({"out": "tuned.fmu"}, "needs a sample period"),
        ({"out": "tuned.txt"}, "none of .toml"),
        ({"free": {}}, "name a parameter"),
    ],
)
def test_what_cannot_be_asked(tuned: Callable[..., wb.TuneResult], asked: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        tuned(QUICK, **asked)


def test_a_study_of_another_system_is_refused(tuned: Callable[..., wb.TuneResult]) -> None:
    tuned(QUICK)
    with pytest.raises(InputError, match="has no model"):
        wb.tune("system:rudder_loop", free={"gain.gain": None}, study="wanted.toml")


DIPPING = """
[components]
error = {sum = "+-"}
pi = {block = "pi", proportional = 0.5, integral = 0.1}
a = {block = "lead_lag", gain = 1.0, lead = 0.0, lag = 1.0}
b = {block = "lead_lag", gain = 1.0, lead = 0.0, lag = 1.0}
c = {block = "lead_lag", gain = 1.0, lead = 0.0, lag = 1.0}
[connections]
"error.u2" = "c.y"
"pi.u" = "error.y"
"a.u" = "pi.y"
"b.u" = "a.y"
"c.u" = "b.y"
[inputs]
r = "error.u1"
[outputs]
y = "c.y"
"""
WANTED = """
models.loop = "dipping.toml"
analyses.margins = {command = "loop", model = "loop", open = "pi.y"}
analyses.lin = {command = "lin", model = "loop"}
requirements = [
    {name = "phase", analysis = "margins", kind = "phase margin", min = 60},
    {name = "bandwidth", analysis = "lin", kind = "bandwidth", min = 0.12},
]
"""


def test_a_bandwidth_that_jumps_where_a_dip_touches_its_level_is_reached(tmp_path: Path) -> None:
    """With P = 1.1 and I = 0.35 both are met; on the way there |T| dips to −3 dB at a third of the bandwidth."""
    (tmp_path / "dipping.toml").write_text(DIPPING, encoding="utf-8")
    (tmp_path / "wanted.toml").write_text(WANTED, encoding="utf-8")
    free = {"pi.proportional": (0.01, 10.0), "pi.integral": (0.001, 5.0)}
    found = wb.tune(tmp_path / "dipping.toml", free=free, study=tmp_path / "wanted.toml", starts=0, workers=HERE)
    assert [r.passed for r in found.requirements] == [True, True]
    p, i = (q.value for q in found.parameters)
    s = 2j * np.pi * np.geomspace(1e-4, 0.12, 2000)
    loop = (p + i / s) / (s + 1.0) ** 3
    assert np.abs(loop / (1.0 + loop)).min() > 10.0 ** (-3.0 / 20.0)


@pytest.mark.parametrize("phase", [40, 45, 50, 55, 60, 65])
def test_what_is_hard_is_met_where_the_rest_cannot_be(tmp_path: Path, phase: int) -> None:
    """The phase margin is all that holds the bandwidth back: it ends at its limit, and a study knows no nearly."""
    (tmp_path / "dipping.toml").write_text(DIPPING, encoding="utf-8")
    wanted = WANTED.replace("min = 60", f"min = {phase}").replace("min = 0.12", "min = 5.0")
    (tmp_path / "wanted.toml").write_text(wanted, encoding="utf-8")
    found = wb.tune(
        tmp_path / "dipping.toml", free={"pi.proportional": (0.01, 10.0), "pi.integral": (0.001, 5.0)},
        study=tmp_path / "wanted.toml", starts=0, hard=["phase"], workers=HERE,
    )  # fmt: skip
    margin, bandwidth = found.requirements
    assert not bandwidth.passed
    assert margin.passed
    assert margin.after == pytest.approx(phase, rel=1e-5)


HELD = """
[components]
error = {sum = "+-"}
shape = {block = "lead_lag", gain = 1.0, lead = 1.0, lag = 0.1}
plant = {block = "transfer_function", numerator = [1.0, 0.0], denominator = [1.0, -0.2, 1.0]}
[connections]
"error.u2" = "plant.y"
"shape.u" = "error.y"
"plant.u" = "shape.y"
[inputs]
r = "error.u1"
[outputs]
y = "plant.y"
"""


def test_a_phase_that_may_rise_least_is_led_away_from_the_border(tmp_path: Path) -> None:
    """The rate of an oscillator that grows is fed back: the loop is stable, and at its lower crossing ahead by 53°."""
    (tmp_path / "held.toml").write_text(HELD, encoding="utf-8")
    (tmp_path / "wanted.toml").write_text(
        'models.loop = "held.toml"\nanalyses.margins = {command = "loop", model = "loop", open = "plant.y"}\n'
        'requirements = [{name = "phase", analysis = "margins", kind = "phase margin", min = 60}]\n', encoding="utf-8",
    )  # fmt: skip
    found = wb.tune(tmp_path / "held.toml", free={"shape.lead": (0.01, 5.0)}, study=tmp_path / "wanted.toml", starts=0,
                    workers=HERE)  # fmt: skip
    (phase,) = found.requirements
    assert phase.before == pytest.approx(53.2, abs=0.1)
    assert phase.passed
    s = 1j * np.geomspace(0.01, 300.0, 200_000)
    loop = (found.values["shape.lead"] * s + 1.0) / (0.1 * s + 1.0) * s / (s**2 - 0.2 * s + 1.0)
    crossed = np.flatnonzero((np.abs(loop[1:]) > 1.0) != (np.abs(loop[:-1]) > 1.0))
    assert np.degrees(np.abs(np.angle(-loop[crossed]))).min() == pytest.approx(phase.after, abs=0.01)


def test_a_mask_between_the_points_and_a_slow_unstable_pole_are_read_as_in_a_study() -> None:
    w, zeta = 2.0 * math.pi * 3.333, 1e-5
    A = np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]])
    none = np.zeros((3, 0))
    b, c, d = np.array([[0.0], [w * w]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))
    system = wb.Linear(A, b, c, d, input_names=("u",), output_names=("y",))
    member = Member(system, none, none.T, {}, {})
    mask = Mask(name="r", analysis="a", kind="mask", upper=[[0.1, 45.0], [100.0, 45.0]])
    peak = -20.0 * math.log10(2.0 * zeta)
    assert min(r.value for r in readings(mask, member)) == pytest.approx(45.0 - peak, abs=1e-3)
    stiff = wb.Linear(np.diag([-2e5, 1e-4]), np.ones((2, 1)), np.ones((1, 2)), d)
    assert max(r.value for r in closed_poles(Member(stiff, none, none.T, {}, {}), loop=False)) == pytest.approx(1e-4)


def test_limits_on_the_other_side_count_where_the_number_is() -> None:
    """Two peaks, 5 and 10 high, and two crossings: the norm is 10, the gain margin the smaller one."""
    none = np.zeros((4, 0))

    def mode(w: float, high: float) -> tuple[Floats, Floats, Floats]:
        zeta = 0.5 / high
        return np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]), np.array([[0.0], [w * w]]), np.array([[1.0, 0.0]])

    (a1, b1, c1), (a2, b2, c2) = mode(1.0, 5.0), mode(1000.0, 10.0)
    system = wb.Linear(
        block_diag(a1, a2), np.vstack([b1, b2]), np.hstack([c1, c2]), np.zeros((1, 1)),
        input_names=("u",), output_names=("y",),
    )  # fmt: skip
    member = Member(system, none, none.T, {}, {})

    def norm(low: float | None = None, high: float | None = None, equal: float | None = None) -> list[float]:
        asked = HInfinityNorm(
            name="r", analysis="a", kind="h-infinity norm", min=low, max=high, equal=equal, tolerance=0.5
        )
        return sorted(r.value for r in readings(asked, member))

    assert norm(low=8.0) == pytest.approx([2.0], abs=0.02)
    assert norm(equal=10.0) == pytest.approx([0.5], abs=0.02)
    assert norm(high=8.0)[0] == pytest.approx(-2.0, abs=0.02)
    lag = wb.Linear(np.array([[-1.0]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    loop = Member(lag, none[:1], none.T[:, :1], {}, {})  # which never crosses −180°
    wide, narrow = (
        GainMargin(name="r", analysis="a", kind="gain margin", min=low, max=high)
        for low, high in ((6.0, None), (None, 60.0))
    )
    assert [r.value for r in readings(wide, loop)] == [math.inf]
    assert [r.value for r in readings(narrow, loop)] == [-math.inf]
    direct = wb.Linear(np.array([[-1.0]]), np.ones((1, 1)), np.ones((1, 1)), np.array([[1.5]]))
    delay = DelayMargin(name="r", analysis="a", kind="delay margin", min=0.01)
    asked = readings(delay, Member(direct, none[:1], none.T[:, :1], {}, {}))
    assert min(r.value for r in asked) == pytest.approx(-0.01)


def test_a_peak_narrower_than_the_parts_of_its_neighbourhood_is_kept() -> None:
    """A mode of damping 1e-6 on the slope of a lag: |G| at it is known, and is the norm."""
    w, zeta, none = 2.0 * math.pi * 3.333, 1e-6, np.zeros((4, 0))
    A = np.array([[0.0, 1.0, 0.0], [-w * w, -2.0 * zeta * w, 0.0], [0.0, 0.0, -0.5]])
    b, c, d = np.array([[0.0], [1e-3 * w * w], [0.5]]), np.array([[1.0, 0.0, 3.0]]), np.zeros((1, 1))
    member = Member(wb.Linear(A, b, c, d, input_names=("u",), output_names=("y",)), none, none.T, {}, {})
    norm = HInfinityNorm(name="r", analysis="a", kind="h-infinity norm", max=1000.0)
    assert min(r.value for r in readings(norm, member)) == pytest.approx(1000.0 - 1e-3 / (2.0 * zeta), abs=1.0)
