#!/usr/bin/env python3
"""Measure how often the error of a frequency response covers the truth where co-simulation parts solve for themselves.

    python scripts/coverage_cosimulation.py                60 random loops of two lags, three settings each
    python scripts/coverage_cosimulation.py --loops 12 --seed 3

Each loop has two lags of 0.01 … 10 s, one of model exchange and one of co-simulation, or both of co-simulation, a gain
of 0.2 … 5 back, and is forced at 0.01 … 10 Hz. It is measured with the communication step that is found, and with given
ones of 1/20 … 1/10000 of a period, which may be far below what the parts' own solvers leave at their tolerance of
1e-3 … 1e-8. The truth is the closed form. Run it with the project's Python (see scripts/dev.py).
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

import workbench as wb  # noqa: E402
from scripts.coverage_nfr import Trial, lines  # noqa: E402

_TEXT = """
[components]
error = {{sum = "+-"}}
first = {{model = "fmu:FirstOrderLag", interface = "{0[0]}", set = {{tau = {1[0]!r}}}}}
second = {{model = "fmu:FirstOrderLag", interface = "{0[1]}", set = {{tau = {1[1]!r}}}}}
[connections]
"error.u2" = {{from = "second.y", gain = {2!r}}}
"first.u" = "error.y"
"second.u" = "first.y"
[inputs]
r = "error.u1"
[outputs]
y = "second.y"
"""


@dataclass(frozen=True)
class Loop:
    """Two lags, their interfaces, the gain back, and where it is forced [Hz]."""

    interfaces: tuple[str, str]
    taus: tuple[float, float]
    gain: float
    frequency: float

    @classmethod
    def random(cls, random: np.random.Generator) -> Loop:
        """Return one."""
        kinds = (("me", "cs"), ("cs", "me"), ("cs", "cs"))
        first, second, frequency = (10.0 ** random.uniform([-2.0, -2.0, -2.0], [1.0, 1.0, 1.0])).tolist()
        return cls(kinds[random.integers(3)], (first, second), random.uniform(0.2, 5.0), frequency)

    @property
    def truth(self) -> complex:
        """The response."""
        s = 2j * math.pi * self.frequency
        forward = 1.0 / ((1.0 + s * self.taus[0]) * (1.0 + s * self.taus[1]))
        return forward / (1.0 + self.gain * forward)

    def measure(self, file: Path, step: float | None, tolerance: float) -> Trial:
        """Measure it in this process; the step is a part of a period."""
        file.write_text(_TEXT.format(self.interfaces, self.taus, self.gain), encoding="utf-8")
        given = None if step is None else step / self.frequency
        with wb.load(file, tolerance=tolerance) as model:
            found = wb.nfr(model, "r", "y", [self.frequency], 1.0, step=given, workers=wb.Workers(in_process=True))
        off = abs(complex(found.response[0, 0]) / self.truth - 1.0)
        return Trial(found.status[0][0], float(found.error[0, 0]), off, int(found.periods[0, 0]))


def trials(count: int, seed: int) -> Iterator[tuple[Loop, float | None, float, Trial]]:
    """Measure random loops: with the step that is found, a short one, and any."""
    random = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(count):
            loop = Loop.random(random)
            for step in (None, 10.0 ** random.uniform(-4.0, -3.0), 10.0 ** random.uniform(-3.0, -1.3)):
                tolerance = float(10.0 ** random.uniform(-8.0, -3.0))
                yield loop, step, tolerance, loop.measure(Path(folder) / "loop.toml", step, tolerance)


def main() -> int:
    """Return 1 if settled points fall short."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--loops", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    o = parser.parse_args()
    found = list(trials(o.loops, o.seed))
    for name, some in (("step found", [f for f in found if f[1] is None]), ("step given", [f for f in found if f[1]])):
        print("\n".join([f"{name}:", *lines([t for *_, t in some])]))
    settled = [f for f in found if f[-1].status == "settled"]
    for loop, step, tolerance, t in settled:
        if not t.true <= t.stated:
            print(f"off {t.true:.2g}, stated {t.stated:.2g}, step {step}, tolerance {tolerance:.2g}: {loop}")
    return 0 if sum(t.true <= t.stated for *_, t in settled) >= 0.95 * len(settled) else 1


if __name__ == "__main__":
    sys.exit(main())
