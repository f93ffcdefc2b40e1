"""The C runtime of our FMUs: accuracy of Co-Simulation, its events, early return and event mode."""

import ctypes
import math
import re
from pathlib import Path

import pytest

from tests.runtime_stub import (
    DISCARD,
    ERROR,
    OK,
    Fmu2,
    Fmu3,
    Vr,
    compile_library,
)

SIZE = ctypes.c_size_t
Flag = ctypes.Array[ctypes.c_bool]
Real = ctypes.Array[ctypes.c_double]


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_library(tmp_path_factory.mktemp("stub"))


@pytest.fixture(scope="session")
def stiff_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_library(tmp_path_factory.mktemp("stiff"), defines=["STUB_STIFF"])


@pytest.fixture(scope="session")
def stateless_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_library(tmp_path_factory.mktemp("stateless"), defines=["STUB_STATELESS"])


@pytest.fixture(params=["explicit", "implicit"])
def either(request: pytest.FixtureRequest, library: Path, stiff_library: Path) -> Path:
    return library if request.param == "explicit" else stiff_library


def bounce_times(n: int) -> list[float]:
    """Instants at which a ball let fall from 1 m with restitution 0.7 touches the ground [s]."""
    times = [math.sqrt(2.0 / 9.81)]
    speed = math.sqrt(2.0 * 9.81)
    for _ in range(n - 1):
        speed *= 0.7
        times.append(times[-1] + 2.0 * speed / 9.81)
    return times


def stiff_solution(t: float) -> float:
    return math.exp(-t) + math.exp(-1000.0 * t)


def event_times(fmu: Fmu2 | Fmu3) -> list[float]:
    found = (re.search(r"event at t = (\S+)", message) for _, _, message in fmu.log)
    return [float(hit.group(1)) for hit in found if hit]


# ---- accuracy ----


def test_bounces_are_located(either: Path) -> None:
    fmu = Fmu2(either)
    fmu.initialise()
    for i in range(20):
        assert fmu.step(i * 0.1, 0.1) == OK
    found = event_times(fmu)
    assert max(min(abs(t - known) for t in found) for known in bounce_times(4)) < 1e-9
    fmu.free()


def test_one_long_step_equals_many_short_ones(either: Path) -> None:
    long, short = Fmu2(either), Fmu2(either)
    long.initialise()
    short.initialise()
    assert long.step(0.0, 1.7) == OK
    for i in range(170):
        assert short.step(i * 0.01, 0.01) == OK
    t1, t2, t3 = bounce_times(3)
    speed = math.sqrt(2.0 * 9.81) * 0.7**3
    height = speed * (1.7 - t3) - 9.81 / 2.0 * (1.7 - t3) ** 2
    assert t1 < t2 < t3 < 1.7
    for fmu in (long, short):
        assert fmu.get(Vr.H)[0] == pytest.approx(height, abs=1e-9)
        assert fmu.get(Vr.A)[0] == pytest.approx(stiff_solution(1.7), abs=2e-6)
        assert fmu.whole("Integer", Vr.SPAN) == 3
        fmu.free()


def test_error_follows_the_tolerance(either: Path) -> None:
    errors = []
    for tolerance in (1e-3, 1e-5, 1e-7, 1e-9):
        fmu = Fmu3(either)
        fmu.initialise(tolerance=tolerance)
        worst = 0.0
        for i in range(40):
            assert fmu.step(i * 0.01, 0.01)[0] == OK
            worst = max(worst, abs(fmu.get(Vr.A)[0] - stiff_solution((i + 1) * 0.01)))
        errors.append(worst)
        assert worst < 20.0 * tolerance
        fmu.free()
    assert errors[3] < errors[1] * 1e-2 < errors[0]


def test_input_steps_at_communication_points(either: Path) -> None:
    """The step size is carried over; a jump of the input must not harm the accuracy."""
    fmu = Fmu2(either)
    assert fmu.set(Vr.E, 1.0) == OK  # the ball must not come to rest
    fmu.initialise()
    area = 0.0
    for i in range(100):
        u = math.sin(i) * 100.0
        assert fmu.set(Vr.U, u) == OK
        assert fmu.step(i * 0.05, 0.05) == OK
        area += 0.05 * u
        assert fmu.get(Vr.S)[0] == pytest.approx(area, abs=1e-8)
    fmu.free()


