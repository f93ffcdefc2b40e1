"""The kernel's solvers in C: closed forms, exact stops, events, refusals, and agreement with their Python twins."""

import ctypes
import math
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.kernel_bench import (
    KERNEL,
    SIZES,
    SOURCES,
    WARNINGS,
    Bench,
    Library,
    RefusedError,
    compile_with_zig,
    load,
    twin,
)
from workbench.kernel import gear
from workbench.kernel.gear import GEAR_FUNCTIONS, GearLibrary, gear_library, why_missing

needs_gear = pytest.mark.skipif(bool(why_missing()), reason=f"FMPy's SUNDIALS cannot be loaded: {why_missing()}")
both = pytest.mark.parametrize("solver", ["vkm", pytest.param("gear", marks=needs_gear)])
Open = Callable[..., Bench]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    path = tmp_path_factory.mktemp("kernel") / "bench.library"
    compile_with_zig(path)
    return load(path)


@pytest.fixture
def start(library: Library) -> Iterator[Open]:
    made: list[Bench] = []

    def make(solver: str, problem: str, *x: float, t: float = 0.0, rtol: float = 1e-6, scale: float = 1e-3) -> Bench:
        made.append(Bench(library, solver, problem, rtol=rtol, scale=scale))
        made[-1].restart(t, *x)
        return made[-1]

    yield make
    for bench in made:
        bench.close()


def stiff_truth(t: float, x: float, y: float) -> np.ndarray:
    """Solution of the stiff problem from (x, y) at 0."""
    slow, fast = 0.5 * (x - 1.0 + y), 0.5 * (x - 1.0 - y)
    decayed = slow * math.exp(-t), fast * math.exp(-1000.0 * t)
    return np.array([math.cos(t) + decayed[0] + decayed[1], math.sin(t) + decayed[0] - decayed[1]])


# ---- accuracy ----


@both
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
def test_decay_to_tolerance(start: Open, solver: str, rtol: float) -> None:
    bench = start(solver, "decay", 1.0, rtol=rtol)
    bench.run(3.0)
    assert bench.t == 3.0
    assert bench.x[0] == pytest.approx(math.exp(-3.0), rel=100.0 * rtol)


@both
def test_errors_fall_with_the_tolerance(start: Open, solver: str) -> None:
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8):
        bench = start(solver, "smooth_oscillator", 1.0, 0.0, rtol=rtol)
        bench.run(10.0)
        errors.append(np.abs(bench.x - [math.cos(10.0), -math.sin(10.0)]).max())
    assert errors[0] < 1e-2
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 0.1 * errors[1]
    assert errors[2] < 3e-6


@both
@pytest.mark.parametrize("first", [(1.0, 0.0), (3.0, 1.0)])
def test_stiff_with_forcing(start: Open, solver: str, first: tuple[float, float]) -> None:
    bench = start(solver, "stiff", *first, rtol=1e-7)
    bench.run(0.5)
    np.testing.assert_allclose(bench.x, stiff_truth(0.5, *first), rtol=3e-6)


@needs_gear
def test_gear_needs_few_evaluations_on_a_stiff_problem(start: Open) -> None:
    stiff, plain = start("gear", "stiff", 3.0, 1.0), start("vkm", "stiff", 3.0, 1.0)
    stiff.run(5.0)
    plain.run(5.0)
    assert stiff.counts["evaluations"] < 500
    assert plain.counts["evaluations"] > 20 * stiff.counts["evaluations"]


@needs_gear
def test_van_der_pol_over_its_jump(start: Open) -> None:
    bench = start("gear", "van_der_pol", 2.0, 0.0, rtol=1e-7)
    bench.run(1000.0)
    tight = start("gear", "van_der_pol", 2.0, 0.0, rtol=1e-10, scale=1e-5)
    tight.run(1000.0)
    # After 806 s the state jumps from 1 to -2; an independent figure: SciPy's Radau and LSODA.
    assert tight.x[0] == pytest.approx(-1.86364625, abs=1e-7)
    assert bench.x[0] == pytest.approx(tight.x[0], abs=1e-5)
    assert bench.counts["evaluations"] < 4000


@both
def test_interpolation_is_as_accurate_as_the_steps(start: Open, solver: str) -> None:
    bench = start(solver, "smooth_oscillator", 1.0, 0.0, rtol=1e-8)
    while bench.t < 5.0:
        bench.step(5.0)
        for part in (0.0, 0.3, 0.77, 1.0):
            t = bench.t_old + part * (bench.t - bench.t_old)
            assert np.abs(bench.interpolate(t) - [math.cos(t), -math.sin(t)]).max() < 1e-6
    assert (bench.interpolate(bench.t) == bench.x).all()


