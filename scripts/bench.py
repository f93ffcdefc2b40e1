#!/usr/bin/env python3
"""Measure what users wait for: the CPU time of public functions and commands, beside their peers, and their memory.

    python3 scripts/dev.py bench                       all benches, as a table
    python3 scripts/dev.py bench nfr csv               some
    python3 scripts/dev.py bench --quick               smaller models, fewer repetitions
    python3 scripts/dev.py bench --against CHECKOUT    every row here and there, by turns: before, after, ratio
    python3 scripts/dev.py bench --table PAGE.md       the table goes into a page, too

Each side of a row is a process of its own (bench_process.py) that runs a function of bench_sides.py. All sides of a row
take turns, after one turn to warm up, unless the first run of a process is what is measured. Medians. CPU time is that
of the process with its workers and compilers; memory is the peak of the process itself, or of a program that it waited
for. Another checkout is measured with the Python of its .venv, if it has one. Nothing here is a test: times depend on
the machine and on what else it does. Not for Windows.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from scripts.bench_process import ROOT, Cost, Lab, Side

MARK = "<!-- measured -->"  # what is below it in a page is written anew
STEEPEST = 1.2  # exponent of cost over size
LAG = "fmu:FirstOrderLag"
CHAIN = """model Chain{n}
  parameter Integer n = {half};
  input Real u(start = 0);
  output Real y;
  Real x[n](each start = 0, each fixed = true);
  Real v[n](each start = 0, each fixed = true);
equation
  for i in 1:n loop
    der(x[i]) = v[i];
    der(v[i]) = u - x[i] - 0.5*v[i]*abs(v[i]);
  end for;
  y = x[n];
end Chain{n};
"""


def ratio(ours: Cost, peer: Cost) -> float:
    """Return ours / peer."""
    return ours.cpu / peer.cpu


def faster(ours: Cost, peer: Cost) -> float:
    """Return peer / ours."""
    return peer.cpu / ours.cpu


def value(ours: Cost, *_: Cost) -> float:
    """Return what ours returned."""
    return math.nan if ours.value is None else float(ours.value)


def seconds(ours: Cost, *_: Cost) -> float:
    """Return the CPU time of ours."""
    return ours.cpu


def each(count: float) -> Callable[..., float]:
    """Return a function: the CPU time of ours in units of `count` seconds."""
    return lambda ours, *_: ours.cpu / count


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        name: what is measured.
        ours: the side that it is about.
        peer: what it is measured beside.
        number: of the costs of both, which the goal is about.
        unit: of it.
        most, least: the goal; None: there is none.
        size: of the model, for the exponent.
    """

    name: str
    ours: Side
    peer: Side | None = None
    number: Callable[..., float] = seconds
    unit: str = "s"
    most: float = math.inf
    least: float = -math.inf
    size: float = 0.0

    @property
    def sides(self) -> tuple[Side, ...]:
        """Ours, and the peer where there is one."""
        return (self.ours, *filter(None, [self.peer]))

    @property
    def goal(self) -> str:
        """The goal as text."""
        words = [f"≤ {self.most:g}"] if self.most < math.inf else []
        return " ".join([*words, *([f"≥ {self.least:g}"] if self.least > -math.inf else []), self.unit]).strip()


# -- the benches ------------------------------------------------------------------------------


def command(*words: str, empty_cache: bool = False, fresh: bool = False) -> Side:
    """Return a run of `workbench` with these words."""
    arguments = {"words": ["-m", "workbench", *words], "empty_cache": empty_cache}
    return Side("workbench", "command", arguments, fresh=fresh)


def start(_: Lab) -> Iterator[Row]:
    """What each command costs before it does anything, in units of `import numpy`."""
    peer = Side("import numpy", "command", {"words": ["-c", "import numpy"]})
    for words in ("--help", "nfr --help", "info fmu:Rudder", "trim fmu:Rudder", "lin fmu:Rudder"):
        yield Row(f"workbench {words}", command(*words.split()), peer, ratio, "×")


