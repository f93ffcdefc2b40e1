"""The C runtime of our FMUs: state machines, rules of setting, saved states, events and accuracy."""

import ctypes
import itertools
import math
import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.runtime_stub import (
    DISCARD,
    ERROR,
    HEADERS,
    OK,
    EventInfo2,
    Fmu2,
    Fmu3,
    Vr,
    build_driver,
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


# ---- the library as such ----


@pytest.mark.parametrize("version", [2, 3])
def test_every_function_of_the_header_is_exported(library: Path, version: int) -> None:
    text = (HEADERS / f"fmi{version}Functions.h").read_text(encoding="utf-8")
    names = re.findall(rf"FMI{version}_Export fmi{version}\w+TYPE\s+(fmi{version}\w+);", text)
    assert len(names) > 40
    loaded = ctypes.CDLL(str(library))
    assert [name for name in names if not hasattr(loaded, name)] == []
    assert not hasattr(loaded, "core_new")


def test_versions(library: Path) -> None:
    loaded = ctypes.CDLL(str(library))
    for name, expected in (
        ("fmi2GetVersion", b"2.0"),
        ("fmi3GetVersion", b"3.0"),
        ("fmi2GetTypesPlatform", b"default"),
    ):
        loaded[name].restype = ctypes.c_char_p
        assert ctypes.cast(loaded[name], ctypes.CFUNCTYPE(ctypes.c_char_p))() == expected


def test_wrong_guid_is_refused_with_a_message(library: Path) -> None:
    two, three = Fmu2(library, guid=b"{other}"), Fmu3(library, token=b"{other}")
    assert two.component is None
    assert "GUID" in two.last
    assert three.component is None
    assert "token" in three.last


def test_scheduled_execution_is_refused_with_a_message(library: Path) -> None:
    fmu = Fmu3(library, "me")
    function = fmu.library["fmi3InstantiateScheduledExecution"]
    function.restype = ctypes.c_void_p
    assert function(b"x", b"y", None, False, True, None, fmu._logger, None, None, None) is None
    assert "not available" in fmu.last
    fmu.free()


# ---- state machine ----


def test_fmi2_wrong_state_names_function_and_state(library: Path) -> None:
    fmu = Fmu2(library)
    assert fmu.step(0.0, 0.1) == ERROR
    assert fmu.last.startswith("fmi2DoStep: not allowed in state instantiated")
    assert fmu.log[-1][:2] == (ERROR, "logStatusError")
    assert fmu("EnterInitializationMode") == ERROR
    assert "in state error" in fmu.last
    fmu.must("Reset")
    fmu.initialise()
    assert fmu.step(0.0, 0.1) == OK
    fmu.free()


WRONG_2: list[tuple[str, str, str, tuple[Any, ...]]] = [
    ("me", "instantiated", "GetReal", (None, SIZE(0), None)),
    ("me", "instantiated", "ExitInitializationMode", ()),
    ("me", "Event Mode", "SetContinuousStates", (None, SIZE(0))),
    ("me", "Event Mode", "CompletedIntegratorStep", (0, None, None)),
    ("me", "Event Mode", "SetupExperiment", (0, 0.0, 0.0, 0, 0.0)),
    ("me", "Continuous-Time Mode", "NewDiscreteStates", (None,)),
    ("me", "Continuous-Time Mode", "EnterContinuousTimeMode", ()),
    ("me", "Continuous-Time Mode", "SetInteger", (None, SIZE(0), None)),
    ("me", "terminated", "SetTime", (0.0,)),
    ("me", "terminated", "Terminate", ()),
    ("cs", "Initialization Mode", "DoStep", (0.0, 0.1, 1)),
    ("cs", "Initialization Mode", "Terminate", ()),
    ("cs", "stepComplete", "CancelStep", ()),
    ("cs", "stepComplete", "EnterInitializationMode", ()),
    ("cs", "terminated", "DoStep", (0.0, 0.1, 1)),
]


def lead_to_2(fmu: Fmu2, state: str) -> None:
    if state == "instantiated":
        return
    fmu.must("SetupExperiment", 0, 0.0, 0.0, 0, 0.0)
    fmu.must("EnterInitializationMode")
    if state == "Initialization Mode":
        return
    fmu.must("ExitInitializationMode")
    if state == "Continuous-Time Mode":
        fmu.must("EnterContinuousTimeMode")
    if state == "terminated":
        fmu.must("Terminate")


@pytest.mark.parametrize(("kind", "state", "function", "arguments"), WRONG_2)
def test_fmi2_calls_in_the_wrong_state(
    library: Path, kind: str, state: str, function: str, arguments: tuple[Any, ...]
) -> None:
    fmu = Fmu2(library, kind)
    lead_to_2(fmu, state)
    assert fmu(function, *arguments) == ERROR
    assert fmu.last.startswith(f"fmi2{function}: not allowed in state {state}")
    fmu.free()


def lead_to_3(fmu: Fmu3, state: str) -> None:
    if state == "Instantiated":
        return
    fmu.must("EnterInitializationMode", False, 0.0, 0.0, False, 0.0)
    if state == "Initialization Mode":
        return
    fmu.must("ExitInitializationMode")
    if state == "Continuous-Time Mode":
        fmu.must("EnterContinuousTimeMode")
    if state == "Terminated":
        fmu.must("Terminate")


WRONG_3: list[tuple[str, str, str, tuple[Any, ...]]] = [
    ("me", "Instantiated", "ExitInitializationMode", ()),
    ("me", "Instantiated", "GetFloat64", (None, SIZE(0), None, SIZE(0))),
    ("me", "Event Mode", "SetContinuousStates", (None, SIZE(0))),
    ("me", "Event Mode", "EnterEventMode", ()),
    ("me", "Continuous-Time Mode", "UpdateDiscreteStates", (None,) * 6),
    ("me", "Continuous-Time Mode", "SetBoolean", (None, SIZE(0), None, SIZE(0))),
    ("me", "Terminated", "SetTime", (0.0,)),
    ("cs", "Step Mode", "EnterStepMode", ()),
    ("cs", "Step Mode", "UpdateDiscreteStates", (None,) * 6),
    ("cs", "Initialization Mode", "DoStep", (0.0, 0.1, True, None, None, None, None)),
    ("cs", "Step Mode", "ExitConfigurationMode", ()),
    ("cs", "Step Mode", "ActivateModelPartition", (0, 0.0)),
    ("cs", "Terminated", "Terminate", ()),
]


@pytest.mark.parametrize(("kind", "state", "function", "arguments"), WRONG_3)
def test_fmi3_calls_in_the_wrong_state(
    library: Path, kind: str, state: str, function: str, arguments: tuple[Any, ...]
) -> None:
    fmu = Fmu3(library, kind)
    lead_to_3(fmu, state)
    assert fmu(function, *arguments) == ERROR
    assert fmu.last.startswith(f"fmi3{function}: not allowed in state {state}")
    fmu.free()


def test_functions_of_the_other_kind_are_refused(library: Path) -> None:
    me, cs = Fmu2(library, "me"), Fmu3(library, "cs")
    me.must("EnterInitializationMode")
    assert me.step(0.0, 0.1) == ERROR
    assert "not available in Model Exchange" in me.last
    assert cs("GetNumberOfContinuousStates", None) == ERROR
    assert "not available in Co-Simulation" in cs.last
    me.free()
    cs.free()


def test_null_instance_and_null_arguments(library: Path) -> None:
    fmu = Fmu2(library)
    nobody = Fmu2(library, guid=b"wrong")
    assert nobody("Reset") == ERROR
    nobody.free()
    fmu.initialise()
    assert fmu("GetReal", None, SIZE(1), None) == ERROR
    assert "vr is a null pointer" in fmu.last
    fmu.free()


# ---- variables ----


@pytest.mark.parametrize(
    ("reference", "allowed"),
    [
        (Vr.U, "instantiated initialising event continuous"),
        (Vr.H, "instantiated initialising"),
        (Vr.B, "instantiated"),  # initial = approx
        (Vr.GAIN, "instantiated initialising event"),
        (Vr.G, "instantiated initialising"),
        (Vr.HELD, "instantiated initialising"),
        (Vr.Y, ""),
        (Vr.PERIOD, ""),
        (Vr.TIME, ""),
        (Vr.DER_H, ""),
    ],
)
def test_what_may_be_set_when(library: Path, reference: Vr, allowed: str) -> None:
    for version in (2, 3):
        found = []
        for state in ("instantiated", "initialising", "event", "continuous"):
            fmu: Any = Fmu2(library, "me") if version == 2 else Fmu3(library, "me")
            if state != "instantiated":
                fmu("EnterInitializationMode", *((False, 0.0, 0.0, False, 0.0) if version == 3 else ()))
            if state in {"event", "continuous"}:
                fmu.must("ExitInitializationMode")
            if state == "continuous":
                fmu.must("EnterContinuousTimeMode")
            if fmu.set(reference, 0.5) == OK:
                found.append(state)
            else:
                assert "must not be set in state" in fmu.last
            fmu.free()
        assert found == allowed.split()


def test_co_simulation_sets_inputs_and_tunable_parameters_only(library: Path) -> None:
    fmu = Fmu2(library)
    fmu.initialise()
    assert fmu.set(Vr.U, 1.0) == OK
    assert fmu.set(Vr.GAIN, 3.0) == OK
    assert fmu.set_whole("Integer", Vr.INCREMENT, 2) == OK
    assert fmu.set_whole("Boolean", Vr.ENABLE, 1) == OK
    assert fmu.get(Vr.Y) == [3.0]
    assert fmu.set(Vr.G, 1.0) == ERROR
    assert "'g' (fixed parameter) must not be set in state stepComplete" in fmu.last
    fmu.free()


def test_types_and_references_are_checked(library: Path) -> None:
    for name, value, expected in (
        ("count", Vr.COUNT, "variable 'count' (value reference 16) is of type Integer, not Real"),
        ("none", 1000, "there is no variable with value reference 1000"),
    ):
        fmu = Fmu2(library)
        fmu.initialise()
        fmu_status = fmu("GetReal", (ctypes.c_uint * 1)(value), SIZE(1), (ctypes.c_double * 1)())
        assert (name, fmu_status) == (name, ERROR)
        assert expected in fmu.last
        fmu.free()


def test_values_out_of_range(library: Path) -> None:
    fmu = Fmu2(library)
    assert fmu.set(Vr.E, 1.5) == OK
    assert fmu.log[-1][1] == "logStatusWarning"
    assert fmu.set_whole("Integer", Vr.MODE, 4) == ERROR
    assert "outside 1 ... 3" in fmu.last
    fmu.must("Reset")
    assert fmu.set(Vr.U, math.nan) == ERROR
    assert "'u' must be finite" in fmu.last
    fmu.free()


def test_fmi3_types(library: Path) -> None:
    fmu = Fmu3(library)
    fmu.initialise()
    assert fmu.whole("Int64", Vr.MODE) == 1
    assert fmu.whole("Int32", Vr.COUNT) == 1
    assert fmu.whole("Boolean", Vr.ABOVE) == 0
    nothing = (None, SIZE(0), None, SIZE(0))
    for kind in ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "UInt64", "String"):
        fmu.must("Get" + kind, *nothing)
        fmu.must("Set" + kind, *nothing)
    assert fmu("GetFloat32", None, SIZE(1), None, SIZE(1)) == ERROR
    assert "fmi3GetFloat32: the model has no Float32 variables" in fmu.last
    fmu.must("Reset")
    assert fmu("EnterConfigurationMode") == ERROR
    assert "no structural parameters" in fmu.last
    fmu.free()