# ---- steps ----


@both
def test_stops_are_exact(start: Open, solver: str) -> None:
    bench = start(solver, "decay", 1.0)
    for stop in (0.1, 0.1 + 1e-9, 1.0 / 3.0, 0.7, math.pi, 1e3):
        while bench.t < stop:
            before = bench.t
            bench.step(stop)
            assert bench.t_old == before < bench.t <= stop
        assert bench.t == stop


@both
def test_nothing_is_evaluated_beyond_the_stop(start: Open, solver: str) -> None:
    bench = start(solver, "decay", 1.0)
    for stop in (0.3, 0.6, 1.7):
        bench.run(stop)
        assert bench.furthest <= stop * (1.0 + 1e-15)


@both
def test_longest_step_is_respected_also_when_it_shrinks(start: Open, solver: str) -> None:
    bench = start(solver, "decay", 1.0, rtol=1e-3)
    for until, longest in ((2.0, math.inf), (3.0, 0.1), (3.2, 0.013), (5.0, math.inf), (5.1, 0.02)):
        stops = 0
        while bench.t < until:
            bench.step(until, longest)
            assert bench.t - bench.t_old <= longest * (1.0 + 2e-9)
            stops += 1
        assert stops <= 1.6 * (2.0 / longest if math.isfinite(longest) else 0.0) + 60


@both
def test_restart_forgets_the_past(start: Open, solver: str) -> None:
    used, fresh = start(solver, "stiff", 3.0, 1.0), start(solver, "stiff", 1.0, 0.5, t=2.0)
    used.run(0.7, 0.05)
    used.step(9.0)
    used.restart(2.0, 1.0, 0.5)
    fresh.run(2.5, 0.3)
    used.run(2.5, 0.3)
    assert (used.x == fresh.x).all()


@both
def test_evaluations_are_counted(start: Open, solver: str) -> None:
    bench = start(solver, "oscillator", 1.0, 0.0)
    bench.run(10.0)
    counts = bench.counts
    assert counts["evaluations"] == counts["asked_for"] > 0
    assert counts["steps"] > 3


# ---- events ----


@both
def test_event_times(start: Open, solver: str) -> None:
    bench = start(solver, "oscillator", 1.0, 0.0, rtol=1e-12)
    times = bench.events(20.0)
    np.testing.assert_allclose(times, (np.arange(len(times)) + 0.5) * math.pi, atol=1e-10)
    assert len(times) == 6


@both
def test_an_event_step_ends_just_on_the_far_side(start: Open, solver: str) -> None:
    bench = start(solver, "oscillator", 1.0, 0.0)
    while not bench.step(2.0):
        pass
    assert bench.x[0] <= 0.0
    assert bench.interpolate(bench.t - 4e-12)[0] > 0.0
    assert (bench.interpolate(bench.t) == bench.x).all()


@both
def test_two_crossings_in_one_step(start: Open, solver: str) -> None:
    """The indicator leaves its domain for 28 ms and returns, while steps are a second long."""
    # Exact for the solver of order 4; the other's errors at the start move the top.
    bench = start(solver, "thrown", 0.0, 1.0, rtol=1e-3 if solver == "vkm" else 1e-7)
    half = math.sqrt(0.0002)
    np.testing.assert_allclose(bench.events(3.0), [1.0 - half, 1.0 + half], atol=1e-10 if solver == "vkm" else 1e-4)


@both
def test_several_indicators_in_order(start: Open, solver: str) -> None:
    bench = start(solver, "three_levels", 0.0, rtol=1e-3)
    np.testing.assert_allclose(bench.events(1.0), [0.3, 0.3001, 0.7], atol=1e-11)


@both
def test_a_crossing_exactly_at_the_stop(start: Open, solver: str) -> None:
    bench = start(solver, "until_one", 0.0)
    while not bench.step(1.0):
        assert bench.t < 1.0
    assert bench.t == 1.0
    bench.restart(1.0, *bench.x)
    assert bench.events(2.0) == []


@both
def test_an_indicator_that_starts_at_zero(start: Open, solver: str) -> None:
    """Zero belongs to the domain below: going up is an event at once, staying or going down is none."""
    bench = start(solver, "rise", 0.0)
    times = bench.events(1.0)
    assert len(times) == 1
    assert 0.0 < times[0] < 1e-12
    assert start(solver, "oscillator", 0.0, -1.0).events(3.0) == []


