"""Each side of a row of scripts/bench.py in a process of its own: both ends, who asks and what answers.

    python scripts/bench_process.py MODULE:FUNCTION '{"argument": value}'

The function prepares, and returns what is measured. Each number on standard input runs it so often; a line of JSON
tells CPU time, memory and value. No numerics are imported here: a process inherits the peak memory of its parent.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import psutil

ROOT = Path(__file__).resolve().parent.parent
MOST = 1000  # runs in one measurement
MIB = 1024.0 if sys.platform == "linux" else 1024.0**2  # of ru_maxrss


# -- who asks: imports no numerics, either ------------------------------------------------------


@dataclass(frozen=True)
class Side:
    """One side of a row.

    Attributes:
        what: in the table.
        function: in bench_sides.py, or `command` of bench_process.py.
        arguments: of it.
        family: other sides of this name differ in size only: an exponent is fitted to them.
        fresh: each run is the first of its process.
    """

    what: str
    function: str
    arguments: dict[str, Any]
    family: str = ""
    fresh: bool = False


@dataclass(frozen=True)
class Cost:
    """What a side took.

    Attributes:
        cpu: median [s].
        memory: the most that the process took, or one that it waited for; not a worker that lives [MiB].
        value: what it returned last.
        problem: why it was not measured.
    """

    cpu: float = math.nan
    memory: float = math.nan
    value: Any = None
    problem: str = ""

    def __str__(self) -> str:
        return self.problem or f"{_shown(self.cpu)}, {self.memory:.0f} MiB"


def _shown(value: float) -> str:
    scale, unit = next(((s, u) for s, u in ((1.0, "s"), (1e3, "ms")) if value * s >= 1.0), (1e6, "µs"))
    return f"{value * scale:.3g} {unit}"


class Running:
    """A side in its process, in one of the checkouts; where each run is the first one, in a process after the other.

    Attributes:
        problem: why it gives no answers.
    """

    def __init__(
        self, side: Side, checkout: Path, folder: Path, *, least: float = 0.0, cache: Path | None = None
    ) -> None:
        self.side, self.checkout, self.folder, self.least, self.cache = side, checkout, folder, least, cache
        self.problem, self.count = "", 1
        self.answers: list[dict[str, Any]] = []
        self.process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def turn(self) -> None:
        """Run it once more, often enough to be measured; the first time it is prepared, and runs to warm up."""
        if self.process is None and not self.problem:
            self._start()
            if not self.side.fresh:
                self._ask("1")
        found = self._ask(str(self.count))
        while not self.side.fresh and found and self.count < MOST and found["cpu"] * self.count < 0.5 * self.least:
            self.count = min(math.ceil(self.least / max(found["cpu"], 1e-6)), MOST)
            found = self._ask(str(self.count))
        self.answers += [found] if found else []
        if self.side.fresh:
            self._end()

    @property
    def cost(self) -> Cost:
        """What it took so far."""
        if self.problem or not self.answers:
            return Cost(problem=self.problem)
        cpu, memory = (tuple(answer[key] for answer in self.answers) for key in ("cpu", "memory"))
        return Cost(statistics.median(cpu), max(memory), self.answers[-1]["value"])

    def _start(self) -> None:
        python = self.checkout / ".venv" / "bin" / "python"
        module = "bench_process" if self.side.function == "command" else "bench_sides"
        path = os.pathsep.join(filter(None, [str(self.checkout), os.environ.get("PYTHONPATH")]))
        environment = {**os.environ, "PYTHONPATH": path} | ({"XDG_CACHE_HOME": str(self.cache)} if self.cache else {})
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # a user compiles no module twice
        words = [f"{module}:{self.side.function}", json.dumps(self.side.arguments)]
        self.process = subprocess.Popen(
            [python if python.exists() else sys.executable, ROOT / "scripts" / "bench_process.py", *words],
            cwd=self.folder, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        if (found := self._ask()) and self.checkout not in Path(found["package"]).parents:
            self.problem = "its Python has another workbench"

    def _ask(self, *lines: str) -> dict[str, Any]:
        if self.problem:
            return {}
        if self.process is None or self.process.stdin is None or self.process.stdout is None:
            raise RuntimeError("its process has not been started")
        for line in lines:
            print(line, file=self.process.stdin, flush=True)
        answer: dict[str, Any] = json.loads(self.process.stdout.readline() or '{"problem": "its process ended"}')
        self.problem = answer.get("problem", "")
        return {} if self.problem else answer

    def _end(self) -> None:
        if self.process is not None:
            self.process.communicate()  # it ends with its standard input
            self.process = None


class Lab:
    """Where rows are measured.

    Attributes:
        quick: smaller models, fewer repetitions.
        checkouts: this one, and the one that it is measured against.
        folder: for all files.
    """

    def __init__(self, folder: Path, checkouts: Sequence[Path], *, quick: bool) -> None:
        self.folder, self.checkouts, self.quick = folder, checkouts, quick

    def fewer(self, full: float, quick: float) -> int:
        """Return how many there are of something."""
        return int(quick if self.quick else full)

    def made(self, function: str, **arguments: Any) -> str:
        """Return what a function of bench_sides.py made, or knows, in this checkout."""
        with Running(Side("", function, arguments), ROOT, self.folder) as running:
            running.turn()
            if running.problem:
                raise RuntimeError(f"{function}: {running.problem}")
            return str(running.cost.value)

    def measured(self, sides: Sequence[Side]) -> list[list[Cost]]:
        """Return the costs of the sides of a row, in each checkout."""
        least, turns = (0.1, 3) if self.quick else (0.3, 7)
        if any(side.fresh for side in sides):
            turns = (turns + 1) // 2
        with ExitStack() as stack:
            running = [
                [stack.enter_context(Running(s, c, self.folder, least=least, cache=cache)) for s in sides]
                for c, cache in zip(self.checkouts, (self.folder / "cache-0", self.folder / "cache-1"), strict=False)
            ]
            for _ in range(turns):
                for each in chain.from_iterable(running):
                    each.turn()
            return [[each.cost for each in checkout] for checkout in running]


# -- what answers ---------------------------------------------------------------------------


def command(words: Sequence[str], *, empty_cache: bool = False) -> Callable[[], None]:
    """Prepare a run of Python with these words.

    Args:
        words: behind `python`.
        empty_cache: whether each run begins with an empty cache, that of the compiler, too.
    """

    def run() -> None:
        cache = {"XDG_CACHE_HOME": tempfile.mkdtemp(dir=".")} if empty_cache else {}
        done = subprocess.run(
            [sys.executable, *words], env={**os.environ, **cache}, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(words)}: {done.stderr.strip()[-200:]}")

    return run


def own_time() -> float:
    """Return the CPU time of this process and the children that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def time_of_children() -> float:
    """Return the CPU time of the children that live, as workers do [s]; known to a hundredth of a second."""
    total = 0.0
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            times = child.cpu_times()
            total += times.user + times.system
    return total


def peak_memory() -> float:
    """Return the most memory that this process or an ended child has had [MiB]."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / MIB


def main() -> int:
    """Prepare, then run as often as standard input says."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what the measured code prints is no answer

    def answer(**known: object) -> None:
        print(json.dumps(known), file=answers, flush=True)

    module, _, name = sys.argv[1].partition(":")
    try:
        run = getattr(importlib.import_module(module), name)(**json.loads(sys.argv[2]))
        package = importlib.util.find_spec("workbench")
        answer(package=package.origin if package else "")
        for line in sys.stdin:
            count, value = int(line), None
            took = -time_of_children() - own_time()  # looking for children takes time, too
            for _ in range(count):
                value = run()
            took += own_time() + time_of_children()
            answer(cpu=took / count, memory=peak_memory(), value=value if isinstance(value, float | str) else None)
    except ModuleNotFoundError as error:
        answer(problem=f"{error.name} is not installed")
    except Exception as error:  # noqa: BLE001 - whatever goes wrong is a row of the table
        answer(problem=f"{type(error).__name__}: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