def test_polynomial_inputs_are_exact(either: Path) -> None:
    fmu = Fmu2(either)
    fmu.initialise()
    h = 0.3
    assert fmu.set(Vr.U, 1.0) == OK
    assert fmu.input_derivatives(Vr.U, 2.0, -3.0, 4.0) == OK
    assert fmu.step(0.0, h) == OK
    end = 1.0 + 2.0 * h - 3.0 * h**2 / 2 + 4.0 * h**3 / 6
    area = h + 2.0 * h**2 / 2 - 3.0 * h**3 / 6 + 4.0 * h**4 / 24
    assert fmu.get(Vr.U, Vr.S) == pytest.approx([end, area], abs=1e-12)
    assert fmu.step(h, h) == OK  # derivatives not given again: the input keeps its value
    assert fmu.get(Vr.U, Vr.S) == pytest.approx([end, area + end * h], abs=1e-12)
    assert fmu.input_derivatives(Vr.U, 1.0, 1.0, 1.0, 1.0) == ERROR
    assert "order 1 to 3" in fmu.last
    fmu.free()


def test_crossings_of_an_input_inside_a_step_are_found(either: Path) -> None:
    """u = 4 t (1 - t) exceeds 0.5 between two instants of the same step."""
    fmu = Fmu2(either)
    fmu.initialise()
    assert fmu.input_derivatives(Vr.U, 4.0, -8.0) == OK
    assert fmu.step(0.0, 1.0) == OK
    for known in ((1 - math.sqrt(0.5)) / 2, (1 + math.sqrt(0.5)) / 2):
        assert min(abs(t - known) for t in event_times(fmu)) < 1e-12
    fmu.free()


def test_output_derivatives(library: Path) -> None:
    fmu = Fmu2(library)
    fmu.initialise()
    assert fmu.set(Vr.U, 3.0) == OK
    assert fmu.input_derivatives(Vr.U, 5.0) == OK
    assert fmu.step(0.0, 0.25) == OK
    values = (ctypes.c_double * 3)()
    references, orders = (ctypes.c_uint * 3)(Vr.Y, Vr.WAVE, Vr.Y), (ctypes.c_int * 3)(1, 1, 2)
    fmu.must("GetRealOutputDerivatives", references, SIZE(3), orders, values)
    assert list(values) == pytest.approx([3.0 + 5.0 * 0.25 + 2.0 * 5.0, math.cos(0.25), 0.0], abs=1e-9)
    fmu.free()


# ---- events in Co-Simulation ----


def test_a_sample_sees_the_input_of_its_own_instant(library: Path) -> None:
    """The event at the end of a step belongs to the next one: left limits before, then the new input."""
    fmu = Fmu2(library)
    fmu.initialise()
    assert fmu.set(Vr.U, 1.0) == OK
    assert fmu.step(0.0, 0.1) == OK
    assert fmu.whole("Integer", Vr.COUNT) == 1
    assert fmu.get(Vr.HELD) == [0.0]
    assert fmu.set(Vr.U, 2.0) == OK
    assert fmu.get(Vr.HELD) == [2.0]
    assert fmu.whole("Integer", Vr.COUNT) == 2
    assert fmu.step(0.1, 0.1) == OK
    assert fmu.whole("Integer", Vr.COUNT) == 2
    fmu.free()


def test_communication_points_with_rounding_hit_every_sample(library: Path) -> None:
    fmu = Fmu2(library)
    assert fmu.set(Vr.E, 1.0) == OK  # the ball must not come to rest
    fmu.initialise()
    t = 0.0
    for _ in range(1000):
        assert fmu.step(t, 0.1) == OK
        t += 0.1
    assert t != 100.0
    assert fmu.whole("Integer", Vr.COUNT) == 1000
    fmu.free()


def test_model_without_states(stateless_library: Path) -> None:
    fmu = Fmu2(stateless_library)
    fmu.initialise()
    assert fmu.input_derivatives(Vr.U, 1.0) == OK
    assert fmu.step(0.0, 0.95) == OK
    assert fmu.whole("Integer", Vr.COUNT) == 10
    assert fmu.whole("Boolean", Vr.ABOVE) == 1
    assert fmu.get(Vr.HELD)[0] == pytest.approx(0.9)
    fmu.free()


def test_fmi2_end_asked_for_by_the_model(library: Path) -> None:
    fmu = Fmu2(library)
    assert fmu.set_whole("Integer", Vr.LAST, 4) == OK
    fmu.initialise()
    assert fmu.step(0.0, 1.0) == DISCARD
    ended, time = ctypes.c_int(), ctypes.c_double()
    fmu.must("GetBooleanStatus", 3, ctypes.byref(ended))
    fmu.must("GetRealStatus", 2, ctypes.byref(time))
    assert ended.value == 1
    assert time.value == pytest.approx(0.3)
    assert fmu("GetStringStatus", 1, None) == DISCARD
    fmu.must("Terminate")
    fmu.free()


