"""Every check can fail: FMUs that break one promise each are found out, and the honest one is not blamed."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from tests.lying_fmus import LIES, build_lying
from workbench.cli.app import run
from workbench.errors import SimulationError
from workbench.health.check.registry import CHECKS
from workbench.health.check.request import Check, check
from workbench.health.check.result import HealthCard, HealthLine
from workbench.jobs.options import Workers
from workbench.model.load import load
from workbench.point.lin.request import Lin, lin, lin_over
from workbench.point.trim.request import trim
from workbench.requests.request import asked_options
from workbench.response.branches.request import Branches
from workbench.response.nfr.prior_knowledge import surroundings
from workbench.response.nfr.request import Nfr, nfr
from workbench.response.simulate.request import Simulate, simulate

# One of the lies is what memory holds that nobody set: in copies of one process it is the same.
pytestmark = pytest.mark.usefixtures("started_workers")

HERE = Workers(in_process=True)  # these lies end no process
QUICK = [n for n, lie in LIES.items() if lie.check != "memory"]
LEAKS = [n for n, lie in LIES.items() if lie.check == "memory"]

K, D = 40.0, 0.8  # of the lying FMU
STEP = 0.01


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lies")


def card(folder: Path, name: str, *only: str) -> HealthCard:
    where = None if "processes" in only else HERE
    return check(build_lying(folder, name), only=only or None, workers=where)


def assert_found(line: HealthLine, name: str) -> None:
    assert (line.verdict, line.name) == (LIES[name].verdict, LIES[name].check)
    assert re.search(LIES[name].evidence, line.evidence), line.evidence
    assert line.consequence


def test_every_check_has_a_lie() -> None:
    others = {"runs", "drift"} | {"largest-step", "real-time"}  # below; tests/test_step_advice.py
    assert {lie.check for lie in LIES.values()} | others == set(CHECKS)


def test_an_honest_fmu_is_good_in_all(folder: Path) -> None:
    found = check(build_lying(folder, "honest"))  # in worker processes, as a user does
    assert {(c.interface, c.name): c.verdict for c in found.checks if c.verdict != "good"} == {}
    assert len(found.checks) == sum(len(c.interfaces) for c in CHECKS.values())
    assert found.passed
    assert found.interfaces == ("me", "cs")


def test_an_unstable_model_is_no_broken_fmu(folder: Path) -> None:
    assert card(folder, "unstable", *(n for n in CHECKS if n != "memory")).worst == "good"


def test_an_input_that_has_not_its_declared_start_value_is_told_of_until_it_is_set(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = "u: the description says start 0.5, the FMU has 0 until it is set; `start_values` sets it"
    file = build_lying(folder, "other-start")
    for interface in ("cs", "me"):
        with load(file, interface) as model:
            assert told in simulate(model, stop=0.1).notes
            assert told not in simulate(model, inputs={"u": 0.5}, stop=0.1).notes
            found = trim(model)
            assert told in found.notes
            assert told not in trim(model, u0={"u": 0.5}).notes
            assert told not in simulate(model, stop=0.1, at=found).notes  # the point says what it is
        with load(file, interface, start_values={"u": 0.5}) as model:
            assert told not in simulate(model, stop=0.1).notes
            assert check(file, only=["starts"], start_values={"u": 0.5}, workers=HERE).worst == "good"
    with load(build_lying(folder, "honest")) as model:
        assert not any("the description says" in note for note in simulate(model, stop=0.1).notes)
    for more, said in (("", True), (" --set u=0.5", False)):
        assert run(["lin", str(file), *more.split()]) == 0
        assert ("start 0.5, the FMU has 0 until it is set; --set sets it" in capsys.readouterr().err) is said


def test_in_one_process_nothing_is_said_of_others(folder: Path) -> None:
    found = check(build_lying(folder, "pid"), only=["processes"], workers=HERE)
    assert {line.verdict for line in found.checks} == {"not applicable"}


@pytest.mark.parametrize("name", ["honest", "pid"])
def test_a_sweep_takes_one_point_in_two_processes(folder: Path, name: str) -> None:
    """The stiffness of "pid" is another one in each process."""
    with load(build_lying(folder, name), "me") as model:

        def linear() -> tuple[str, ...]:
            found = lin_over(model, over={"u": np.linspace(0.0, 1.0, 24).tolist()}, workers=Workers(jobs=2))
            assert [dict(p.values) for p in found.points] == [{"u": u} for u in np.linspace(0.0, 1.0, 24)]
            return found.notes

        def sines() -> tuple[str, ...]:
            found = nfr(model, "u", "y", np.linspace(0.3, 0.6, 24), [0.01], workers=Workers(jobs=2))
            assert found.frequency_hz == pytest.approx(np.linspace(0.3, 0.6, 24))
            return found.warnings

        for sweep in (linear, sines):
            told, until = list[str](), time.monotonic() + (60.0 if name == "pid" else 0.0)
            while not told:  # where the second worker is late, the first one does all, and nothing has to fit together
                told = [text for text in sweep() if "taken in two worker processes, differs by" in text]
                if time.monotonic() > until:
                    break
            assert len(told) == (name == "pid")
        few = lin_over(model, over={"u": [0.0, 0.5, 1.0]}, workers=Workers(jobs=2))
    assert not few.notes  # one more would be a third of the work


@pytest.mark.parametrize("name", QUICK)
def test_a_lie_is_found(folder: Path, name: str) -> None:
    found = card(folder, name, LIES[name].check)
    for interface in LIES[name].interfaces:
        assert_found(found.line(LIES[name].check, interface), name)
    assert found.passed == (LIES[name].verdict != "broken")


def test_who_repeats_steps_is_taken_back_by_replay(folder: Path) -> None:
    """It restores well, but makes other steps while a state is kept (noSetFMUStatePriorToCurrentPoint)."""
    with load(build_lying(folder, "repeats"), "cs") as model:
        assert "while a state is kept it makes other steps" in model.why_replay()
        repeats = simulate(model, stop=1.0)
    with load(build_lying(folder, "honest"), "cs") as model:
        assert model.why_replay() == ""
        assert np.array_equal(simulate(model, stop=1.0).signals["y"], repeats.signals["y"])


@pytest.mark.parametrize("name", LEAKS)
def test_a_leak_is_measured(folder: Path, name: str) -> None:
    with load("fmu:Aircraft") as model:  # leaves free memory behind in the kept worker
        simulate(model, stop=20.0, points=np.linspace(0.001, 20.0, 200_000))
    found = check(build_lying(folder, name), only=["memory"], interface="cs").line("memory", "cs")
    assert_found(found, name)
    size = {"leak": 64 << 10, "large-leak": 2 << 20}[name]
    assert found.numbers["bytes_per_session"] == pytest.approx(size, rel=0.1)
    assert found.numbers["sessions"][-1] == 100


def test_what_does_not_repeat_itself_is_not_blamed_for_more(folder: Path) -> None:
    found = card(folder, "random", "determinism", "reset", "instances", "start-time")
    verdicts = {c.name: c.verdict for c in found.checks if c.interface == "me"}
    assert verdicts.pop("determinism") == "broken"
    assert set(verdicts.values()) == {"not applicable"}


def test_a_state_that_forgets_deceives_the_quick_probe_but_not_the_card(folder: Path) -> None:
    line = card(folder, "forgetful", "snapshots").line("snapshots", "cs")
    assert line.numbers["method"] == "state"  # what a session believes
    assert "after a second restore" in line.evidence


# -- step: against explicit Euler in NumPy and the exact solution ----------------------------------


def _euler(h: float, count: int, stiffness: float, force: float) -> np.ndarray:
    x = np.zeros((count + 1, 2))
    for k in range(count):
        position, speed = x[k]
        x[k + 1] = x[k] + h * np.array([speed, force - stiffness * position - D * speed])
    return x


def _exact(times: np.ndarray, force: float) -> np.ndarray:
    system = np.array([[0.0, 1.0, 0.0], [-K, -D, force], [0.0, 0.0, 0.0]])
    return np.array([expm(system * t)[:2, 2] for t in times])


def test_error_and_order_of_explicit_euler_are_those_of_the_exact_solution(folder: Path) -> None:
    numbers = card(folder, "euler", "step").line("step", "cs").numbers
    force = 2 * 0.05  # both inputs, each a twentieth of its size 1
    times = STEP * np.arange(1, 65)
    exact, mine = _exact(times, force), _euler(STEP, 64, K, force)[1:]
    error = np.quantile(np.abs(mine - exact) / np.ptp(exact, axis=0), 0.9, axis=0).max()
    assert numbers["error"] == pytest.approx(error, rel=0.05)
    assert numbers["order"] == pytest.approx(1.0, abs=0.05)
    assert numbers["own_step"]
    assert numbers["steps"][:3] == [0.01, 0.005, 0.0025]


def test_the_first_change_is_that_of_two_runs(folder: Path) -> None:
    numbers = card(folder, "euler", "step").line("step", "cs").numbers
    coarse, fine = _euler(STEP, 64, K, 0.1)[1:], _euler(STEP / 2, 128, K, 0.1)[2::2]
    gaps = np.abs(coarse - fine) / np.ptp(np.concatenate([coarse, fine]), axis=0)
    assert numbers["changes"][0] == pytest.approx(np.quantile(gaps, 0.9, axis=0).max(), rel=1e-3)


def test_the_excursion_of_a_diverging_fmu_is_that_of_explicit_euler(folder: Path) -> None:
    line = card(folder, "diverging", "step").line("step", "cs")
    h = line.numbers["excursion_step"]
    ratio = round(STEP / h)

    def reach(x: np.ndarray) -> np.ndarray:
        seen = x[:: len(x) // 50][1:51]  # the points of a test run: 50 of 200 steps
        far: np.ndarray = np.abs(seen - seen[0]).max(axis=0)
        return far

    far, near = _euler(STEP, 200, 1e4, 0.1), _euler(h, 200 * ratio, 1e4, 0.1)[::ratio]
    assert line.numbers["excursion"] == pytest.approx((reach(far) / reach(near)).max(), rel=1e-3)
    assert line.numbers["diverges"]
    assert "use interface me" in line.consequence


def test_the_recommended_step_is_good(folder: Path) -> None:
    line = card(folder, "euler", "step").line("step", "cs")
    (wanted,) = re.findall(r"step=([\d.e-]+)` \(about 1 %", line.consequence)
    again = check(build_lying(folder, "euler"), only=["step"], interface="cs", step=float(wanted), workers=HERE)
    assert again.line("step", "cs").numbers["error"] < 0.015


# -- what moves by itself ------------------------------------------------------------------------


def test_own_movement_is_told(folder: Path) -> None:
    line = card(folder, "clock", "drift").line("drift", "me")  # forced by the time: it never settles
    assert line.verdict == "watch"
    assert re.search(r"(swings|drifts) by itself, by", line.evidence)


def test_a_clock_is_told_with_its_size(folder: Path) -> None:
    line = card(folder, "clock", "start-time").line("start-time", "me")
    assert line.numbers["shift"] == 32.0
    assert line.numbers["relative"] > 0.1
    assert re.findall(r"`\w+`", line.consequence) == ["`start`"]
    for request in (Simulate, Nfr, Lin, Branches, Check):
        assert "--start" in {declared.flag for declared, _ in asked_options(request).values()}


# -- what a command makes of a lie -------------------------------------------------------------------


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_an_fmu_that_allows_one_instance_only_without_saying_so_is_used_one_after_the_other(
    folder: Path, interface: str
) -> None:
    """In workers a closed instance waits for its end; where it stands in the way of the next it is ended before."""
    with load(build_lying(folder, "single"), interface) as model:
        for _ in range(2):  # in a worker process, as a user does
            assert trim(model).converged


def test_where_directional_derivatives_fail_auto_goes_on_by_differences_and_says_so(folder: Path) -> None:
    """dv/dt = u + w − K x − D v: what was asked for by name still ends, with the way out."""
    with load(build_lying(folder, "no-derivative"), "me") as model:
        with pytest.raises(SimulationError, match=r"GetDirectionalDerivative returned error.*; use method difference$"):
            lin(model, method="exact")
        found = lin(model)
    np.testing.assert_allclose(found.result.A, [[0.0, 1.0], [-K, -D]], atol=1e-6)
    assert found.result.method == "difference"
    assert "they fail: Lying: fmi2GetDirectionalDerivative returned error" in found.result.to_dict()["why"]


def test_where_directional_derivatives_fail_nfr_knows_its_surroundings_by_differences(folder: Path) -> None:
    with load(build_lying(folder, "no-derivative"), "me") as model:
        linear = surroundings(model, "u", "y").linear
    assert linear is not None
    np.testing.assert_allclose(linear.part.A, [[0.0, 1.0], [-K, -D]], atol=1e-6)
