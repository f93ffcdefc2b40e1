"""Points of a frequency response that are solved for: against closed forms and piecewise exact motions."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Callable
from contextlib import closing
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import fsolve

import workbench as wb
from scripts.promises.nfr import Plant, measure
from tests.lin_fmus import built
from workbench.jobs.store import FILE_NAME
from workbench.response.nfr.error import Evidence
from workbench.response.nfr.page import nfr_page
from workbench.response.nfr.period_solver import Search, can_solve
from workbench.response.nfr.point import PointTask
from workbench.response.periodic.fourier import Period
from workbench.response.periodic.monodromy import VariationalEquation
from workbench.response.periodic.period_map import Lap
from workbench.session.compiled import CompiledMeSession

HERE: dict[str, Any] = {"in_process": True, "drift_check": False}


def source(name: str, body: str) -> str:
    return f"model {name}\n input Real u(start = 0);\n output Real o;\n{body}\nend {name};\n"


def solved(name: str, body: str, f: float, amplitude: float, **options: Any) -> wb.NfrResult:  # noqa: ANN401 - those of nfr
    with wb.load(built(source(name, body), name), "me", tolerance=1e-8) as model:
        return wb.nfr(model, "u", "o", frequencies=[f], amplitudes=[amplitude], **HERE, **options)


def test_the_aircraft_needs_hardly_more_than_a_period_a_point() -> None:
    f = np.geomspace(2.8, 8.0, 10)
    with wb.load("fmu:Aircraft") as model:
        found = wb.nfr(model, "elevator", "z_front_fuselage", frequencies=f, amplitudes=[1e-3], **HERE)
        exact = wb.lin(model, inputs=["elevator"], outputs=["z_front_fuselage"])
    truth = np.array([complex(exact(2j * math.pi * x)) for x in f])
    assert found.periods.sum() <= 30  # at most three each
    assert all(s == "settled" for row in found.status for s in row)
    assert np.all(found.stable == 1.0)
    off = np.abs(found.response[0] / truth - 1.0)
    assert np.all(off <= 0.00115)  # 0.01 dB
    assert np.all(off <= found.error[0])


def test_lightly_damped_plants_are_settled_and_within_their_errors() -> None:
    random = np.random.default_rng(5)
    trials = [measure(Plant.random(random), tolerance=1e-8, max_periods=20, blind=False) for _ in range(12)]
    assert all(t.status == "settled" for t in trials)
    assert all(t.true <= t.stated <= 0.01 for t in trials)


def test_the_multipliers_are_those_of_the_poles() -> None:
    f, poles = 0.7, np.array([-0.3 + 2.0j, -0.3 - 2.0j, -1.1])
    plant = control.ss([[0, 1, 0], [-4.09, -0.6, 1], [0, 0, -1.1]], [[0], [0], [1]], [[1, 0, 0]], 0)
    with wb.connect({"p": plant}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}) as model:
        found = wb.nfr(model, "u", "y", frequencies=[f], amplitudes=[1.0], **HERE)
    certificate = found.certificates[0][0]
    assert certificate is not None
    assert certificate.method == "solved"
    wanted = np.exp(poles / f)
    assert np.abs(np.sort_complex(np.array(certificate.multipliers)) - np.sort_complex(wanted)).max() < 1e-4
    assert certificate.fold_distance == pytest.approx(np.abs(1.0 - wanted).min(), rel=1e-3)


# -- motions whose pieces are known exactly -------------------------------------------------------------------------


def fundamental(x: Callable[[float], float], phase: float, half: float) -> complex:
    """Of a motion whose second half is the negative of its first, which begins at a phase of the forcing."""
    t = (np.arange(40000) + 0.5) / 40000 * half
    values = np.array([x(s) for s in t])
    return 2j * complex(np.mean(values * np.exp(-1j * (math.pi / half * t + phase))))


def rate_limiter(f: float, m: float) -> complex:
    peak = 1.0 / (4.0 * f)
    turn = math.pi - math.asin(peak / m)
    return 8.0 * peak / math.pi**2 / m * complex(np.exp(-1j * (turn - math.pi / 2.0)))


def coulomb(f: float, m: float) -> complex:
    """x″ + 0.1x′ + x + 0.3·sign x′ = m·sin: from one turning point to the next it is linear."""
    w = 2.0 * math.pi * f
    a = np.array([[0, 1, 0, 0, 0], [-1, -0.1, m, 0, -0.3], [0, 0, 0, w, 0], [0, 0, -w, 0, 0], [0, 0, 0, 0, 0.0]])

    def begin(z: list[float]) -> np.ndarray:
        return np.array([z[0], 0.0, math.sin(z[1]), math.cos(z[1]), 1.0])

    def misses(z: list[float]) -> list[float]:
        end = expm(a * math.pi / w) @ begin(z)
        return [end[0] + z[0], end[1]]

    z = fsolve(misses, [-1.2, 1.0], xtol=1e-13)
    n = 20000
    step, x = expm(a * math.pi / w / n), expm(a * math.pi / w / n / 2) @ begin(z)
    total = 0.0j
    for k in range(n):
        total += x[0] * np.exp(-1j * ((k + 0.5) / n * math.pi + z[1]))
        x = step @ x
    return 2j * total / n / m


def relay(f: float, m: float) -> complex:
    """z′ = r − z, r switched by u − z = ±0.3."""
    half = 0.5 / f
    e = math.exp(-half)
    z0 = -(1.0 - e) / (1.0 + e)
    return fundamental(lambda t: 1.0 + (z0 - 1.0) * math.exp(-t), math.asin((0.3 + z0) / m), half) / m


def backlash(f: float, m: float) -> complex:
    """x′ = −10·(what x − u exceeds ±0.3 by): drawn along for a part of each half period, and at rest for the other."""
    w, rate, h = 2.0 * math.pi * f, 10.0, 0.3

    def drawn(t: float, x0: float, th: float) -> float:
        # x′ = rate·(m·sin(wt + th) − h − x)
        s = rate * m / math.hypot(rate, w)
        lag = math.atan2(w, rate)
        return s * math.sin(w * t + th - lag) - h + (x0 + h - s * math.sin(th - lag)) * math.exp(-rate * t)

    def misses(z: list[float]) -> list[float]:
        x, th, end = z
        at = drawn(end, -x, th)
        return [at - x, m * math.sin(w * end + th) - h - at, m * math.sin(th) - h + x]

    x, th, end = fsolve(misses, [0.8 * (m - h), math.asin((h - 0.8 * (m - h)) / m), 0.4 / f], xtol=1e-13)
    return fundamental(lambda t: drawn(t, -x, th) if t < end else x, th, 0.5 / f) / m


LIMITED = "Real y(start = 0, fixed = true);\nequation\n der(y) = if u > y then 1 else -1; o = y;"
RUBBED = """Real x(start = -1.2, fixed = true); Real v(start = 0.01, fixed = true);
equation
  der(x) = v;
  der(v) = u - 0.1 * v - x - (if v > 0 then 0.3 else -0.3);
  o = x;"""
SWITCHED = """Real z(start = 0, fixed = true); discrete Real r(start = 1, fixed = true);
equation
  der(z) = r - z;
  when u - z > 0.3 then r = 1; elsewhen u - z < -0.3 then r = -1; end when;
  o = z;"""
DRAWN = """Real x(start = 0, fixed = true); Real v;
equation
  v = x - u;
  der(x) = -10 * (if v > 0.3 then v - 0.3 elseif v < -0.3 then v + 0.3 else 0);
  o = x;"""

# Name → (model, its response, frequency [Hz], amplitude).
CASES: dict[str, tuple[str, Callable[[float, float], complex], float, float]] = {
    "RateLimiter": (LIMITED, rate_limiter, 1.0, 1.0),
    "Coulomb": (RUBBED, coulomb, 1.3 / (2.0 * math.pi), 1.0),
    "Relay": (SWITCHED, relay, 0.5, 2.0),
    "Backlash": (DRAWN, backlash, 0.5, 1.0),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("method", ["auto", "settle"])
def test_responses_with_jumps_and_kinks_are_the_exact_ones(name: str, method: str) -> None:
    body, truth, f, m = CASES[name]
    result = solved(name, body, f, m, method=method, max_periods=60)
    off = abs(complex(result.response[0, 0]) / exact(truth, f, m) - 1.0)
    assert result.status == (("settled",),)
    assert off <= result.error[0, 0] <= 0.01
    assert result.stable[0, 0] == 1.0


@cache
def exact(truth: Callable[[float, float], complex], f: float, m: float) -> complex:
    return truth(f, m)


# -- what cannot be solved for --------------------------------------------------------------------------------------


def test_an_unstable_response_is_told_as_such() -> None:
    plant = control.ss([[0.2]], [[1]], [[1]], 0)
    with wb.connect({"p": plant}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}) as model:
        found = wb.nfr(model, "u", "y", frequencies=[1.0], amplitudes=[1.0], **HERE)
    size = abs(1.0 / (2j * math.pi - 0.2))
    assert found.status == (("failed",),)
    assert found.stable[0, 0] == 0.0
    assert f"there is an unstable periodic response of gain {size:.3f}"[:-1] in found.failed[0].reason


def test_a_run_that_has_not_left_an_unstable_response_yet_does_not_make_it_stable() -> None:
    """It settles within two periods, in which the pole at 0.7 rad/s makes nothing of what it holds of the response."""
    plant = control.ss([[0.7]], [[0.01]], [[1]], 1)
    with wb.connect({"p": plant}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}) as model:
        found = wb.nfr(model, "u", "y", frequencies=[6.0], amplitudes=[1.0], **HERE)
    assert found.status == (("settled",),)
    assert abs(found.response[0, 0] - (1.0 + 0.01 / (12j * math.pi - 0.7))) < found.error[0, 0]
    assert math.isnan(found.stable[0, 0])


def test_a_model_without_states_needs_one_period(tmp_path: Path) -> None:
    """And one more, where it has events, to see that nothing else repeats."""
    (file := tmp_path / "limit.toml").write_text(
        '[components]\nk = {block = "saturation", lower = -1.0, upper = 1.0}\n'
        '[inputs]\nu = "k.u"\n[outputs]\ny = "k.y"\n'
    )
    with wb.load(file) as model:
        found = wb.nfr(model, "u", "y", frequencies=[1.0], amplitudes=[0.1, 2.0], **HERE)
    assert found.periods.max() <= 2
    assert found.status == (("settled",), ("settled",))


def test_a_linear_motion_of_a_model_with_events_costs_a_short_run() -> None:
    """Its two poles leave 0.775 of a deviation in a period: a few show that the run contracts to the motion."""
    with wb.load("fmu:Saturation") as model:
        found = wb.nfr(model, "u", "y", frequencies=[1.0], amplitudes=[0.1], **HERE)
    assert found.periods.max() <= 8
    assert found.to_dict()["certificate"]["reached"] == [["run"]]


def test_an_integrator_is_solved_for_although_a_multiplier_is_one() -> None:
    plant = control.tf([1.0], [1.0, 0.0])
    with wb.connect({"p": plant}, [], inputs={"u": "p.u"}, outputs={"y": "p.y"}) as model:
        found = wb.nfr(model, "u", "y", frequencies=[0.5], amplitudes=[1.0], **HERE)
    assert abs(found.response[0, 0] * 1j * math.pi - 1.0) <= found.error[0, 0]
    assert found.status == (("settled",),)


def test_a_second_stable_response_is_told_of_points_from_the_store_too(tmp_path: Path) -> None:
    def found() -> tuple[wb.NfrResult, int]:
        seen: list[float] = []
        with wb.load("fmu:Duffing") as model:
            record = wb.nfr(
                model, "u", "y", amplitudes=[0.1], band=(0.15, 0.3), store=tmp_path,
                progress=lambda p, *_: seen.append(p), **HERE,
            )  # fmt: skip
        return record, len(seen)

    (measured, some), (kept, none) = found(), found()
    assert some == measured.periods.size
    assert none <= 1  # the last one, told at the end
    # As if it had been stopped before it looked.
    with closing(sqlite3.connect(tmp_path / FILE_NAME)) as database, database:
        assert database.execute("DELETE FROM measurements WHERE point LIKE 'second responses%'").rowcount == 1
    again, _ = found()
    assert "another stable response" in measured.warnings[0]
    from_the_store = (*measured.warnings, "5 of 5 points were measured before and are kept")
    assert kept.warnings == again.warnings == from_the_store


def test_a_second_stable_response_is_told_and_no_linear_one_is_suspected() -> None:
    with wb.load("fmu:Duffing") as model:
        found = wb.nfr(model, "u", "y", amplitudes=[0.1], band=(0.1, 0.4), **HERE)
        calm = wb.nfr(model, "u", "y", amplitudes=[0.01], band=(0.1, 0.4), **HERE)
    (words,) = found.warnings
    assert "another stable response, gain 10.05 besides 1.461" in words or "gain 1.461 besides 10.05" in words
    assert not any("stable response" in words for words in calm.warnings)
    # What the start decides is not green, and the highest gain is that of the responses measured.
    page, quiet = nfr_page(found), nfr_page(calm)
    assert sorted(v.word for v in page.summary) == ["settled", "watch"]
    assert [v.word for v in quiet.summary] == ["settled"]
    assert "solved for" in quiet.summary[0].text
    of_measured = [
        any("Of the responses measured" in text for s in p.sections for text in s.paragraphs) for p in (page, quiet)
    ]
    assert of_measured == [True, False]


SPRING = """parameter Real d = 0.1; parameter Real c = 0; Real x(start = 0, fixed = true);
    Real v(start = 0, fixed = true); equation der(x) = v; der(v) = u - d * v - x - c * x^3; o = x;"""


@pytest.mark.parametrize(
    ("damping", "cubic", "amplitude", "points"),
    [(0.0892, -0.1, 0.1711, 11), (0.02, 0.5, 0.05, 5), (0.02, 2.0, 0.04, 8), (0.05, 1.0, 0.3, 5)],
)
def test_a_second_response_at_a_peak_that_the_sweep_steps_over_is_told(
    damping: float, cubic: float, amplitude: float, points: int
) -> None:
    """Where there are two responses is what `branches` finds; of the first two sweeps all points look linear."""
    frequencies = np.geomspace(0.08, 0.4, points)
    given = {"d": damping, "c": cubic}
    with wb.load(built(source("Spring", SPRING), "Spring"), "me", tolerance=1e-9, start_values=given) as model:
        found = wb.nfr(model, "u", "o", frequencies, [amplitude], **HERE)
        branches = wb.branches(
            model, "u", "o", [amplitude], band=(0.08, 0.4), frequencies=frequencies, order=1, in_process=True
        )
    several = [f for f in frequencies if sum(place.stable for place in branches.at(float(f))) > 1]
    assert several
    assert [words for words in found.warnings if "another stable response" in words and f"{several[0]:.6g}" in words]


def test_a_jump_is_guessed_only_where_nobody_looked(monkeypatch: pytest.MonkeyPatch) -> None:
    """A narrow resonance between two frequencies looks like a jump."""
    monkeypatch.setattr("workbench.response.nfr.run.jumps", lambda _, **__: ["it may jump"])
    found = {}
    for method in ("auto", "settle"):
        with wb.load("fmu:Duffing") as model:
            found[method] = wb.nfr(
                model, "u", "y", amplitudes=[0.1], band=(0.1, 0.4), method=method, max_periods=8, **HERE
            )
    assert "it may jump" in found["settle"].warnings
    assert "it may jump" not in found["auto"].warnings


def test_settling_can_be_asked_for() -> None:
    with wb.load("fmu:Rudder") as model:
        found = wb.nfr(model, "delC", "del", frequencies=[2.0], amplitudes=[1.0], method="settle", **HERE)
    certificate = found.certificates[0][0]
    assert certificate is not None
    assert certificate.method == "settled"
    assert found.periods[0, 0] >= 3


FORCED = """parameter Real d = 0.1; Real x(start = 0, fixed = true); Real v(start = 0, fixed = true);
    equation der(x) = v; der(v) = u - d * v - x - 0.3 * v^3; o = x;"""


def test_what_is_called_stable_is_stable() -> None:
    """An oscillator that moves by itself, forced: multipliers of its motions by the variational equation.

    Derivatives that did for Newton's method called some of the unstable ones stable.
    """

    def period(z: np.ndarray, d: float, a: float, f: float) -> np.ndarray:
        def rhs(t: float, s: np.ndarray) -> np.ndarray:
            force = a * math.sin(2.0 * math.pi * f * t)
            A = np.array([[0.0, 1.0], [-1.0, -d - 0.9 * s[1] ** 2]])
            return np.append([s[1], force - d * s[1] - s[0] - 0.3 * s[1] ** 3], A @ s[2:].reshape(2, 2))

        start = np.append(z, np.eye(2))
        found: np.ndarray = solve_ivp(rhs, (0.0, 1.0 / f), start, method="DOP853", rtol=1e-9, atol=1e-11).y[:, -1]
        return found

    judged = 0
    for d in (-0.05, -0.1, -0.2, -0.3):
        with wb.load(built(source("Rayleigh", FORCED), "Rayleigh"), "me", tolerance=1e-8, start_values={"d": d}) as m:
            result = wb.nfr(
                m, "u", "o", frequencies=[0.36, 0.42, 0.48, 0.5332, 0.6], amplitudes=[1.0, 1.888, 2.6], **HERE
            )
        for i, j in np.argwhere(result.stable == 1.0):
            a, f, z = float(result.amplitude[i]), float(result.frequency_hz[j]), complex(result.response[i, j])
            start = [a * z.imag, 2.0 * math.pi * f * a * z.real]
            orbit = fsolve(lambda s, d=d, a=a, f=f: period(s, d, a, f)[:2] - s, start, xtol=1e-9)
            largest = np.abs(np.linalg.eigvals(period(orbit, d, a, f)[2:].reshape(2, 2))).max()
            assert largest < 1.0, (d, a, f)
            judged += 1
    assert judged >= 5


def test_a_response_on_a_bent_branch_is_solved_for_after_waiting_in_vain_and_all_its_periods_count() -> None:
    """The motion of the linear model leads nowhere there, and 20 periods do not do; 60 do."""
    asked: dict[str, Any] = {"frequencies": [0.18], "amplitudes": [0.1], **HERE}
    with wb.load("fmu:Duffing") as model:
        found = wb.nfr(model, "u", "y", max_periods=20, **asked)
        waited = wb.nfr(model, "u", "y", max_periods=60, method="settle", **asked)
    assert found.status == waited.status == (("settled",),)
    assert abs(found.response[0, 0] / waited.response[0, 0] - 1.0) <= found.error[0, 0] + waited.error[0, 0] < 0.01
    assert found.periods[0, 0] > 20


TASK = PointTask(input="u", output="y", frequency=1.0, amplitude=1.0, errcrit=0.1, max_periods=20)


@pytest.mark.parametrize("states", [299, 300, 301])
def test_what_can_be_solved_for_without_a_linear_model_can_have_its_slopes_at_more_instants(states: int) -> None:
    session = object.__new__(CompiledMeSession)
    vars(session)["instance"] = SimpleNamespace(nx=states, has_history=False)
    search = object.__new__(Search)
    search.periods, search._level = SimpleNamespace(session=session), 0  # type: ignore[assignment]
    assert can_solve(session, TASK) == search._more_instants() == (states <= 300)


def test_what_the_last_step_changes_is_in_the_error_whatever_its_phase() -> None:
    search = object.__new__(Search)
    search._task, search._evidence, search._count = TASK, Evidence(), 3
    harmonics = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    lap = Lap(np.zeros(1), np.ones(1), Period(harmonics, 1.0 + 0j, 1.0), 0, np.ones(1))
    errors = []
    for turned in (0.0, 0.5, 1.0, 1.5):
        rows = np.array([[0.0], [math.cos(math.pi * turned)], [math.sin(math.pi * turned)]])
        found = search._solved(lap, VariationalEquation(np.zeros((1, 1)), rows, np.zeros(1)), np.array([1e-4]))
        errors.append(found.error)
        assert found.error >= abs(complex(*(found.harmonics - harmonics)[1:3]))
    assert errors == pytest.approx([errors[0]] * 4, rel=1e-3)


@pytest.mark.parametrize("nominal", ["", ", nominal = 1"])
@pytest.mark.parametrize("method", ["auto", "settle"])
def test_motions_far_below_the_nominal_values_are_not_better_than_they_are_said_to_be(
    nominal: str, method: str
) -> None:
    """The integration judges its errors by nominal values: a small motion was wrong by half, and said to be exact."""
    text = f"""parameter Real d = 0.1; Real x(start = 0, fixed = true{nominal});
        Real v(start = 0, fixed = true{nominal}); equation der(x) = v; der(v) = u - d * v - x; o = x;"""
    with wb.load(built(source("Light", text), "Light"), "me") as model:
        found = wb.nfr(model, "u", "o", [0.03, 0.159, 0.6, 1.5], [1e-12, 1e-9, 1e-6, 1e-3], method=method, **HERE)
    omega = 2.0 * math.pi * found.frequency_hz
    truth = 1.0 / (1.0 - omega**2 + 0.1j * omega)
    off = np.abs(found.response / truth - 1.0)
    known = np.isfinite(found.error)
    assert np.count_nonzero(known) >= 14
    assert np.all(off[known] <= found.error[known] + 1e-9)
    assert np.all(found.averaged[found.error > 0.02])
    if method == "auto":
        assert np.max(off[1:]) < 1e-3
        assert found.averaged[0].any() == bool(nominal)