@both
def test_going_on_without_a_restart(start: Open, solver: str) -> None:
    bench = start(solver, "oscillator", 1.0, 0.0, rtol=1e-8)
    found = []
    while bench.t < 8.0:
        if bench.step(8.0):
            found.append(bench.t)
    np.testing.assert_allclose(found, (np.arange(len(found)) + 0.5) * math.pi, atol=1e-6)
    assert len(found) == 3
    np.testing.assert_allclose(bench.x, [math.cos(8.0), -math.sin(8.0)], atol=1e-6)


def test_events_of_time_only(start: Open) -> None:
    bench = start("none", "time_only")
    # Zero at the start, then up: an event at once.
    np.testing.assert_allclose(bench.events(1.8), [0.0, 0.5, 0.7, 1.0, 1.5], atol=1e-12)
    assert bench.t == 1.8
    assert bench.interpolate(1.5).size == 0


def test_nothing_to_do_is_one_step(start: Open) -> None:
    bench = start("none", "nothing")
    bench.step(5.0)
    assert bench.t == 5.0
    bench.run(7.0, 0.1)
    assert bench.counts["steps"] == 21


# ---- trouble ----


@both
def test_a_discarded_point_shortens_the_step(start: Open, solver: str) -> None:
    bench = start(solver, "near_wall", 0.0, rtol=1e-2)
    bench.run(1.0)
    assert bench.x[0] == pytest.approx(1.0, abs=1e-3)


@both
@pytest.mark.parametrize(("problem", "where"), [("walled", 1.0), ("not_a_number", 1.0)])
def test_what_cannot_be_passed_is_said(start: Open, solver: str, problem: str, where: float) -> None:
    bench = start(solver, problem, 0.0)
    with pytest.raises(RefusedError, match=rf"^{solver}: [^\n]+$"):
        bench.run(2.0)
    assert bench.t == pytest.approx(where, abs=1e-6)
    bench.restart(0.0, 0.0)
    bench.run(0.5)
    assert bench.t == 0.5


@both
def test_a_start_that_cannot_be_evaluated_is_said(start: Open, solver: str) -> None:
    bench = start(solver, "walled", 2.0)
    with pytest.raises(RefusedError, match=f"^{solver}: "):
        bench.step(1.0)


@both
@pytest.mark.parametrize("problem", ["broken", "broken_indicator"])
def test_after_a_failure_for_good_the_owner_has_the_word(start: Open, solver: str, problem: str) -> None:
    bench = start(solver, problem, 0.0)
    with pytest.raises(RefusedError, match=r"^$"):
        bench.run(2.0)
    assert bench.t <= 0.5


@both
def test_indicators_that_are_refused_shorten_the_step(start: Open, solver: str) -> None:
    bench = start(solver, "wall_for_indicators", 0.0)
    while not bench.step(5.0):
        assert bench.t < 1.0
    assert bench.t == pytest.approx(0.999, abs=1e-9)


def test_solvers_refuse_the_wrong_number_of_states(library: Library) -> None:
    for solver, problem in (("vkm", "nothing"), ("gear", "nothing"), ("none", "decay")):
        with pytest.raises(RefusedError, match="not created"):
            Bench(library, solver, problem)


# ---- the Python twins ----


@pytest.mark.parametrize(
    ("problem", "x"),
    [("decay", [1.0]), ("stiff", [3.0, 1.0]), ("smooth_oscillator", [1.0, 0.0]), ("near_wall", [0.0])],
)
def test_vkm_steps_like_its_twin(library: Library, start: Open, problem: str, x: list[float]) -> None:
    bench, python = start("vkm", problem, *x), twin(library, "vkm", problem)
    python.restart(0.0, np.array(x))
    for stop in (0.01, 0.2):
        while bench.t < stop:
            bench.step(stop, 0.06)
            python.step(stop, 0.06)
            assert bench.t == pytest.approx(python.t, rel=1e-13)
            np.testing.assert_allclose(bench.x, python.x, rtol=1e-12)
            middle = 0.5 * (bench.t + bench.t_old)
            np.testing.assert_allclose(bench.interpolate(middle), python.interpolate(middle), rtol=1e-12)
    assert python.t == stop


@both
def test_events_like_the_twins(library: Library, start: Open, solver: str) -> None:
    bench, python = start(solver, "oscillator", 1.0, 0.2), twin(library, solver, "oscillator")
    python.restart(0.0, np.array([1.0, 0.2]))
    times = []
    while python.t < 10.0:
        if python.step(10.0, math.inf):
            times.append(python.t)
            python.restart(python.t, python.x.copy())
    np.testing.assert_allclose(bench.events(10.0), times, rtol=1e-12 if solver == "vkm" else 1e-6)
    np.testing.assert_allclose(bench.x, python.x, rtol=1e-10 if solver == "vkm" else 1e-5)
    python.close()


