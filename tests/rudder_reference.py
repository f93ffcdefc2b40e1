"""The rudder's equations written a second time: the check on its Modelica source, and the tool for linear facts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import fsolve

Vector = npt.NDArray[np.float64]

STATES = ("p1", "p2", "spool", "current", "piston", "pistonSpeed", "surface", "surfaceSpeed")
NOMINAL: Vector = np.array([1e7, 1e7, 1e-4, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2])
AT_REST: Vector = np.array([1.055e7, 1.055e7, 0, 0, 0, 0, 0, 0])


@dataclass(frozen=True)
class Inputs:
    """The three inputs that are constant in normal operation."""

    supply: float = 2.06e7
    moment: float = 0.0
    bypass: float = 0.0


NORMAL = Inputs()


def limit(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)


def jet(drop: float) -> float:
    """Speed [m/s] of an orifice jet under a pressure drop [Pa], laminar below 1e5 Pa."""
    return math.sqrt(2 / 1000) * drop / math.sqrt(math.hypot(drop, 1e5))


def flows(p1: float, p2: float, spool: float, inputs: Inputs) -> tuple[float, float]:
    """Volume flows [m3/s] into the two chambers."""
    bypass = min(max(inputs.bypass, 0.0), 1.0)
    rounded = math.hypot(spool, 1e-5)
    towards1, towards2 = (rounded + spool) / 2, (rounded - spool) / 2
    out1, out2 = jet(p1 - 5e5), jet(p2 - 5e5)
    valve1 = 0.02 * (towards1 * jet(inputs.supply - p1) - towards2 * out1)
    valve2 = 0.02 * (towards2 * jet(inputs.supply - p2) - towards1 * out2)
    leak = 5e-12 * (p1 - p2)
    mixed1 = (1 - bypass) * valve1 - bypass * 5e-6 * out1
    mixed2 = (1 - bypass) * valve2 - bypass * 5e-6 * out2
    return 0.61 * mixed1 - leak, 0.61 * mixed2 + leak


def derivatives(x: Vector, command_deg: float, inputs: Inputs = NORMAL) -> Vector:
    """Time derivatives of the eight states [SI]."""
    p1, p2, spool, current, piston, speed, surface, rate = (float(v) for v in x)
    flow1, flow2 = flows(p1, p2, spool, inputs)
    error = math.radians(limit(command_deg, 25)) - piston / 0.15
    link = 8e7 * (piston - 0.15 * surface) + 1.2e5 * (speed - 0.15 * rate)
    friction = 150 * math.tanh(speed / 0.01) + 2e3 * speed
    stop = 1e8 * (max(piston - 0.07, 0) + min(piston + 0.07, 0))
    return np.array(
        [
            8e8 * (flow1 - 4e-3 * speed) / (7e-5 + 4e-3 * (0.07 + piston)),
            8e8 * (flow2 + 4e-3 * speed) / (7e-5 + 4e-3 * (0.07 - piston)),
            limit((limit(0.01 * current, 3.6e-4) - spool) / 0.007, 0.013),
            (0.04 * math.tanh(0.512 * error / 0.04) - current) / 0.017,
            speed,
            (4e-3 * (p1 - p2) - friction - stop - link) / 6,
            rate,
            (0.15 * link - 3000 * surface - 300 * rate + inputs.moment) / 36,
        ]
    )


def trim(command_deg: float, inputs: Inputs = NORMAL) -> Vector:
    """Equilibrium of all eight states under a constant command."""
    guess = AT_REST.copy()
    guess[6] = math.radians(command_deg)
    guess[4] = 0.15 * guess[6]

    def residual(scaled: Vector) -> Vector:
        return derivatives(scaled * NOMINAL, command_deg, inputs) / NOMINAL

    found: Vector = fsolve(residual, guess / NOMINAL, xtol=1e-13) * NOMINAL
    return found


def linearise(x: Vector, command_deg: float) -> tuple[Vector, Vector]:
    """A (8, 8) and B (8,) in units of NOMINAL, by narrow central differences."""
    columns = []
    for k, size in enumerate(NOMINAL):
        step = np.zeros(8)
        step[k] = 1e-5 * size
        change = derivatives(x + step, command_deg) - derivatives(x - step, command_deg)
        columns.append(change / 2e-5 / NOMINAL)
    column = (derivatives(x, command_deg + 1e-4) - derivatives(x, command_deg - 1e-4)) / 2e-4 / NOMINAL
    return np.column_stack(columns), column


def response(a: Vector, b: Vector, frequency: float) -> complex:
    """Transfer from command [deg] to surface [deg] at a frequency [Hz]."""
    solved = np.linalg.solve(2j * math.pi * frequency * np.eye(8) - a, b)
    return complex(math.degrees(1) * NOMINAL[6] * solved[6])
