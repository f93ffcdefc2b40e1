#!/usr/bin/env python3
"""Linear models of the elevator law by the perturbation sets of figure 31, simulated beside the law.

    python scripts/figure31.py [--plot figure31.png]

The law is trimmed, linearised over its sample period with each set, and both are forced by a full stick at 5 Hz,
0.5 Hz and 0.05 Hz. Two sets more are ours: widths so narrow that nothing is limited, and a set fitted to 5 Hz.
Run it with the project's Python (see scripts/dev.py).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from rich import box  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

import workbench as wb  # noqa: E402
from workbench.plotting.figure import COLOURS, rows, save  # noqa: E402

Floats = NDArray[np.float64]

LAW = "fmu:ElevatorLaw"
STICK, ELEVATOR = "side_stick", "elevator"
AMPLITUDE = 1.0  # the whole stick, its normal range
FREQUENCIES = (5.0, 0.5, 0.05)  # [Hz]
PERIODS = 11  # of 5 Hz, 0.5 Hz or 0.05 Hz are a whole number of samples of 0.022 s
SETTLED = 2  # so many times 11 periods before

# Total widths: of the four states, of the five inputs.
PUBLISHED: Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "30a": ((1, 1, 1, 1), (1, 1, 1, 1, 1)),
    "30b": ((100, 100, 100, 1), (100, 100, 100, 100, 1)),
    "30c": ((100, 100, 100, 10), (100, 100, 100, 100, 1)),
    "30d": ((100, 100, 100, 10), (100, 100, 100, 100, 1.5)),
}
OURS: Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "narrow": ((0.1, 0.1, 0.1, 0.1), (0.1, 0.1, 0.1, 0.1, 0.1)),
    "fitted": ((100, 100, 100, 15), (100, 100, 100, 100, 1.65)),
}


@dataclass(frozen=True, eq=False)
class Wave:
    """What a sine of the stick makes of the elevator.

    Attributes:
        time: of the samples, shape (n,) [s].
        values: elevator from each sample to the next, shape (n,) [deg].
        fundamental: complex, elevator over stick [deg].
    """

    time: Floats
    values: Floats
    fundamental: complex

    @classmethod
    def of(cls, time: Floats, values: Floats, frequency: float) -> Wave:
        """Return the wave; `time` spans whole periods."""
        turning = np.exp(-2j * np.pi * frequency * time)
        return cls(time, values, complex(2j * np.mean(values * turning)) / AMPLITUDE)


@dataclass(frozen=True, eq=False)
class Trial:
    """One linear model beside the law, at one frequency.

    Attributes:
        name: of the set of widths.
        frequency: [Hz].
        linear, law: what either does.
    """

    name: str
    frequency: float
    linear: Wave
    law: Wave

    @property
    def phase_shift(self) -> float:
        """Phase of the linear model less that of the law [deg]."""
        return float(np.degrees(np.angle(self.linear.fundamental / self.law.fundamental)))

    @property
    def gain_ratio(self) -> float:
        """Gain of the linear model over that of the law."""
        return abs(self.linear.fundamental / self.law.fundamental)

    @property
    def error(self) -> float:
        """Root mean square of the difference, over that of the law's motion."""
        motion = self.law.values - np.mean(self.law.values)
        return float(np.sqrt(np.mean((self.linear.values - self.law.values) ** 2) / np.mean(motion**2)))


@dataclass(frozen=True, eq=False)
class Study:
    """All of it.

    Attributes:
        trim: the operating point, one of a family.
        models: set of widths → linear model.
        trials: by set and frequency.
    """

    trim: wb.TrimResult
    models: Mapping[str, wb.LinResult]
    trials: Mapping[tuple[str, float], Trial]


def study() -> Study:
    """Trim, linearise with every set, simulate the linear models and the law."""
    with wb.load(LAW, "me") as law:
        trim = wb.trim(law)
        sets = {**PUBLISHED, **OURS}
        models = {n: wb.lin(law, at=trim.point, dx=list(dx), du=list(du)).result for n, (dx, du) in sets.items()}
    with wb.load(LAW, "me", start_values=trim.point.discrete) as law:
        waves = {f: _law(law, f, models["narrow"].dt) for f in FREQUENCIES}
    trials = {
        (name, f): Trial(name, f, _linear(model, f), waves[f]) for name, model in models.items() for f in FREQUENCIES
    }
    return Study(trim, models, trials)


