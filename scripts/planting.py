"""Run Python with one module of the package changed, nothing on disk: for `plant_faults.py` and `mutants.py`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

__all__ = ["PLANTED", "ROOT", "run_planted"]

ROOT = Path(__file__).resolve().parents[1]
PLANTED = Path(__file__).with_name("planted")


def run_planted(
    arguments: Sequence[str], file: Path | None, text: str, *, timeout: float
) -> subprocess.CompletedProcess[str]:
    """Run Python in the project's folder, with the text in place of a module's own, here and in all its processes.

    Args:
        arguments: of Python.
        file: of the module; None: nothing is changed.
        text: of the module.
        timeout: how long [s].

    Raises:
        subprocess.TimeoutExpired: it did not end.
    """
    # Small matrices gain nothing from several threads, which wait for each other on a busy machine.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": os.environ.get("OPENBLAS_NUM_THREADS", "1")}
    with tempfile.TemporaryDirectory() as folder:
        if file is not None:
            module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            told = Path(folder) / "planted.json"
            planted = {"module": module.removesuffix(".__init__"), "file": str(file), "text": text}
            told.write_text(json.dumps(planted), encoding="utf-8")
            path = [str(PLANTED), *filter(None, [os.environ.get("PYTHONPATH")])]
            environment |= {"PYTHONPATH": os.pathsep.join(path), "WORKBENCH_PLANTED": str(told)}
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=timeout,
        )  # fmt: skip