def test_directional_derivative(library: Path) -> None:
    fmu = Fmu2(library, "me")
    fmu.initialise()
    sensitivity = (ctypes.c_double * 2)()
    unknowns, knowns = (ctypes.c_uint * 2)(Vr.Y, Vr.DER_A), (ctypes.c_uint * 3)(Vr.U, Vr.A, Vr.S)
    seed = (ctypes.c_double * 3)(1.0, 2.0, 3.0)
    fmu.must("GetDirectionalDerivative", unknowns, SIZE(2), knowns, SIZE(3), seed, sensitivity)
    assert list(sensitivity) == [5.0, -1001.0]
    assert (
        fmu("GetDirectionalDerivative", unknowns, SIZE(2), (ctypes.c_uint * 1)(Vr.G), SIZE(1), seed, sensitivity)
        == ERROR
    )
    assert "'g' (value reference 14) is no input, continuous state or tunable parameter" in fmu.last
    fmu.free()


# ---- Model Exchange ----


def test_model_exchange_event(library: Path) -> None:
    fmu = Fmu2(library, "me")
    fmu.initialise()
    info = EventInfo2()
    info.again = 1
    while info.again:
        fmu.must("NewDiscreteStates", ctypes.byref(info))
    assert (info.defined, info.time) == (1, 0.1)
    fmu.must("EnterContinuousTimeMode")
    fmu.must("SetTime", 0.05)
    x, dx, z = (ctypes.c_double * 7)(), (ctypes.c_double * 7)(), (ctypes.c_double * 3)()
    fmu.must("GetContinuousStates", x, SIZE(7))
    x[0], x[1] = -1e-9, -4.0
    fmu.must("SetContinuousStates", x, SIZE(7))
    fmu.must("GetDerivatives", dx, SIZE(7))
    fmu.must("GetEventIndicators", z, SIZE(3))
    assert (dx[0], dx[1], z[0]) == (-4.0, -9.81, -1e-9)
    fmu.must("EnterEventMode")
    fmu.must("NewDiscreteStates", ctypes.byref(info))
    assert (info.again, info.states) == (1, 1)
    fmu.must("GetContinuousStates", x, SIZE(7))
    assert x[1] == pytest.approx(2.8)
    fmu.free()


