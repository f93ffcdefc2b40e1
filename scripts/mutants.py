#!/usr/bin/env python3
"""Which changes of the numerical code do the tests not notice?

    python scripts/mutants.py                         300 mutants of the numerical rooms
    python scripts/mutants.py --count 20 workbench/core/values/linear.py
    python scripts/mutants.py --seed 7 --count 60     the same ones at each commit that leaves the code as it is
    python scripts/mutants.py --again tests/test_linear.py    after tests were added there
    python scripts/mutants.py --list --count 20       show them, run nothing

A mutant is one operator, comparison, number or condition changed. They are drawn from the code as it is, by a
seed that follows from the commit (--seed: another). Each is run, without a change
on disk, against tests that run its line, the quickest first, until one fails; which they are is recorded once
(`covered.py`; --record does so again, --again for some files of tests). It is killed where one of them fails, or does
not end, and passes without it. What survives is listed: mend it by a test with a truth of its own (a closed form, a
residual, a second method), never by writing down what comes out. Some change
nothing that anybody could see.

A driver of our own: mutmut wants all tests in one run of one process first, which takes ten minutes here and does not
see worker processes; cosmic-ray has one test command for all modules, and changes the files themselves.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.covered import Test, is_recorded, read, record
from scripts.planting import ROOT, run_planted

FOLDERS = (
    "point", "response", "health", "data", "loops", "identification", "limit_cycles",
    "core", "system", "session", "kernel",
)  # fmt: skip
COUNT = 300
TESTS, SECONDS = 300, 60.0  # of a mutant, at most: so many tests, which take so long [s]
PATIENCE, LEAST = 4.0, 30.0  # times what the tests take without a change; [s]
ENOUGH = 0.9  # of them

_COMPARED = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==", ast.Is: "is not",
    ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
_COMPUTED = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.Pow: "*", ast.FloorDiv: "/", ast.Mod: "*",
    ast.MatMult: "*", ast.BitAnd: "|", ast.BitOr: "&",
}  # fmt: skip
_NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "argmin": "argmax", "argmax": "argmin"}


@dataclass(frozen=True)
class Mutant:
    """One change.

    Attributes:
        file: of the module.
        line: in it.
        begin, end: bytes of it that are replaced.
        new: what is put there.
        old: what stands there.
        statement: the text of its line.
        number: how many times the same is changed before, in a line of the same text.
    """

    file: Path
    line: int
    begin: int
    end: int
    new: str
    old: str
    statement: str
    number: int

    @property
    def change(self) -> str:
        """What."""
        return f"{self.old.strip()} → {self.new.strip()}"

    @property
    def words(self) -> str:
        """Where, and what."""
        return f"{self.file.relative_to(ROOT)}:{self.line}: {self.change}"

    @property
    def key(self) -> tuple[str, str, str]:
        """File, text of the line and change: the same as long as the line is."""
        return self.file.relative_to(ROOT).as_posix(), self.statement, self.change

    def text(self) -> str:
        """Return the module with the change."""
        source = self.file.read_bytes()
        return (source[: self.begin] + self.new.encode() + source[self.end :]).decode()


# -- what can be changed ---------------------------------------------------------------------------


class _Finder:
    """Finds the places of one file."""

    def __init__(self, file: Path, source: bytes) -> None:
        self.file, self.source = file, source
        self._lines, self._starts = source.splitlines(keepends=True), [0]
        for line in self._lines:
            self._starts.append(self._starts[-1] + len(line))
        self._seen: Counter[tuple[str, str, str]] = Counter()
        self.found: list[Mutant] = []

    def at(self, line: int, column: int) -> int:
        return self._starts[line - 1] + column

    def span(self, node: ast.expr) -> tuple[int, int]:
        return self.at(node.lineno, node.col_offset), self.at(node.end_lineno or 0, node.end_col_offset or 0)

    def add(self, begin: int, end: int, new: str) -> None:
        old = self.source[begin:end].decode()
        if old.strip() != new.strip():
            line = self.source[:begin].count(b"\n") + 1
            statement = self._lines[line - 1].decode().strip()
            number = self._seen[statement, new, old]
            self._seen[statement, new, old] += 1
            self.found.append(Mutant(self.file, line, begin, end, new, old, statement, number))

    def visit(self, node: ast.AST) -> None:
        if _is_left_alone(node):
            return
        self._change(node)
        for name, value in ast.iter_fields(node):
            if name in {"annotation", "returns", "decorator_list", "type_params"}:
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    self.visit(child)

    def _change(self, node: ast.AST) -> None:
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            self._between(node.left, node.comparators[0], _COMPARED[type(node.ops[0])])
        elif (
            isinstance(node, ast.BinOp)
            and type(node.op) in _COMPUTED
            and not isinstance(node.left, ast.Constant | ast.JoinedStr)
        ):
            self._between(node.left, node.right, _COMPUTED[type(node.op)])
        elif isinstance(node, ast.BoolOp):
            new = "or" if isinstance(node.op, ast.And) else "and"
            self._between(node.values[0], node.values[1], new)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            begin, end = self.span(node)
            operator = "not" if isinstance(node.op, ast.Not) else "-"  # an operand's span is without its parentheses
            self.add(begin, end, f"({self.source[begin:end].decode().removeprefix(operator).strip()})")
        elif isinstance(node, ast.Constant):
            self._constant(node)
        elif isinstance(node, ast.Name) and node.id in _NAMES:
            self.add(*self.span(node), _NAMES[node.id])
        elif isinstance(node, ast.Attribute) and node.attr in _NAMES:
            _, end = self.span(node)
            self.add(end - len(node.attr), end, _NAMES[node.attr])
        elif isinstance(node, ast.If | ast.IfExp | ast.While) and not isinstance(node.test, ast.Compare | ast.BoolOp):
            begin, end = self.span(node.test)
            self.add(begin, end, f"(not ({self.source[begin:end].decode()}))")

    def _between(self, left: ast.expr, right: ast.expr, new: str) -> None:
        """Replace the operator, which stands somewhere between two operands and their parentheses."""
        begin, end = self.span(left)[1], self.span(right)[0]
        between = self.source[begin:end].decode()
        match = re.search(r"not in|is not|\bin\b|\bis\b|\band\b|\bor\b|//|\*\*|[<>=!]=|[-+*/%@<>&|]", between)
        if match is not None:
            at = begin + len(between[: match.start()].encode())
            self.add(at, at + len(match[0].encode()), new)

    def _constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self.add(*self.span(node), str(not value))
        elif isinstance(value, int):
            self.add(*self.span(node), str(value + 1))
        elif isinstance(value, float):
            self.add(*self.span(node), repr(2.0 * value if value else 1.0))


def _is_left_alone(node: ast.AST) -> bool:
    """Whether a change would only change words, types, or how much is said: messages, declarations of fields."""
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
        return True
    if isinstance(node, ast.AnnAssign):
        return node.value is None
    if isinstance(node, ast.Call):
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        return name in {"entry", "field", "option", "round", "geterr", "errstate", "NewType", "TypeVar"}
    if isinstance(node, ast.If):
        return getattr(node.test, "id", "") == "TYPE_CHECKING"
    return False


def mutants_of(file: Path, source: bytes | None = None) -> list[Mutant]:
    """Return all mutants of a file.

    Args:
        file: of a module.
        source: its text; by default that which it has.
    """
    finder = _Finder(file, file.read_bytes() if source is None else source)
    finder.visit(ast.parse(finder.source))
    return finder.found


def _drawn(every: Sequence[Mutant], count: int, seed: int) -> list[Mutant]:
    """Return so many by chance, if there are as many, in the order of files and lines."""
    picked = random.Random(seed).sample(every, min(count, len(every)))  # noqa: S311 - nothing secret
    return sorted(picked, key=lambda m: (m.file, m.begin))


def _is_tried(file: Path) -> bool:
    return file.suffix == ".py" and file.name != "request.py"  # the declarations of a request are words


def fresh(paths: Sequence[Path], count: int, seed: int) -> list[Mutant]:
    """Return mutants drawn from the code as it is.

    Args:
        paths: files and folders.
        count: how many, if there are as many.
        seed: of the choice.
    """
    files = sorted({f for path in paths for f in ([path] if path.is_file() else path.rglob("*.py"))})
    return _drawn([m for f in files if _is_tried(f) for m in mutants_of(f)], count, seed)


# -- which tests could notice ----------------------------------------------------------------------


def tests_of(mutant: Mutant, most: float) -> list[Test]:
    """Return the tests that run what is changed, quickest first, and others of their files if there is time.

    Args:
        mutant: what is changed.
        most: how long they take at most, but for the first [s].
    """
    known = read()
    running = known.running(mutant.file, mutant.line)
    functions: Counter[str] = Counter()
    ranks = []
    for test in running:
        ranks.append(functions[test.function])  # one of each function comes before its other parameters
        functions[test.function] += 1
    ranked = [t for _, t in sorted(zip(ranks, running, strict=True), key=lambda r: (r[0], r[1].seconds))]
    picked, seconds = list[Test](), 0.0
    for test in [*ranked, *known.beside(running)][:TESTS]:
        if not picked or seconds + test.seconds <= most:
            seconds += test.seconds
            picked.append(test)
    return picked


# -- one after the other ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Tried:
    """What became of a mutant.

    Attributes:
        mutant: what was changed.
        tests: that ran, until one failed.
        killer: the test that failed; empty: none did. None: none runs the line.
    """

    mutant: Mutant
    tests: Sequence[Test]
    killer: str | None


def _pytest(tests: Sequence[str]) -> list[str]:
    return ["-m", "pytest", "-q", "-x", "--tb=no", "-p", "no:cacheprovider", "-p", "no:xdist", *tests]


def tried(mutant: Mutant) -> Tried:
    """Run the tests of a mutant, until one fails.

    Args:
        mutant: what is changed.
    """
    tests = tests_of(mutant, SECONDS)
    if not tests:
        return Tried(mutant, tests, None)
    one, every = (LEAST + PATIENCE * of(t.seconds for t in tests) for of in (max, sum))
    names = [t.name for t in tests]
    try:
        done = run_planted([*_pytest(names), f"--timeout={one:.0f}"], mutant.file, mutant.text(), timeout=every)
    except subprocess.TimeoutExpired:
        return Tried(mutant, tests, names[0])
    if not done.returncode:
        return Tried(mutant, tests, "")
    failed = re.search(r"^(?:FAILED|ERROR) (\S+?\.py::.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
    return Tried(mutant, tests, failed[1] if failed and failed[1] in names else names[0])


def _unjust(killers: set[str]) -> set[str]:
    """Return those of the tests that fail without a mutant, too: by themselves, or on a busy machine."""
    if not killers:
        return set()
    done = run_planted([a for a in _pytest(sorted(killers)) if a != "-x"], None, "", timeout=3600.0)
    if done.returncode not in {0, 1}:
        raise SystemExit(f"the tests have changed since they were recorded: --record\n{done.stderr[-2000:]}")
    return {name for name in killers if done.returncode and name in done.stdout}


def _show(what: Tried) -> None:
    word = {None: "NOT RUN", "": "SURVIVES"}.get(what.killer, "killed")
    print(f"{word:9s}{what.mutant.words}", flush=True)
    if what.killer:
        print(f"{'':9s}by {what.killer}", flush=True)
    elif what.tests:
        print(f"{'':9s}tried: {' '.join(t.name for t in what.tests)}", flush=True)


def _seed() -> int:
    """Return a seed that follows from the commit: a sample that nobody has mended."""
    done = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    return int(done.stdout[:8], 16)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the mutants and return the exit code: 1 where fewer than nine of ten are killed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", type=Path, help="files or folders; by default the numerical ones")
    parser.add_argument("--count", type=int, default=COUNT, help=f"how many are tried; by default {COUNT}")
    parser.add_argument("--seed", type=int, help="of the choice; by default that of the commit")
    parser.add_argument("--record", action="store_true", help="first find out again which tests run their lines")
    parser.add_argument("--again", nargs="+", metavar="FILE", help="record these files of tests again, and new ones")
    parser.add_argument("--list", action="store_true", help="show the mutants, run nothing")
    asked = parser.parse_args(arguments)
    paths = [p.resolve() for p in asked.paths] or [ROOT / "workbench" / name for name in FOLDERS]
    if missing := [p for p in paths if not p.exists()]:
        parser.error(f"there is no {missing[0]}")
    mutants = fresh(paths, asked.count, _seed() if asked.seed is None else asked.seed)
    places = [(m.file, m.line) for m in mutants]
    if asked.record or not is_recorded(places):
        print("recording which tests run their lines ...", flush=True)
        record(places)
    elif asked.again:
        record(places, asked.again, again=True)
    if asked.list:
        for mutant in mutants:
            print(f"{mutant.words}    by {len(read().running(mutant.file, mutant.line))} tests")
        return 0
    return _run(mutants)


def _run(mutants: Sequence[Mutant]) -> int:
    """Try them all, show them, and return the exit code."""
    every = list[Tried]()
    with ThreadPoolExecutor(min(2, os.cpu_count() or 1)) as pool:  # the tests have processes of their own
        for done in pool.map(tried, mutants):
            every.append(done)
            _show(done)
    unjust = _unjust({t.killer for t in every if t.killer})
    for name in sorted(unjust):
        print(f"fails without a mutant, too, and killed none: {name}")
    killed = [t.mutant for t in every if t.killer and t.killer not in unjust]
    count, dead = (Counter(m.file.relative_to(ROOT).parts[1] for m in group) for group in (mutants, killed))
    for folder, number in count.items():
        print(f"{folder:12s}{dead[folder]} of {number} killed")
    print(f"{len(killed)} of {len(mutants)} killed")
    return 0 if len(killed) >= ENOUGH * len(mutants) else 1


if __name__ == "__main__":
    sys.exit(main())
