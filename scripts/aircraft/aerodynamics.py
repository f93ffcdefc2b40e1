"""Strip theory: quasi-steady forces on modes and control surfaces, with one lag for each group of strips.

A strip's lift is q̄ c Δy cLα (α_i + τ δ), at a quarter of the chord, with the angle of attack at three quarters of
the chord, α = θ − (ż_¾)/V. A share of the lift follows α late: L = q̄ S cLα ((1 − a) α + a x), ẋ = −λ V (x − α),
the one-lag form of Wagner's function (Bisplinghoff, Ashley, Halfman, Aeroelasticity, 5.7). The strips of a group share
one x, which follows their mean α.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from scripts.aircraft.structure import TAIL_TIP, Structure, chord, tail_chord
from workbench.core.values.arrays import Floats

LATE = 0.4  # share of the lift that comes late
SLOPE = 5.6  # dcL/dα of a strip [1/rad]
SURFACES = ("elevator", "inner_aileron", "outer_aileron")


@dataclass(frozen=True, slots=True)
class Surface:
    """A control surface.

    Attributes:
        span: from, to [m].
        inertia: about the hinge [kg·m²].
        unbalance: static moment about the hinge [kg·m].
        share: of the chord, behind the hinge.
    """

    span: tuple[float, float]
    inertia: float
    unbalance: float
    share: float


TABLE = {
    "elevator": Surface((1.0, 9.3), 150.0, 40.0, 0.30),
    "inner_aileron": Surface((17.0, 22.0), 95.0, 35.0, 0.25),
    "outer_aileron": Surface((22.0, 28.5), 65.0, 25.0, 0.25),
}


@dataclass(frozen=True, slots=True)
class Strip:
    """What a strip sees: rows over the 33 coordinates."""

    quarter: Floats  # z of the quarter-chord point
    three_quarter: Floats
    twist: Floats
    chord: float
    width: float
    group: int
    surface: int | None
    hinge: Floats  # z of the hinge line


@dataclass(frozen=True, slots=True)
class Aerodynamics:
    """Forces on the right-hand side are q̄ (−A0 q − A1 q̇/V + L x), ẋ = −λ V (x − E0 q − E1 q̇/V)."""

    A0: Floats
    A1: Floats
    L: Floats
    E0: Floats
    E1: Floats
    lag: Floats
    coupling: Floats  # (30, 3) mass coupling of modes and surfaces


def strips(structure: Structure) -> list[Strip]:
    """Return the strips of wing and tailplane."""
    edges = [2.8, 5.0, 8.0, 11.0, 14.0, 17.0, 19.5, 22.0, 23.6, 25.2, 26.8, 28.5, 30.0]
    found = [_strip(structure, a, b, wing=True) for a, b in pairwise(edges)]
    edges = [0.0, 1.0, 3.0, 5.0, 7.0, 9.3]
    found += [_strip(structure, a, b, wing=False) for a, b in pairwise(edges)]
    return found


def _strip(structure: Structure, low: float, high: float, *, wing: bool) -> Strip:
    y = (low + high) / 2.0
    nodes = structure.wing if wing else structure.tail
    span = np.array([structure.frame.nodes[n][1] for n in nodes])
    z = np.array([np.interp(y, span, structure.shapes[[6 * n + 2 for n in nodes], k]) for k in range(30)])
    # streamwise twist: the rotation about y
    twist = np.array([np.interp(y, span, structure.shapes[[6 * n + 4 for n in nodes], k]) for k in range(30)])
    c = chord(y) if wing else tail_chord(min(y, TAIL_TIP))
    z, twist = np.r_[z, np.zeros(3)], np.r_[twist, np.zeros(3)]
    names = SURFACES[1:] if wing else SURFACES[:1]
    surface = next((SURFACES.index(n) for n in names if TABLE[n].span[0] <= y <= TABLE[n].span[1]), None)
    group = (0 if y < 11 else 1 if y < 19.5 else 2 if y < 25.2 else 3) if wing else 4
    axis = 0.40  # elastic axis, share of the chord
    hinge = 1.0 - (TABLE[SURFACES[surface]].share if surface is not None else 0.25)

    return Strip(
        z + (axis - 0.25) * c * twist,
        z - (0.75 - axis) * c * twist,
        twist,
        c,
        high - low,
        group,
        surface,
        z - (hinge - axis) * c * twist,
    )


def prior(structure: Structure) -> Aerodynamics:
    """Return strip theory's matrices on the 33 coordinates."""
    A0, A1 = np.zeros((33, 33)), np.zeros((33, 33))
    L, E0, E1 = np.zeros((33, 5)), np.zeros((5, 33)), np.zeros((5, 33))
    area = np.zeros(5)
    coupling = np.zeros((33, 3))
    width = np.zeros(3)
    for strip in strips(structure):
        _lift(strip, A0, A1, L)
        E0[strip.group] += strip.chord * strip.width * strip.twist
        E1[strip.group] -= strip.chord * strip.width * strip.three_quarter
        area[strip.group] += strip.chord * strip.width
        if strip.surface is not None:
            _hinge(strip, A0, A1)
            s = TABLE[SURFACES[strip.surface]]
            coupling[:, strip.surface] += strip.width * (s.inertia * strip.twist - s.unbalance * strip.hinge)
            width[strip.surface] += strip.width
    _drag(A0, A1)
    E0, E1 = E0 / area[:, None], E1 / area[:, None]
    lag = np.array([0.055, 0.075, 0.10, 0.13, 0.11])
    return Aerodynamics(A0, A1, L, E0, E1, lag, (coupling / width)[:30])


def _lift(strip: Strip, A0: Floats, A1: Floats, L: Floats) -> None:
    force = strip.quarter * strip.chord * strip.width * SLOPE  # generalised force for α = 1, over q̄
    A0 -= (1.0 - LATE) * np.outer(force, strip.twist)
    A1 += (1.0 - LATE) * np.outer(force, strip.three_quarter)
    L[:, strip.group] += LATE * force
    if strip.surface is not None:
        column = 30 + strip.surface
        A0[:, column] -= 0.45 * force  # effectiveness of the flap
        A0[:, column] += 0.55 * strip.twist * strip.chord**2 * strip.width  # nose down
        A1[:, column] += -0.15 * force * strip.chord * 0.25


def _hinge(strip: Strip, A0: Floats, A1: Floats) -> None:
    row = 30 + (strip.surface or 0)
    c = TABLE[SURFACES[strip.surface or 0]].share * strip.chord
    factor = c**2 * strip.width
    A0[row] += factor * 0.25 * strip.twist
    A1[row] += -factor * 0.25 * strip.three_quarter
    A0[row, row] += factor * 0.5
    A1[row, row] += factor * c * 1.1


_RETURNS = ((0, 0.05, 1.0), (1, 0.08, 1.5))  # coordinate, frequency [Hz] and damping ratio of its slow return
_PRESSURE, _SPEED = 0.5 * 0.41 * 250.0**2, 250.0


def _drag(A0: Floats, A1: Floats) -> None:
    """Forces that hold the eliminated phugoid's place: speed and height return slowly (mass-normalised)."""
    for row, hertz, _ in _RETURNS:
        A0[row, row] += (2.0 * np.pi * hertz) ** 2 / _PRESSURE
    A1 += returning()


def returning() -> Floats:
    """Return the share of A1 by which speed and height return slowly; it is not the air's, shape (33, 33)."""
    A1 = np.zeros((33, 33))
    for row, hertz, damping in _RETURNS:
        A1[row, row] = 2.0 * damping * 2.0 * np.pi * hertz * _SPEED / _PRESSURE
    return A1
