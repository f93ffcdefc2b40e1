"""Limit cycles as the methods found them, turned into entries of the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

from workbench.core.values.arrays import Complex
from workbench.limit_cycles.limit_cycle.cut import SplitLoop
from workbench.limit_cycles.limit_cycle.harmonic_balance import Cycle
from workbench.limit_cycles.limit_cycle.request import DESCRIBING_FUNCTION, HARMONIC_BALANCE, SHOOTING, SIMULATION
from workbench.limit_cycles.limit_cycle.result import LimitCycle, SimulatedCycle
from workbench.response.periodic.stability import is_stable, largest

__all__ = ["contradictions", "from_balance", "from_run", "same_cycle"]

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
        multiplier=largest(across),
        residual=cycle.residual,
        states=states,
    )


def from_run(run: SimulatedCycle, watch: Sequence[str]) -> LimitCycle:
    """Return the entry of a simulation.

    Args:
        run: what it ended in.
        watch: the blocks' inputs.
    """
    first = watch[0]
    return LimitCycle(
        method=SIMULATION,
        crossing=run.crossing,
        frequency_hz=run.frequency_hz,
        amplitude=run.amplitude[first],
        fundamental=run.fundamental[first],
        mean=run.mean[first],
        amplitudes=dict(run.amplitude),
        stable=True if run.steady else None,
    )


def contradictions(result: Sequence[LimitCycle], variable: str) -> list[str]:
    """Return in words where the methods contradict each other about the cycle of one crossing.

    Each is compared with the last that solves or runs the system itself, a steady simulation or a closed orbit.

    Args:
        result: the entries.
        variable: whose amplitude and mean they have.
    """
    words = []
    for number, entries in groupby((c for c in result if c.crossing is not None), key=lambda c: c.number):
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
