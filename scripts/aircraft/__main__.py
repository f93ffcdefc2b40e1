"""Write modelica_src/Aircraft/Aircraft.mo from strip theory and the stored changes of 240 of its terms.

    python -m scripts.aircraft

How they were found stands in modelica_src/Aircraft/README.md.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from scripts.aircraft.modelica import source
from scripts.aircraft.problem import changed, free_entries, prior_aircraft

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parents[1] / "modelica_src" / "Aircraft" / "Aircraft.mo"


def written() -> str:
    """Return the Modelica source."""
    aircraft = prior_aircraft()[1]
    with (HERE / "calibrated.csv").open(encoding="utf-8", newline="") as file:
        changes = np.array([float(row["change / scale"]) for row in csv.DictReader(file)])
    return source(changed(aircraft, free_entries(aircraft), changes))


if __name__ == "__main__":
    SOURCE.write_text(written(), encoding="utf-8")
