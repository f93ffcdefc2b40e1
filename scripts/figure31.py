#!/usr/bin/env python3
"""Linear models of the elevator law by the perturbation sets of figure 31, simulated beside the law.

    python scripts/figure31.py [--plot figure31.png]

The law is trimmed, linearised over its sample period with each set, and both are forced by a full stick at 5 Hz,
0.5 Hz and 0.05 Hz. Two sets more are ours: widths so narrow that nothing is limited, and a set fitted to 5 Hz.
`workbench reproduce fig31` measures the same. Run it with the project's Python (see scripts/dev.py).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from rich import box  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from workbench.reproduce.chapter6 import draw_widths  # noqa: E402
from workbench.reproduce.law_widths import FREQUENCIES, OURS, PUBLISHED, WidthComparison, study  # noqa: E402
from workbench.show.figure import save  # noqa: E402


def show(result: WidthComparison, console: Console) -> None:
    """Print the equilibria, the table and what it says."""
    console.print(f"trim: {result.trim.message}")
    table = Table(box=box.SIMPLE_HEAD, title="Linear models compared with the law, full stick", title_justify="left")
    for heading in ("set", "dx", "du", "Hz", "gain ratio", "phase shift \\[deg]", "error \\[%]"):
        table.add_column(heading, justify="left" if heading in {"set", "dx", "du"} else "right", no_wrap=True)
    for name, (dx, du) in {**PUBLISHED, **OURS}.items():
        about = [name, ", ".join(f"{w:g}" for w in dx), ", ".join(f"{w:g}" for w in du)]
        for frequency in FREQUENCIES:
            trial = result.trials[name, frequency]
            numbers = (f"{trial.gain_ratio:.3f}", f"{trial.phase_shift:+.2f}", f"{100.0 * trial.error:.1f}")
            table.add_row(*about, f"{frequency:g}", *numbers)
            about = [""] * 3
        table.add_section()
    console.print(table)
    for frequency in FREQUENCIES:
        least = min((result.trials[n, frequency] for n in PUBLISHED), key=lambda t: abs(t.phase_shift))
        console.print(
            f"{frequency:g} Hz: least phase shift of the published sets {least.phase_shift:+.3f} deg, {least.name}"
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plot", metavar="PATH", help="write the picture: .png, .svg or .pdf")
    given = parser.parse_args(arguments)
    result = study()
    show(result, Console(width=None if sys.stdout.isatty() else 130, highlight=False))
    if given.plot:
        save(draw_widths(result), given.plot)
    return 0


if __name__ == "__main__":
    sys.exit(main())
