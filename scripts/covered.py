"""Which tests run which lines of the package: recorded by one run of the tests, for `mutants.py`.

coverage.py, with a context for each test, does not know in a worker process which test it works for; here all
processes of a run look at the number of the test in one file (`planted/sitecustomize.py`).
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path

import pytest

from scripts.planting import PLANTED, ROOT

__all__ = ["Covered", "Test", "is_recorded", "read", "record"]

FOLDER = ROOT / "build-cache" / "covered"
EVERY = 100_000  # lines: more than any module has
SLOW = 30  # a test that takes longer is of no use here [s]

# What looks at text, pictures, pages, builds and platforms: slow, and others run the same numerical lines.
ELSEWHERE = (
    *("ui_", "docs", "docstring", "examples", "release", "report", "notebook", "zoo", "command_examples"),
    *("build_", "toolchain", "compile", "kernel_sanitizers", "interrupts", "endings", "cluster", "cli_comp"),
    *("foreign_text", "contributing", "layers", "workers_", "wall", "planting", "plot_", "runtime_", "aircraft"),
)

_ROW = re.compile(r"(\d+)\t(\d+)\t(\S+\.py)\n")


@dataclass(frozen=True)
class Test:
    """A test that passed.

    Attributes:
        name: pytest's node id.
        seconds: it took, with what it alone prepared.
    """

    __test__ = False  # for pytest, which imports this module
    name: str
    seconds: float

    @property
    def file(self) -> str:
        """Of the test."""
        return self.name.partition("::")[0]

    @property
    def function(self) -> str:
        """The test without its parameters."""
        return self.name.partition("[")[0]


# -- recording: this module is a plugin of pytest, too ---------------------------------------------


class _Record:
    """Numbers the tests and says, for all processes, which one runs."""

    def __init__(self, folder: Path) -> None:
        self._number = int((folder / "now").read_text(encoding="utf-8"))  # of the last test that was recorded before
        self._now = os.open(folder / "now", os.O_WRONLY)
        self._tests = (folder / "tests").open("a", encoding="utf-8", buffering=1)
        self._seconds, self._passed = 0.0, True
        os.pwrite(self._now, b"%8d" % 0, 0)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logstart(self) -> None:
        sys.settrace(sys.modules["sitecustomize"].traced.call)  # a signal's exception in a trace function ends it
        self._number += 1
        self._seconds, self._passed = 0.0, True
        os.pwrite(self._now, b"%8d" % self._number, 0)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._seconds += report.duration
        self._passed &= report.outcome == "passed"

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        if self._passed:
            self._tests.write(f"{self._number}\t{self._seconds:.3f}\t{nodeid}\n")
        os.pwrite(self._now, b"%8d" % 0, 0)


def pytest_configure(config: pytest.Config) -> None:
    """Record the run if `record` has started it."""
    if folder := os.environ.get("WORKBENCH_TRACED"):
        config.pluginmanager.register(_Record(Path(folder)))


def is_recorded(places: Iterable[tuple[Path, int]]) -> bool:
    """Whether the last record looked for all that a test must run to notice changes in some lines.

    Args:
        places: modules, and lines in them.
    """
    wanted = FOLDER / "wanted"
    return wanted.exists() and _rows(places) <= set(wanted.read_text(encoding="utf-8").splitlines())


def record(places: Iterable[tuple[Path, int]], files: Sequence[str] = (), *, again: bool = False) -> int:
    """Run the tests, and write which of them run some lines; return pytest's exit code.

    Args:
        places: modules, and lines in them that will be changed.
        files: of tests; by default those of the numerical parts.
        again: what was recorded of other files stays.
    """
    FOLDER.mkdir(parents=True, exist_ok=True)
    rows = "".join(f"{row}\n" for row in sorted(_rows(places)))
    last = _last_number() if again else 0
    begun = {"tests": _without(files)} if again else {"tests": "", "hits": "", "wanted": rows}
    for name, content in {"now": f"{last:8d}", **begun}.items():
        (FOLDER / name).write_text(content, encoding="utf-8")
    every = sorted((ROOT / "tests").glob("test_*.py"))
    wanted = [str(f) for f in every if not f.stem.removeprefix("test_").startswith(ELSEWHERE)]
    path = os.pathsep.join([str(PLANTED), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, "PYTHONPATH": path, "WORKBENCH_TRACED": str(FOLDER)}
    plugins = [
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "-p",
        __name__ if __name__ != "__main__" else "scripts.covered",
    ]
    command = [sys.executable, "-m", "pytest", "-q", "--tb=line", *plugins, f"--timeout={SLOW}", *(files or wanted)]
    return subprocess.call(command, cwd=ROOT, env=environment)


def _rows(places: Iterable[tuple[Path, int]]) -> set[str]:
    """Return rows of line and module: what a test must run to notice a change."""
    found = (place for file, line in places for place in _lines_of(file, line))
    return {
        f"{i}\t{file.relative_to(ROOT).as_posix()}"
        for file, lines in found
        for i in (lines if len(lines) < EVERY else range(1, len(file.read_text(encoding="utf-8").splitlines()) + 1))
    }


# -- what was recorded -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Covered:
    """The record.

    Attributes:
        tests: number → test.
        hits: file → line → numbers of the tests that run it.
    """

    tests: dict[int, Test]
    hits: dict[Path, dict[int, set[int]]]

    def running(self, file: Path, line: int) -> list[Test]:
        """Return the tests that run a line, quickest first.

        What runs when a module is imported, a constant or a default, counts as run where its name is used, or else
        anywhere in the module.

        Args:
            file: of the module.
            line: in it.
        """
        numbers: set[int] = set()
        for where, lines in _lines_of(file, line):
            known = self.hits.get(where, {})
            numbers |= {n for i in lines for n in known.get(i, ())}
        return self._quickest(numbers & self.tests.keys())

    def beside(self, tests: Sequence[Test]) -> list[Test]:
        """Return the other tests of their files, quickest first: the first of them may have prepared what all look at.

        Args:
            tests: that run a line.
        """
        files, names = {t.file for t in tests}, {t.name for t in tests}
        return self._quickest(n for n, t in self.tests.items() if t.file in files and t.name not in names)

    def _quickest(self, numbers: Iterable[int]) -> list[Test]:
        return sorted((self.tests[n] for n in numbers), key=lambda t: t.seconds)


@cache
def read() -> Covered:
    """Return what was recorded last."""
    tests: dict[int, Test] = {}
    for row in (FOLDER / "tests").read_text(encoding="utf-8").splitlines():
        number, seconds, name = row.split("\t", maxsplit=2)
        tests[int(number)] = Test(name, float(seconds))
    hits: dict[Path, dict[int, set[int]]] = defaultdict(lambda: defaultdict(set))
    for test, line, file in _hits(FOLDER):
        hits[ROOT / file][line].add(test)
    return Covered(tests, hits)


def _without(files: Sequence[str]) -> str:
    """Return the rows of the tests that were recorded, but for those of some files."""
    gone = {Path(file).name for file in files}
    rows = (FOLDER / "tests").read_text(encoding="utf-8").splitlines(keepends=True)
    return "".join(row for row in rows if Path(row.split("\t")[2].partition("::")[0]).name not in gone)


def _hits(folder: Path) -> Iterator[tuple[int, int, str]]:
    """Yield number of test, line and module."""
    with (folder / "hits").open(encoding="utf-8", errors="replace") as rows:
        for row in rows:
            if match := _ROW.fullmatch(row):  # some tests' FMUs write into all files that are open
                yield int(match[1]), int(match[2]), match[3]


def _last_number() -> int:
    """Return the highest number of a test in the record, of one that failed, too; 0: there is none."""
    passed = (int(row.split("\t")[0]) for row in (FOLDER / "tests").read_text(encoding="utf-8").splitlines())
    return max(chain([0], passed, (number for number, _, _ in _hits(FOLDER))))


@cache
def _tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def _own_lines(statement: ast.stmt) -> range:
    """Return the lines of a statement without those of the statements in it."""
    body = getattr(statement, "body", None) or getattr(statement, "cases", None)
    last = getattr(body[0], "pattern", body[0]).lineno if body else (statement.end_lineno or statement.lineno) + 1
    return range(statement.lineno, max(last, statement.lineno + 1))


def _lines_of(file: Path, line: int) -> Iterator[tuple[Path, Sequence[int]]]:
    """Yield the lines that a test must run to notice a change in a line."""
    around = [n for n in ast.walk(_tree(file)) if isinstance(n, ast.stmt) and n.lineno <= line <= (n.end_lineno or 0)]
    innermost = min(around, key=lambda n: ((n.end_lineno or 0) - n.lineno, -n.lineno))
    functions = [n for n in around if isinstance(n, ast.FunctionDef)]
    if isinstance(innermost, ast.FunctionDef):  # a default
        yield file, range(innermost.body[0].lineno, (innermost.end_lineno or 0) + 1)
    elif functions:
        yield file, _own_lines(innermost)
    else:
        assigned = {n.id for n in ast.walk(innermost) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        assigned |= {n.name for n in around if isinstance(n, ast.ClassDef)}
        yield from _uses(file, assigned) if assigned else [(file, range(1, EVERY + 1))]


def _uses(file: Path, names: set[str]) -> Iterator[tuple[Path, Sequence[int]]]:
    """Yield the lines on which names of a module stand, in it and elsewhere."""
    pattern = re.compile(rf"\b(?:{'|'.join(map(re.escape, names))})\b")
    private = all(n.startswith("_") for n in names)
    for where in [file] if private else [file, *sorted(file.parent.parent.rglob("*.py"))]:
        rows = where.read_text(encoding="utf-8").splitlines()
        yield where, [i for i, row in enumerate(rows, start=1) if pattern.search(row)]
