"""Temporary folders: gone with their process, however it ends, and left alone while it lives."""

from __future__ import annotations

import errno
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.platforms import posix_signals
from tests.programs import ended, start

MAKES = """
import os, signal, sys, tempfile
tempfile.tempdir = {folder!r}
from workbench.core.machine.scratch import scratch_folder
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


@pytest.mark.parametrize("number", [errno.EPERM, errno.ENOLCK, errno.ENOSYS])
@pytest.mark.skipif(sys.platform == "win32", reason="files are locked in another way there")
def test_a_folder_is_made_where_files_cannot_be_locked(tmp_path: Path, number: int) -> None:
    """As in a confined process, and on some network file systems; it is gone with its process."""
    refused = f"import fcntl\ndef refuse(*_): raise OSError({number}, 'refused')\nfcntl.flock = refuse\n"
    process = start(["-c", refused + MAKES.format(folder=str(tmp_path), then="")])
    said, failure = process.communicate(timeout=60.0)
    assert Path(said.strip()).is_relative_to(tmp_path), failure
    assert not list(tmp_path.iterdir())


@posix_signals
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


@posix_signals
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


@posix_signals
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


@posix_signals
def test_a_killed_program_leaves_neither_process_nor_folder(tmp_path: Path) -> None:
    code = (
        f"import signal, tempfile; tempfile.tempdir = {str(tmp_path)!r}\n"
        "import workbench as wb\n"
        "from workbench.jobs.worker_process import _idle\n"
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


@posix_signals
def test_a_folder_that_was_not_locked_yet_when_its_process_died_is_removed(tmp_path: Path) -> None:
    (tmp_path / "fmi-workbench-empty").mkdir()
    somebody_s = tmp_path / "fmi-workbench-notes" / "mine.txt"  # never locked, and not empty: it is none of ours
    somebody_s.parent.mkdir()
    somebody_s.write_text("kept", encoding="utf-8")
    after = makes(tmp_path, "")
    made(after)
    after.communicate()
    assert [path.name for path in tmp_path.iterdir()] == ["fmi-workbench-notes"]
    assert somebody_s.read_text(encoding="utf-8") == "kept"


@posix_signals
def test_a_link_with_its_name_leads_nowhere(tmp_path: Path) -> None:
    elsewhere = tmp_path / "home"
    elsewhere.mkdir()
    (tmp_path / "fmi-workbench-link").symlink_to(elsewhere)
    after = makes(tmp_path, "")
    made(after)
    after.communicate()
    assert not list(elsewhere.iterdir())
    assert elsewhere.is_dir()


RACE = """
import os, sys, tempfile
tempfile.tempdir = {folder!r}
from workbench.core.machine import scratch
for _ in range(200):
    scratch._Mine.folder = None  # as a new process would
    held = scratch.scratch_folder("one")
    assert held.is_dir() and (held.parent / "lock").is_file(), held
    assert scratch._lock_of(held.parent) is None
    os.close(scratch._Mine.lock)  # as at its end
"""


@posix_signals
def test_processes_that_begin_at_the_same_time_leave_each_other_alone(tmp_path: Path) -> None:
    several = [start(["-c", RACE.format(folder=str(tmp_path))]) for _ in range(4)]
    assert [process.communicate(timeout=60)[1] for process in several] == [""] * 4


@posix_signals
def test_threads_that_begin_at_the_same_time_share_a_folder(tmp_path: Path) -> None:
    code = (
        f"import tempfile, threading; tempfile.tempdir = {str(tmp_path)!r}\n"
        "from workbench.core.machine.scratch import scratch_folder\n"
        "gate = threading.Barrier(8)\n"
        "def make(): gate.wait(); scratch_folder('one')\n"
        "threads = [threading.Thread(target=make) for _ in range(8)]\n"
        "[t.start() for t in threads]; [t.join() for t in threads]\n"
    )
    process = start(["-c", code])
    assert process.communicate(timeout=60)[1] == ""
    assert not list(tmp_path.iterdir())


@posix_signals
def test_a_worker_that_is_let_go_of_removes_nothing_of_its_parent(tmp_path: Path) -> None:
    """As one whose start was interrupted: its pipe ends, the parent goes on."""
    code = (
        f"import tempfile, time; tempfile.tempdir = {str(tmp_path)!r}\n"
        "from workbench.core.machine.scratch import scratch_folder\n"
        "from workbench.jobs.worker_process import WorkerProcess\n"
        "kept = scratch_folder('kept')\n"
        "worker = WorkerProcess()\n"
        "worker._process.stdin.close()\n"
        "worker._process.wait(30)\n"
        "print(kept.is_dir())\n"
    )
    process = start(["-c", code])
    assert process.communicate(timeout=60) == ("True\n", "")