def test_fmi3_end_asked_for_by_the_model(library: Path) -> None:
    fmu = Fmu3(library)
    assert fmu.set_whole("Int32", Vr.LAST, 4) == OK
    fmu.initialise()
    *flags, time = fmu.step(0.0, 1.0)
    assert flags == [OK, False, True, False]
    assert time == pytest.approx(0.3)
    fmu.free()


def test_failing_equations_name_the_time(either: Path) -> None:
    fmu = Fmu2(either)
    assert fmu.set(Vr.FAULT, 0.25) == OK
    fmu.initialise()
    assert fmu.step(0.0, 1.0) == ERROR
    stopped = re.search(r"stopped at t = (\S+): .*the model says: der\(r\) is not a number", fmu.last)
    assert stopped is not None
    assert float(stopped.group(1)) == pytest.approx(0.25, abs=1e-6)
    assert len([entry for entry in fmu.log if entry[0] == ERROR]) == 1  # trials are not reported
    fmu.free()


def test_chattering_is_an_error_with_advice(either: Path) -> None:
    fmu = Fmu2(either)
    assert fmu.set_whole("Boolean", Vr.SLIDE, 1) == OK
    fmu.initialise()
    assert fmu.step(0.0, 1.0) == ERROR
    assert "the model chatters" in fmu.last
    fmu.free()


# ---- bounces that end in a finite time ----


def end_of_bounces(restitution: float) -> float:
    """When a ball let fall from 1 m comes to rest: the fall, then flights that shrink as a geometric series [s]."""
    return math.sqrt(2.0 / 9.81) * (1.0 + 2.0 * restitution / (1.0 - restitution))


def told_end(fmu: Fmu2 | Fmu3) -> float:
    told = re.search(r"infinitely many events \(Zeno behaviour.*\) before t = (\S+); let the model rest", fmu.last)
    assert told is not None, fmu.last
    return float(told.group(1))


@pytest.mark.parametrize("size", [1.0, 0.01])
@pytest.mark.parametrize("restitution", [0.05, 0.3, 0.8, 0.95])
def test_no_ball_falls_through_its_floor(either: Path, restitution: float, size: float) -> None:
    end = end_of_bounces(restitution)
    fmu = Fmu2(either)
    assert fmu.set(Vr.E, restitution) == OK
    fmu.initialise()
    lowest, i = 1.0, 0
    while i * size < 1.2 * end and fmu.step(i * size, size) == OK:
        lowest = min(lowest, fmu.get(Vr.H)[0])
        i += 1
    assert told_end(fmu) == pytest.approx(end, rel=1e-4)
    assert i == math.floor(end / size)
    assert lowest > 0.0
    assert len([entry for entry in fmu.log if entry[0] == ERROR]) == 1
    fmu.free()


def test_every_bounce_is_found_up_to_the_end(either: Path) -> None:
    fmu = Fmu2(either)
    fmu.initialise()
    end = end_of_bounces(0.7)
    assert fmu.step(0.0, end - 1e-4) == OK
    n = fmu.whole("Integer", Vr.SPAN)
    assert n == sum(t < end - 1e-4 for t in bounce_times(100))
    found = event_times(fmu)
    assert max(min(abs(t - known) for t in found) for known in bounce_times(n)) < 1e-9
    fmu.free()


@pytest.mark.parametrize("stiff", [(), ("STUB_STIFF",)])
def test_a_ball_that_knows_rest_is_left_there(tmp_path: Path, stiff: tuple[str, ...]) -> None:
    fmu = Fmu2(compile_library(tmp_path, defines=["STUB_REST=1e-4", *stiff]))
    fmu.initialise()
    for i in range(50):
        assert fmu.step(i * 0.1, 0.1) == OK
    assert fmu.get(Vr.H, Vr.V) == [0.0, 0.0]
    assert fmu.whole("Integer", Vr.SPAN) == math.ceil(math.log(1e-4 / math.sqrt(2.0 * 9.81)) / math.log(0.7))
    fmu.free()


def test_a_saved_state_knows_the_bounces(either: Path) -> None:
    """Saved between two of the last bounces, restored later: the same refusal, to the last digit."""
    fmu = Fmu2(either)
    fmu.initialise()
    near = end_of_bounces(0.7) - 1e-3
    assert fmu.step(0.0, near) == OK
    saved, messages = fmu.snapshot(), []
    for _ in range(2):
        assert fmu.step(near, 0.1) == ERROR
        messages.append(fmu.last)
        fmu.restore(saved)
    assert messages[0] == messages[1]
    assert told_end(fmu) == pytest.approx(end_of_bounces(0.7), rel=1e-4)
    fmu.release(saved)
    fmu.free()


