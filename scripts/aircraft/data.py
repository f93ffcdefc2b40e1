"""The aircraft's data: what the Modelica model holds, and the matrices that follow from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scripts.aircraft.aerodynamics import returning
from workbench.core.values.arrays import Floats

POINTS = (
    "z_front_fuselage",
    "x_center_of_gravity",
    "z_center_of_gravity",
    "theta_center_of_gravity",
    "z_rear_fuselage",
    "x_wing_tip",
    "z_wing_tip",
    "y_inner_engine",
    "z_inner_engine",
    "y_outer_engine",
    "z_outer_engine",
)

HEAVE = 1  # coordinate


@dataclass(frozen=True, slots=True)
class Aircraft:
    """Coordinates: 3 rigid modes, 27 elastic modes, then elevator, inner aileron and outer aileron.

    Attributes:
        airspeed: reference [m/s].
        air_density: reference [kg/m³].
        hertz: structural frequencies, shape (30,) [Hz].
        damping: structural damping ratios, shape (30,).
        inertia: of the surfaces about their hinges, shape (3,) [kg·m²].
        coupling: inertial coupling of modes and surfaces, shape (30, 3).
        actuator_stiffness: shape (3,) [N·m/rad].
        actuator_damping: shape (3,) [N·m·s/rad].
        shape: displacement of the points, shape (11, 33).
        A0: aerodynamic stiffness per dynamic pressure, shape (33, 33).
        A1: aerodynamic damping per dynamic pressure for rate over airspeed, shape (33, 33).
        L: forces of the late lift per dynamic pressure, shape (33, 5).
        E0: what the late lift follows, by position, shape (5, 33).
        E1: the same by rate over airspeed, shape (5, 33).
        lag: rates per airspeed, shape (5,) [1/m].
    """

    airspeed: float
    air_density: float
    hertz: Floats
    damping: Floats
    inertia: Floats
    coupling: Floats
    actuator_stiffness: Floats
    actuator_damping: Floats
    shape: Floats
    A0: Floats
    A1: Floats
    L: Floats
    E0: Floats
    E1: Floats
    lag: Floats

    @property
    def pressure(self) -> float:
        """Dynamic pressure [Pa]."""
        return 0.5 * self.air_density * self.airspeed**2

    def gust_force(self) -> Floats:
        """Return the forces of an angle of attack of 1 rad without their late part, per dynamic pressure, shape (33,).

        They are those of sinking, without the force by which height returns slowly.
        """
        heave = float(self.shape[POINTS.index("z_center_of_gravity"), HEAVE])
        forces: Floats = (self.A1 - returning())[:, HEAVE]
        return forces / heave

    def mass(self) -> Floats:
        """Return the mass matrix, shape (33, 33)."""
        mass = np.eye(33)
        mass[:30, 30:], mass[30:, :30] = self.coupling, self.coupling.T
        mass[range(30, 33), range(30, 33)] = self.inertia
        return mass

    def stiffness(self, *, failed: bool = True) -> Floats:
        """Return stiffness with quasi-steady aerodynamics; `failed`: without the outer aileron's actuator."""
        K = self.pressure * self.A0
        K[range(30), range(30)] += (2.0 * np.pi * self.hertz) ** 2
        K[range(30, 33), range(30, 33)] += self.actuator_stiffness * [1.0, 1.0, 0.0 if failed else 1.0]
        return K

    def resistance(self, *, failed: bool = True) -> Floats:
        """Return the damping matrix, as :meth:`stiffness`."""
        C = self.pressure / self.airspeed * self.A1
        C[range(30), range(30)] += 4.0 * np.pi * self.hertz * self.damping
        C[range(30, 33), range(30, 33)] += self.actuator_damping * [1.0, 1.0, 0.0 if failed else 1.0]
        return C

    def system(self, *, failed: bool = True) -> Floats:
        """Return A, shape (71, 71); states are coordinates, rates, lags."""
        A = np.zeros((71, 71))
        inverse = np.linalg.inv(self.mass())
        A[:33, 33:66] = np.eye(33)
        A[33:66, :33] = -inverse @ self.stiffness(failed=failed)
        A[33:66, 33:66] = -inverse @ self.resistance(failed=failed)
        A[33:66, 66:] = inverse @ (self.pressure * self.L)
        rates = self.airspeed * self.lag
        A[66:, :33] = rates[:, None] * self.E0
        A[66:, 33:66] = self.lag[:, None] * self.E1
        A[66:, 66:] = -np.diag(rates)
        return A
