"""What the calibration may change: some aerodynamic terms, each scaled by its prior, from the prior on.

Free are, for every elastic and rigid mode, the outer aileron's hinge moments, the forces of inner and outer
aileron, and the diagonal of the elastic modes; in stiffness and in damping. Masses, shapes, structure and lags stay
what the prior says.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scripts.aircraft.aerodynamics import SURFACES, TABLE, prior
from scripts.aircraft.data import Aircraft
from scripts.aircraft.structure import Structure, build, points
from workbench.core.values.arrays import Complex, Floats

Integers = NDArray[np.int64]

AIRSPEED, AIR_DENSITY = 250.0, 0.41
MODAL_DAMPING = 0.012
INNER, OUTER = 31, 32  # coordinates
# Natural frequency [Hz] and damping ratio of each surface on its actuator.
ACTUATORS = ((22.0, 0.35), (14.0, 0.7), (20.0, 0.35))


@dataclass(frozen=True, slots=True)
class Free:
    """Free entries of the 33 × 33 matrices: value = prior + scale · p.

    Attributes:
        stiffness: which are stiffness (the others are damping).
        row: shape (n,).
        column: shape (n,).
        scale: shape (n,), in units of K and C.
    """

    stiffness: NDArray[np.bool_]
    row: Integers
    column: Integers
    scale: Floats

    def slopes(self, s: complex, left: Complex, right: Complex) -> Complex:
        """Return leftᵀ (∂K + s ∂C) right for every free entry."""
        product = left[self.row] * right[self.column] * self.scale
        return np.where(self.stiffness, product, s * product)


def prior_aircraft(actuators: tuple[tuple[float, float], ...] = ACTUATORS) -> tuple[Structure, Aircraft]:
    """Return structure and strip theory's aircraft."""
    structure = build()
    aero = prior(structure)
    inertia = np.array([TABLE[name].inertia for name in SURFACES])
    omega = 2.0 * np.pi * np.array([hertz for hertz, _ in actuators])
    ratio = np.array([damping for _, damping in actuators])
    aircraft = Aircraft(
        AIRSPEED,
        AIR_DENSITY,
        structure.hertz,
        np.full(30, MODAL_DAMPING),
        inertia,
        aero.coupling,
        inertia * omega**2,
        2.0 * ratio * inertia * omega,
        np.hstack([points(structure), np.zeros((11, 3))]),
        aero.A0,
        aero.A1,
        aero.L,
        aero.E0,
        aero.E1,
        aero.lag,
    )
    return structure, aircraft


def free_entries(aircraft: Aircraft) -> Free:
    """Return what may change, with scales 0.5 |prior| + 0.3 typical of its group."""
    pressure = aircraft.pressure
    found = [*_entries(pressure * aircraft.A0, stiffness=True)]
    found += _entries(pressure / aircraft.airspeed * aircraft.A1, stiffness=False)
    kind, row, column, scale = zip(*found, strict=True)
    return Free(np.array(kind), np.array(row), np.array(column), np.array(scale))


def _entries(matrix: Floats, *, stiffness: bool) -> Iterator[tuple[bool, int, int, float]]:
    elastic, rigid = np.arange(3, 30), np.arange(3)
    groups = [(np.full(27, OUTER), elastic), (elastic, np.full(27, OUTER)), (elastic, np.full(27, INNER))]
    groups += [(elastic, elastic)]
    groups += [(np.full(3, OUTER), rigid), (rigid, np.full(3, OUTER)), (rigid, np.full(3, INNER))]
    for rows, columns in groups:
        values = matrix[rows, columns]
        scales = 0.5 * abs(values) + 0.3 * np.sqrt(np.mean(values**2))
        yield from ((stiffness, int(i), int(j), float(k)) for i, j, k in zip(rows, columns, scales, strict=True))
    own = abs(float(matrix[OUTER, OUTER]))
    for i, j, share in ((OUTER, OUTER, 0.4), (INNER, OUTER, 0.1), (OUTER, INNER, 0.4)):
        yield stiffness, i, j, share * own


def changed(aircraft: Aircraft, free: Free, p: Floats) -> Aircraft:
    """Return the aircraft with the free entries at `p`."""
    A0, A1 = aircraft.A0.copy(), aircraft.A1.copy()
    step, kind = p * free.scale / aircraft.pressure, free.stiffness
    np.add.at(A0, (free.row[kind], free.column[kind]), step[kind])
    np.add.at(A1, (free.row[~kind], free.column[~kind]), step[~kind] * aircraft.airspeed)
    return replace(aircraft, A0=A0, A1=A1)
