"""Branches of periodic responses, against SciPy's integration of the same equations."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import workbench as wb
from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.lin_fmus import built
from workbench.cli.app import run
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.response.branches.family import ForcedPeriodMaps
from workbench.response.branches.request import Branches
from workbench.response.branches.run import _BranchSearch, explore
from workbench.response.periodic.monodromy import instants


def duffing(
    x: Floats, f: float, amplitude: float, k: tuple[float, float, float], periods: int = 1
) -> tuple[Floats, Floats]:
    """Return the states after some periods of x″ + k₀x′ + k₁x + k₂x³ = amplitude·sin, and their derivative."""

    def slope(t: float, z: Floats) -> Floats:
        p = z[2:].reshape(2, 2)
        a = np.array([[0.0, 1.0], [-k[1] - 3.0 * k[2] * z[0] ** 2, -k[0]]])
        dv = amplitude * math.sin(2.0 * math.pi * f * t) - k[0] * z[1] - k[1] * z[0] - k[2] * z[0] ** 3
        return np.array([z[1], dv, *(a @ p).ravel()])

    end = solve_ivp(slope, (0.0, periods / f), [*x, 1.0, 0.0, 0.0, 1.0], method="DOP853", rtol=1e-12, atol=1e-13).y[
        :, -1
    ]
    return end[:2], end[2:].reshape(2, 2)


HARDENING = (0.05, 1.0, 1.0)
UEDA = (0.1, 0.0, 1.0)


@cache
def hardening() -> wb.BranchesResult:
    with wb.load("fmu:Duffing", tolerance=1e-9) as model:
        return wb.branches(model, "u", "y", [0.1], band=(0.1, 0.4), frequencies=[0.207], onset=True)


def from_fundamental(gain: float, phase_deg: float, f: float, amplitude: float) -> Floats:
    w, angle = 2.0 * math.pi * f, math.radians(phase_deg)
    return gain * amplitude * np.array([math.sin(angle), w * math.cos(angle)])


def test_the_folds_are_those_of_the_equation() -> None:
    folds = hardening().folds
    assert [f.kind for f in folds] == ["fold", "fold"]
    for fold in folds:
        x = from_fundamental(fold.gain, fold.phase_deg, fold.frequency_hz, 0.1)

        def misses(z: Floats) -> Floats:
            end, phi = duffing(z[:2], z[2], 0.1, HARDENING)
            return np.array([*(end - z[:2]), np.linalg.det(phi - np.eye(2))])

        truth = fsolve(misses, [*x, fold.frequency_hz], xtol=1e-11)
        assert np.abs(misses(truth)).max() < 1e-8
        assert fold.frequency_hz == pytest.approx(truth[2], rel=1e-6)


def test_between_the_folds_there_are_three_responses() -> None:
    (branch,) = hardening().branches
    places = branch.places_at(0.207)
    assert [bool(branch.stable[i]) for i in places] == [True, False, True]
    for i in places:
        x = from_fundamental(branch.gain[i], branch.phase_deg[i], 0.207, 0.1)
        orbit = fsolve(lambda z: duffing(z, 0.207, 0.1, HARDENING)[0] - z, x, xtol=1e-12)
        largest = np.abs(np.linalg.eigvals(duffing(orbit, 0.207, 0.1, HARDENING)[1])).max()
        assert max(map(abs, branch.multipliers[i])) == pytest.approx(largest, rel=1e-3)
        points = np.arange(400) / 400 / 0.207
        y = solve_ivp(
            lambda t, z: [z[1], 0.1 * math.sin(2 * math.pi * 0.207 * t) - 0.05 * z[1] - z[0] - z[0] ** 3],
            (0.0, 1.0 / 0.207), orbit, t_eval=points, method="DOP853", rtol=1e-11, atol=1e-12,
        ).y[0]  # fmt: skip
        gain = 2.0 * abs(np.mean(y * np.exp(-2j * math.pi * 0.207 * points))) / 0.1
        assert branch.gain[i] == pytest.approx(gain, rel=1e-5)


def test_it_begins_to_jump_where_the_folds_meet() -> None:
    onset = hardening().onset
    assert onset is not None
    # One harmonic: (w² − 1 − ¾A²)² + (0.05w)² = (F/A)² has a cusp at 0.01709.
    assert onset.amplitude == pytest.approx(0.01709, rel=5e-3)
    assert onset.frequency_hz == pytest.approx(0.1662, rel=1e-3)
    assert np.all(onset.curve_hz[:, 1] >= onset.curve_hz[:, 0])


def test_the_first_two_doublings_are_those_of_the_equation() -> None:
    f = 0.5 / math.pi
    asked = Branches(input="u", output="y", vary={"amplitude": (4.0, 6.0)}, frequencies=[f], order=2, seeds=2)
    with wb.load("fmu:Duffing", start_values={"stiffness": 0.0, "damping": 0.1}, tolerance=1e-10) as model:
        family = ForcedPeriodMaps(model, "u", "y", "amplitude", 4.0, 6.0, f, 1.0)
        tracks = explore(family, asked)
    doublings = [(fam, s) for fam, track in tracks for s in track.special if s.kind == "period doubling"]
    found = {1: math.nan, 2: math.nan}
    for fam, special in doublings:
        if fam.order not in found:
            continue

        def misses(z: Floats, order: int = fam.order) -> Floats:
            end, phi = duffing(z[:2], f, z[2], UEDA, order)
            return np.array([*(end - z[:2]), np.linalg.det(phi + np.eye(2))])

        truth = fsolve(misses, [*special.place.x, fam.value(special.place.p)], xtol=1e-11)
        assert np.abs(misses(truth)).max() < 1e-6
        assert fam.value(special.place.p) == pytest.approx(truth[2], rel=1e-4)
        found[fam.order] = truth[2]
    assert found[1] == pytest.approx(4.87609, abs=1e-4)
    assert found[2] == pytest.approx(5.43954, abs=1e-4)


def test_an_isola_of_three_periods_is_found_from_random_states() -> None:
    with wb.load("fmu:Duffing", start_values={"stiffness": 0.0, "damping": 0.1}, tolerance=1e-9) as model:
        found = wb.branches(
            model, "u", "y", vary={"amplitude": (1.2, 1.8)}, frequencies=[0.5 / math.pi], order=3, seeds=12
        )
    (isola,) = [b for b in found.branches if b.order == 3 and b.closed]
    assert isola.varied.min() == pytest.approx(1.3786, abs=2e-3)
    assert isola.varied.max() == pytest.approx(1.6693, abs=3e-3)
    assert 0 < isola.stable.sum() < len(isola.stable)


# A forced lag beside a Hopf bifurcation at mu = 0 and a pitchfork z = ±√(mu − 0.2), which nothing couples.
PITCHFORK = """model Pitchfork
 input Real u(start = 0);
 output Real y;
 parameter Real mu = -0.3;
 Real a(start = 0, fixed = true);
 Real b(start = 0, fixed = true);
 Real z(start = 0, fixed = true);
 Real x(start = 0, fixed = true);
