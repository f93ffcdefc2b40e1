#!/usr/bin/env python3
"""Measure the inner loop against what it replaces, and what must stay small.

    python scripts/bench.py                    all benches; a table, and bench.json
    python scripts/bench.py --only cs,me       the benches whose names begin so
    python scripts/bench.py --quick            fewer repetitions and cycles

Both sides of a pair are measured in one run, alternating; medians; ratios. Nothing here is a test: times
depend on the machine and on what else it does. Run it with the project's Python (see scripts/dev.py).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from workbench.core.values.arrays import Floats

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

import workbench as wb  # noqa: E402
from scripts import bench_fmpy, bench_processes, bench_systems  # noqa: E402
from tests.drivers import DRIVERS, driven_by  # noqa: E402
from workbench.jobs.options import Workers  # noqa: E402


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        name: what is measured.
        ours, theirs: the two sides of a pair, or one value alone, as text with units.
        ratio: theirs / ours, or the value that the goal is about.
        goal: as text.
        met: whether it is; None: nothing to say.
        seconds: the raw medians [s] or other numbers, by name.
    """

    name: str
    ours: str = ""
    theirs: str = ""
    ratio: float | None = None
    goal: str = ""
    met: bool | None = None
    numbers: dict[str, float] | None = None
    note: str = ""


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    repeats: int
    steps: int
    cycles: int
    sessions: int
    sweep: tuple[float, float]
    amplitudes: tuple[float, ...]


FULL = Size(repeats=7, steps=20_000, cycles=2_000, sessions=500, sweep=(0.5, 20.0), amplitudes=(0.25, 1.0, 4.0))
QUICK = Size(repeats=3, steps=5_000, cycles=200, sessions=100, sweep=(5.0, 20.0), amplitudes=(1.0,))
STEP = 1e-3  # [s]
FREQUENCY = 2.0  # [Hz]


class MissingError(Exception):
    """A part of the workbench that this bench needs is not there."""


