"""Whether stability margins over parameters are ever optimistic: random loops beside brute force.

Each loop is a controller with a lead, a notch and two lags around an integrator; two or three of their constants are
uncertain by 10 to 50 %, and act by their inverses, squares and products. Brute force: roots of the closed loop's
polynomial, written down apart from the workbench, at random parameter sets and at the corners of boxes that grow.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

import workbench as wb
from workbench.core.values.arrays import Floats

_MOST = 2.0  # multiples of the ranges
_NAMES = ("lead.gain", "lead.lead", "lead.lag", "notch.frequency", "notch.width", "lag.lag", "slow.lag")


@dataclass(frozen=True)
class LoopCase:
    """A loop.

    Attributes:
        nominal: parameter → value in the middle of its range.
        ranges: of the uncertain ones.
    """

    nominal: Mapping[str, float]
    ranges: Mapping[str, tuple[float, float]]

    @classmethod
    def random(cls, random: np.random.Generator) -> LoopCase:
        """Return one whose middle is stable."""
        while True:
            low = np.array([0.3, 0.05, 0.01, 0.3, 0.2, 0.05, 0.3])
            high = np.array([2.0, 0.5, 0.1, 2.0, 1.0, 0.3, 1.5])
            nominal = dict(zip(_NAMES, np.exp(random.uniform(np.log(low), np.log(high))).tolist(), strict=True))
            chosen = random.choice(_NAMES, int(random.integers(2, 4)), replace=False).tolist()
            width = random.uniform(0.1, 0.5, len(chosen)).tolist()
            ranges = {n: (nominal[n] * (1.0 - w), nominal[n] * (1.0 + w)) for n, w in zip(chosen, width, strict=True)}
            case = cls(nominal, ranges)
            if case.growth([0.0] * len(chosen)) < -0.02:
                return case

    def growth(self, deviation: Sequence[float]) -> float:
        """Return the largest real part of the closed loop's poles at deviations in half the ranges."""
        v = dict(self.nominal)
        for (name, (low, high)), d in zip(self.ranges.items(), deviation, strict=True):
            v[name] = 0.5 * (low + high) + 0.5 * (high - low) * d
        w = 2.0 * np.pi * v["notch.frequency"]
        above = np.polymul([v["lead.gain"] * v["lead.lead"], v["lead.gain"]],
                           [1.0, 0.4 * v["notch.width"] * w, w * w])  # fmt: skip
        below = np.array([1.0, 0.0])
        for factor in ([v["lead.lag"], 1.0], [1.0, 2.0 * v["notch.width"] * w, w * w], [v["lag.lag"], 1.0],
                       [v["slow.lag"], 1.0]):  # fmt: skip
            below = np.polymul(below, factor)
        return float(np.roots(np.polyadd(below, above)).real.max())

    def brute(self, random: np.random.Generator, samples: int) -> float:
        """Return the size of the smallest unstable parameter set found by brute force; infinite: none."""
        count = len(self.ranges)
        corners = [np.array(s) for s in itertools.product((-1.0, 1.0), repeat=count)]
        inner: list[Floats] = list(random.uniform(-1.0, 1.0, (samples // 20, count)))
        best = np.inf
        for direction in (*corners, *(x / np.abs(x).max() for x in inner)):
            sizes = np.linspace(0.0, min(_MOST, best), 21)[1:]
            unstable = [k for k in sizes if self.growth((k * direction).tolist()) > 0.0]
            best = min([best, *unstable[:1]])
        return float(best)

    def system(self) -> wb.Model:
        """Return the loop for the workbench."""
        v = self.nominal
        block = wb.BlockComponent
        parts = {
            "lead": block(name="lead", kind="lead_lag", parameters={"gain": v["lead.gain"], "lead": v["lead.lead"],
                                                                   "lag": v["lead.lag"]}),
            "notch": block(name="notch", kind="notch", parameters={"frequency": v["notch.frequency"],
                                                                  "width": v["notch.width"], "depth": 0.2}),
            "lag": block(name="lag", kind="lead_lag", parameters={"lead": 0.0, "lag": v["lag.lag"]}),
            "slow": block(name="slow", kind="lead_lag", parameters={"lead": 0.0, "lag": v["slow.lag"]}),
            "plant": block(name="plant", kind="integrator"),
            "error": wb.SumComponent(name="error", signs=(1, -1)),
        }  # fmt: skip
        chain = ["error", "lead", "notch", "lag", "slow", "plant"]
        wires = [(f"{a}.y", f"{b}.u") for a, b in itertools.pairwise(chain)]
        return wb.connect(parts, [*wires, ("plant.y", "error.u2")], inputs={"r": "error.u1"})


def run(*, cases: int = 100, samples: int = 10000, seed: int = 1) -> int:
    """Print how far the margins are from brute force; return 1 if one is optimistic.

    Args:
        cases: loops.
        samples: evaluations of brute force for each.
        seed: of the first.
    """
    random = np.random.default_rng(seed)
    optimistic, ratios, gaps, decided = 0, [], [], 0
    for number in range(cases):
        case = LoopCase.random(random)
        truth = case.brute(random, samples)
        with case.system() as system:
            told = wb.robust(system, uncertain=case.ranges, up_to=_MOST, hold=True, in_process=True).stability
        wrong = told.lower > truth or (told.worst.unstable and told.worst.pole.real <= 0.0)
        optimistic += wrong
        decided += told.verdict != "unknown"
        if np.isfinite(truth):
            ratios.append(told.lower / truth)
            gaps.append(told.upper / truth)
        if wrong:
            print(f"{number}: {told.lower:.4g} is proved, but {truth:.4g} is unstable")
    print(f"{optimistic} of {cases} optimistic; {decided} decided on the ranges as given")
    if ratios:
        print(f"proved / smallest unstable by brute force: median {np.median(ratios):.3f}, least {min(ratios):.3f}")
        print(f"found / smallest unstable by brute force: median {np.median(gaps):.3f}, largest {max(gaps):.3f}")
    return int(optimistic > 0)
