"""Space frames: consistent matrices of straight beam elements.

Przemieniecki, Theory of Matrix Structural Analysis, ch. 5 and 11.

Axes everywhere: x aft, y outboard, z up; a rotation about y is positive nose up. Six degrees of freedom a node.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workbench.core.values.arrays import Floats


@dataclass(frozen=True, slots=True)
class Section:
    """A beam's cross section.

    Attributes:
        mass: per length [kg/m].
        polar: mass moment of inertia about the axis per length [kg·m].
        axial: EA [N].
        torsion: GJ [N·m²].
        flap: EI of bending up and down [N·m²].
        lag: EI of bending in the plane [N·m²].
    """

    mass: float
    polar: float
    axial: float
    torsion: float
    flap: float
    lag: float


@dataclass(slots=True)
class Frame:
    """Nodes, and matrices assembled so far."""

    nodes: list[Floats] = field(default_factory=list)
    elements: list[tuple[int, int, Section]] = field(default_factory=list)
    lumps: list[tuple[int, float, Floats]] = field(default_factory=list)

    def node(self, x: float, y: float, z: float) -> int:
        """Add a node [m] and return its number."""
        self.nodes.append(np.array([x, y, z]))
        return len(self.nodes) - 1

    def beam(self, first: int, second: int, section: Section) -> None:
        """Connect two nodes."""
        self.elements.append((first, second, section))

    def lump(self, node: int, mass: float, inertia: tuple[float, float, float]) -> None:
        """Put a mass [kg] with moments of inertia [kg·m²] on a node."""
        self.lumps.append((node, mass, np.array(inertia)))

    def matrices(self) -> tuple[Floats, Floats]:
        """Return mass and stiffness, each (6 n, 6 n)."""
        size = 6 * len(self.nodes)
        mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
        for first, second, section in self.elements:
            where = np.r_[6 * first : 6 * first + 6, 6 * second : 6 * second + 6]
            turn, length = _axes(self.nodes[first], self.nodes[second])
            mass[np.ix_(where, where)] += turn.T @ _mass(section, length) @ turn
            stiffness[np.ix_(where, where)] += turn.T @ _stiffness(section, length) @ turn
        for node, value, inertia in self.lumps:
            where = np.arange(6 * node, 6 * node + 6)
            mass[where, where] += np.r_[[value] * 3, inertia]
        return mass, stiffness


def _axes(first: Floats, second: Floats) -> tuple[Floats, float]:
    """Return the rotation into the element's axes (12, 12) and its length; local z is as near to up as can be."""
    along = second - first
    length = float(np.linalg.norm(along))
    along = along / length
    up = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    side = np.cross(up, along)
    side /= np.linalg.norm(side)
    turn = np.vstack([along, side, np.cross(along, side)])
    return np.kron(np.eye(4), turn), length


def _bending(
    block: Floats, rows: list[int], sign: float, terms: tuple[float, float, float, float, float, float]
) -> None:
    """Put the 4 × 4 matrix of a beam in bending into `block`; `sign` is −1 where the slope is minus the rotation."""
    a, b, c, d, e, f = terms
    slope = np.diag([1.0, sign, 1.0, sign])
    matrix = np.array([[a, b, c, -d], [b, e, d, f], [c, d, a, -b], [-d, f, -b, e]])
    block[np.ix_(rows, rows)] += slope @ matrix @ slope


def _stiffness(section: Section, length: float) -> Floats:
    k = np.zeros((12, 12))
    for row, value in ((0, section.axial / length), (3, section.torsion / length)):
        k[np.ix_([row, row + 6], [row, row + 6])] += value * np.array([[1.0, -1.0], [-1.0, 1.0]])
    for rows, sign, ei in (([1, 5, 7, 11], 1.0, section.lag), ([2, 4, 8, 10], -1.0, section.flap)):
        factor = ei / length**3
        terms = (12.0, 6.0 * length, -12.0, -6.0 * length, 4.0 * length**2, 2.0 * length**2)
        _bending(k, rows, sign, tuple(factor * t for t in terms))  # type: ignore[arg-type]
    return k


def _mass(section: Section, length: float) -> Floats:
    m = np.zeros((12, 12))
    for row, value in ((0, section.mass * length), (3, section.polar * length)):
        m[np.ix_([row, row + 6], [row, row + 6])] += value / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    factor = section.mass * length / 420.0
    terms = (156.0, 22.0 * length, 54.0, 13.0 * length, 4.0 * length**2, -3.0 * length**2)
    for rows, sign in (([1, 5, 7, 11], 1.0), ([2, 4, 8, 10], -1.0)):
        _bending(m, rows, sign, tuple(factor * t for t in terms))  # type: ignore[arg-type]
    return m