def alternate(sides: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return the median wall time of each side [s], measured in turns after one turn to warm up."""
    times: dict[str, list[float]] = {name: [] for name in sides}
    for turn in range(repeats + 1):
        for name, run in sides.items():
            start = time.perf_counter()
            run()
            if turn:
                times[name].append(time.perf_counter() - start)
    return {name: statistics.median(values) for name, values in times.items()}


# Co-simulation


def cs(size: Size) -> Iterator[Row]:
    """Stepping a slave: ours, FMPy's calls in Python, and loops in C.

    FMPy's loop and the plain one in C hold the input, so ours does in those pairs, and the answers agree. By default
    ours gives the input's slope where the FMU takes it, which is another, more accurate computation with two more
    calls a step; its pair is a loop in C that makes the same calls.
    """
    n = size.steps
    for file, name in ((bench_fmpy.gain(), "Gain"), (ROOT / "fmus" / "fmi2" / "FirstOrderLag.fmu", "FirstOrderLag")):
        held = partial(wb.load, file, "cs", step=STEP)
        with (
            bench_fmpy.Slave(file) as slave,
            held(hold_inputs=True) as plain,
            held() as model,
            plain.open_session() as holding,
            model.open_session() as session,
        ):
            sides: dict[str, Callable[[], float]] = {
                "held": partial(_our_loop, holding, n),
                "fmpy": partial(slave.python_loop, n, STEP, FREQUENCY),
                "bare": partial(slave.c_loop, "bare_loop", n, STEP, FREQUENCY),
                "ours": partial(_our_loop, session, n),
                "same": partial(slave.c_loop, "same_calls", n, STEP, FREQUENCY),
            }
            last = {side: run() for side, run in sides.items()}
            times = alternate(sides, size.repeats)
        per = {side: value / n for side, value in times.items()}
        same = [last["held"], last["fmpy"], last["bare"]]
        apart = f"last outputs differ by {max(same) - min(same):.1e}"
        yield _ratio(f"CS {name}, held: FMPy's loop / ours", per["held"], per["fmpy"], 15.0, "µs/step", note=apart)
        yield _ratio(f"CS {name}, held: ours / bare C loop", per["bare"], per["held"], 1.3, "µs/step", at_most=True)
        calls = "the loop in C makes the same calls: slope, step, output, input, output"
        yield _ratio(
            f"CS {name}, slopes: ours / C loop", per["same"], per["ours"], 1.3, "µs/step", at_most=True, note=calls
        )


def _our_loop(session: wb.Session, n: int) -> float:
    """Make n steps from where the session stands; the first time from 0, as the others."""
    end = session.time + n * STEP
    record = session.advance(end, signals={"u": wb.Sine(frequency=FREQUENCY)}, record=["y"])
    return float(record.values["y"][record.time == end][0])


def _ratio(
    name: str, small: float, large: float, goal: float, unit: str, *, at_most: bool = False, note: str = ""
) -> Row:
    scale = {"µs/step": 1e6, "ms": 1e3, "s": 1.0}[unit]
    ratio = large / small
    words = [f"{value * scale:.3g} {unit}" for value in (small, large)]
    ours, theirs = reversed(words) if at_most else words
    numbers = {"ours": large if at_most else small, "theirs": small if at_most else large}
    met = ratio <= goal if at_most else ratio >= goal
    return Row(name, ours, theirs, ratio, f"{'≤' if at_most else '≥'} {goal:g}", met, numbers, note)


# Model exchange


def me(size: Size) -> Iterator[Row]:
    """Rudder with gear against FMPy's CVode wrapper, at equal tolerance and at equal accuracy."""
    file = ROOT / "fmus" / "fmi2" / "Rudder.fmu"
    stop, tolerance = 2.0, 1e-6
    points = np.linspace(0.0, stop, 201)[1:]
    signals = {"delC": wb.Sine(frequency=FREQUENCY, amplitude=2.0)}
    with driven_by("python"), wb.load(file, "me", "vkm", tolerance=1e-11) as exact:
        truth = _run_ours(exact, signals, points)
    fmpy_side = bench_fmpy.Exchange(file, "delC", "del", points, signals["delC"])
    with wb.load(file, "me", "gear", tolerance=tolerance) as model:
        ours_error = _error(_run_ours(model, signals, points), truth)
        choices = _accuracies(fmpy_side, truth, tolerance, ours_error)
        for label, interval, error in choices:
            ours, theirs = partial(_run_ours, model, signals, points), partial(fmpy_side.run, tolerance, interval)
            times = alternate({"ours": ours, "fmpy": theirs}, size.repeats)
            row = _ratio(f"ME Rudder gear, {label}: simulate_fmu / ours", times["ours"], times["fmpy"], 20.0, "ms")
            numbers = {**(row.numbers or {}), "error_ours": ours_error, "error_theirs": error, "interval": interval}
            note = f"largest errors {ours_error:.1e} and {error:.1e} of the range (output every {interval:g} s)"
            yield replace(row, numbers=numbers, note=note)


def _run_ours(model: wb.DescribedModel, signals: Mapping[str, wb.Signal], points: Floats) -> Floats:
    with model.open_session() as session:
        record = session.advance(float(points[-1]), signals=signals, record=["del"], points=points)
    at = np.searchsorted(record.time, points, side="right") - 1
    return record.values["del"][at]


def _error(values: Floats, truth: Floats) -> float:
    return float(np.max(np.abs(values - truth)) / np.ptp(truth))


def _accuracies(
    side: bench_fmpy.Exchange, truth: Floats, tolerance: float, wanted: float
) -> list[tuple[str, float, float]]:
    """Equal tolerance, and the longest output interval with which FMPy is as accurate as we are."""
    intervals = [0.01, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4]
    first = _error(side.run(tolerance, intervals[0]), truth)
    found = [("equal tolerance", intervals[0], first)]
    for interval in intervals:
        error = _error(side.run(tolerance, interval), truth)
        if error <= 1.5 * wanted or interval == intervals[-1]:
            label = "equal accuracy" if error <= 1.5 * wanted else "the best of it"
            found.append((label, interval, error))
            break
    return found


# Sweeps


def sweep(size: Size) -> Iterator[Row]:
    """The sweep of the demo with the compiled sessions and with the tests' oracle in Python, in this process."""
    in_process = Workers(in_process=True)
    sides = {driver: partial(_sweep, size, driver, in_process) for driver in DRIVERS}
    times = alternate(sides, max(1, size.repeats // 3))
    yield _ratio("demo sweep: oracle in Python / compiled", times["compiled"], times["python"], 30.0, "s")


# Model, input, output, frequencies [Hz], amplitude: sweeps that are solved for beside the same ones waited for.
_RESPONSES = {
    "Rudder": ("delC", "del", np.geomspace(0.5, 20.0, 12), 1.0),
    "Aircraft": ("elevator", "z_front_fuselage", np.geomspace(2.8, 8.0, 10), 1e-3),
}


def solving(size: Size) -> Iterator[Row]:
    """Points of a frequency response solved for, and waited for as the source did."""
    for name, (u, y, frequencies, amplitude) in _RESPONSES.items():
        with wb.load(f"fmu:{name}") as model:
            asked: dict[str, Any] = {
                "frequencies": frequencies,
                "amplitudes": [amplitude],
                "in_process": True,
                "drift_check": False,
            }
            sides = {m: partial(wb.nfr, model, u, y, method=m, **asked) for m in ("settle", "auto")}
            times = alternate(sides, max(1, size.repeats // 3))
        yield _ratio(
            f"{name}, {len(frequencies)} points: waited for / solved for", times["auto"], times["settle"], 1.0, "s"
        )


def workers(size: Size) -> Iterator[Row]:
    """A sweep of several seconds with one worker process and with two; starting them is not left out."""
    sides = {str(n): partial(_sweep, size, "compiled", Workers(jobs=n), ratio=1.01, solver="vkm") for n in (1, 2)}
    times = alternate(sides, max(1, size.repeats // 3))
    row = _ratio("fine sweep: one worker / two", times["2"], times["1"], 1.8, "s")
    yield replace(row, note=f"Rudder with vkm; {os.cpu_count()} cores")


def _sweep(size: Size, driver: str, where: Workers, *, ratio: float = 1.2, solver: str = "auto") -> None:
    with driven_by(driver), wb.load("fmu:Rudder", "auto", solver) as model:
        wb.nfr(model, "delC", "del", band=size.sweep, ratio=ratio, amplitudes=size.amplitudes, workers=where)


# Systems


def systems(size: Size) -> Iterator[Row]:
    """A loop of three FMUs beside FMPy's calls at the same accuracy; the cost of a right-hand side of up to 50 FMUs."""
    for tolerance in (1e-3, 1e-4)[: 1 if size is QUICK else 2]:
        with bench_systems.OurLoop(tolerance) as ours, bench_systems.FmpyLoop() as theirs:
            wanted = bench_systems.loop_error(ours.run())
            count, error = bench_systems.equal_step(theirs, wanted)
            times = alternate({"ours": ours.run, "fmpy": partial(theirs.run, count)}, size.repeats)
        name = f"loop of three, tolerance {tolerance:g}: FMPy's doStep / ours"
        row = _ratio(name, times["ours"], times["fmpy"], 20.0, "ms")
        step = bench_systems.GRID / count
        note = f"errors against the closed form {wanted:.1e} and {error:.1e} (a step of {1e3 * step:.3g} ms); one delay"
        yield replace(row, note=note, numbers={**(row.numbers or {}), "error_ours": wanted, "error_theirs": error})
    for words, feed_through, solver in (
        ("states as outputs", False, "vkm"), ("feed-through", True, "vkm"),
        ("states as outputs", False, "gear"), ("feed-through", True, "gear"),
    ):  # fmt: skip
        found = bench_systems.growth(15 * size.repeats, feed_through=feed_through, solver=solver)
        costs = dict(zip(bench_systems.SIZES, found.seconds, strict=True))
        last = max(costs)
        yield Row(
            f"{last} FMUs, {words}, {solver}: slope at the end / of all",
            f"{1e6 * costs[last]:.2f} µs/rhs",
            "",
            1.0 + found.last_slope,
            "1 ± 0.2",
            abs(found.last_slope) <= 0.2,
            {f"seconds_{n}": cost for n, cost in costs.items()},
            f"{', '.join(f'{n}: {1e6 * c:.2f} µs' for n, c in costs.items())}; off a straight line by at most "
            f"{100 * found.off_line:.0f} %; {1e9 * found.slope:.0f} ns for each FMU",
        )


# What must stay small


def cycles(size: Size) -> Iterator[Row]:
    """Open, run and close FMUs over and over: no failure, no growth."""
    growth = bench_processes.cycle_growth(size.cycles)
    if growth is None:
        raise MissingError("resident memory is not known on this system")
    words = f"{growth / 1e6:.1f} MB"
    yield Row(f"growth over {size.cycles} open/run/close cycles", words, "", growth / 1e6, "< 10 MB", growth < 10e6)


def sessions(size: Size) -> Iterator[Row]:
    """Many sessions open at once."""
    opened, problem = bench_processes.open_at_once(size.sessions)
    met = opened == size.sessions or bool(problem)
    yield Row("sessions open at once", str(opened), "", opened, str(size.sessions), met, None, problem)


def lin(size: Size) -> Iterator[Row]:
    """Linearise a model of 71 states and 2 inputs."""
    with wb.load(bench_fmpy.seventy_one(), "me") as model:
        for method in ("exact", "difference"):
            took = alternate({"lin": partial(wb.lin, model, method=method)}, size.repeats)["lin"]
            yield Row(f"lin of 71 states, {method}", f"{1e3 * took:.1f} ms", "", took, "< 0.2 s", took < 0.2)


def start(size: Size) -> Iterator[Row]:
    """Wall time of the command line."""
    for words, goal in ((["--help"], 0.4), (["info", "fmu:Rudder"], 0.7)):
        took = bench_processes.command_time(words, size.repeats)
        yield Row(f"workbench {' '.join(words)}", f"{took:.2f} s", "", took, f"< {goal} s", took < goal)


def kernel(_: Size) -> Iterator[Row]:
    """Size of the compiled inner loop on disk."""
    for file in sorted((ROOT / "workbench" / "kernel" / "lib").glob("*/workbench_kernel.*")):
        if file.suffix in {".so", ".dll", ".dylib"}:
            yield Row(f"kernel for {file.parent.name}", f"{file.stat().st_size / 1024:.0f} KiB")


BENCHES: dict[str, Callable[[Size], Iterator[Row]]] = {
    "cs": cs, "me": me, "sweep": sweep, "solving": solving, "workers": workers, "cycles": cycles,
    "sessions": sessions, "start": start, "systems": systems, "lin": lin, "kernel": kernel,
}  # fmt: skip


def measure(name: str, size: Size) -> list[Row]:
    """Run one bench; what is missing or goes wrong is a row, too."""
    try:
        return list(BENCHES[name](size))
    except MissingError as reason:
        return [Row(name, note=f"not measured: {reason}")]
    except wb.WorkbenchError as error:
        return [Row(name, met=False, note=f"failed: {error}")]


def show(rows: Sequence[Row]) -> None:
    """Print the table."""
    heads = ("bench", "ours", "other", "ratio", "goal", "")
    marks = {True: "ok", False: "MISSED", None: ""}
    lines = [
        (r.name, r.ours, r.theirs, "" if r.ratio is None else f"{r.ratio:.3g}", r.goal, marks[r.met]) for r in rows
    ]
    widths = [max(map(len, column)) for column in zip(heads, *lines, strict=True)]
    for line, note in zip([heads, *lines], ["", *(r.note for r in rows)], strict=True):
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())
        if note:
            print(f"    {note}")


def main() -> int:
    """Measure what the command line asks for; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help=f"comma separated: {', '.join(BENCHES)}")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions and cycles")
    parser.add_argument(
        "--json", type=Path, default=Path("bench.json"), help="where the figures go (default: %(default)s)"
    )
    arguments = parser.parse_args()
    wanted = [w for w in arguments.only.split(",") if w]
    rows = []
    for name in BENCHES:
        if not wanted or name in wanted:
            print(f"{name} ...", file=sys.stderr, flush=True)
            rows += measure(name, QUICK if arguments.quick else FULL)
    show(rows)
    machine = {"system": platform.platform(), "cores": os.cpu_count(), "python": platform.python_version()}
    figures = {
        "version": wb.__version__,
        "quick": arguments.quick,
        "machine": machine,
        "rows": [asdict(r) for r in rows],
    }
    arguments.json.write_text(json.dumps(figures, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 1 if any(row.met is False for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
