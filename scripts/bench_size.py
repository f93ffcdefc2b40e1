#!/usr/bin/env python3
"""What large models cost, and how exact the methods for them are: one table.

    python scripts/bench_size.py                      this checkout
    python scripts/bench_size.py --against FOLDER     beside another one, with its environment in FOLDER/.venv
    python scripts/bench_size.py --only lin,info      the rows whose names begin so

Each command runs in a process of its own: its CPU time with that of all its processes, and the most memory that one of
them took; what is less than this script's own, some 80 MiB, is not seen. What is read for the first time has an empty
cache. Compilers keep what they made: the first build fills theirs, and is told apart.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

import workbench as wb  # noqa: E402
from tests.large_fmus import build_large, build_loop  # noqa: E402
from tests.stub_fmus import stub_library  # noqa: E402
from workbench.build.toolchain import host_only  # noqa: E402
from workbench.core.machine.blas import one_thread  # noqa: E402
from workbench.core.machine.files import pack  # noqa: E402
from workbench.core.values.large import poles_about  # noqa: E402
from workbench.core.values.linear import Linear  # noqa: E402
from workbench.core.values.modal import poles_near  # noqa: E402

STATES, VARIABLES = 2000, 100_000
MIB = 1024.0  # of ru_maxrss [KiB]
CHAIN = """model Chain{n}
  parameter Integer n = {half};
  parameter Real c = {stiffness};
  parameter Real d = 0.5;
  input Real u(start = 0);
  output Real y;
  Real x[n](each start = 0, each fixed = true);
  Real v[n](each start = 0, each fixed = true);
equation
  for i in 1:n loop
    der(x[i]) = v[i];
  end for;
  der(v[1]) = u - c*(x[1] - x[2]) - d*(v[1] - v[2]);
  for i in 2:n-1 loop
    der(v[i]) = c*(x[i-1] - 2*x[i] + x[i+1]) + d*(v[i-1] - 2*v[i] + v[i+1]);
  end for;
  der(v[n]) = c*(x[n-1] - 2*x[n]) + d*(v[n-1] - 2*v[n]);
  y = x[n];
end Chain{n};
"""


@dataclass(frozen=True)
class Cost:
    """What a command took.

    Attributes:
        cpu: of it and its processes [s].
        wall: [s].
        memory: the most that one of them took [MiB].
        good: whether it ended well.
    """

    cpu: float
    wall: float
    memory: float
    good: bool

    def __str__(self) -> str:
        shown = f"{self.cpu:7.2f} s {self.wall:7.2f} s {self.memory:6.0f} MiB"
        return shown if self.good else f"{shown} FAILED"


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        name: of what is measured.
        goal: as text.
        arguments: of the command `workbench`.
        fresh: the cache is emptied before.
    """

    name: str
    goal: str
    arguments: Sequence[str]
    fresh: bool = False


def main() -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="another checkout, with its environment in .venv")
    parser.add_argument("--only", default="", help="beginnings of names, separated by commas")
    asked = parser.parse_args()
    pythons = [ROOT] + ([asked.against.resolve()] if asked.against else [])
    wanted = tuple(asked.only.split(","))
    print(f"{'':34} {'goal':>12}  " + "  ".join(f"{folder.name + ': CPU, wall, memory':32}" for folder in pythons))
    with tempfile.TemporaryDirectory() as folder:
        for row in rows(Path(folder)):
            if row.name.startswith(wanted):
                found = [measured(row, python, Path(folder) / f"cache-{i}") for i, python in enumerate(pythons)]
                print(f"{row.name:34} {row.goal:>12}  " + "  ".join(f"{cost!s:32}" for cost in found), flush=True)
        if "accuracy".startswith(wanted):
            for line in accuracies(Path(folder)):
                print(line, flush=True)
    return 0