def info(lab: Lab) -> Iterator[Row]:
    """A model of 100,000 variables."""
    n = lab.fewer(100_000, 10_000)
    file = lab.made("parameters", n=n)
    for name, empty, goal in (("first", True, 2.0), ("again", False, 0.5)):
        yield Row(f"info of {n} variables, {name}", command("info", file, empty_cache=empty), most=goal)


def point(lab: Lab) -> Iterator[Row]:
    """Trim beside lin, over the number of states."""
    for n in (10, 100, 500, 2000)[: lab.fewer(4, 3)]:
        rod = lab.made("large", kind="rod", n=n)
        trim = Side("trim", "analysis", {"name": "trim", "file": rod}, "trim over states")
        lin = Side("lin", "analysis", {"name": "lin", "file": rod}, "lin over states")
        yield Row(f"trim of a rod, {n} states", trim, lin, ratio, "×", 10.0, size=n)
        if n == 2000:
            yield Row(f"trim of a rod, {n} states", trim, most=5.0)


def nfr(lab: Lab) -> Iterator[Row]:
    """A point of a frequency response beside the periods that it reports, over the number of states."""
    rods = (10, 100, 300, 500, 1000, 2000, 5000)[: lab.fewer(7, 4)]
    chains = (100, 300, 1000)[: lab.fewer(3, 2)]  # of light modes, at a static point
    for kind, n in (*(("rod", n) for n in rods), *(("chain", n) for n in chains)):
        file, series = lab.made("large", kind=kind, n=n), "a point of nfr over states" if kind == "rod" else ""
        asked = {"input": "u", "output": "y", "frequencies": [0.1], "amplitudes": [1.0]}
        ours = Side("nfr", "analysis", {"name": "nfr", "file": file, **asked}, series)
        kernel = Side("its periods in a session", "kernel_periods", {"file": file, "frequency": 0.1})
        yield Row(f"nfr of a {kind}, a point, {n} states", ours, kernel, ratio, "×", 3.0 if n >= 100 else 8.0, size=n)


def response(_: Lab) -> Iterator[Row]:
    """Points of a response solved for, beside waiting until it has settled."""
    for name, u, y, band, count, amplitude in (
        ("Rudder", "delC", "del", (0.5, 20.0), 12, 1.0),
        ("Aircraft", "elevator", "z_front_fuselage", (2.8, 8.0), 10, 1e-3),
    ):
        points = [band[0] * (band[1] / band[0]) ** (k / (count - 1)) for k in range(count)]
        asked = {"input": u, "output": y, "frequencies": points, "amplitudes": [amplitude], "drift_check": False}
        auto, settle = (
            Side(m, "analysis", {"name": "nfr", "file": f"fmu:{name}", "method": m, **asked})
            for m in ("auto", "settle")
        )
        yield Row(f"nfr of {name}, {count} points", auto, settle, ratio, "×", 1.0)


def simulate(lab: Lab) -> Iterator[Row]:
    """Time histories: many steps of co-simulation beside a loop in Python, and the least that a call costs."""
    count = lab.fewer(100_000, 20_000)
    loop = Side("FMPy's calls in Python", "fmpy_steps", {"count": count})
    for where, here, goal in (("in this process", True, 10.0), ("by a worker", False, 7.0)):
        for by in ("interval", "points"):
            sine = {"u": "sine:amplitude=1,frequency=2"}
            asked = {"stop": count * 1e-3, "rows": count, "by": by, "inputs": sine, "in_process": here}
            opened = {"interface": "cs", "step": 1e-3}
            ours = Side("", "simulation", {"file": LAG, "opened": opened, "verify_step": False, **asked})
            least = goal if by == "points" or not here else -math.inf
            yield Row(f"simulate, {count} CS steps, {by}, {where}", ours, loop, faster, "× faster", least=least)
    for where, here, goal in (("in this process", True, 1.0), ("by a worker", False, 2.5)):
        asked = {"file": LAG, "stop": 0.01, "rows": 500, "by": "interval", "in_process": here}
        yield Row(
            f"simulate, the least, {where}", Side("", "simulation", asked), number=each(1e-3), unit="ms", most=goal
        )
    for rows in (10_000, 30_000, 100_000)[: lab.fewer(3, 2)]:
        asked = {"file": LAG, "stop": 10.0, "rows": rows, "by": "points", "in_process": True}
        ours = Side("", "simulation", asked, "simulate over points")
        yield Row(f"simulate, {rows} points", ours, number=each(1e-6 * rows), unit="µs/point", size=rows)


