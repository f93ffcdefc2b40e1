"""Measurements of scripts/bench.py that need a process of their own: memory, open sessions, start-up."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

_CYCLES = """
import json, sys
import workbench as wb

def resident():
    for line in open("/proc/self/status"):
        if line.startswith("VmRSS"):
            return int(line.split()[1]) * 1024

def cycle():
    for interface in ("me", "cs"):
        with wb.load("fmu:FirstOrderLag", interface, step=0.05 if interface == "cs" else None) as model:
            with model.open_session() as session:
                session.advance(1.0, signals={"u": wb.Sine(frequency=2.0)}, record=["y"])

for _ in range(50):
    cycle()
before = resident()
for _ in range(int(sys.argv[1]) // 2):
    cycle()
print(json.dumps(resident() - before))
"""

_SESSIONS = """
import contextlib, json, sys
import workbench as wb

opened, problem = 0, ""
with contextlib.ExitStack() as stack:
    model = stack.enter_context(wb.load("fmu:Rudder"))
    try:
        sessions = []
        for _ in range(int(sys.argv[1])):
            sessions.append(stack.enter_context(model.open_session()))
            opened += 1
        for session in sessions:
            session.advance(0.01, signals={"delC": wb.Sine(frequency=2.0)})
    except wb.WorkbenchError as error:
        problem = str(error)
print(json.dumps([opened, problem]))
"""


def _python(code: str, *arguments: str) -> object:
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"a measuring process ended with {done.returncode}: {done.stderr.strip()[-300:]}")
    return json.loads(done.stdout)


def cycle_growth(cycles: int) -> float | None:
    """Return the growth of resident memory over `cycles` FMUs opened, run and closed [bytes]; None: not known."""
    if not Path("/proc/self/status").exists():
        return None
    return float(str(_python(_CYCLES, str(cycles))))


def open_at_once(count: int) -> tuple[int, str]:
    """Open `count` sessions on one model and advance them all; return how many opened, and what stopped it."""
    found = _python(_SESSIONS, str(count))
    if not isinstance(found, list):
        raise TypeError(found)
    return int(found[0]), str(found[1])


def command_time(words: Sequence[str], repeats: int) -> float:
    """Return the median wall time of a `workbench` command [s]."""
    times = []
    for turn in range(repeats + 1):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "workbench", *words], cwd=ROOT, capture_output=True, check=True)
        if turn:
            times.append(time.perf_counter() - start)
    return statistics.median(times)
