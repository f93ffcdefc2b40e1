"""Let a session run under its inputs until nothing moves any more."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.session.base import Session

__all__ = ["FIRST_STEPS", "LEAST_STEPS", "MAX_STEPS", "STEP", "STEP_PARTS", "Settled", "settle"]

STEP = 1e-3  # [s], communication step where nothing says how long it should be
STEP_PARTS = (1.0, 0.125, 0.125**2)  # of a communication step, tried one after the other
FIRST_STEPS = 64  # communication steps of the first stretch
LEAST_STEPS = 4096  # communication steps that are watched at least: a slow sampler stands still between samples
MAX_STEPS = 200_000  # communication steps of one run
SAMPLES = 64  # looked at per stretch
RUNAWAY = 1e30  # nominal values
UNKNOWN = 1e-9  # smallest size of a variable that declares none; below it, rounding
DECAY = 0.2  # from one stretch to the next, twice as long, of what settles


@dataclass(frozen=True, eq=False)
class Settled:
    """Where a run ended.

    Attributes:
        time: [s].
        values: shape (n,), of the watched variables at the end.
        ranges: shape (n,), by how much each moved in the last half of the run.
        largest: shape (n,), largest magnitude of each in the whole run.
        settled: whether all stand still.
    """

    time: float
    values: Floats
    ranges: Floats
    largest: Floats
    settled: bool


def settle(
    session: Session,
    names: Sequence[str],
    nominal: Floats,
    *,
    first: float,
    longest: float,
    tolerance: float,
    least: float = 0.0,
    told: Callable[[Settled], None] = lambda _: None,
) -> Settled:
    """Run a session in stretches, each as long as all before it, until nothing moves.

    It stands still when in the last stretch no variable has moved by more than `tolerance`, relative to its
    magnitude or nominal value, and that less than 0.2 of the stretch before: a slow drift moves twice as far in twice
    the time and is not taken for rest.

    Not for undamped models, which never rest, and no proof for models that wait longer than they have been
    watched.

    Args:
        session: stands anywhere; it is advanced with its inputs as they are.
        names: variables to watch; without any the session is at rest where it stands.
        nominal: shape (n,), their nominal values; 0: the largest value that is seen.
        first: length of the first stretch [s].
        longest: of the whole run [s].
        tolerance: see above.
        least: of the whole run [s].
        told: is called with where the run is after each stretch that does not end it.

    Raises:
        SimulationError: the model fails on the way.
    """
    if not names:
        nothing = np.zeros(0)
        return Settled(session.time, nothing, nothing, nothing, settled=True)
    begin, stretch = session.time, first
    before, seen = np.full(len(names), math.inf), np.zeros(len(names))
    while True:
        start = session.time
        points = np.linspace(start, start + stretch, SAMPLES + 1)[1:]
        record = session.advance(float(points[-1]), signals={}, record=names, points=points)
        table = np.array([record.values[n] for n in names]).reshape(len(names), -1)
        values, ranges = table[:, -1], np.ptp(table, axis=1)
        seen = np.maximum(seen, np.abs(table).max(axis=1))
        scale = np.maximum(np.abs(values), np.where(nominal > 0.0, nominal, np.maximum(seen, UNKNOWN)))
        if not (seen < RUNAWAY * np.where(nominal > 0.0, nominal, 1.0)).all():
            raise SimulationError("the model runs away", time=session.time)
        still = (ranges <= tolerance * scale) & ((ranges <= DECAY * before) | (ranges <= 1e-3 * tolerance * scale))
        if still.all() and np.isfinite(before).all() and session.time - begin >= least:
            return Settled(session.time, values, ranges, seen, settled=True)
        here = Settled(session.time, values, ranges, seen, settled=False)
        if session.time + 2.0 * stretch - begin > longest:
            return here
        told(here)
        before, stretch = ranges, session.time - begin