def test_model_exchange_lets_the_integrator_come_back(library: Path) -> None:
    fmu = Fmu3(library, "me")
    fmu.must("EnterInitializationMode", False, 0.0, 0.0, False, 0.0)
    assert fmu.set(Vr.FAULT, 1.0) == OK
    fmu.must("ExitInitializationMode")
    fmu.must("EnterContinuousTimeMode")
    fmu.must("SetTime", 2.0)
    dx = (ctypes.c_double * 7)()
    assert fmu("GetContinuousStateDerivatives", dx, SIZE(7)) == DISCARD
    fmu.must("SetTime", 0.5)
    fmu.must("GetContinuousStateDerivatives", dx, SIZE(7))
    n = ctypes.c_size_t()
    fmu.must("GetNumberOfEventIndicators", ctypes.byref(n))
    assert n.value == 3
    fmu.free()


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


# ---- saved states ----


def trajectory(fmu: Fmu2, points: list[float]) -> list[Any]:
    rows: list[Any] = []
    for start, end in itertools.pairwise(points):
        assert fmu.set(Vr.U, math.sin(7.0 * start)) == OK
        assert fmu.input_derivatives(Vr.U, 7.0 * math.cos(7.0 * start)) == OK
        assert fmu.step(start, end - start) == OK
        rows += [fmu.get(Vr.H, Vr.V, Vr.A, Vr.B, Vr.S, Vr.Y, Vr.HELD), fmu.serialised()]
    return rows