equation
 der(a) = mu*a - 2.3*b - a*(a*a + b*b);
 der(b) = mu*b + 2.3*a - b*(a*a + b*b);
 der(z) = (mu - 0.2)*z - z^3;
 der(x) = u - x;
 y = x + z;
end Pitchfork;
"""


def test_a_torus_and_crossing_branches_are_located_and_the_crossing_ones_followed() -> None:
    with wb.load(built(PITCHFORK, "Pitchfork"), "me", tolerance=1e-9) as model:
        found = wb.branches(model, "u", "y", [1.0], frequencies=[0.5], vary={"mu": (-0.5, 0.5)}, seeds=0)
    torus, crossing = sorted(found.folds, key=lambda f: f.varied)
    assert (torus.kind, crossing.kind) == ("Neimark-Sacker", "branch point")
    assert torus.varied == pytest.approx(0.0, abs=1e-9)
    assert crossing.varied == pytest.approx(0.2, abs=1e-5)
    straight, *aside = found.branches
    assert np.array_equal(straight.stable, straight.varied < 0.0)
    assert np.abs(straight.offset).max() < 1e-6
    assert {np.sign(b.offset[-1]) for b in aside} == {1.0, -1.0}
    for b in aside:
        assert b.varied[-1] == 0.5
        assert b.offset**2 == pytest.approx(b.varied - 0.2, rel=1e-4)
        assert not b.stable.any()  # where a and b leave zero


def test_a_parameter_can_be_varied() -> None:
    with wb.load("fmu:Duffing") as model:
        found = wb.branches(model, "u", "y", [0.1], vary={"cubic": (0.2, 2.0)}, frequencies=[0.207], seeds=4)
    assert found.vary == "cubic"
    # At 1 it is the model of the other tests.
    gains = []
    for b in found.branches:
        for i in np.flatnonzero((b.varied[1:] - 1.0) * (b.varied[:-1] - 1.0) < 0.0).tolist():
            share = (1.0 - b.varied[i]) / (b.varied[i + 1] - b.varied[i])
            gains.append(float(b.gain[i] + share * (b.gain[i + 1] - b.gain[i])))
    assert sorted(gains) == pytest.approx([1.474, 8.873, 10.012], rel=0.01)


@pytest.mark.parametrize(
    ("there", "tried"),
    [
        ({0.0, 0.5, 1.0}, [0.0, 1.0]),
        ({0.0}, [0.0, 1.0]),
        ({1.0}, [0.0, 1.0]),
        ({0.5}, [0.0, 1.0, 0.5]),
        (set(), [0.0, 1.0, 0.5]),
    ],
)
def test_responses_are_looked_for_at_both_bounds_and_in_the_middle_if_there_are_none(
    there: set[float], tried: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A branch that an isola or a fold keeps from the lower bound may be reached from the upper one only."""
    family: Any = None
    tracks: list[Any] = []
    search, seen = _BranchSearch(family, lambda _: None, 10, tracks=tracks), []

    def reach(_: object, __: object, p: float) -> float:
        seen.append(p)
        if p not in there:
            raise SimulationError("does not settle")
        return p

    monkeypatch.setattr(search, "_reach", reach)
    monkeypatch.setattr(search, "_follow", lambda _, place: tracks.append(place))
    if there:
        search.from_starts()
    else:
        with pytest.raises(SimulationError, match="no periodic response was found: does not settle"):
            search.from_starts()
    assert seen == tried
    assert tracks == [p for p in tried if p in there]


