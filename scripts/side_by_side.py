#!/usr/bin/env python3
"""Solving for periodic responses beside waiting for them: periods, processor time, true error, in one run.

    python scripts/side_by_side.py                 all cases
    python scripts/side_by_side.py rudder rod      some of them

The truth of linear cases is their closed form; of the others the same model at a relative tolerance of 1e-10, waited
for over up to 2000 periods until a period changes it by less than 1e-5. Run it with the project's Python (see
scripts/dev.py).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from workbench.core.values.arrays import Complex

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import control  # noqa: E402
import numpy as np  # noqa: E402

import workbench as wb  # noqa: E402
from scripts.coverage_nfr import trials  # noqa: E402


@dataclass(frozen=True)
class Case:
    """What is measured.

    Attributes:
        open: opens the model at a relative tolerance; None: its own.
        input, output: names.
        frequencies: [Hz].
        amplitude: [unit of the input].
        truth: response at the frequencies; None: measured.
    """

    open: Callable[[float | None], wb.Model]
    input: str
    output: str
    frequencies: Sequence[float]
    amplitude: float
    truth: Callable[[], Complex] | None = None


def bundled(name: str) -> Callable[[float | None], wb.Model]:
    """Return what opens a bundled model."""
    return lambda tolerance: wb.load(f"fmu:{name}", tolerance=tolerance)


def rod(count: int = 250) -> control.StateSpace:
    """Return a rod in `count` masses, fixed at one end, forced at the other; its first mode at 1 Hz, damped by 1 %."""
    k = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    k[-1, -1] = 1.0
    lowest = np.sqrt(np.linalg.eigvalsh(k)[0])
    k *= (2.0 * np.pi / lowest) ** 2
    damping = 0.02 / (2.0 * np.pi) * k  # proportional to stiffness: the higher a mode, the more
    a = np.block([[np.zeros((count, count)), np.eye(count)], [-k, -damping]])
    b, c = np.zeros((2 * count, 1)), np.zeros((1, 2 * count))
    b[-1, 0], c[0, count - 1] = (2.0 * np.pi) ** 2, 1.0
    return control.ss(a, b, c, 0.0)


def _rod(tolerance: float | None) -> wb.Model:
    return wb.connect({"rod": rod()}, [], inputs={"u": "rod.u"}, outputs={"y": "rod.y"}, tolerance=tolerance or 1e-8)


def _of(system: control.StateSpace, frequencies: Sequence[float]) -> Complex:
    return np.array([complex(system(2j * np.pi * f)) for f in frequencies])


def _aircraft(frequencies: Sequence[float]) -> Complex:
    with wb.load("fmu:Aircraft", tolerance=1e-10) as model:
        exact = wb.lin(model, inputs=["elevator"], outputs=["z_front_fuselage"])
    return np.array([complex(exact(2j * np.pi * f)) for f in frequencies])


_FLIGHT = np.geomspace(2.8, 8.0, 10).tolist()
_ROD = [0.9, 1.0, 1.1, 3.0]
CASES = {
    "rudder": Case(bundled("Rudder"), "delC", "del", np.geomspace(0.5, 20.0, 12).tolist(), 1.0),
    "aircraft": Case(bundled("Aircraft"), "elevator", "z_front_fuselage", _FLIGHT, 1e-3, lambda: _aircraft(_FLIGHT)),
    "duffing": Case(bundled("Duffing"), "u", "y", np.geomspace(0.05, 0.16, 12).tolist(), 0.1),
    "rod": Case(_rod, "u", "y", _ROD, 1.0, lambda: _of(rod(), _ROD)),
}


def _truth(case: Case) -> Complex:
    if case.truth is not None:
        return case.truth()
    with case.open(1e-10) as model:
        found = wb.nfr(
            model, case.input, case.output, case.frequencies, [case.amplitude],
            method="settle", errcrit=1e-3, max_periods=2000, drift_check=False, in_process=True,
        )  # fmt: skip
    response: Complex = found.response[0]
    return response


def compare(name: str, case: Case) -> None:
    """Print one line for each method."""
    truth = _truth(case)
    for method in ("settle", "auto"):
        with case.open(None) as model:
            begin = time.process_time()
            found = wb.nfr(
                model, case.input, case.output, case.frequencies, [case.amplitude],
                method=method, drift_check=False, in_process=True,
            )  # fmt: skip
            spent = time.process_time() - begin
        off = np.abs(found.response[0] / truth - 1.0)
        covered = np.mean((off <= found.error[0]) | np.isnan(found.error[0]))
        settled = sum(status == "settled" for status in found.status[0])
        decibels = float(np.max(np.abs(20.0 * np.log10(np.abs(found.response[0] / truth)))))
        print(
            f"{name:<9} {method:<7} {len(truth):>4} points {int(found.periods.sum()):>5} periods {spent:>7.2f} s CPU "
            f"{decibels:>9.5f} dB off at most, settled {settled}, covered {100.0 * covered:.0f} %",
            flush=True,
        )


def plants() -> None:
    """Print one line for each method: 200 random lightly damped plants."""
    for method in ("settle", "auto"):
        begin = time.process_time()
        found = list(trials(200, 1, tolerance=1e-8, max_periods=20, blind=False, method=method))
        spent = time.process_time() - begin
        settled = [t for t in found if t.status == "settled"]
        known = [t for t in found if np.isfinite(t.stated)]
        covered = np.mean([t.true <= t.stated for t in known])
        worst = 20.0 * np.log10(1.0 + max((t.true for t in settled), default=0.0))
        periods = sum(t.periods for t in found)
        print(
            f"{'plants':<9} {method:<7} {len(found):>4} points {periods:>5} periods {spent:>7.2f} s CPU "
            f"{worst:>9.5f} dB off at most where settled, settled {len(settled)}, "
            f"covered {100.0 * covered:.0f} %",
            flush=True,
        )


def main() -> int:
    """Compare the cases that are named, or all."""
    known = [*CASES, "plants"]
    names = sys.argv[1:] or known
    for name in names:
        if name not in known:
            print(f"side_by_side: no case '{name}'; known: {', '.join(known)}", file=sys.stderr)
            return 2
    for name in names:
        if name == "plants":
            plants()
        else:
            compare(name, CASES[name])
    return 0


if __name__ == "__main__":
    sys.exit(main())
