"""The C runtime of our FMUs: saved states bit for bit, and every function under sanitizers."""

import ctypes
import itertools
import math
import os
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from tests.runtime_stub import (
    ERROR,
    OK,
    RUNTIME,
    Fmu2,
    Fmu3,
    Vr,
    build_driver,
    compile_library,
)
from workbench.build.fmu import generate

MODELICA = Path(__file__).parent / "modelica"
SIZE = ctypes.c_size_t


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_library(tmp_path_factory.mktemp("stub"))


@pytest.fixture(scope="session")
def stiff_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_library(tmp_path_factory.mktemp("stiff"), defines=["STUB_STIFF"])


@pytest.fixture(params=["explicit", "implicit"])
def either(request: pytest.FixtureRequest, library: Path, stiff_library: Path) -> Path:
    return library if request.param == "explicit" else stiff_library


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


# ---- memory and undefined behaviour ----


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For the runtime under sanitizers, which all drivers share."""
    return tmp_path_factory.mktemp("objects")


@pytest.mark.parametrize("defines", [(), ("STUB_STIFF",)])
def test_every_function_under_sanitizers(tmp_path: Path, objects: Path, defines: tuple[str, ...]) -> None:
    """No report, no leak, also for wrong calls in every state and for each allocation that fails."""
    program, watch = build_driver(tmp_path, objects, defines=defines)
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False, env=_sanitizer_environment())
    if watch == "address" and "LeakSanitizer has encountered a fatal error" in done.stderr:
        pytest.skip("the leak sanitizer cannot look at processes here (ptrace is forbidden)")
    assert done.stderr == ""
    assert done.returncode == 0


@pytest.fixture(scope="module")
def delay_driver(tmp_path_factory: pytest.TempPathFactory, objects: Path) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("delays")
    sources = generate(MODELICA / "Delays.mo", "Delays.Chain")
    (folder / "model.c").write_bytes(sources.c_files["model.c"])
    root = ET.fromstring(sources.descriptions[2])  # noqa: S314 - written just now
    numbers = {v.get("name"): v.get("valueReference") for v in root.iter("ScalarVariable")}
    defines = (f'GUID="{root.get("guid")}"', f"U={numbers['u']}", f"Y={numbers['y']}")
    model = [RUNTIME / "core.c", folder / "model.c"]
    return build_driver(folder, objects, defines=defines, driver="delay_driver.c", model=model)


@pytest.mark.parametrize("what", [[], ["fuzz"]])
def test_delays_under_sanitizers(delay_driver: tuple[Path, str], what: list[str]) -> None:
    """A generated model: the past of its delays is saved, read back to the last bit, and freed.

    fuzz: serialised states with each number and each byte changed are refused, or harmless.
    """
    program, watch = delay_driver
    done = subprocess.run(
        [str(program), *what], capture_output=True, text=True, check=False, env=_sanitizer_environment(), timeout=600
    )
    if watch == "address" and "LeakSanitizer has encountered a fatal error" in done.stderr:
        pytest.skip("the leak sanitizer cannot look at processes here (ptrace is forbidden)")
    assert done.stderr == ""
    assert done.returncode == 0


def _sanitizer_environment() -> dict[str, str]:
    return {**os.environ, "ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