def _samples(frequency: float, period: float) -> tuple[Floats, int]:
    """Return the sample instants from rest on, and how many of the last are kept."""
    kept = round(PERIODS / frequency / period)
    time: Floats = period * np.arange(float((SETTLED + 1) * kept))
    return time, kept


def _law(model: wb.Model, frequency: float, period: float) -> Wave:
    time, kept = _samples(frequency, period)
    stick = wb.Sine(amplitude=AMPLITUDE, frequency=frequency)
    middle = time + 0.5 * period  # where the law holds what it set at the sample
    done = wb.simulate(model, stop=middle[-1], inputs={STICK: stick}, outputs=[ELEVATOR], points=middle)
    values = done.signals[ELEVATOR][np.searchsorted(done.time, middle - 1e-9)]
    return Wave.of(time[-kept:], values[-kept:], frequency)


def _linear(model: wb.LinResult, frequency: float) -> Wave:
    time, kept = _samples(frequency, model.dt)
    j = model.input_names.index(STICK)
    state, values = np.zeros(len(model.A)), []
    for u in AMPLITUDE * np.sin(2.0 * np.pi * frequency * time):
        values.append(float((model.C @ state)[0] + model.D[0, j] * u))
        state = model.A @ state + model.B[:, j] * u
    return Wave.of(time[-kept:], model.point.y[ELEVATOR] + np.array(values)[-kept:], frequency)


def show(result: Study, console: Console) -> None:
    """Print the equilibria, the table and what it says."""
    console.print(f"trim: {result.trim.message}")
    table = Table(box=box.SIMPLE_HEAD, title="Linear models compared with the law, full stick", title_justify="left")
    for heading in ("set", "dx", "du", "Hz", "gain ratio", "phase shift \\[deg]", "error \\[%]"):
        table.add_column(heading, justify="left" if heading in {"set", "dx", "du"} else "right", no_wrap=True)
    for name, (dx, du) in {**PUBLISHED, **OURS}.items():
        about = [name, ", ".join(f"{w:g}" for w in dx), ", ".join(f"{w:g}" for w in du)]
        for frequency in FREQUENCIES:
            trial = result.trials[name, frequency]
            numbers = (f"{trial.gain_ratio:.3f}", f"{trial.phase_shift:+.2f}", f"{100.0 * trial.error:.1f}")
            table.add_row(*about, f"{frequency:g}", *numbers)
            about = [""] * 3
        table.add_section()
    console.print(table)
    for frequency in FREQUENCIES:
        least = min((result.trials[n, frequency] for n in PUBLISHED), key=lambda t: abs(t.phase_shift))
        console.print(
            f"{frequency:g} Hz: least phase shift of the published sets {least.phase_shift:+.3f} deg, {least.name}"
        )


def draw(result: Study, path: str | Path) -> None:
    """Draw two periods of the law and of the published linear models at 5 Hz and at 0.5 Hz."""
    figure, axes = rows(2, title="Elevator law and its linear models, full stick")
    curves = {"30a": "30a, 30b", "30c": "30c", "30d": "30d", "narrow": "narrow widths (ours)"}
    for ax, frequency in zip(axes, FREQUENCIES, strict=False):
        law = result.trials["30a", frequency].law
        shown = law.time - law.time[0] < 2.0 / frequency + 1e-9
        turns = frequency * (law.time - law.time[0])[shown]
        ax.step(turns, law.values[shown], where="post", color="#222222", linewidth=2.2, label="law")
        for number, (name, text) in enumerate(curves.items()):
            wave = result.trials[name, frequency].linear
            style: dict[str, Any] = {
                "color": COLOURS[number],
                "linewidth": 1.4,
                "linestyle": ("-", "--", "-.", ":")[number],
            }
            ax.step(turns, wave.values[shown], where="post", label=text, **style)
        ax.set_ylabel(f"{ELEVATOR} [deg]")
        ax.text(0.01, 0.03, f"{frequency:g} Hz", transform=ax.transAxes, fontweight="bold")
    axes[-1].set_xlabel("time [periods]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8.5)
    save(figure, path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plot", metavar="PATH", help="write the picture: .png, .svg or .pdf")
    given = parser.parse_args(arguments)
    result = study()
    show(result, Console(width=None if sys.stdout.isatty() else 130, highlight=False))
    if given.plot:
        draw(result, given.plot)
    return 0


if __name__ == "__main__":
    sys.exit(main())
