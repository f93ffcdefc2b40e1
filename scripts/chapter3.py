#!/usr/bin/env python3
"""Linearise the blocks of the source report's chapter 3: every number beside the published one.

    python scripts/chapter3.py

Points and widths stand in workbench/reproduce/chapter3.toml, published numbers and tolerances in targets.toml beside
it. Exit code 1: one is off. `workbench reproduce 3` measures the same. Run it with the project's Python (see
scripts/dev.py).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
from rich import box  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from workbench.reproduce.chapter3 import EXPERIMENTS, Example, examples  # noqa: E402
from workbench.reproduce.measurement import Measurement, Reproduction  # noqa: E402
from workbench.reproduce.targets import PublishedTarget, read_targets  # noqa: E402


@dataclass(frozen=True)
class Entry:
    """One number beside its published value."""

    target: PublishedTarget
    number: int
    published: float
    measured: float

    @property
    def difference(self) -> float:
        """Measured less published."""
        return self.measured - self.published

    @property
    def agrees(self) -> bool:
        """Whether it is the published number to the last place."""
        low, high = (np.atleast_1d(side)[self.number - 1] for side in self.target.limits)
        return bool(low <= self.measured <= high)

    @property
    def word(self) -> str:
        """The verdict."""
        return "ok" if self.agrees else "off" if self.target.reason is None else "not reachable"


def entries(experiment: Reproduction, found: Measurement) -> Iterator[Entry]:
    """Yield every published number of an experiment beside the measured one."""
    for name in experiment.targets:
        target = read_targets()[name]
        published, measured = (np.atleast_1d(np.asarray(x, dtype=float)) for x in (target.value, found.values[name]))
        for i, (p, m) in enumerate(zip(published, measured, strict=True), 1):
            yield Entry(target, i, float(p), float(m))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and return the exit code."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args(
        arguments
    )
    table = Table(
        box=box.SIMPLE_HEAD, title="Linearised blocks, total widths", title_justify="left", padding=(0, 1, 0, 0)
    )
    for heading in ("example", "block", "x0; u0", "dx; du", "target"):
        table.add_column(heading, no_wrap=True)
    for heading in ("published", "measured", "difference"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    wrong = 0
    for example, experiment in zip(examples().values(), EXPERIMENTS, strict=True):
        about = [example.name, example.block, *_point(example)]
        for entry in entries(experiment, experiment.measure()):
            wrong += entry.word == "off"
            numbers = (f"{entry.published:.10g}", f"{entry.measured:.10g}", f"{entry.difference:.1e}")
            table.add_row(*about, f"{entry.target.name} {entry.number}", *numbers, entry.word)
            about = [""] * 4
        table.add_section()
    Console(width=None if sys.stdout.isatty() else 180, highlight=False).print(table)
    print("every published digit is met, or said why not" if not wrong else f"{wrong} off the published digits")
    return 1 if wrong else 0


def _point(example: Example) -> tuple[str, str]:
    return _short(example.x0, example.u0), _short(example.dx, example.du)


def _short(states: Sequence[float], forcing: float) -> str:
    return ", ".join(f"{x:.5g}" for x in states) + f"; {forcing:.5g}"


if __name__ == "__main__":
    sys.exit(main())
