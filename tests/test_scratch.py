"""Temporary folders: gone with their process, however it ends, and left alone while it lives."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import pytest

from tests.programs import ended, start

posix = pytest.mark.skipif(os.name == "nt", reason="signals and fork")

MAKES = """
import os, signal, sys, tempfile
tempfile.tempdir = {folder!r}
from workbench.core.scratch import scratch_folder
print(scratch_folder("one"), flush=True)
{then}
"""


def makes(folder: Path, then: str = "signal.pause()") -> subprocess.Popen[str]:
    """Start a process that makes a folder in `folder` and prints its name."""
    return start(["-c", MAKES.format(folder=str(folder), then=then)])


def made(process: subprocess.Popen[str]) -> Path:
    assert process.stdout is not None
    return Path(process.stdout.readline().strip())


def test_folders_go_with_their_process(tmp_path: Path) -> None:
    process = makes(tmp_path, "")
    folder = made(process)
    process.communicate()
    assert folder.is_relative_to(tmp_path)
    assert not list(tmp_path.iterdir())


@posix
def test_those_of_the_dead_are_removed_by_the_next_and_those_of_the_living_are_not(tmp_path: Path) -> None:
    dead, alive = makes(tmp_path), makes(tmp_path)
    of_dead, of_alive = made(dead), made(alive)
    dead.kill()
    dead.communicate()
    assert of_dead.is_dir()
    after = makes(tmp_path, "")
    made(after)
    after.communicate()
    assert not of_dead.parent.exists()
    assert of_alive.is_dir()
    alive.kill()
    alive.communicate()


@posix
def test_a_copy_made_by_fork_removes_nothing(tmp_path: Path) -> None:
    process = makes(
        tmp_path, "if os.fork() == 0:\n    scratch_folder('two')\n    sys.exit(0)\nos.wait()\nsignal.pause()"
    )
    folder = made(process)
    probe = makes(tmp_path, "")
    made(probe)
    probe.communicate()
    assert folder.is_dir()
    process.kill()
    process.communicate()


@posix
def test_a_fork_of_a_program_that_has_a_model_leaves_it_usable() -> None:
    code = (
        "import os, sys, workbench as wb\n"
        "model = wb.load('fmu:FirstOrderLag')\n"
        "wb.simulate(model, stop=0.1)\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    wb.simulate(model, stop=0.1)\n"
        "    sys.exit(7)\n"
        "print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), len(wb.simulate(model, stop=0.1).time))\n"
    )
    process = start(["-c", code])
    out, err = process.communicate()
    assert (out.split(), err) == (["7", "501"], "")


@posix
def test_a_killed_program_leaves_neither_process_nor_folder(tmp_path: Path) -> None:
    code = (
        f"import signal, tempfile; tempfile.tempdir = {str(tmp_path)!r}\n"
        "import workbench as wb\n"
        "from workbench.workers.process import _idle\n"
        "with wb.load('fmu:FirstOrderLag') as model:\n"
        "    wb.simulate(model, stop=0.1)\n"
        "    print(*(w.pid for w in _idle), flush=True)\n"
        "    signal.pause()\n"
    )
    process = start(["-c", code])
    assert process.stdout is not None
    pids = [int(p) for p in process.stdout.readline().split()]
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert pids
    assert all(ended(pid) for pid in pids)
    assert not list(tmp_path.iterdir())
