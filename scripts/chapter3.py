#!/usr/bin/env python3
"""Linearise the blocks of the source report's chapter 3 and compare with what was published.

    python scripts/chapter3.py

Point, widths and published numbers stand in scripts/chapter3.toml. Exit code 1: one is off its published digits. Run
it with the project's Python (see scripts/dev.py).
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
from rich import box  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

import workbench as wb  # noqa: E402

HALF = 0.51  # of the last place: a number that was rounded, and the rounding of this computer


@dataclass(frozen=True, kw_only=True)
class Example:
    """One published linearisation.

    Attributes:
        name: its number in the source report.
        block: in words.
        model: bundled model.
        parameters: that are set.
        x0, u0: operating point.
        dx, du: total widths.
        digits: decimal places that are compared.
        A, B, C, D: what was published; None: nothing.
        slope: of the block alone; None: C and D are given.
    """

    name: str
    block: str
    model: str
    x0: Sequence[float]
    u0: float
    dx: Sequence[float]
    du: float
    digits: int
    parameters: dict[str, float] | None = None
    A: Sequence[Sequence[float]] | None = None
    B: Sequence[float] | None = None
    C: Sequence[float] | None = None
    D: float | None = None
    slope: float | None = None


@dataclass(frozen=True)
class Entry:
    """One number beside its published value."""

    name: str
    published: float
    measured: float
    digits: int

    @property
    def difference(self) -> float:
        """Measured less published."""
        return self.measured - self.published

    @property
    def agrees(self) -> bool:
        """Whether it is the published number to the last place."""
        return abs(self.difference) <= HALF * 10.0**-self.digits


def examples() -> tuple[dict[str, Any], list[Example]]:
    """Return the dynamics in front of the blocks, and the examples."""
    with Path(__file__).with_suffix(".toml").open("rb") as file:
        data = tomllib.load(file)
    return data["dynamics"], [Example(**fields) for fields in data["example"]]


def linearised(example: Example) -> wb.LinResult:
    """Return the linear model of the bundled FMU at the example's point with the example's widths."""
    with wb.load(f"fmu:{example.model}", "me", start_values=example.parameters or {}) as model:
        x0 = dict(zip((v.name for v in model.states), example.x0, strict=True))
        return wb.lin(
            model, x0=x0, u0={"u": example.u0}, dx=list(example.dx), du=example.du, method="difference", outputs=["y"]
        ).result


def entries(example: Example, result: wb.LinResult, dynamics: dict[str, Any]) -> Iterator[Entry]:
    """Yield every published number of an example beside the measured one."""
    if example.slope is not None:
        through = (*(result.C[0] / dynamics["C"]), result.D[0, 0] / dynamics["D"])
        for name, slope in zip((*result.state_names, *result.input_names), through, strict=True):
            yield Entry(f"slope by {name}", example.slope, float(slope), example.digits)
        return
    published = {"A": example.A, "B": example.B, "C": example.C, "D": example.D}
    for matrix, values in published.items():
        if values is None:
            continue
        measured = getattr(result, matrix)
        expected = np.array(values, dtype=float).reshape(measured.shape)
        for (i, j), value in np.ndenumerate(measured):
            yield Entry(f"{matrix}[{i + 1},{j + 1}]", float(expected[i, j]), float(value), example.digits)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and return the exit code."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args(
        arguments
    )
    table = Table(
        box=box.SIMPLE_HEAD, title="Linearised blocks, total widths", title_justify="left", padding=(0, 1, 0, 0)
    )
    for heading in ("example", "block", "x0; u0", "dx; du", "entry"):
        table.add_column(heading, no_wrap=True)
    for heading in ("published", "measured", "difference"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    dynamics, listed = examples()
    wrong = 0
    for example in listed:
        about = [example.name, example.block, _short(example.x0, example.u0), _short(example.dx, example.du)]
        for entry in entries(example, linearised(example), dynamics):
            wrong += not entry.agrees
            numbers = (f"{entry.published:.10g}", f"{entry.measured:.10g}", f"{entry.difference:.1e}")
            table.add_row(*about, entry.name, *numbers, "ok" if entry.agrees else f"off at {entry.digits} places")
            about = [""] * 4
        table.add_section()
    Console(width=None if sys.stdout.isatty() else 140, highlight=False).print(table)
    print("every published digit is met" if not wrong else f"{wrong} off the published digits")
    return 1 if wrong else 0


def _short(states: Sequence[float], forcing: float) -> str:
    return ", ".join(f"{x:.5g}" for x in states) + f"; {forcing:.5g}"


if __name__ == "__main__":
    sys.exit(main())
