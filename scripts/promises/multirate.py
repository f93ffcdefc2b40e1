"""Compare systems with several sample rates with their closed form.

Each has two to four rates, nested, coprime and with offsets: linear components, blocks, FMUs with one and two samplers,
around one or two continuous plants (tests/multirate.py). FMUs are driven by model exchange, and by co-simulation with
events (FMI 3.0). `simulate` is compared with an exact event simulation: the largest difference at 40 times, relative to
the largest value. `lin` is compared with Kalman and Bertram's map by hand, the verdict of `loop`, opened behind one of
the parts, with a long run, and its gain margin with the spectral radius on both sides of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

import workbench as wb
from tests.multirate import System, connected, departure, random_system, verdict_fault

_TOLERANCE = 1e-10  # of vkm, so that what is left is a matter of events; gear does not always get so far
_ALLOWED = 1e-6
_WAYS = (("me", 2), ("me", 3), ("cs", 3))


@dataclass(frozen=True)
class Simulated:
    """One simulation.

    Attributes:
        error: largest difference from the truth, relative to its largest value.
    """

    error: float

    @classmethod
    def of(cls, system: System, *, interface: str = "me", fmi: int = 2, times: int = 40) -> Simulated:
        """Run a step of the input over six basic periods, two seconds at least, and look between the instants.

        Args:
            system: the system.
            interface: of its FMUs.
            fmi: their version.
            times: how often it is looked at.
        """
        end = max(6 * system.basic_period, Fraction(2))
        places = [end * k / times + Fraction(1, 9973) for k in range(times)]
        truth = system.truth.simulate(places)
        points = np.array([float(t) for t in places])
        names = [n.y.replace(".", "_") for n in system.nodes]
        signals = {"r": wb.Constant(1.0)}
        model = connected(system, interface=interface, fmi=fmi, solver="vkm", tolerance=_TOLERANCE)
        with model, model.open_session(signals=signals) as session:
            found = session.advance(points[-1], signals=signals, record=names, points=points)
        rows = [int(np.flatnonzero(found.time == t)[-1]) for t in points]
        seen = np.column_stack([found.values[name][rows] for name in names])
        return cls(float(np.abs(seen - truth).max() / np.abs(truth).max()))


@dataclass
class Analyses:
    """What `lin` and `loop` say of the systems.

    Attributes:
        systems: that were looked at.
        worst: largest departure of a linear model that is right.
        stated: verdicts "stable" or "unstable".
        margins: gain margins that were stated.
        faults: what was wrong.
    """

    systems: int = 0
    worst: float = 0.0
    stated: int = 0
    margins: int = 0
    faults: int = 0

    def add(self, system: System, number: int) -> list[str]:
        """Linearise a system, and open its loop behind a node; return what is wrong.

        Args:
            system: the system.
            number: of the node.
        """
        self.systems += 1
        with connected(system) as model:
            off = departure(system, wb.lin(model).result)
            margins = wb.loop(model, system.nodes[number].y).margins
        self.worst = max(self.worst, off if off <= _ALLOWED else 0.0)
        self.stated += margins.verdict in ("stable", "unstable")
        self.margins += 0.0 < margins.gain_margin < np.inf
        fault = verdict_fault(system, number, margins)
        found = [*([f"lin is off by {off:.1e}"] if not off <= _ALLOWED else []), *([f"loop: {fault}"] if fault else [])]
        self.faults += len(found)
        return found

    def __str__(self) -> str:
        """Return the counts in one line."""
        return (
            f"lin and loop: {self.systems} systems, {self.faults} faults; largest departure {self.worst:.1e}, "
            f"{self.stated} verdicts, {self.margins} gain margins"
        )


def _ways(system: System) -> tuple[tuple[str, int], ...]:
    return _WAYS if any(n.kind == "fmu" for n in system.nodes) else _WAYS[:1]


def run(*, cases: int = 300, seed: int = 0) -> int:
    """Print what differs, and the worst difference; return 1 if anything does.

    Args:
        cases: systems.
        seed: of the first.
    """
    worst, wrong, runs, analyses = 0.0, 0, 0, Analyses()
    for number in range(seed, seed + cases):
        system = random_system(number)
        for interface, fmi in _ways(system):
            error = Simulated.of(system, interface=interface, fmi=fmi).error
            worst, runs = max(worst, error), runs + 1
            if not error <= _ALLOWED:
                wrong += 1
                print(f"seed {number}, {interface}, FMI {fmi}: {error:.1e}: {system}", flush=True)
        for fault in analyses.add(system, number % len(system.nodes)):
            print(f"seed {number}: {fault}: {system}", flush=True)
    print(f"simulate: {runs} runs of {cases} systems, {wrong} wrong, largest difference {worst:.1e}")
    print(analyses)
    return int(wrong + analyses.faults > 0)
