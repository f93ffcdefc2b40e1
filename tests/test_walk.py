"""How far a user's command is from the compiled code, in calls of our own."""

from __future__ import annotations

import subprocess
import sys

import pytest

# Run in a process of its own: `main` takes over its signals.
COUNTED = """
import sys
from workbench.cli import main
from workbench.kernel.library import kernel

step, ways = kernel().kernel_me_run, []

def watched(*arguments):
    frame, way = sys._getframe(1), []
    while frame.f_code is not main.__code__:
        if frame.f_globals["__name__"].startswith("workbench."):
            way.append(frame.f_code.co_name)
        frame = frame.f_back
    ways.append(["main", *reversed(way)])
    return step(*arguments)

kernel().kernel_me_run = watched
try:
    line = "nfr fmu:FirstOrderLag --input u --output y --freq 1 --amplitude 1 --in-process --method"
    main([*line.split(), *sys.argv[1:]])
finally:
    print("way:", *max((w for w in ways if "harmonics" in w), key=len), file=sys.stderr)
"""


@pytest.mark.parametrize(("method", "own"), [("auto", "lap"), ("settle", "run_point")])
def test_a_frequency_passes_at_most_ten_functions_from_main_to_the_kernel(method: str, own: str) -> None:
    ended = subprocess.run([sys.executable, "-c", COUNTED, method], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "period" in ended.stdout  # the page of the result
    *_, told = ended.stderr.splitlines()
    begin, *way = told.split()
    assert begin == "way:"
    assert way[0] == "main"
    assert {own, "harmonics"} <= set(way)  # the points, not what looks at the model before
    assert len(way) <= 10, " → ".join(way)