def test_a_linear_model_has_one_branch_and_its_gain_is_the_closed_form() -> None:
    plant = control.ss([[0, 1], [-1, -0.2]], [[0], [1]], [[1, 0]], 0)
    with wb.connect({"p": plant}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}) as model:
        found = wb.branches(model, "u", "y", [1.0], band=(0.05, 0.5), seeds=3)
    (branch,) = found.branches
    s = 2j * np.pi * branch.frequency_hz
    assert found.folds == ()
    assert branch.stable.all()
    assert np.abs(branch.gain * np.abs(s**2 + 0.2 * s + 1.0) - 1.0).max() < 2e-4


def test_the_instants_of_slopes_lie_inside_the_period_and_rise() -> None:
    times = instants(1.0, 2.0, 3)
    assert np.all(np.diff(times) > 0.0)
    assert times.shape == (6,)
    assert times[0] > 1.0
    assert times[-1] < 3.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--amplitude", "0.1"], "band: give the lowest and the highest frequency"),
        (["--band", "0.1:0.4"], "amplitude: give one or several"),
        (["--amplitude", "0.1", "--band", "0.1:0.4", "--interface", "cs"], "use interface me"),
        (
            ["--freq", "0.2", "--amplitude", "0.1", "--vary", "cubi=0:1"],
            "--vary: Duffing has no parameter 'cubi'; did you mean cubic?",
        ),
        (["--vary", "amplitude=0.1:1", "--amplitude", "1", "--band", "0.1:1"], "vary: give the one frequency"),
    ],
)
def test_what_cannot_be_followed_is_one_line(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["branches", "fmu:Duffing", "--input", "u", "--output", "y", *options]) == 2
    assert words in capsys.readouterr().err


