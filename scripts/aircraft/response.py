"""Frequency functions of the second-order form and their slopes by adjoints; eigenvalues and theirs by eigenvectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scripts.aircraft.data import Aircraft
from scripts.aircraft.problem import INNER, OUTER, POSITION, RATE, Free
from workbench.core.values.arrays import Complex, Floats


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Eigenvalues with right and left eigenvectors (rows of `left` · columns of `right` = 1)."""

    values: Complex
    right: Complex
    left: Complex


class Response:
    """One aircraft with its outer aileron free, ready for many frequencies and loops."""

    def __init__(self, aircraft: Aircraft, free: Free) -> None:
        self.aircraft, self.free = aircraft, free
        self.mass = aircraft.mass()
        self.inverse = np.linalg.inv(self.mass)
        self.stiffness, self.resistance = aircraft.stiffness(), aircraft.resistance()
        self.open = aircraft.system()
        self.moment, self.command = np.zeros(71), np.zeros(71)
        self.moment[33:66] = self.inverse[:, OUTER]
        self.command[33:66] = self.inverse[:, INNER] * aircraft.actuator_stiffness[1]

    def receptance(self, hertz: float) -> tuple[complex, Complex]:
        """Return s = jω and (s² M + s C + K − lag)⁻¹, shape (33, 33)."""
        s, craft = 2j * np.pi * hertz, self.aircraft
        rates = craft.airspeed * craft.lag
        late = craft.pressure * (craft.L * (rates / (s + rates))) @ (craft.E0 + s * craft.E1 / craft.airspeed)
        dynamic = s * s * self.mass + s * self.resistance + self.stiffness - late
        return s, np.asarray(np.linalg.inv(dynamic), dtype=complex)

    def slope(self, s: complex, receptance: Complex, left: Complex, column: int) -> Complex:
        """Return the slopes of leftᵀ P⁻¹ e over the free entries."""
        return -self.free.slopes(s, left @ receptance, receptance[:, column])

    def loop(self, damper: float, gain: float = 0.0) -> Floats:
        """Return A with an equivalent damper [N·m·s/rad] and a gain from the aileron's position to the inner one."""
        A = self.open.copy()
        A[:, RATE] -= damper * self.moment
        A[:, POSITION] += gain * self.command
        return A

    def eigenvalue_slopes(self, spectrum: Spectrum, i: int) -> Complex:
        """Return the slopes of eigenvalue `i` over the free entries."""
        left = spectrum.left[i, 33:66] @ self.inverse
        return -self.free.slopes(complex(spectrum.values[i]), left, spectrum.right[:33, i])


def spectrum_of(A: Floats) -> Spectrum:
    """Return eigenvalues and eigenvectors."""
    values, right = np.linalg.eig(A)
    return Spectrum(values, right, np.linalg.inv(right))
