"""Whether compiled sessions do what their readable twins in Python do, whatever is done with them.

Random plays of two or three advances, with snapshots, restored or not, and random signals, on bundled FMUs, those of
OpenModelica and a hybrid one, by both interfaces and solvers: tests/test_kernel_sessions.py with other plays, and more.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def run(*, cases: int = 20, seed: int = 1) -> int:
    """Return 1 if two differ.

    Args:
        cases: plays of each FMU, interface and solver.
        seed: of the plays.
    """
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", f"--hypothesis-seed={seed}"]
    environment = {**os.environ, "WORKBENCH_SESSIONS": str(cases)}
    return int(subprocess.call([*command, "tests/test_kernel_sessions.py"], cwd=ROOT, env=environment) != 0)