@needs_gear
def test_gear_steps_like_its_twin(library: Library, start: Open) -> None:
    bench, python = start("gear", "stiff", 3.0, 1.0), twin(library, "gear", "stiff")
    python.restart(0.0, np.array([3.0, 1.0]))
    for stop in (0.5, 2.0):
        while bench.t < stop:
            bench.step(stop)
            python.step(stop, math.inf)
            assert bench.t == pytest.approx(python.t, rel=1e-12)
            np.testing.assert_allclose(bench.x, python.x, rtol=1e-10)
    python.close()


def test_events_of_time_like_the_twin(library: Library, start: Open) -> None:
    bench, python = start("none", "time_only"), twin(library, "none", "time_only")
    python.restart(0.0, np.zeros(0))
    times = []
    while python.t < 1.8:
        if python.step(1.8, math.inf):
            times.append(python.t)
            python.restart(python.t, np.zeros(0))
    np.testing.assert_allclose(bench.events(1.8), times, atol=1e-12)


# ---- SUNDIALS by address ----


def test_the_tables_in_c_and_python_are_the_same() -> None:
    text = (KERNEL / "cvode.h").read_text(encoding="utf-8")
    table = text[text.index("typedef struct {") : text.index("} Sundials;")]
    called = re.findall(r"\(\*(\w+)\)\(", table)
    looked_for = re.findall(r"/\* (\w+_Dense) \*/", text)
    assert called + looked_for == [name for name, _ in GEAR_FUNCTIONS]
    assert f"FUNCTIONS = {len(called)} + MATRIX_OPERATIONS + SOLVER_OPERATIONS" in text


def test_gear_without_its_libraries_is_refused_and_says_why(library: Library, tmp_path: Path) -> None:
    for table in (GearLibrary(), GearLibrary(gear_library().functions, 3)):
        with pytest.raises(RefusedError, match="not created"):
            Bench(library, "gear", "decay", table=table)
    assert "this platform" in gear._load_from(None).missing
    assert "cannot be loaded" in gear._load_from(tmp_path).missing
    assert gear._load_from(tmp_path).table.n_functions == 0


@needs_gear
def test_errors_of_cvode_are_not_printed(start: Open, capfd: pytest.CaptureFixture[str]) -> None:
    bench = start("gear", "walled", 0.0)
    with pytest.raises(RefusedError):
        bench.run(2.0)
    assert capfd.readouterr() == ("", "")


@needs_gear
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_many_solvers_leave_no_memory_behind(library: Library) -> None:
    def cycle(times: int) -> int:
        for _ in range(times):
            bench = Bench(library, "gear", "stiff")
            bench.restart(0.0, 3.0, 1.0)
            bench.run(0.01)
            bench.close()
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])

    first = cycle(200)
    assert (cycle(1000) - first) * os.sysconf("SC_PAGE_SIZE") < 1_000_000


# ---- sanitizers ----


@pytest.mark.skipif(shutil.which("gcc") is None and shutil.which("clang") is None, reason="no compiler with sanitizers")
def test_sanitizers_find_nothing(tmp_path: Path) -> None:
    compiler = shutil.which("gcc") or shutil.which("clang") or ""
    program = tmp_path / "bench"
    options = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-DBENCH_MAIN", *WARNINGS]
    built = subprocess.run([compiler, *options, *SOURCES, "-lm", "-ldl", "-o", str(program)], check=False)
    if built.returncode != 0:
        pytest.skip("this compiler has no sanitizers")
    folder = gear._folder()
    pairs = [(f"{folder}/sundials_{library}{gear._suffix()}", name) for name, library in GEAR_FUNCTIONS]
    arguments = [word for pair in pairs for word in pair]
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    lines = [line.split(" ", 3) for line in done.stdout.splitlines()]
    expected = 2 * (len([n for n, _ in SIZES.values() if n]) * (1 if why_missing() else 2) + 2)
    assert len(lines) == expected
    # The second run from the same start is the first run again.
    assert lines[::2] == lines[1::2]


def test_ctypes_structure_matches(library: Library) -> None:
    assert ctypes.sizeof(GearLibrary) == ctypes.sizeof(ctypes.c_void_p) + ctypes.sizeof(ctypes.c_size_t)
