"""Measure what a best linear approximation makes of plants that are linear, though their transients last.

Each plant has one to three modes of 0.5 to 5 Hz with damping ratios of 1e-3 … 0.5 (logarithmic), a third of them an
integrator besides, and starts from rest one period before the records. Its sampled response is known in closed form.
Such a plant has no distortion, and 95 % of its lines should lie in their circles. The bounded form is in
tests/test_bla.py.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import workbench as wb
from tests.random_systems import Modes, random_modes
from workbench.build.toolchain import host_only

BAND, NOISES = (0.1, 8.0), (0.0, 0.001, 0.01)
_DISTORTION, _HELD = 1e-3, 0.9  # of plants without noise, which have none: at most; and at least of the lines


def simulated(plant: Modes, interface: str, folder: Path) -> wb.BlaResult:
    """Return what the command finds.

    Args:
        plant: to measure.
        interface: "me" or "cs".
        folder: for the FMU.
    """
    path = folder / f"{interface}{len(list(folder.iterdir()))}.fmu"
    wb.export(plant.linear, path, platforms=[host.name for host in host_only()])
    with wb.load(path, interface=interface, tolerance=1e-8) as model:
        return wb.bla(model, "u", "y", rms=[1.0], band=BAND)


def recorded(plant: Modes, noise: float, seed: int) -> wb.BlaResult:
    """Return what recorded data give, 7 realisations of 2 periods.

    Args:
        plant: to record.
        noise: standard deviation over that of the output.
        seed: of the noise.
    """
    dt, random = 1.0 / (8.0 * BAND[1]), np.random.default_rng(seed)
    data = list(plant.records(dt, BAND, realisations=7, periods=2))
    return wb.best_linear(
        [wb.make_experiment(dt, u, y + noise * y.std() * random.standard_normal(len(y))) for u, y in data],
        period=1.0 / BAND[0],
    )


def rows(plants: range, *, records_only: bool) -> Iterator[tuple[str, float, float]]:
    """Yield of each measurement what it is, the distortion, and which part of the lines the circles hold."""
    with tempfile.TemporaryDirectory() as folder:
        for seed in plants:
            plant = random_modes(np.random.default_rng(seed), integrates=seed % 3 == 2)
            every = {f"recorded, noise {noise:g}": recorded(plant, noise, seed) for noise in NOISES}
            if not records_only:
                every |= {interface: simulated(plant, interface, Path(folder)) for interface in ("me", "cs")}
            for name, found in every.items():
                away = np.abs(found.response[0] - plant.sampled(found.frequency_hz, found.dt))
                yield name, float(found.left[0]), float(np.mean(away <= found.error[0]))


def run(*, cases: int = 60, seed: int = 0, recorded_only: bool = False) -> int:
    """Return 1 where a linear plant is said to be nonlinear, or circles hold too few lines.

    Args:
        cases: plants.
        seed: of the first.
        recorded_only: without simulated ones: a minute.
    """
    found: dict[str, list[tuple[float, float]]] = {}
    for name, left, held in rows(range(seed, seed + cases), records_only=recorded_only):
        found.setdefault(name, []).append((left, held))
    for name, pairs in found.items():
        left, held = np.array(pairs).T
        print(
            f"{name}: {len(pairs)} plants, distortion at most {left.max():.2g} of the output (median "
            f"{np.median(left):.2g}); circles hold {held.mean():.1%} of the lines, at least {held.min():.0%}"
        )
    exact = np.array([pair for name, pairs in found.items() if "noise" not in name for pair in pairs])
    return int(exact.size > 0 and not (exact[:, 0].max() < _DISTORTION and exact[:, 1].mean() >= _HELD))
