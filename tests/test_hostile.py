"""Hostile FMUs: each ends in one clear line, and those that would take the process with them really do."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drivers import DRIVERS
from tests.hostile_fmus import BROKEN_FILES, HOSTILE, NEEDS_WORKER, build_broken, build_hostile
from tests.hybrid_fmus import ERROR, Hybrid, describe
from tests.mimic_fmus import build_mimic
from workbench.core.machine.scratch import scratch_folder
from workbench.errors import FmuError, SimulationError
from workbench.fmi import library
from workbench.fmi.fmi2 import Instance2
from workbench.fmi.library import Library
from workbench.model.load import load
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Constant

ROOT = Path(__file__).parent.parent
INTERFACES = ["me", "cs"]
GRID = np.linspace(0.01, 1.0, 100)


def run(file: Path, interface: str) -> float:
    with load(file, interface) as model:
        return float(simulate(model, stop=1.0, points=GRID, verify_step=False).signals["y"][-1])


@pytest.mark.parametrize("interface", INTERFACES)
def test_the_tame_one_runs(tmp_path: Path, interface: str) -> None:
    assert run(build_hostile(tmp_path, "nothing"), interface) == pytest.approx(1.0 - np.exp(-1.0), rel=5e-3)


@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
@pytest.mark.parametrize("interface", INTERFACES)
@pytest.mark.parametrize("name", [n for n, h in HOSTILE.items() if h.message])
def test_failures_while_running_are_one_line_with_the_time(
    tmp_path: Path, name: str, interface: str, driver: str
) -> None:
    file = build_hostile(tmp_path, name)
    with pytest.raises(SimulationError, match=HOSTILE[name].message) as caught:
        run(file, interface)
    assert caught.value.time == pytest.approx(0.5, abs=0.05)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", BROKEN_FILES)
def test_broken_files_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    file = build_broken(tmp_path, name)
    with pytest.raises(FmuError, match=BROKEN_FILES[name][1]) as caught:
        run(file, "cs")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(file))
    assert not list(tmp_path.parent.rglob("escaped.txt"))


@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
@pytest.mark.parametrize("interface", INTERFACES)
@pytest.mark.parametrize("name", ["lazy-restore", "wrong-restore", "random"])
def test_a_lying_saved_state_is_found_out_and_replayed(tmp_path: Path, name: str, interface: str, driver: str) -> None:
    file = build_hostile(tmp_path, name)
    with load(file, interface) as model, model.open_session() as session:
        assert model.snapshot_method() == "replay"
        session.advance(0.3, signals={"u": Constant(2.0)})
        before = session.values(["x"])["x"]
        saved = session.snapshot()
        session.advance(0.6, signals={"u": Constant(-5.0)})
        session.restore(saved)
        assert session.time == 0.3
        assert session.values(["x"])["x"] == pytest.approx(before, abs=0.0 if name != "random" else 1e-3)


def test_an_honest_saved_state_is_used(tmp_path: Path) -> None:
    with load(build_hostile(tmp_path, "nothing")) as model:
        assert model.snapshot_method() == "state"


def test_an_fmu_that_is_not_made_again_after_its_log_categories_is_refused(tmp_path: Path) -> None:
    """It refuses the categories that its description names, and then a second instance: NULL."""
    components = [1]
    functions: dict[str, Any] = {
        "fmi2Instantiate": lambda *_: components.pop() if components else None,
        "fmi2SetDebugLogging": lambda *_: ERROR,
        "fmi2FreeInstance": lambda *_: None,
    }
    description = dataclasses.replace(describe(Hybrid()), log_categories=("logStatusError",))
    with pytest.raises(FmuError, match=r"^made\.fmu: the FMU cannot be instantiated"):
        Instance2(description, tmp_path, interface="me", source="made.fmu", library=Library(functions))
    assert not components


def test_a_copy_that_cannot_be_loaded_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "_is_loaded", lambda _path: True)
    file = tmp_path / "binaries" / "broken.so"
    file.parent.mkdir()
    file.write_bytes(b"not a library")
    holder = scratch_folder("beside").parent
    with pytest.raises(FmuError, match="cannot load this FMU's binary"):
        library.load_alone(file, version=2, interface="me", identifier="broken")
    assert not list(holder.glob("alone-*"))


KEYS = """
import sys, threading
sys.path.insert(0, {root!r})
from workbench import load, simulate
for _ in range(3):
    with load({file!r}, "cs") as model:
        simulate(model, stop=0.1, in_process=True)
    thread = threading.Thread(target=print, args=["alive"])
    thread.start()
    thread.join()
"""


def test_a_key_that_the_fmu_has_not_taken_is_not_given_back(tmp_path: Path) -> None:
    """It is the first key of the process, which is Python's: without it Python ends at the next thread."""
    code = KEYS.format(root=str(ROOT), file=str(build_mimic(tmp_path, "keyless")))
    done = subprocess.run([sys.executable, "-c", code], timeout=120, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, ["alive"] * 3), done.stderr


# What a worker process has to survive really happens.

ENDS = {"segfault": -11, "segfault-at-start": -11, "abort": -6, "exit": 3}


def test_the_list_for_workers_is_complete() -> None:
    assert set(NEEDS_WORKER) == {*ENDS, "hang", "hang-at-start", "memory", "chatter"}
