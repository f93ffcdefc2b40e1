"""The C runtime of our FMUs: state machines, rules of setting, types, Model Exchange and log."""

import ctypes
import math
import re
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
    compile_library,
)

SIZE = ctypes.c_size_t


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_library(tmp_path_factory.mktemp("stub"))


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
    ("me", "Instantiated", "GetDirectionalDerivative", (None, SIZE(0)) * 4),
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
    assert fmu.get(Vr.A) == [2.0]
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
    assert (dx[0], dx[1]) == (-4.0, -9.81)
    assert z[0] == pytest.approx(-1e-9, rel=1e-3)
    fmu.must("EnterEventMode")
    fmu.must("NewDiscreteStates", ctypes.byref(info))
    assert (info.again, info.states) == (1, 1)
    fmu.must("GetContinuousStates", x, SIZE(7))
    assert x[1] == pytest.approx(2.8)
    fmu.free()


def test_an_indicator_of_zero_is_still_in_its_old_domain(library: Path) -> None:
    """Else an integrator that stops exactly on the root sees no change there and none afterwards."""
    fmu = Fmu3(library, "me")
    fmu.initialise()
    fmu.must("EnterContinuousTimeMode")
    x, z = (ctypes.c_double * 7)(), (ctypes.c_double * 3)()
    fmu.must("GetContinuousStates", x, SIZE(7))
    signs = []
    for h in (1e-9, 0.0, -1e-12):
        x[0] = h
        fmu.must("SetContinuousStates", x, SIZE(7))
        fmu.must("GetEventIndicators", z, SIZE(3))
        signs.append(math.copysign(1.0, z[0]))
    assert signs == [1.0, 1.0, -1.0]
    fmu.must("EnterEventMode")
    fmu.must("EnterContinuousTimeMode")
    x[0] = 0.0  # now from below
    fmu.must("SetContinuousStates", x, SIZE(7))
    fmu.must("GetEventIndicators", z, SIZE(3))
    assert z[0] < 0.0
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
