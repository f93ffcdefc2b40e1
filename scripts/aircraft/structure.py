"""The half aircraft as a space frame, and its symmetric modes.

A four-engined transport of about 180 t and 60 m span, drawn from the usual magnitudes of its class; no particular
type. Symmetric motion: nodes in the plane of symmetry move in x and z and turn about y only.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from scripts.aircraft.frame import Frame, Section
from workbench.core.values.arrays import Floats

SWEEP = np.tan(np.radians(30.0))
TIP = 30.0  # half span [m]
ROOT = 2.8  # half width of the fuselage [m]
WING_X = 25.0  # elastic axis at the root [m]
TAIL_X, TAIL_TIP = 57.0, 9.5
N_ELASTIC = 27


@dataclass(frozen=True, slots=True)
class Structure:
    """The frame with its modes.

    Attributes:
        frame: nodes and elements.
        fuselage: node numbers, nose to tail.
        wing: node numbers, root to tip.
        tail: node numbers, root to tip.
        engines: node numbers, inner and outer.
        centre: x of the centre of gravity [m].
        hertz: frequencies of the modes [Hz], shape (30,); three rigid ones (surge, heave, pitch) first.
        shapes: mass-normalised, shape (6 nodes, 30) [1/√kg].
    """

    frame: Frame
    fuselage: list[int]
    wing: list[int]
    tail: list[int]
    engines: list[int]
    centre: float
    hertz: Floats
    shapes: Floats


def chord(y: float) -> float:
    """Return the wing's chord [m] at the span coordinate y [m]."""
    return 10.0 + (2.6 - 10.0) * (y - ROOT) / (TIP - ROOT)


def tail_chord(y: float) -> float:
    """Return the tailplane's chord [m] at the span coordinate y [m]."""
    return 5.5 + (2.2 - 5.5) * y / TAIL_TIP


def build() -> Structure:
    """Assemble the frame and solve for its symmetric modes."""
    frame = Frame()
    fuselage = _fuselage(frame)
    wing = _wing(frame, fuselage[6])
    tail = _tail(frame, fuselage[-2])
    engines = [_engine(frame, wing[3], 2.6, 1.5), _engine(frame, wing[8], 2.4, 1.2)]
    mass, stiffness = frame.matrices()
    free = np.ones(len(mass), dtype=bool)
    for node in fuselage:
        free[[6 * node + 1, 6 * node + 3, 6 * node + 5]] = False
    values, vectors = eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)])
    shapes = np.zeros((len(mass), 3 + N_ELASTIC))
    rigid, centre = _rigid(frame, mass, free)
    shapes[:, :3] = rigid
    elastic = vectors[:, 3 : 3 + N_ELASTIC]
    largest = elastic[np.argmax(abs(elastic), axis=0), range(N_ELASTIC)]
    shapes[free, 3:] = elastic * np.sign(largest)
    hertz = np.r_[np.zeros(3), np.sqrt(values[3 : 3 + N_ELASTIC]) / (2.0 * np.pi)]
    return Structure(frame, fuselage, wing, tail, engines, centre, hertz, shapes)


def _rigid(frame: Frame, mass: Floats, free: NDArray[np.bool_]) -> tuple[Floats, float]:
    """Return surge, heave and pitch about the centre of gravity, mass-normalised, and the centre's x."""
    places = np.array(frame.nodes)
    surge, heave, turn = (np.zeros(len(mass)) for _ in range(3))
    surge[0::6], heave[2::6] = 1.0, 1.0
    total = heave @ mass @ heave
    turn[0::6], turn[2::6], turn[4::6] = places[:, 2], -places[:, 0], 1.0
    centre = -float(heave @ mass @ turn / total)
    height = float(surge @ mass @ turn / total)
    turn += centre * heave - height * surge
    modes = np.column_stack([surge, heave, turn])
    modes[~free] = 0.0
    return modes / np.sqrt(np.einsum("ni,nm,mi->i", modes, mass, modes)), centre