def test_json_csv_and_picture(tmp_path: Path) -> None:
    out, table, picture = (str(tmp_path / f"b.{kind}") for kind in ("json", "csv", "png"))
    command = ["nfr", "fmu:Duffing", "--input", "u", "--output", "y", "--amplitude", "0.1", "--band", "0.15:0.3"]
    assert run([*command, "--branches", "--json", out, "--csv", table, "--plot", picture]) == 0
    data = json.loads(Path(out).read_text(encoding="utf-8"))
    (branch,) = data["branches"]
    assert {"amplitude", "frequency_hz", "gain", "phase_deg", "stable", "multipliers"} <= branch.keys()
    assert len(branch["frequency_hz"]) == len(branch["gain"]) == len(branch["stable"]) == len(branch["multipliers"])
    assert {"frequency_hz", "amplitude", "gain", "kind"} <= data["folds"][0].keys()
    assert [f["kind"] for f in data["folds"]] == ["fold", "fold"]
    assert Path(picture).stat().st_size > 10_000


# -- third-party FMUs -------------------------------------------------------------------------------------------------

_STATIC = '"C[1]" = 0.0, "C[2]" = 0.0, D = 1.0'


def foreign(folder: Path, *, damping: float, second: bool = False) -> Path:
    """MassSpringSubSystem1 with a cubic spring and a damper, on the ground or on MassSpringSubSystem2."""
    lines = f"""
    [components]
    a = "{gemseo_fmu("MassSpringSubSystem1")}"
    spring = {{model = "fmu:AlgebraicExpression", set = {{c0 = 0, c1 = 0, c2 = 0, c3 = 1.0, {_STATIC}}}}}
    push = {{sum = "{"+--+" if second else "+--"}"}}
    {f'b = "{gemseo_fmu("MassSpringSubSystem2")}"' if second else ""}
    {'pull = {sum = "+-"}' if second else ""}
    [connections]
    "spring.u" = {{from = "a.x1", convert = false}}
    "push.u2" = "spring.y"
    "push.u3" = {{from = "a.v1", gain = {damping}, convert = false}}
    "a.x2" = {{from = "push.y", convert = false}}
    """
    if second:
        lines += f"""
    "push.u4" = {{from = "b.x2", convert = false}}
    "pull.u1" = {{from = "a.x1", convert = false}}
    "pull.u2" = {{from = "b.v2", gain = {damping}, convert = false}}
    "b.x1" = {{from = "pull.y", convert = false}}
    """
    lines += """
    [inputs]
    u = "push.u1"
    [outputs]
    x = "a.x1"
    """
    path = folder / "system.toml"
    path.write_text("\n".join(line.strip() for line in lines.splitlines()), encoding="utf-8")
    return path


def swept(slope: Callable[[Floats, float], list[float]], start: list[float], frequencies: list[float]) -> list[float]:
    """Return gains of x = z[1] at an amplitude of 0.3, each point run on from the one before for up to 150 periods."""
    z, y, found = np.array(start), np.empty(0), list[float]()
    for f in frequencies:
        points = np.arange(1, 201) / 200 / f
        for _ in range(150):
            run_on = solve_ivp(
                lambda t, z, w=2.0 * math.pi * f: slope(z, 0.3 * math.sin(w * t)),
                (0.0, 1.0 / f), z, t_eval=points, rtol=1e-7, atol=1e-9,
            )  # fmt: skip
            moved, z, y = float(np.abs(run_on.y[:, -1] - z).max()), run_on.y[:, -1], run_on.y[1]
            if moved < 1e-5:
                break
        found.append(2.0 * abs(np.mean(y * np.exp(-2j * math.pi * f * points))) / 0.3)
    return found