def test_event_mode_is_refused_where_the_bounces_end(either: Path) -> None:
    """FMI 3 with early return: each bounce is a doStep of its own."""
    fmu = Fmu3(either, event_mode=True, early_return=True)
    fmu.initialise()
    point, status = 0.0, OK
    while status == OK and point < 3.0:
        while fmu.update_discrete_states()[0]:
            pass
        fmu.must("EnterStepMode")
        status, event, _, _, point = fmu.step(point, 3.0 - point)
        if status == OK and event:
            fmu.must("EnterEventMode")
    assert status == ERROR
    assert told_end(fmu) == pytest.approx(end_of_bounces(0.7), rel=1e-4)
    fmu.free()


def test_endless_event_iteration_is_an_error(library: Path) -> None:
    fmu = Fmu2(library)
    assert fmu.set_whole("Integer", Vr.MODE, 3) == OK
    fmu.must("EnterInitializationMode")
    assert fmu("ExitInitializationMode") == ERROR
    assert "does not end (1000 iterations)" in fmu.last
    fmu.free()


@pytest.mark.parametrize(
    ("point", "size", "message"),
    [
        (0.1, 0.1, "the current communication point is 0, not 0.1"),
        (0.0, 0.0, "must be longer than 0"),
        (0.0, math.inf, "finite"),
        (0.0, 2.5, "beyond the stop time 2"),
    ],
)
def test_arguments_of_a_step(library: Path, point: float, size: float, message: str) -> None:
    fmu = Fmu2(library)
    fmu.initialise(stop=2.0)
    assert fmu.step(point, size) == ERROR
    assert message in fmu.last
    fmu.free()


# ---- FMI 3 event mode ----


def test_event_mode_and_early_return(library: Path) -> None:
    fmu = Fmu3(library, event_mode=True, early_return=True)
    fmu.initialise()
    assert fmu.set(Vr.U, 1.0) == OK
    while fmu.update_discrete_states()[0]:
        pass
    fmu.must("EnterStepMode")
    status, event, terminate, early, time = fmu.step(0.0, 1.0)
    assert (status, event, terminate, early, time) == (OK, True, False, True, 0.1)
    assert fmu.get(Vr.HELD) == [1.0]
    fmu.must("EnterEventMode")
    assert fmu.set(Vr.U, 2.0) == OK
    again, _, _, following = fmu.update_discrete_states()
    assert (again, following, fmu.get(Vr.HELD)) == (True, 0.2, [2.0])
    assert not fmu.update_discrete_states()[0]
    fmu.must("EnterStepMode")
    assert fmu.step(0.1, 0.1) == (OK, True, False, False, 0.2)  # at the end: no early return
    fmu.free()


def test_event_mode_finds_the_bounces(library: Path) -> None:
    fmu = Fmu3(library, event_mode=True, early_return=True)
    fmu.initialise()
    point, returns = 0.0, []
    while fmu.update_discrete_states()[0]:
        pass
    fmu.must("EnterStepMode")
    while point < 1.2:
        _, event, _, early, point = fmu.step(point, 1.2 - point)
        if not event:
            break
        returns += [point] if early else []
        fmu.must("EnterEventMode")
        while fmu.update_discrete_states()[0]:
            pass
        fmu.must("EnterStepMode")
    for known in bounce_times(2):
        assert min(abs(t - known) for t in returns) < 1e-9
    fmu.free()


def test_without_early_return_events_are_handled_inside(library: Path) -> None:
    fmu = Fmu3(library, event_mode=True)
    fmu.initialise()
    fmu.must("EnterStepMode")  # the iteration left out is made up for
    assert fmu.step(0.0, 0.55) == (OK, False, False, False, 0.55)
    assert fmu.whole("Int32", Vr.COUNT) == 6
    fmu.free()
    plain = Fmu3(library)
    plain.initialise()
    assert plain("EnterEventMode") == ERROR
    assert "eventModeUsed = false" in plain.last
    plain.free()


def test_intermediate_update(library: Path) -> None:
    seen: list[tuple[float, float]] = []
    fmu: Fmu3

    def update(_: object, time: float, ask: bool, get: bool, done: bool, may: bool, want: Flag, at: Real) -> None:
        seen.append((time, fmu.get(Vr.S)[0]))
        assert (ask, get, done, may) == (False, True, True, True)
        if 0.3 < time < 0.6:
            want[0], at[0] = True, 0.62

    fmu = Fmu3(library, early_return=True, update=update)
    fmu.initialise()
    assert fmu.set(Vr.U, 2.0) == OK
    status, event, _, early, time = fmu.step(0.0, 1.0)
    assert (status, event, early, time) == (OK, False, True, 0.62)
    assert all(s == pytest.approx(2.0 * t) for t, s in seen)
    seen.clear()
    assert fmu.step(0.62, 0.2)[:4] == (OK, False, False, False)
    assert seen[-1][0] == pytest.approx(0.82)
    fmu.free()
