#!/usr/bin/env python3
"""Identification of the elevator law and of the rudder: every figure of chapters 6.3 and 7.2, measured now.

    python scripts/identification.py [--seeds 5] [--plot folder]

The published binary sequence is not printed, so the law is identified from several; ranges are over them.
Run it with the project's Python (see scripts/dev.py).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
from rich import box  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

import workbench as wb  # noqa: E402
from workbench.identification.validate.fit import (  # noqa: E402
    ERROR_FIGURES,
    error_figure,
)
from workbench.reproduce.identification import (  # noqa: E402
    SEEDS,
    SEGMENTS,
    a_gain,
    coherence_of,
    crossing,
    first_order,
    law,
    limited,
    outside,
    rudder,
    swept,
)
from workbench.reproduce.targets import read_targets  # noqa: E402


def wanted(name: str) -> str:
    """Return a target in words."""
    return read_targets()[name].text


@dataclass(frozen=True)
class Row:
    """One figure: what is published or asked for, what was measured, over the seeds."""

    what: str
    target: str
    measured: Sequence[float]

    @property
    def words(self) -> str:
        """The range."""
        low, high = min(self.measured), max(self.measured)
        return f"{low:.4g}" if low == high else f"{low:.4g} … {high:.4g}"


def of_law(seeds: Sequence[int]) -> list[Row]:
    """Figures of chapter 6.3."""
    full = [law(s, amplitude=1.0) for s in seeds]
    models = [first_order(d) for d in full]
    return [*of_data(full), *of_models(models), *of_other_inputs(seeds, models)]


def of_data(full: Sequence[wb.ExciteResult]) -> list[Row]:
    """The coherence, which depends on the window more than on anything else."""
    rows = []
    for window, overlap in (("boxcar", 0.0), ("hann", 0.5)):
        found = [coherence_of(d.identification, window, overlap) for d in full]
        what = f"coherence, {SEGMENTS} segments, {window}"
        target = wanted("law-coherence") if window == "boxcar" else ""
        rows.append(Row(f"{what}: peak", target, [float(c.max()) for c in found]))
        rows.append(Row(f"{what}: median", "clearly below 1", [float(np.median(c)) for c in found]))
    return rows


def of_models(models: Sequence[wb.IdentifyResult]) -> list[Row]:
    """The model of first order at full amplitude."""
    ratio = [float(m.estimate.singular_values[0] / m.estimate.singular_values[1]) for m in models]
    one_step = [m.own.prediction.fits[0].error_percent for m in models]
    errors = [
        Row(
            f"simulation error on the data of the fit, '{n}' [%]",
            wanted("law-error"),
            [error(m, n) for m in models],
        )
        for n in ERROR_FIGURES
    ]
    return [
        Row("first singular value over the second", wanted("law-singular-values"), ratio),
        *errors,
        Row("simulation error on other data [%]", "", [m.error_percent for m in models]),
        Row("one-step error on the data of the fit [%]", "", one_step),
        Row(
            "lags of the residuals outside the 95 % band, of 25",
            wanted("law-residuals"),
            [outside(m) for m in models],
        ),
        Row(
            "lags ≥ 0 input–residual outside the 95 % band, of 26",
            wanted("law-cross-correlation"),
            [crossing(m) for m in models],
        ),
    ]


def of_other_inputs(seeds: Sequence[int], models: Sequence[wb.IdentifyResult]) -> list[Row]:
    """What the input's amplitude and offset change."""
    positive = [first_order(law(s, amplitude=0.5, offset=0.5)) for s in seeds]
    gentle = [law(s, amplitude=0.04, offset=0.3) for s in seeds]
    small = [wb.identify(d.identification, validation=d.validation) for d in gentle]
    slow, slow_positive = ([a_gain(swept(s, offset)) for s in seeds] for offset in (0.0, 0.5))
    # n4sid makes an unstable model of first order of these few slow lines; moesp does not.
    lags = {
        m: [wb.identify(swept(s, 0.0).identification, order=1, method=m) for s in seeds] for m in ("n4sid", "moesp")
    }
    failed = [wb.advise(law(s, amplitude=1.0, settings={"elevator_failed": 1.0}).identification) for s in seeds]
    seen = [float(a.finding("saturation").verdict != "good") for a in failed]
    seen_normally = [float(m.advice.finding("saturation").verdict != "good") for m in models]
    own = [m.own.fit_percent["elevator"] for m in models]
    return [
        Row("fit on the data of the fit, −1 … 1 [%]", "", own),
        Row("fit on the data of the fit, 0 … 1 [%]", "better", [m.own.fit_percent["elevator"] for m in positive]),
        Row("fit on other data, −1 … 1 [%]", "", [m.fit_percent for m in models]),
        Row("fit on other data, 0 … 1 [%]", "better", [m.fit_percent for m in positive]),
        Row("order found, 0.26 … 0.34, limiter idle", wanted("law-small-order"), [float(m.order) for m in small]),
        Row(
            "fit on other data, 0.26 … 0.34, limiter idle [%]",
            wanted("law-small-fit"),
            [m.fit_percent for m in small],
        ),
        Row("fit of a gain, slow multisine, centred [%]", "", [m.fit_percent for m in slow]),
        Row("fit of a gain, slow multisine, positive [%]", "better", [m.fit_percent for m in slow_positive]),
        *(
            Row(f"slow multisine, first order by {m}: pole", "stable", [float(x.model.poles[0].real) for x in found])
            for m, found in lags.items()
        ),
        Row("one elevator failed: the advice sees a limit (1)", "1", seen),
        Row("both elevators work: the advice sees a limit (1)", "0", seen_normally),
        Row("one elevator failed, slow multisine: a limit (1)", "1", [limited(1.0, s) for s in seeds]),
        Row("both elevators work, slow multisine: a limit (1)", "0", [limited(0.0, s) for s in seeds]),
    ]


