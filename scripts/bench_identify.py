#!/usr/bin/env python3
"""Measure subspace identification: time and memory of a large record, recovery of random systems.

    python scripts/bench_identify.py               time and peak memory, 1e5 samples of 2 inputs and 2 outputs, order 20
    python scripts/bench_identify.py --recovery    noise-free: orders 1 to 10, 1 to 3 inputs and outputs, 50 seeds each
    python scripts/bench_identify.py --noise       20 dB at the output: how often the automatic order is the true one

Nothing here is a test: times depend on the machine and on what else it does.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from tests.random_systems import Plant, pole_error, random_plant  # noqa: E402
from workbench.identification.subspace.estimate import estimate  # noqa: E402
from workbench.identification.subspace.weightings import METHODS  # noqa: E402

ORDERS = range(1, 11)
MEGABYTE = 2.0**20

_LARGE = """
import json, sys, time
import numpy as np
from tests.random_systems import random_plant
from workbench.identification.subspace.estimate import estimate

def peak():
    for line in open("/proc/self/status"):
        if line.startswith("VmHWM"):
            return int(line.split()[1]) * 1024

rng = np.random.default_rng(1)
plant = random_plant(rng, 20, 2, 2)
u = rng.standard_normal((100_000, 2))
y = plant.output(u)
y = y + 0.1 * y.std(axis=0) * rng.standard_normal(y.shape)
estimate(u[:2000], y[:2000], 0.01, order=2, method=sys.argv[1], horizon=4)  # libraries loaded, threads started
before, start = peak(), time.perf_counter()
found = estimate(u, y, 0.01, order=20, method=sys.argv[1])
seconds = time.perf_counter() - start
y_fit = found.model.simulate(u, found.model.x0)
fit = 100.0 * (1.0 - np.linalg.norm(y - y_fit) / np.linalg.norm(y - y.mean(axis=0)))
print(json.dumps({"seconds": seconds, "bytes": peak() - before, "total": peak(), "horizon": found.horizon, "fit": fit}))
"""


@dataclass(frozen=True)
class LargeRow:
    """One method on the large record.

    Attributes:
        method: name.
        seconds: wall time of `estimate`, best of the repetitions [s].
        peak_bytes: growth of the process's peak resident memory by it [B].
        total_bytes: peak resident memory of the whole process, the record and libraries included [B].
        horizon: block rows that were used.
        fit_percent: of the simulation; about 90 is what noise of 20 dB leaves.
    """

    method: str
    seconds: float
    peak_bytes: float
    total_bytes: float
    horizon: int
    fit_percent: float


def rows(repeats: int = 3) -> list[LargeRow]:
    """Return time and peak memory of every method, each repetition in a process of its own (Linux only).

    Args:
        repeats: runs per method.
    """
    return [_large(method, repeats) for method in METHODS]


def _large(method: str, repeats: int) -> LargeRow:
    runs = [_run(method) for _ in range(repeats)]
    best = min(runs, key=lambda r: r["seconds"])
    top = max(r["bytes"] for r in runs), max(r["total"] for r in runs)
    return LargeRow(method, best["seconds"], *top, int(best["horizon"]), best["fit"])


def _run(method: str) -> dict[str, float]:
    command = [sys.executable, "-c", _LARGE, method]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


@dataclass(frozen=True)
class Case:
    """One random system."""

    order: int
    plant: Plant
    u: np.typing.NDArray[np.float64]
    y: np.typing.NDArray[np.float64]


def cases(seeds: int, samples: int, noise: float) -> Iterator[Case]:
    """Yield records of random systems; the initial state is random, too.

    Args:
        seeds: systems per order.
        samples: length of the record.
        noise: at the output, white, relative to the output's standard deviation.
    """
    for order in ORDERS:
        for seed in range(seeds):
            rng = np.random.default_rng(100 * seed + order)
            inputs, outputs = (int(k) for k in rng.integers(1, 4, 2))
            plant = random_plant(rng, order, inputs, outputs)
            u = rng.standard_normal((samples, inputs))
            y = plant.output(u, rng.standard_normal(order))
            yield Case(order, plant, u, y + noise * y.std(axis=0) * rng.standard_normal(y.shape))


def recovery(seeds: int = 50, samples: int = 600) -> None:
    """Print the worst pole error by method without noise, at the given and at the automatic order.

    Args:
        seeds: systems per order.
        samples: length of the record.
    """
    for method in METHODS:
        worst = {"given": 0.0, "auto": 0.0}
        wrong = count = 0
        for case in cases(seeds, samples, 0.0):
            count += 1
            given = estimate(case.u, case.y, 1.0, order=case.order, method=method)
            worst["given"] = max(worst["given"], pole_error(given.model.poles, case.plant.poles))
            found = estimate(case.u, case.y, 1.0, method=method)
            if found.order != case.order:
                wrong += 1
                continue
            worst["auto"] = max(worst["auto"], pole_error(found.model.poles, case.plant.poles))
        print(f"{method}: {count} systems, worst pole error {worst}, automatic order wrong {wrong} times", flush=True)


def noisy_orders(seeds: int = 20, samples: int = 4000, method: str = "n4sid") -> None:
    """Print how often the automatic order is the true one, by order, with noise of 20 dB at the output.

    Args:
        seeds: systems per order.
        samples: length of the record.
        method: name.
    """
    found: dict[int, list[int]] = {n: [] for n in ORDERS}
    for case in cases(seeds, samples, 0.1):
        found[case.order].append(estimate(case.u, case.y, 1.0, method=method).order)
    for n, orders in found.items():
        right, above = sum(k == n for k in orders), sum(k > n for k in orders)
        print(f"order {n}: right {right} of {len(orders)}, above {above}, found {sorted(orders)}", flush=True)


def main() -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--recovery", action="store_true")
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--seeds", type=int, default=50)
    arguments = parser.parse_args()
    if arguments.recovery:
        recovery(arguments.seeds)
    if arguments.noise:
        noisy_orders(arguments.seeds)
    if not (arguments.recovery or arguments.noise):
        for row in rows():
            print(
                f"{row.method}: {row.seconds:.2f} s, peak memory +{row.peak_bytes / MEGABYTE:.0f} MB "
                f"(process {row.total_bytes / MEGABYTE:.0f} MB), horizon {row.horizon}, fit {row.fit_percent:.2f} %"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