def _fuselage(frame: Frame) -> list[int]:
    x = np.array([0.0, 4.0, 9.0, 14.0, 19.0, 22.0, WING_X, 28.0, 33.0, 38.0, 43.0, 48.0, 53.0, TAIL_X, 61.0])
    nodes = [frame.node(value, 0.0, 0.0) for value in x]
    for first, second in pairwise(nodes):
        middle = (frame.nodes[first][0] + frame.nodes[second][0]) / 2.0
        slim = min(1.0, 0.25 + middle / 12.0, 0.2 + (62.0 - middle) / 18.0)
        frame.beam(first, second, Section(680.0 * slim, 2500.0 * slim, 4e9 * slim, 5e9, 1.3e10 * slim**2, 9e9))
    return nodes


def _wing(frame: Frame, root: int) -> list[int]:
    stations = np.r_[ROOT, np.linspace(ROOT, TIP, 15)[1:]]
    nodes = [frame.node(WING_X, stations[0], -0.5)]
    _stiff(frame, root, nodes[0])
    for y in stations[1:]:
        nodes.append(frame.node(WING_X + SWEEP * (y - ROOT), y, -0.5 + 0.09 * (y - ROOT)))
        middle = float(frame.nodes[nodes[-2]][1] + y) / 2.0
        frame.beam(nodes[-2], nodes[-1], _wing_section(middle))
    return nodes


def _wing_section(y: float) -> Section:
    c = chord(y) / chord(ROOT)
    soft = 1.0 - 0.70 / (1.0 + np.exp(-(y - 20.0) / 1.5))  # a soft outer wing
    mass = 1900.0 * c**1.5 if y < 22.0 else 800.0 * c**1.5  # fuel inboard
    flap = 1.6e9 * c**3.2 * soft
    return Section(mass, mass * (0.25 * chord(y)) ** 2, 6e9 * c**2, 3.4e9 * c**3.2 * soft, flap, 20.0 * flap)


def _tail(frame: Frame, root: int) -> list[int]:
    nodes = [frame.node(TAIL_X, 1.0, 1.0)]
    _stiff(frame, root, nodes[0])
    for y in (3.1, 5.2, 7.3, TAIL_TIP):
        nodes.append(frame.node(TAIL_X + SWEEP * (y - 1.0), y, 1.0 + 0.1 * (y - 1.0)))
        c = tail_chord(y - 1.0) / 5.5
        mass = 260.0 * c**1.5
        polar = mass * (0.25 * tail_chord(y)) ** 2
        section = Section(mass, polar, 2e9, 2.5e8 * c**3, 2.6e8 * c**3, 2e9 * c**3)
        frame.beam(nodes[-2], nodes[-1], section)
    return nodes


def _engine(frame: Frame, wing: int, ahead: float, below: float) -> int:
    place = frame.nodes[wing]
    node = frame.node(place[0] - ahead, place[1], place[2] - below)
    frame.lump(node, 5200.0, (1500.0, 4500.0, 4500.0))
    frame.beam(wing, node, Section(10.0, 5.0, 2e9, 1.6e8, 2.4e8, 6e6 * ahead))
    return node


def _stiff(frame: Frame, first: int, second: int) -> None:
    frame.beam(first, second, Section(1.0, 1.0, 5e10, 5e10, 5e10, 5e10))


def points(structure: Structure) -> Floats:
    """Return the displacements of the eleven measured points by the modes, shape (11, 30)."""
    shapes, wing, engines = structure.shapes, structure.wing, structure.engines
    x = [structure.frame.nodes[n][0] for n in structure.fuselage]

    def at_centre(direction: int) -> Floats:
        rows = shapes[[6 * n + direction for n in structure.fuselage]]
        return np.array([np.interp(structure.centre, x, column) for column in rows.T])

    return np.array(
        [
            shapes[6 * structure.fuselage[1] + 2],
            *(at_centre(direction) for direction in (0, 2, 4)),
            shapes[6 * structure.fuselage[-2] + 2],
            *(shapes[6 * wing[-1] + direction] for direction in (0, 2)),
            *(shapes[6 * engine + direction] for engine in engines for direction in (1, 2)),
        ]
    )
