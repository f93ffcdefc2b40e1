"""Requests of trim, lin and modes: what they import, options of one name, and what is left when they are stopped."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

import workbench as wb
from workbench.cli.app import run
from workbench.core.records.option import options_of
from workbench.jobs.job import Job
from workbench.point.lin.grid import LinGrid, LinPoint
from workbench.point.lin.request import LinOver
from workbench.point.trim.request import Trim

# One small FMU needs none of these, in the process of the command or in its worker.
SLOW = (
    "concurrent.futures", "control", "email", "logging", "matplotlib", "numpy.ma", "rich", "scipy", "sqlite3",
    "tomllib", "workbench.system.block_table", "workbench.system.components", "workbench.system.description",
)  # fmt: skip

# What python-control brings along, which takes a second in each worker process.
SLOWEST = ("control", "matplotlib", "scipy.signal", "scipy.stats")

LOOP = """
[components]
block = {block = "saturation", lower = -1, upper = 1}
plant = {block = "transfer_function", numerator = [-10], denominator = [1, 3, 3, 1]}
[connections]
"plant.u" = "block.y"
"block.u" = "plant.y"
"""


# Command → modules that it must not import, in the order in which one process runs them: none has to do without what
# one before it may import.
SMALL = {
    "info fmu:FirstOrderLag --in-process": SLOW,
    "trim fmu:FirstOrderLag --in-process": SLOW,
    "lin fmu:FirstOrderLag --in-process": SLOW,
    "simulate fmu:FirstOrderLag --stop 1 --in-process": SLOW,
    "limit-cycle loop.toml --block block --in-process": SLOWEST,
}
PROGRAM = """
import sys
from workbench.cli.app import run
for line in sys.argv[1:]:
    print("\\nimported:", run(line.split()), *sys.modules)
"""


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, frozenset[str]]:
    """Run the small commands in a process of their own; return what is imported after each of them."""
    folder = tmp_path_factory.mktemp("imported")
    (folder / "loop.toml").write_text(LOOP, encoding="utf-8")
    words = [sys.executable, "-c", PROGRAM, *SMALL]
    out = subprocess.run(words, capture_output=True, text=True, check=True, cwd=folder).stdout
    found = [line.split()[1:] for line in out.splitlines() if line.startswith("imported: ")]
    assert [code for code, *_ in found] == ["0"] * len(SMALL), out
    return {line: frozenset(modules) for line, (_, *modules) in zip(SMALL, found, strict=True)}


@pytest.mark.parametrize(("command", "slow"), SMALL.items())
def test_a_small_command_imports_nothing_slow(
    command: str, slow: tuple[str, ...], imported: Mapping[str, frozenset[str]]
) -> None:
    assert imported[command].isdisjoint(slow)
    assert "numpy" in imported[command]


def test_modes_have_their_own_tolerance_and_the_model_has_one(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    command = ["modes", "fmu:FirstOrderLag", "--vary", "tau=1:2", "--points", "3"]
    assert run([*command, "--precision", "0.25", "--tolerance", "1e-7", "--json", str(out)]) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["tolerance"] == 0.25


def test_models_that_are_finished_are_kept_when_a_sweep_is_stopped() -> None:
    job = Job(lambda _what, done, _total: job.stop() if done == 2 else None)
    with wb.load("fmu:FirstOrderLag") as model, pytest.raises(KeyboardInterrupt):
        LinOver({"tau": [0.5, 1.0, 2.0, 4.0]}, workers=wb.Workers(in_process=True)).run(model, job)
    grid = job.partial()
    assert isinstance(grid, LinGrid)
    # dx/dt = (u − x)/tau
    assert [p.result.A.tolist() for p in grid.points if p.result is not None] == [[[-2.0]], [[-1.0]]]
    assert [p.reason for p in grid.points] == [None, None, "not reached", "not reached"]


def test_a_heading_is_of_the_options_of_one_class_and_not_of_those_that_have_it_as_a_part() -> None:
    groups = {d.name: d.group for d in options_of(Trim)}
    assert (groups["free"], groups["at"], groups["family"]) == ("", "Model", "How it searches")


def test_a_picture_of_a_family_has_a_curve_for_each_model() -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        found = wb.lin(model).result
    good = [LinPoint({"u": value}, found) for value in (1.0, 2.0)]
    family = LinGrid("m", "me", "s", {"u": (1.0, 2.0, 3.0)}, (*good, LinPoint({"u": 3.0}, None, "no equilibrium")))
    assert {len(axes.lines) for axes in family.plot().axes if axes.lines} == {2}