@needs_gemseo
def test_between_the_folds_of_a_foreign_fmu_long_simulations_from_both_sides_end_on_its_branches(
    tmp_path: Path,
) -> None:
    with wb.load(foreign(tmp_path, damping=0.1), "me", tolerance=1e-9) as model:
        found = wb.branches(model, "u", "x", [0.3], band=(0.1, 0.6), frequencies=[0.29], in_process=True)
    assert sorted(f.varied for f in found.folds) == pytest.approx([0.263583, 0.310413], rel=1e-5)
    (branch,) = found.branches
    gains = [float(branch.gain[i]) for i in branch.places_at(0.29) if branch.stable[i]]

    def slope(z: Floats, u: float) -> list[float]:
        return [u - 0.1 * z[0] - 2.0 * z[1] - z[1] ** 3, z[0]]

    up, down = (swept(slope, [1.0, 0.0], list(way))[-1] for way in ([0.2, 0.24, 0.27, 0.29], [0.4, 0.33, 0.29]))
    assert sorted(gains) == pytest.approx([down, up], rel=2e-3)


@needs_gemseo
def test_two_foreign_fmus_in_one_loop_have_two_resonances_that_jump(tmp_path: Path) -> None:
    """The upper pair is x″ + 0.1x′ + 2x + x³ = x₂ + u, x₂″ + 0.1x₂′ + 2x₂ = x, by shooting with SciPy."""
    with wb.load(foreign(tmp_path, damping=0.1, second=True), "me", tolerance=1e-9) as model:
        found = wb.branches(model, "u", "x", [0.3], band=(0.25, 0.4), frequencies=[0.298], seeds=0, in_process=True)
    assert [f.kind for f in found.folds] == ["fold", "fold"]
    (branch,) = found.branches
    gains = [float(branch.gain[i]) for i in branch.places_at(0.298) if branch.stable[i]]

    def slope(z: Floats, u: float) -> list[float]:
        return [
            u + z[3] - 0.1 * z[0] - 2.0 * z[1] - z[1] ** 3, z[0], z[1] - 0.1 * z[2] - 2.0 * z[3], z[2],
        ]  # fmt: skip

    up, down = (
        swept(slope, [1.0, 0.0, 0.0, 0.0], list(way))[-1] for way in ([0.26, 0.28, 0.29, 0.298], [0.36, 0.32, 0.298])
    )
    assert sorted(gains) == pytest.approx([down, up], rel=2e-3)


@needs_gemseo
def test_a_fold_is_located_where_light_damping_moves_it_strides_away(tmp_path: Path) -> None:
    """By the coarse derivative it lay more than a stride off, and was not told: 0.05 … 1 Hz had one fold of two."""
    with wb.load(foreign(tmp_path, damping=0.02), "me", tolerance=1e-9) as model:
        found = wb.branches(model, "u", "x", [0.3], band=(0.05, 1.0), seeds=0, in_process=True)
    assert [f.kind for f in found.folds] == ["fold", "fold"]
    for fold in found.folds:

        def misses(z: Floats) -> Floats:
            end, phi = duffing(z[:2], z[2], 0.3, (0.02, 2.0, 1.0))
            return np.array([*(end - z[:2]), np.linalg.det(phi - np.eye(2))])

        x = from_fundamental(fold.gain, fold.phase_deg, fold.frequency_hz, 0.3)
        truth = fsolve(misses, [*x, fold.frequency_hz], xtol=1e-10)
        assert np.abs(misses(truth)).max() < 1e-6
        assert fold.frequency_hz == pytest.approx(truth[2], rel=1e-5)


def test_states_that_only_rounding_moves_do_not_count() -> None:
    with wb.load("fmu:Rudder") as rudder:  # the chambers are alike: the piston stands, whatever the supply does
        result = wb.branches(rudder, "pS", "p1", band=(1.0, 10.0), amplitudes=[1e5])
        linear = wb.lin(rudder, inputs=["pS"], outputs=["p1"]).result
    for branch in result.branches:
        expected = np.abs(linear.response(branch.frequency_hz)[:, 0, 0])
        np.testing.assert_allclose(branch.gain, expected, rtol=1e-3)
