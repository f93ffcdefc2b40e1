"""Whether stability margins over parameters are ever optimistic: random loops beside brute force.

Each loop is a controller with a lead, a notch and two lags around an integrator; two or three of their constants are
uncertain by 10 to 50 %, and act by their inverses, squares and products; every other loop becomes unstable. Brute
force: roots of the closed loop's polynomial, written down apart from the workbench, at random parameter sets and at
the corners of boxes that grow.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
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
            high = np.array([8.0, 0.5, 0.1, 2.0, 1.0, 0.3, 1.5])
            nominal = dict(zip(_NAMES, np.exp(random.uniform(np.log(low), np.log(high))).tolist(), strict=True))
            chosen = random.choice(_NAMES, int(random.integers(2, 4)), replace=False).tolist()
            width = random.uniform(0.1, 0.5, len(chosen)).tolist()
            ranges = {n: (nominal[n] * (1.0 - w), nominal[n] * (1.0 + w)) for n, w in zip(chosen, width, strict=True)}
            case = cls(nominal, ranges)
            if case.growth(np.zeros((1, len(chosen))))[0] < -0.02:
                return case

    def growth(self, deviations: Floats) -> Floats:
        """Return the largest real part of the closed loop's poles at deviations in half the ranges, shape (k,).

        Args:
            deviations: shape (k, p).
        """
        v = {name: np.full(len(deviations), value) for name, value in self.nominal.items()}
        for (name, (low, high)), d in zip(self.ranges.items(), deviations.T, strict=True):
            v[name] = 0.5 * (low + high) + 0.5 * (high - low) * d
        w, one = 2.0 * np.pi * v["notch.frequency"], np.ones(len(deviations))
        above = _product([v["lead.gain"] * v["lead.lead"], v["lead.gain"]],
                         [one, 0.4 * v["notch.width"] * w, w * w])  # fmt: skip
        below = _product([one, 0.0 * one], [v["lead.lag"], one], [one, 2.0 * v["notch.width"] * w, w * w],
                         [v["lag.lag"], one], [v["slow.lag"], one])  # fmt: skip
        below[:, -above.shape[1] :] += above
        companion = np.zeros((len(deviations), below.shape[1] - 1, below.shape[1] - 1))
        companion[:, 0] = -below[:, 1:] / below[:, :1]
        companion[:, 1:, :-1] = np.eye(below.shape[1] - 2)
        return np.asarray(np.linalg.eigvals(companion).real.max(axis=1))

    def brute(self, random: np.random.Generator, samples: int) -> float:
        """Return the size of the smallest unstable parameter set found by brute force; infinite: none.

        In each direction, those to the corners first, there are 20 sizes, and as many again below the smallest found.
        """
        count = len(self.ranges)
        corners = np.array(list(itertools.product((-1.0, 1.0), repeat=count)))
        inner = random.uniform(-1.0, 1.0, (samples // 20, count))
        directions = np.vstack([corners, inner / np.abs(inner).max(axis=1, keepdims=True)])
        best, below = np.inf, 0.0
        for high in (_MOST, None):
            sizes = np.linspace(below, high or best, 21)[1:]
            sets = (sizes[:, None, None] * directions).reshape(-1, count)
            unstable = (self.growth(sets) > 0.0).reshape(20, -1).any(axis=1)
            if not unstable.any():
                break
            best = float(sizes[unstable.argmax()])
            below = best - _MOST / 20.0
        return best

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


def _product(*factors: list[Floats]) -> Floats:
    """Return the coefficients of a product of polynomials, highest first, shape (k, n); each is shape (k,)."""
    result = np.ones((len(factors[0][0]), 1))
    for factor in factors:
        longer = np.zeros((len(result), result.shape[1] + len(factor) - 1))
        for i, coefficient in enumerate(factor):
            longer[:, i : i + result.shape[1]] += coefficient[:, None] * result
        result = longer
    return result


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
        while True:  # every other loop is one that becomes unstable
            case = LoopCase.random(random)
            truth = case.brute(random, samples)
            if number % 2 or np.isfinite(truth):
                break
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