def exchange(_: Lab) -> Iterator[Row]:
    """Model exchange beside FMPy's solver."""
    for equal, words in (("tolerance", ""), ("accuracy", " or FMPy's best")):
        peer = Side("FMPy simulate_fmu", "fmpy_exchange", {"equal": equal})
        yield Row(
            f"simulate Rudder, gear, equal {equal}{words}",
            Side("", "exchange", {}),
            peer,
            faster,
            "× faster",
            least=20.0,
        )


def transport(lab: Lab) -> Iterator[Row]:
    """Large results: from a worker, to a file, in memory."""
    rows, columns = lab.fewer(100_000, 20_000), 200
    rod = lab.made("large", kind="rod", n=columns)
    asked = {"file": rod, "rows": rows, "columns": columns}
    worker, here = (Side(w, "transport", {**asked, "in_process": h}) for w, h in (("worker", False), ("here", True)))
    size = 8e-6 * rows * columns  # [MB]
    yield Row(
        f"{size:.0f} MB from a worker, more than here", worker, here,
        lambda ours, peer: 1e3 * (ours.cpu - peer.cpu) / size, "ms/MB", 6.0,
    )  # fmt: skip
    for n in (10_000, 100_000, 1_000_000)[: lab.fewer(3, 2)]:
        ours, peer = (Side(by, "csv", {"rows": n, "by": by}, f"{by} over rows") for by in ("to_csv", "savetxt"))
        yield Row(f"to_csv, {n} rows of 3", ours, peer, each(1e-6 * n), "µs/row", 2.5, size=n)
    rows, columns = lab.fewer(1_000_000, 100_000), 20
    asked = {"file": lab.made("large", kind="rod", n=columns), "rows": rows, "columns": columns}
    ours = Side("", "memory", asked, fresh=True)
    yield Row(f"memory of a result of {rows} × {columns}", ours, number=value, unit="× its size", most=3.0)


def identify(_: Lab) -> Iterator[Row]:
    """The first call in a process: 10,000 samples, order 6, two inputs and outputs."""
    ours, *peers = (
        Side(what, "identification", {"samples": 10_000, "by": what.lower()}, fresh=True)
        for what in ("workbench", "SIPPY", "nfoursid")
    )
    for peer in peers:
        goal = 1.3 if peer.what == "SIPPY" else math.inf
        yield Row(f"identify, beside {peer.what}", ours, peer, ratio, "×", goal)