def measured(row: Row, checkout: Path, cache: Path) -> Cost:
    """Return what a command takes in a checkout."""
    if row.fresh and cache.exists():
        cache.rename(cache.with_name(f"{cache.name}-{time.monotonic_ns()}"))
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    environment.pop("PYTHONPATH", None)
    python = checkout / ".venv" / "bin" / "python"
    start = time.perf_counter()
    process = subprocess.Popen(
        [python, "-m", "workbench", *row.arguments], cwd=checkout, env=environment,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - start
    return Cost(used.ru_utime + used.ru_stime, wall, used.ru_maxrss / MIB, process.returncode == 0)


def rows(folder: Path) -> Iterator[Row]:
    """Yield the rows; the models are made as they come."""
    yield Row("start: --version", "", ["--version"])
    yield Row("start: info of a small FMU", "", ["info", "fmu:Rudder"])
    big = str(variables(folder))
    yield Row("info: 100,000 variables, first", "2 s, 200 MiB", ["info", big], fresh=True)
    yield Row("info: 100,000 variables, again", "0.5 s", ["info", big])
    for n, times in ((6, ("compiler's cache empty", "")), (500, ("",)), (STATES, ("",))):
        for number, words in enumerate(times):
            source = folder / f"Chain{n}-{number}.mo"
            source.write_text(CHAIN.format(n=n, half=n // 2, stiffness=100.0 + number), encoding="utf-8")
            name = f"build: {n} states{f', {words}' if words else ''}"
            goal = "8 s" if n == 500 else ""
            yield Row(name, goal, ["build", str(source), "--out", str(folder / "made.fmu")], fresh=bool(words))
    rod, chain = (str(build_large(folder, kind, STATES)) for kind in ("rod", "chain"))
    yield Row(f"simulate: rod, {STATES} states, 10 s", "3 s", ["simulate", rod, "--stop", "10", "--solver", "gear"])
    for name, file in (("rod", rod), ("chain", chain)):
        yield Row(f"lin: {name}, {STATES} states", "5 s", ["lin", file])
    sine = ["--input", "u", "--output", "y", "--freq", "0.1", "--amplitude", "1"]
    yield Row(f"nfr: a point of the rod, {STATES}", "2 s", ["nfr", rod, *sine])
    for name, file in (("rod", rod), ("chain", chain)):
        followed = ["modes", file, "--vary", "u=0:1", "--count", "10"]
        yield Row(f"modes: ten of the {name}, 41 values", "10 s", followed)
    loop = str(build_loop(Path(rod)))
    yield Row(f"loop: simulate, rod of {STATES}, 10 s", "", ["simulate", loop, "--stop", "10", "--input", "r=1"])
    yield Row(f"loop: lin, rod of {STATES}", "", ["lin", loop])
    yield Row(f"loop: nfr, a point, rod of {STATES}", "", ["nfr", loop, "--input", "r", *sine[2:]])
    yield Row("loop: modes, ten, 41 values", "", ["modes", loop, "--vary", "r=0:1", "--count", "10"])


def variables(folder: Path) -> Path:
    """Return an FMU of many parameters."""
    (host,) = host_only()
    each = "".join(
        f'<ScalarVariable name="part[{i // 100}].x[{i % 100}]" valueReference="{i}" causality="parameter" '
        f'variability="fixed" description="variable {i}"><Real start="{i}.5"/></ScalarVariable>'
        for i in range(VARIABLES)
    )
    xml = (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" modelName="Big" guid="{big}" '
        'numberOfEventIndicators="0"><ModelExchange modelIdentifier="large"/>'
        f"<ModelVariables>{each}</ModelVariables><ModelStructure/></fmiModelDescription>"
    )
    file = folder / "big.fmu"
    library = {f"binaries/{host.name_2}/large{host.suffix}": stub_library("large")}
    pack(file, {"modelDescription.xml": xml.encode(), **library})
    return file


def accuracies(folder: Path) -> Iterator[str]:
    """Yield how far the sparse and the Krylov methods are from dense algebra, line by line."""
    yield ""
    yield f"accuracy: {STATES} states, sparse and Krylov against dense algebra"
    for kind in ("rod", "chain"):
        with wb.load(build_large(folder, kind, STATES)) as model:
            linear: Linear = wb.lin(model, in_process=True).result
        A, B, C = linear.A, linear.B, linear.C
        frequencies = np.array([0.1, 1.0, 10.0])
        with one_thread():
            poles = np.linalg.eigvals(A)
            dense = [C @ np.linalg.solve(2j * np.pi * f * np.eye(STATES) - A, B) + linear.D for f in frequencies]
        response = np.abs(linear.response(frequencies) - dense) / np.abs(dense)
        yield f"  {kind}: response, relative: {response.max():.1e}"
        norm = float(np.abs(A).sum(axis=1).max())
        for about in (0.0, 5.0):
            found = poles_near(A, 50, about)
            off = np.abs(found.value[:, None] - poles).min(axis=1)
            upper = poles[poles.imag >= 0.0]
            nearest = upper[np.argsort(np.abs(upper - 2j * np.pi * about))[: len(found)]]
            left_out = np.abs(nearest[:, None] - poles_about(A, about)).min(axis=1) > 1e-6 * np.abs(nearest)
            said = found.uncertain + 20.0 * np.finfo(float).eps * norm
            yield (
                f"  {kind}: 50 poles near {about:g} Hz: off by {(off / np.abs(found.value)).max():.1e} of their size, "
                f"{off.max() / norm:.1e} of |A|; within the stated uncertainty: {np.mean(off <= said):.0%}; "
                f"left out: {np.count_nonzero(left_out)}"
            )


if __name__ == "__main__":
    sys.exit(main())