def test_rollback_is_bit_for_bit(either: Path) -> None:
    fmu = Fmu2(either)
    fmu.initialise()
    trajectory(fmu, [0.0, 0.03, 0.11, 0.35])
    saved = fmu.snapshot()
    points = [0.35, 0.4, 0.41, 0.6, 1.3, 1.55]
    first = trajectory(fmu, points)
    fmu.restore(saved)
    assert trajectory(fmu, points) == first
    fmu.must("GetFMUstate", ctypes.byref(saved))  # the block is used again
    fmu.release(saved)
    assert not saved.value
    fmu.free()


def test_serialised_state_continues_in_another_instance(either: Path) -> None:
    one, two = Fmu2(either), Fmu2(either)
    one.initialise()
    points = [0.0, 0.2, 0.5, 0.8]
    trajectory(one, points[:2])
    data = one.serialised()
    state = ctypes.c_void_p()
    two.must("DeSerializeFMUstate", data, SIZE(len(data)), ctypes.byref(state))
    two.restore(state)
    two.release(state)
    assert trajectory(two, points[1:]) == trajectory(one, points[1:])
    one.free()
    two.free()


def test_foreign_states_are_refused(library: Path) -> None:
    me, cs = Fmu3(library, "me"), Fmu3(library)
    data = bytearray(me.serialised())
    state = ctypes.c_void_p()
    assert cs("DeserializeFMUState", bytes(data), SIZE(len(data)), ctypes.byref(state)) == ERROR
    assert cs("SetFMUState", None) == ERROR
    assert me("DeserializeFMUState", bytes(data[:-8]), SIZE(len(data) - 8), ctypes.byref(state)) == ERROR
    assert "bytes" in me.last
    data[3] ^= 1
    me.must("Reset")
    assert me("DeserializeFMUState", bytes(data), SIZE(len(data)), ctypes.byref(state)) == ERROR
    assert "another model" in me.last
    me.free()
    cs.free()