def error(model: wb.IdentifyResult, name: str) -> float:
    """Return the error of the simulation on the data of the fit under one definition [%]."""
    return error_figure(model.own.data.y[:, 0], model.own.simulation.computed[:, 0], name)


def of_rudder(seeds: Sequence[int], folder: Path | None) -> list[Row]:
    """Figures of chapter 7.2."""
    frequencies = np.geomspace(0.5, 45.0, 25)
    with wb.load("fmu:Rudder", "me", tolerance=1e-8) as model:
        data = [rudder(s) for s in seeds]
        linear = wb.lin(model, inputs=["delC"]).result
        measured = wb.nfr(model, "delC", "del", frequencies, amplitudes=[2.0])
    found = [wb.identify(d.identification, order=6, validation=d.validation) for d in data]
    laid = [wb.overlay(f.model, lin=linear, nfr=measured) for f in found]
    worst = [o.difference().worst(30.0) for o in laid]
    far = [o.difference().worst(45.0) for o in laid]
    if folder is not None:
        laid[0].plot(folder / "rudder_bode.png")
        found[0].plot(folder / "rudder_fit.png")
    return [
        Row("fit on other data, sixth order [%]", wanted("rudder-fit"), [f.fit_percent for f in found]),
        Row(
            "gain against the NFR up to 30 Hz, largest [dB]",
            wanted("rudder-identified-gain-30"),
            [w[0] for w in worst],
        ),
        Row(
            "phase against the NFR up to 30 Hz, largest [deg]",
            wanted("rudder-identified-phase-30"),
            [w[1] for w in worst],
        ),
        Row(
            "gain against the NFR up to 45 Hz, largest [dB]",
            wanted("rudder-identified-gain-45"),
            [w[0] for w in far],
        ),
        Row(
            "phase against the NFR up to 45 Hz, largest [deg]",
            wanted("rudder-identified-phase-45"),
            [w[1] for w in far],
        ),
    ]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="binary sequences")
    parser.add_argument("--plot", type=Path, help="folder for pictures")
    arguments = parser.parse_args()
    if arguments.plot is not None:
        arguments.plot.mkdir(parents=True, exist_ok=True)
    seeds = range(1, 1 + arguments.seeds)
    console = Console(width=120)
    for title, rows in (("Elevator law (6.3)", of_law(seeds)), ("Rudder (7.2)", of_rudder(seeds, arguments.plot))):
        table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
        for heading in ("figure", "target", f"measured, {arguments.seeds} sequences"):
            table.add_column(heading)
        for row in rows:
            table.add_row(row.what, row.target, row.words)
        console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
