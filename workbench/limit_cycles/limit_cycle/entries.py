"""Limit cycles as the methods found them, turned into entries of the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

import numpy as np

from workbench.core.values.arrays import Complex
from workbench.limit_cycles.limit_cycle.confirm import Simulated
from workbench.limit_cycles.limit_cycle.cut import SplitLoop
from workbench.limit_cycles.limit_cycle.harmonic_balance import Cycle
from workbench.limit_cycles.limit_cycle.request import DESCRIBING_FUNCTION, HARMONIC_BALANCE, SHOOTING, SIMULATION
from workbench.limit_cycles.limit_cycle.result import LimitCycle, SimulatedCycle
from workbench.limit_cycles.limit_cycle.shooting import Orbit
from workbench.model.described_model import DescribedModel
from workbench.response.periodic.stability import is_stable

__all__ = ["contradictions", "from_balance", "from_orbit", "from_run", "same_cycle", "simulated_cycle"]

_SAME = 1e-4  # relative difference of two cycles that are one
_ROUGH = 0.1  # relative error that a describing function may have
_FINE = 0.02  # of harmonic balance with its first harmonics, of a simulation that is steady


def same_cycle(other: LimitCycle, cycle: Cycle) -> bool:
    """Whether a cycle has been found before.

    Args:
        other: an entry.
        cycle: by harmonic balance.
    """
    near = abs(other.frequency_hz / cycle.frequency - 1.0) < _SAME
    return near and abs(other.fundamental / cycle.fundamental - 1.0) < _SAME


def _largest(across: Complex | None) -> float | None:
    """Return the size of the largest multiplier besides the one at 1; None: there is none, or it is not known."""
    return float(np.abs(across).max()) if across is not None and len(across) else None


def from_balance(
    number: int, cycle: Cycle, loop: SplitLoop, across: Complex | None, *, doubt: float, states: Mapping[str, float]
) -> LimitCycle:
    """Return the entry of a motion by harmonic balance.

    Args:
        number: of its crossing.
        cycle: the motion.
        loop: whose.
        across: multipliers besides the one at 1; None: not known.
        doubt: what they may be off by.
        states: at phase 0.
    """
    return LimitCycle(
        method=HARMONIC_BALANCE,
        crossing=number,
        frequency_hz=cycle.frequency,
        amplitude=cycle.amplitude,
        fundamental=cycle.fundamental,
        mean=loop.centre + float(cycle.v[0, 0].real),
        amplitudes=dict(zip((p.v for p in loop.every), cycle.amplitudes.tolist(), strict=True)),
        stable=is_stable(across, doubt=doubt),
        multiplier=_largest(across),
        residual=cycle.residual,
        states=states,
    )


def from_orbit(number: int | None, orbit: Orbit) -> LimitCycle:
    """Return the entry of a closed orbit.

    Args:
        number: of its crossing; None: no crossing predicted it.
        orbit: by shooting.
    """
    return LimitCycle(
        method=SHOOTING,
        crossing=number,
        frequency_hz=orbit.frequency,
        amplitude=orbit.amplitude,
        fundamental=orbit.fundamental,
        mean=orbit.mean,
        amplitudes=orbit.amplitudes,
        stable=is_stable(orbit.multipliers, doubt=orbit.doubt),
        multiplier=_largest(orbit.multipliers),
        residual=orbit.residual,
        states=orbit.states,
    )


def from_run(number: int | None, run: Simulated, watch: Sequence[str]) -> LimitCycle:
    """Return the entry of a simulation.

    Args:
        number: of its crossing; None: no crossing predicted it.
        run: what it showed.
        watch: the blocks' inputs.
    """
    first = watch[0]
    return LimitCycle(
        method=SIMULATION,
        crossing=number,
        frequency_hz=run.frequency,
        amplitude=run.amplitude[first],
        fundamental=run.fundamental[first],
        mean=run.mean[first],
        amplitudes={n: run.amplitude[n] for n in watch},
        stable=True if run.steady else None,
    )


def simulated_cycle(
    system: DescribedModel, number: int | None, run: Simulated, frequency: float, amplitude: float
) -> SimulatedCycle:
    """Return what a simulation ended in.

    Args:
        system: what was simulated.
        number: of the crossing; None: no crossing predicted it.
        run: what it showed.
        frequency: where it began [Hz].
        amplitude: of the block's input, where it began.
    """
    units = {v.name: v.unit for v in system.description.variables}
    return SimulatedCycle(
        crossing=number,
        frequency_hz=run.frequency,
        amplitude=run.amplitude,
        fundamental=run.fundamental,
        mean=run.mean,
        units={n: units.get(n) for n in run.amplitude},
        steady=run.steady,
        periods=run.periods,
        time=run.time,
        values=run.values,
        predicted_frequency_hz=frequency,
        predicted_amplitude=amplitude,
    )


def contradictions(found: Sequence[LimitCycle], variable: str) -> list[str]:
    """Return in words where the methods contradict each other about the cycle of one crossing.

    Each is compared with the last that solves or runs the system itself, a steady simulation or a closed orbit.

    Args:
        found: the entries.
        variable: whose amplitude and mean they have.
    """
    words = []
    for number, entries in groupby((c for c in found if c.crossing is not None), key=lambda c: c.number):
        rows = list(entries)
        sure = [c for c in rows if c.method == SHOOTING or (c.method == SIMULATION and c.stable)]
        for c in rows if sure else ():
            apart = _apart(c, sure[-1])
            if apart:
                words.append(
                    f"crossing {number}: {c.method} contradicts {sure[-1].method} about {variable}: {', '.join(apart)};"
                    f" rely on {sure[-1].method}"
                )
    return words


def _apart(c: LimitCycle, sure: LimitCycle) -> list[str]:
    """Return what differs by more than the errors of both methods."""
    error = _ROUGH if c.method == DESCRIBING_FUNCTION else _FINE
    values = {
        "frequency": (c.frequency_hz, sure.frequency_hz, sure.frequency_hz),
        "fundamental": (c.fundamental, sure.fundamental, sure.fundamental),
        "mean": (c.mean, sure.mean, sure.fundamental),
    }
    return [f"{n} {a:.4g}, not {b:.4g}" for n, (a, b, size) in values.items() if abs(a - b) > error * size]