def test_a_state_saved_before_an_error_brings_the_instance_back(library: Path) -> None:
    fmu = Fmu2(library)
    fmu.initialise()
    saved = fmu.snapshot()
    assert fmu.step(5.0, 1.0) == ERROR
    assert fmu.step(0.0, 1.0) == ERROR
    fmu.restore(saved)
    assert fmu.step(0.0, 1.0) == OK
    fmu.release(saved)
    fmu.free()


# ---- log ----


def test_log_categories(library: Path) -> None:
    two, three = Fmu2(library, logging=False), Fmu3(library, logging=False)
    two.initialise()
    three.initialise()
    assert two.step(0.0, 0.5) == OK
    assert three.step(0.0, 0.5)[0] == OK
    assert (two.log, three.log) == ([], [])
    two.must("SetDebugLogging", 1, SIZE(1), (ctypes.c_char_p * 1)(b"logEvents"))
    assert two.step(0.5, 0.5) == OK
    assert {category for _, category, _ in two.log} == {"logEvents"}
    assert two("SetDebugLogging", 1, SIZE(1), (ctypes.c_char_p * 1)(b"logNothing")) == ERROR
    assert "unknown log category 'logNothing'" in two.last
    assert three("EnterInitializationMode", False, 0.0, 0.0, False, 0.0) == ERROR
    assert three.log == []
    two.free()
    three.free()


# ---- memory and undefined behaviour ----


@pytest.mark.parametrize("defines", [(), ("STUB_STIFF",)])
def test_every_function_under_sanitizers(tmp_path: Path, defines: tuple[str, ...]) -> None:
    """No report, no leak, also for wrong calls in every state and for each allocation that fails."""
    program, watch = build_driver(tmp_path, defines=defines)
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False, env=_sanitizer_environment())
    if watch == "address" and "LeakSanitizer has encountered a fatal error" in done.stderr:
        pytest.skip("the leak sanitizer cannot look at processes here (ptrace is forbidden)")
    assert done.stderr == ""
    assert done.returncode == 0


def _sanitizer_environment() -> dict[str, str]:
    return {**os.environ, "ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