def build(lab: Lab) -> Iterator[Row]:
    """Models of Modelica to FMUs, the compiler's cache empty."""
    for n, target, goal in ((2, "host", 6.0), (2, "all", math.inf), (500, "host", 8.0))[: lab.fewer(3, 1)]:
        source = lab.folder / f"Chain{n}.mo"
        source.write_text(CHAIN.format(n=n, half=n // 2), encoding="utf-8")
        words = ("build", str(source), "--out", str(lab.folder / "made"), "--platform", target)
        ours = command(*words, empty_cache=True, fresh=True)
        yield Row(f"build, {n} states, platform {target}, empty cache", ours, most=goal)


def large(lab: Lab) -> Iterator[Row]:
    """Commands on large models."""
    n = lab.fewer(2000, 500)
    rod, chain, loop = (lab.made("large", kind=kind, n=n) for kind in ("rod", "chain", "loop"))
    sine = ["--freq", "0.1", "--amplitude", "1", "--output", "y", "--input"]
    ten = ["--count", "10", "--vary"]
    for name, most, words in (
        ("simulate 10 s of a rod", 3.0, ["simulate", rod, "--stop", "10", "--solver", "gear"]),
        ("lin of a chain", 5.0, ["lin", chain]),
        ("ten modes of a rod, 41 values", 10.0, ["modes", rod, *ten, "u=0:1"]),
        ("ten modes of a chain, 41 values", 10.0, ["modes", chain, *ten, "u=0:1"]),
        ("simulate 10 s of a loop with a rod", math.inf, ["simulate", loop, "--stop", "10", "--input", "r=1"]),
        ("lin of a loop with a rod", math.inf, ["lin", loop]),
        ("nfr of a loop with a rod, a point", math.inf, ["nfr", loop, *sine, "r"]),
        ("ten modes of a loop with a rod, 41 values", math.inf, ["modes", loop, *ten, "r=0:1"]),
    ):
        yield Row(f"workbench {name}, {n} states", command(*words, fresh=True), most=most)


def systems(lab: Lab) -> Iterator[Row]:
    """Connected FMUs: a loop beside FMPy's calls at the same accuracy, and the cost over their number."""
    peer = Side("FMPy's calls in Python", "fmpy_loop", {})
    yield Row("loop of three, equal accuracy", Side("", "loop_of_three", {}), peer, faster, "× faster", least=20.0)
    for words, direct in (("states as outputs", False), ("feed-through", True)):
        for n in (5, 10, 25, 50)[: lab.fewer(4, 3)]:
            ours = Side("", "ring_simulation", {"n": n, "feed_through": direct}, f"FMUs in a ring, {words}")
            yield Row(f"simulate a ring of {n} FMUs, {words}", ours, number=each(1e-3), unit="ms", size=n)


def leaks(lab: Lab) -> Iterator[Row]:
    """What must stay small, and what must be possible."""
    count = lab.fewer(2000, 200)
    ours = Side("", "cycles", {"count": count}, fresh=True)
    yield Row(f"growth over {count} open/run/close cycles", ours, number=value, unit="MB", most=10.0)
    count = lab.fewer(500, 100)
    ours = Side("", "sessions", {"count": count}, fresh=True)
    yield Row("sessions open at once", ours, number=value, unit="", least=count)


BENCHES: dict[str, Callable[[Lab], Iterator[Row]]] = {
    b.__name__: b
    for b in (start, info, point, nfr, response, simulate, exchange, transport, identify, build, large, systems, leaks)
}


# -- the table --------------------------------------------------------------------------------

Costs = list[list[Cost]]  # of each checkout, of each side


def exponents(measured: Sequence[tuple[Row, Costs]]) -> list[tuple[str, list[float]]]:
    """Return family → exponent of cost over size in each checkout, from a twentieth of the largest size on."""
    found: dict[str, list[list[tuple[float, float]]]] = {}
    for row, costs in measured:
        for k, side in enumerate(row.sides):
            if side.family:
                each_checkout = found.setdefault(side.family, [[] for _ in costs])
                for points, sides in zip(each_checkout, costs, strict=True):
                    points.append((row.size, sides[k].cpu))
    return [(family, [_exponent(points) for points in checkouts]) for family, checkouts in found.items()]


def _exponent(points: Sequence[tuple[float, float]]) -> float:
    largest = max(size for size, _ in points)
    logs = [(math.log(size), math.log(cpu)) for size, cpu in points if 20 * size >= largest and cpu > 0.0]
    return statistics.linear_regression(*zip(*logs, strict=True)).slope if len(logs) > 1 else math.nan


def _mark(row: Row, number: float, sides: Sequence[Cost]) -> str:
    if any(cost.problem and not cost.problem.endswith("is not installed") for cost in sides):
        return "MISSED"
    if math.isnan(number) or row.most == math.inf == -row.least:
        return ""
    return "ok" if row.least <= number <= row.most else "MISSED"


def lines_of(row: Row, costs: Costs) -> tuple[str, ...]:
    """Return the cells of a row: of this checkout, or before and after."""
    numbers = [row.number(*sides) if row.peer is None or len(sides) > 1 else math.nan for sides in costs]
    shown = [f"{number:.3g} {row.unit}".strip() if not math.isnan(number) else "" for number in numbers]
    goal = row.goal if row.most < math.inf or row.least > -math.inf else ""
    end = (goal, _mark(row, numbers[0], costs[0]))
    if len(costs) > 1:
        (after, *_), (before, *_) = costs
        change = "" if before.problem or after.problem else f"{after.cpu / before.cpu:.2f}"
        return (row.name, str(before), str(after), change, shown[1], shown[0], *end)
    ours, *peers = costs[0]
    said = [
        f"{s.what}: {c}" + (f" ({c.value})" if isinstance(c.value, str) else "")
        for s, c in zip(row.sides[1:], peers, strict=True)
    ]
    return (row.name, str(ours), *(said or [""]), shown[0], *end)


def table(measured: Sequence[tuple[Row, Costs]], *, against: bool) -> str:
    """Return all rows and the exponents as a table in Markdown, whose columns are aligned."""
    heads = ["measured", "CPU, memory", "beside", "number", "goal", ""]
    if against:
        heads = ["measured", "before", "after", "after/before", "number before", "number after", "goal", ""]
    lines = [tuple(heads), ("",) * len(heads), *(lines_of(row, costs) for row, costs in measured)]
    for family, found in exponents(measured):
        shown = ["" if math.isnan(e) else f"{e:.2f}" for e in found[::-1]]
        mark = "" if math.isnan(found[0]) else "ok" if found[0] <= STEEPEST else "MISSED"
        blank = ("",) * (len(heads) - 3 - len(found))
        lines.append((f"exponent: {family}", *blank, *shown, f"≤ {STEEPEST:g}", mark))
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    texts = ["| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in lines]
    texts[1] = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return "\n".join(texts) + "\n"


def machine(lab: Lab) -> str:
    """Return when and on what was measured."""
    processor = platform.processor() or platform.machine()
    known = Path("/proc/cpuinfo")
    if known.exists():
        names = [line.partition(":")[2].strip() for line in known.read_text().splitlines() if "model name" in line]
        processor = (names or [processor])[0]
    return (
        f"{'A quick run' if lab.quick else 'The full run'} of {datetime.now(UTC):%Y-%m-%d}: {os.cpu_count()} cores, "
        f"{processor}, {platform.system()}, Python {platform.python_version()}, {lab.made('machine')}."
    )


def write(page: Path, text: str) -> None:
    """Write a table into a page, below its mark; a page that is not there is made."""
    old = page.read_text(encoding="utf-8") if page.exists() else MARK
    page.write_text(f"{old.partition(MARK)[0]}{MARK}\n\n{text}", encoding="utf-8")


def main(words: Sequence[str] | None = None) -> int:
    """Measure what the command line asks for; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(
        prog="dev.py bench", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"by default all of {', '.join(BENCHES)}")
    parser.add_argument("--quick", action="store_true", help="smaller models, fewer repetitions")
    parser.add_argument(
        "--against", type=Path, metavar="CHECKOUT", help="another checkout, measured by turns with this"
    )
    parser.add_argument("--table", type=Path, metavar="PAGE", help=f"page to write the table into, below {MARK}")
    asked = parser.parse_args(words)
    if absent := [name for name in asked.names if name not in BENCHES]:
        parser.error(f"no bench '{absent[0]}'; there are: {', '.join(BENCHES)}")
    checkouts = [ROOT, *([asked.against.resolve()] if asked.against else [])]
    measured: list[tuple[Row, Costs]] = []
    with tempfile.TemporaryDirectory(prefix="workbench-bench-") as folder:
        lab = Lab(Path(folder), checkouts, quick=asked.quick)
        for name in asked.names or BENCHES:
            for row in BENCHES[name](lab):
                measured.append((row, lab.measured(row.sides)))
                print("  ".join(lines_of(*measured[-1])), file=sys.stderr, flush=True)
        text = f"{machine(lab)}\n\n{table(measured, against=bool(asked.against))}"
    print(text)
    if asked.table:
        write(asked.table, text)
    return int("MISSED" in text)


if __name__ == "__main__":
    sys.exit(main())
