#!/usr/bin/env python3
"""Does `dev.py reproduce` notice a fault? Plant some, one at a time, and see.

    python scripts/plant_faults.py                 all faults of scripts/faults.toml, each with the targets it names
    python scripts/plant_faults.py nfr models      those of some areas
    python scripts/plant_faults.py --list          show them, plant nothing

Nothing is changed on disk: each fault is planted in a process of its own, where the text of one module is changed
while it is imported. A fault counts as noticed where a target is missed that is not without it. Exit code 1 where fewer
than nine of ten are noticed, or a target is missed without any fault.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.planting import ROOT, run_planted
from scripts.reproduce.targets import MISSED

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


def missed_with(fault: Fault | None, words: Sequence[str]) -> list[str]:
    """Return what `reproduce` misses with a fault that it does not miss without it.

    Args:
        fault: planted; None: none.
        words: targets, as on the command line.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "found.json"
        command = ["-m", "scripts.reproduce", *words, "--in-process", "--json", str(out)]
        file, text = (None, "") if fault is None else (fault.file, fault.text())
        try:
            done = run_planted(command, file, text, timeout=LONGEST)
        except subprocess.TimeoutExpired:
            return [f"did not end within {LONGEST:g} s"]
        if not out.exists():
            return [(done.stderr.strip().splitlines() or ["ended without a word"])[-1]]
        found = json.loads(out.read_text(encoding="utf-8"))["targets"]
    return [f"{t['name']}: {t['reason']}" for t in found if t["verdict"] == MISSED and not t["known"]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Plant the faults and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("areas", nargs="*", help="areas of the faults; by default all")
    parser.add_argument("--list", action="store_true", help="show the faults, plant nothing")
    asked = parser.parse_args(arguments)
    faults = read_faults()
    known = dict.fromkeys(f.area for f in faults)
    if unknown := [a for a in asked.areas if a not in known]:
        parser.error(f"there is no area {unknown[0]}; there are {', '.join(known)}")
    chosen = [f for f in faults if not asked.areas or f.area in asked.areas]
    for fault in chosen:
        fault.text()  # so that a line that is not there is told before anything is run
        if asked.list:
            print(f"{fault.area:15s}{fault.words}")
    return 0 if asked.list else _plant(chosen)


def _plant(chosen: Sequence[Fault]) -> int:
    words = sorted({word for fault in chosen for word in fault.targets})
    if missed := missed_with(None, words):
        print(f"missed without any fault: {'; '.join(missed)}")
        return 1
    planted, noticed = Counter(f.area for f in chosen), Counter[str]()
    for fault in chosen:
        missed = missed_with(fault, fault.targets)
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
