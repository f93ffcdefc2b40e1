"""A worker that is a copy of the command's process: it is as one that was started, and ends as one."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.programs import ended, start
from workbench.jobs.process_copy import can_copy

pytestmark = pytest.mark.skipif(
    not can_copy(), reason="a worker is a copy of its command on Linux only: elsewhere libraries forbid a fork"
)

BOTH = """
import os, sys
from collections import deque
from tests.worker_tasks import surroundings
from workbench.core.machine import cycles
from workbench.jobs import worker_process as process
from workbench.jobs.options import Limits
from workbench.jobs.pool import Pool
from workbench.cli import interrupt, streams

cycles.seldom()
streams.guard()
interrupt.insist_on_interrupts()
interrupt.listen_for_endings()
import numpy
kept = open(sys.argv[0])
seen = []
for copied in (True, False):
    if copied:
        process.allow_copy()
        process.prepare(["numpy"])
    with Pool(None, jobs=1, limits=Limits(), fresh=not copied) as pool:
        seen += [reply.value for reply in pool.run(surroundings, deque([os.getpid()]))]
        print(*(type(worker._process).__name__ for worker in pool._workers))
for one, other in zip(*seen):
    print(one == other or (one, other))
process._idle.clear()
process.prepare(["numpy"])
print(*(type(worker._process).__name__ for worker in process._idle))
"""


def test_a_copy_has_what_a_worker_has_that_was_started_and_nothing_of_its_parent(tmp_path: Path) -> None:
    script = tmp_path / "both.py"
    script.write_text(BOTH, encoding="utf-8")
    process = start([str(script)])
    out, err = process.communicate(timeout=300)
    assert (out.splitlines(), err) == (["ProcessCopy", "Popen", "True", "True", "True", "Popen"], "")


COMMAND = """
import sys
from workbench.cli.app import run
from workbench.jobs import worker_process as process
alone, *words = sys.argv[1:]
code = run(words, alone=bool(alone))
print(*(type(worker._process).__name__ for worker in process._idle))
sys.exit(code)
"""


@pytest.mark.parametrize(
    "words",
    [
        "trim fmu:FirstOrderLag",
        "lin fmu:FirstOrderLag",
        "info fmu:FirstOrderLag",
        "simulate fmu:FirstOrderLag --stop 1",
    ],
)
def test_a_command_does_the_same_in_a_copy(words: str) -> None:
    lines = {}
    for alone in ("yes", ""):
        process = start(["-c", COMMAND, alone, *words.split()])
        out, err = process.communicate(timeout=300)
        lines[alone] = *out.splitlines()[:-1], err, process.returncode
        assert out.splitlines()[-1] == ("ProcessCopy" if alone else "Popen")
    assert lines["yes"] == lines[""]


def test_the_program_copies_itself() -> None:
    # What it prints at its end tells of it; in a process that also does something else no copy is made.
    code = (
        "import atexit\nfrom workbench.cli import main\nfrom workbench.jobs import worker_process as process\n"
        "atexit.register(lambda: print(*(type(w._process).__name__ for w in process._alive)))\n"
        "main(['trim', 'fmu:FirstOrderLag'])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "ProcessCopy"


ENDS = """
import os, sys
from collections import deque
import workbench as wb
from tests.worker_tasks import obey
from workbench.jobs import worker_process as process
from workbench.jobs.options import Limits
from workbench.jobs.pool import Pool
model = wb.load("fmu:FirstOrderLag")
process.allow_copy()
process._idle.clear()
process.prepare(["numpy"])
(worker,) = process._idle
with Pool(model.recipe, jobs=1, limits=Limits()) as pool:
    for event in pool.run(obey, deque([eval(word) for word in sys.argv[1:]])):
        print(worker.pid, model.recipe.folder, getattr(event, "reason", None) or event.value, flush=True)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_copy_ends_with_its_parent_whatever_ends_it(how: signal.Signals) -> None:
    process = start(["-c", ENDS, "('say', 1)", "('endless_in_c',)"])
    assert process.stdout is not None
    pid, folder, said = process.stdout.readline().split()
    process.send_signal(how)
    process.communicate()
    assert said == "1"
    assert ended(int(pid))
    assert not Path(folder).exists()


@pytest.mark.parametrize(
    ("job", "words"),
    [
        ("('segfault',)", "the FMU crashed: segmentation fault (SIGSEGV)"),
        ("('exit', 3)", "the FMU ended its process (exit code 3)"),
        ("('stdout',)", ""),
    ],
)
def test_how_a_copy_ended_is_told_rightly(job: str, words: str) -> None:
    process = start(["-c", ENDS, job, "('say', 2)"])
    out, err = process.communicate(timeout=300)
    first, *_, last = out.splitlines()
    assert words in first
    assert (last.split()[-1], err, process.returncode) == ("2", "", 0)
