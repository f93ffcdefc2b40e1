"""The stages of the calibration, and the stored result as a readable table."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from scripts.aircraft.cost import Cost, Stage
from scripts.aircraft.data import Aircraft
from scripts.aircraft.levenberg import minimise
from scripts.aircraft.problem import FAST_ACTUATORS, Free, free_entries, prior_aircraft
from workbench.core.values.arrays import Floats

STORED = Path(__file__).with_name("calibrated.csv")
_EARLY = {"tip": 9.94, "front": 1.529, "late": False}
# Weights with the iterations allowed; `early` leaves out what needs the main figures first.
EARLY = (
    (Stage(0.1, 1.0, 1.0, 0.03, **_EARLY), 15),  # type: ignore[arg-type]
    (Stage(0.3, 1.0, 1.0, 0.03, **_EARLY), 15),  # type: ignore[arg-type]
    (Stage(1.0, 1.0, 1.0, 0.03, **_EARLY), 20),  # type: ignore[arg-type]
    (Stage(1.0, 4.0, 1.0, 0.03, **_EARLY), 20),  # type: ignore[arg-type]
    (Stage(3.0, 6.0, 1.0, 0.03, **_EARLY), 20),  # type: ignore[arg-type]
    (Stage(10.0, 10.0, 1.0, 0.03, **_EARLY), 20),  # type: ignore[arg-type]
)
LATE = (
    (Stage(1.0, 2.0, 3.0, 0.02), 40),
    (Stage(1.0, 4.0, 3.0, 0.02), 20),
    (Stage(5.0, 6.0, 3.0, 0.02), 25),
    (Stage(30.0, 10.0, 3.0, 0.02), 25),
    (Stage(60.0, 20.0, 3.0, 0.02), 20),
)


def from_prior() -> Floats:
    """Fit from the prior on; the actuator of the inner aileron is fast at first and gets its bandwidth later."""
    _, fast = prior_aircraft(FAST_ACTUATORS)
    free = free_entries(fast)
    p = np.zeros(len(free.scale))
    for stage, iterations in EARLY:
        p = _stage(fast, free, stage, p, iterations)
    return refine(p)


def refine(p: Floats) -> Floats:
    """Run the late stages from `p`."""
    _, aircraft = prior_aircraft()
    free = free_entries(aircraft)
    for stage, iterations in LATE:
        p = _stage(aircraft, free, stage, p, iterations)
    return p


def _stage(aircraft: Aircraft, free: Free, stage: Stage, p: Floats, iterations: int) -> Floats:
    cost = Cost(aircraft, free, stage)
    p, _ = minimise(cost, p, damping=0.1, iterations=iterations, tolerance=1e-3)
    rest = cost(p)[0][: -len(p)]
    print(
        f"data {stage.data:g}, stability {stage.stability:g}: cost {rest @ rest:.3g}, "
        f"distance from the prior {np.linalg.norm(p):.1f}"
    )
    return p


def write(p: Floats, free: Free, path: Path = STORED) -> None:
    """Write the parameters with what they change."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["matrix", "row", "column", "change / scale"])
        for stiffness, i, j, value in zip(free.stiffness, free.row, free.column, p, strict=True):
            table.writerow(["stiffness" if stiffness else "damping", i + 1, j + 1, f"{value:.9g}"])


def read(path: Path = STORED) -> Floats:
    """Return the stored parameters."""
    with path.open(encoding="utf-8", newline="") as file:
        return np.array([float(row["change / scale"]) for row in csv.DictReader(file)])
