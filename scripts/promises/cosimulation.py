"""Measure how often the error of a frequency response covers the truth where co-simulation parts solve for themselves.

Each loop has two lags of 0.01 … 10 s, one of model exchange and one of co-simulation, or both of co-simulation, a gain
of 0.2 … 5 back, and is forced at 0.01 … 10 Hz. It is measured with the communication step that is found, and with given
ones of 1/20 … 1/10000 of a period, which may be far below what the parts' own solvers leave at their tolerance of
1e-3 … 1e-8. The truth is the closed form.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import workbench as wb
from scripts.promises.trial import Trial, held, lines

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


def run(*, cases: int = 60, seed: int = 1) -> int:
    """Return 1 if settled points fall short.

    Args:
        cases: loops.
        seed: of the first.
    """
    found = list(trials(cases, seed))
    for name, some in (("step found", [f for f in found if f[1] is None]), ("step given", [f for f in found if f[1]])):
        print("\n".join([f"{name}:", *lines([t for *_, t in some])]))
    for loop, step, tolerance, t in found:
        if t.status == "settled" and not t.true <= t.stated:
            print(f"off {t.true:.2g}, stated {t.stated:.2g}, step {step}, tolerance {tolerance:.2g}: {loop}")
    return int(not held([t for *_, t in found]))
