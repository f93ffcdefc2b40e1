#!/usr/bin/env python3
"""Does `workbench reproduce` notice a fault? Plant some, one at a time, and see.

    python scripts/plant_faults.py                 all faults of scripts/faults.toml, each with the targets it names
    python scripts/plant_faults.py nfr models      those of some areas
    python scripts/plant_faults.py --list          show them, plant nothing

Nothing is changed on disk: each fault is planted in a process of its own, where the text of one module is changed while
it is imported. A fault counts as noticed where a target is missed, or leaves what is measured instead, that is not
without it. Exit code 1 where fewer than nine of ten are noticed, or a target is missed without any fault.
"""

from __future__ import annotations

import argparse
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, ModuleType

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "workbench"
FILE = Path(__file__).with_name("faults.toml")
ENOUGH = 0.9  # of the faults
LONGEST = 600.0  # [s], of one of them
# Where a parameter of a bundled FMU is changed: every FMU comes past here.
_LOAD = "model/load"
_OPENED = "    source = str(unpacked.source)\n"


@dataclass(frozen=True)
class Fault:
    """One line that is changed.

    Attributes:
        area: of the numerics.
        module: its file in the package, without suffix; or a bundled FMU.
        targets: words for `reproduce`.
        old, new: text that occurs once, and what is put there.
        first: the first of several places is meant.
        set: parameters of the FMU instead.
    """

    area: str
    module: str
    targets: tuple[str, ...]
    old: str = ""
    new: str = ""
    first: bool = False
    set: dict[str, float] = field(default_factory=dict)

    @property
    def file(self) -> Path:
        """The file that is changed."""
        return PACKAGE / f"{_LOAD if self.set else self.module}.py"

    @property
    def words(self) -> str:
        """What is changed."""
        if self.set:
            return f"{self.module}: " + ", ".join(f"{name} = {value:g}" for name, value in self.set.items())
        return f"{self.module}: {' '.join(self.new.split())}"

    def text(self) -> str:
        """Return the file with the fault.

        Raises:
            SystemExit: the line is not there, or more than once.
        """
        text, old, new = self.file.read_text(encoding="utf-8"), self.old, self.new
        if self.set:
            old = _OPENED
            new = f"{old}    if unpacked.source.stem == {self.module!r}:\n        recipe = replace(recipe, "
            new += f"start_values={{**{self.set!r}, **recipe.start_values}})\n"
        count = text.count(old)
        if count == 0 or (count > 1 and not self.first):
            raise SystemExit(f"{FILE.name}: {self.module}: '{old.strip()}' occurs {count} times")
        return text.replace(old, new, 1)


def read_faults() -> list[Fault]:
    """Return all faults."""
    with FILE.open("rb") as file:
        tables = tomllib.load(file)["fault"]
    return [Fault(**{**t, "targets": tuple(t["targets"])}) for t in tables]


# -- in the process with the fault -----------------------------------------------------------------


class _Changed(importlib.machinery.SourceFileLoader):
    """Loads a module from a text that is not in its file."""

    def __init__(self, name: str, path: str, text: str) -> None:
        super().__init__(name, path)
        self._text = text

    def get_code(self, fullname: str) -> CodeType:
        return compile(self._text, self.path, "exec", dont_inherit=True)


class _Planted(importlib.abc.MetaPathFinder):
    """Finds the module with the fault."""

    def __init__(self, file: Path, text: str) -> None:
        self._name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        self._file, self._text = file, text

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name:
            return None
        loader = _Changed(fullname, str(self._file), self._text)
        return importlib.util.spec_from_file_location(fullname, self._file, loader=loader)


def measure(fault: Fault | None, words: Sequence[str]) -> int:
    """Measure targets in this process and print as JSON which are missed, and were not expected to be."""
    if fault is not None:
        sys.meta_path.insert(0, _Planted(fault.file, fault.text()))
    sys.path.insert(0, str(ROOT))
    from workbench.reproduce import reproduce  # noqa: PLC0415 - after the fault is planted
    from workbench.workers import Workers  # noqa: PLC0415

    result = reproduce(words, workers=Workers(in_process=True))
    missed = [f"{o.target.name}: {o.text}" if not o.problem else f"{o.target.name}: {o.problem}"
              for o in result.unexpected]  # fmt: skip
    print(json.dumps(missed))
    return 0


# -- in the process that plants --------------------------------------------------------------------


def _run(number: int | None, words: Sequence[str]) -> list[str]:
    """Return what is missed with a fault, in a process of its own."""
    command = [sys.executable, __file__, "--one", str(-1 if number is None else number), *words]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": os.environ.get("OPENBLAS_NUM_THREADS", "1")}
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST, env=environment)
    except subprocess.TimeoutExpired:
        return [f"did not end within {LONGEST:g} s"]
    if done.returncode:
        return [(done.stderr.strip().splitlines() or ["ended without a word"])[-1]]
    found: list[str] = json.loads(done.stdout.splitlines()[-1])
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Plant the faults and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("areas", nargs="*", help="areas of the faults; by default all")
    parser.add_argument("--list", action="store_true", help="show the faults, plant nothing")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    asked = parser.parse_args(arguments)
    faults = read_faults()
    if asked.one is not None:
        return measure(None if asked.one < 0 else faults[asked.one], asked.areas)
    known = dict.fromkeys(f.area for f in faults)
    if unknown := [a for a in asked.areas if a not in known]:
        parser.error(f"there is no area {unknown[0]}; there are {', '.join(known)}")
    chosen = [(k, f) for k, f in enumerate(faults) if not asked.areas or f.area in asked.areas]
    for _, fault in chosen:
        fault.text()  # so that a line that is not there is told before anything is run
        if asked.list:
            print(f"{fault.area:15s}{fault.words}")
    return 0 if asked.list else _plant(chosen)


def _plant(chosen: Sequence[tuple[int, Fault]]) -> int:
    words = sorted({word for _, fault in chosen for word in fault.targets})
    if missed := _run(None, words):
        print(f"missed without any fault: {'; '.join(missed)}")
        return 1
    planted, noticed = Counter(f.area for _, f in chosen), Counter[str]()
    for number, fault in chosen:
        missed = _run(number, fault.targets)
        noticed[fault.area] += bool(missed)
        print(f"{'noticed' if missed else 'NOT':9s}{fault.area:15s}{fault.words}", flush=True)
        print(f"{'':24s}{missed[0] if missed else 'by ' + ', '.join(fault.targets)}", flush=True)
    for area, count in planted.items():
        print(f"{area:15s}{noticed[area]} of {count} noticed")
    share = noticed.total() / planted.total()
    print(f"{noticed.total()} of {planted.total()} noticed: {100.0 * share:.0f} %")
    return 0 if share >= ENOUGH else 1


if __name__ == "__main__":
    sys.exit(main())
