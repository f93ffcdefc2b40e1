"""How often the bootstrap's regions hold the true poles: random systems, white binary input, white noise of −20 dB.

Run as a program it prints the rate of each order: `python tests/bootstrap_coverage.py [systems [replicates [samples]]]`
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.core.values.arrays import Complex

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment, make_experiment
from workbench.identification.identified.recursion import march_one
from workbench.identification.subspace.estimate import estimate
from workbench.identification.validate.bootstrap import PoleBootstrap, bootstrap_poles
from workbench.identification.validate.estimator import same_settings

DT = 0.1


@dataclass(frozen=True, eq=False)
class System:
    A: Floats
    B: Floats
    C: Floats
    D: Floats
    poles: Complex

    def simulate(self, u: Floats) -> Floats:
        states, _ = march_one(u @ self.B.T, self.A, np.zeros(len(self.A)))
        return np.asarray(states @ self.C.T + u @ self.D.T)


def random_system(order: int, rng: np.random.Generator, inputs: int = 1, outputs: int = 1) -> System:
    """Poles of modulus 0.3 … 0.95, pairs and real ones as they come, in a random basis."""
    A, poles = np.zeros((order, order)), list[complex]()
    while len(poles) < order:
        k, radius = len(poles), rng.uniform(0.3, 0.95)
        if order - k >= 2 and rng.random() < 0.6:
            p = radius * np.exp(1j * rng.uniform(0.1, np.pi - 0.1))
            A[k : k + 2, k : k + 2] = [[p.real, p.imag], [-p.imag, p.real]]
            poles += [p, p.conjugate()]
        else:
            A[k, k] = radius if rng.random() < 0.8 else -radius
            poles.append(A[k, k])
    T = rng.normal(size=(order, order))
    B, C = rng.normal(size=(order, inputs)), rng.normal(size=(outputs, order))
    inverse = np.linalg.inv(T)
    return System(T @ A @ inverse, T @ B, C @ inverse, rng.normal(size=(outputs, inputs)), np.array(poles))


def noisy_record(system: System, rng: np.random.Generator, samples: int, *, relative: float = 0.1) -> Experiment:
    u = np.sign(rng.normal(size=(samples, system.B.shape[1])))
    y = system.simulate(u)
    return make_experiment(DT, u, y + relative * y.std(axis=0) * rng.normal(size=y.shape))


def bootstrap_of(data: Experiment, order: int, *, replicates: int, joint: bool = True, seed: int = 0) -> PoleBootstrap:
    found = estimate(data.u, data.y, DT, order=order, stable=True)
    model = found.model.named(input_names=data.input_names, output_names=data.output_names)
    return bootstrap_poles(model, data, same_settings(found), replicates=replicates, joint=joint, seed=seed)


def cases(
    order: int, systems: int, *, replicates: int, samples: int, first: int = 0
) -> Iterator[tuple[System, PoleBootstrap]]:
    for number in range(first, first + systems):
        rng = np.random.default_rng([order, number])
        system = random_system(order, rng)
        data = noisy_record(system, rng, samples)
        yield system, bootstrap_of(data, order, replicates=replicates, seed=number)


def main(systems: int = 100, replicates: int = 200, samples: int = 1000) -> None:
    print(f"{systems} systems each, {replicates} replicates, {samples} samples")  # noqa: T201
    for order in (1, 2, 3, 4):
        found = list(cases(order, systems, replicates=replicates, samples=samples, first=20_000))
        held = [b.holds_all(s.poles) for s, b in found]
        full = [h for h, (_, b) in zip(held, found, strict=True) if b.determined == order]
        print(  # noqa: T201
            f"order {order}: all poles held in {sum(held)}/{systems}; determined {sum(full)}/{len(full)}, "
            f"a pole not determined {sum(held) - sum(full)}/{systems - len(full)}",
            flush=True,
        )


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))
