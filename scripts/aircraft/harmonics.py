"""Harmonic balance of the damper's limit cycle with harmonics 1, 3, 5 and 7, and its slopes.

y(t) = Re Σ Yₙ exp(jnωt) is the aileron's rate; Yₙ = −H(njω) Fₙ(Y) with the damper's moment α₂ y |y|. Eight real
unknowns: Y₁ (real), Y₃, Y₅, Y₇, ω.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scripts.aircraft.problem import OUTER
from scripts.aircraft.response import Response
from workbench.core.values.arrays import Complex, Floats

ALPHA2 = 7000.0
ORDERS = np.array([1, 3, 5, 7])
SAMPLES = 256
_ANGLE = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
_SYNTHESIS = np.exp(1j * np.outer(_ANGLE, ORDERS))
_ANALYSIS = np.exp(-1j * np.outer(ORDERS, _ANGLE)) * 2.0 / SAMPLES
_SCALE = 100.0  # of ω among the unknowns
_START = np.array([0.22, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0 * np.pi * 2.64 / _SCALE])


@dataclass(frozen=True, slots=True)
class Cycle:
    """Logarithms of peak rate [rad/s] and peak position [deg], frequency [Hz]; their slopes (3, n)."""

    figures: Floats
    slopes: Floats
    fundamental: float


def limit_cycle(response: Response) -> Cycle | None:
    """Return the cycle near 2.64 Hz, None where Newton's method does not find it."""
    v = _START.copy()
    for _ in range(30):
        values = _transfer(response, v[7])
        residual, jacobian = _residual(v, values), _jacobian(response, v, values)
        step = -np.linalg.solve(jacobian, residual)
        bound = min(1.0, 0.1 * v[0] / max(abs(step[:7]).max(), 1e-12), 0.01 * v[7] / max(abs(step[7]), 1e-12))
        v = v + bound * step
        if abs(step).max() < 1e-10:
            return Cycle(_figures(v), _slopes(response, v, jacobian), float(v[0]))
    return None


def _harmonics(v: Floats) -> Complex:
    return np.array([v[0], v[1] + 1j * v[2], v[3] + 1j * v[4], v[5] + 1j * v[6]])


def _transfer(response: Response, scaled: float) -> Complex:
    found = []
    for order in ORDERS:
        s, receptance = response.receptance(order * scaled * _SCALE / (2.0 * np.pi))
        found.append(s * receptance[OUTER, OUTER])
    return np.array(found)


def _moments(v: Floats) -> Complex:
    rate = (_SYNTHESIS @ _harmonics(v)).real
    moments = _ANALYSIS @ (ALPHA2 * rate * abs(rate))
    return np.asarray(moments, dtype=complex)


def _residual(v: Floats, transfer: Complex) -> Floats:
    rest = _harmonics(v) + transfer * _moments(v)
    return np.column_stack([rest.real, rest.imag]).ravel()


def _jacobian(response: Response, v: Floats, transfer: Complex) -> Floats:
    base, width = _residual(v, transfer), 1e-7
    columns = [(_residual(v + width * unit, transfer) - base) / width for unit in np.eye(8)[:7]]
    width = 1e-6
    columns.append((_residual(v, _transfer(response, v[7] + width)) - base) / width)
    return np.column_stack(columns)


def _figures(v: Floats) -> Floats:
    omega = v[7] * _SCALE
    rate = (_SYNTHESIS @ _harmonics(v)).real
    position = (_SYNTHESIS @ (_harmonics(v) / (1j * ORDERS * omega))).real
    return np.array([np.log(rate.max()), np.log(np.degrees(position.max())), omega / (2.0 * np.pi)])


def _slopes(response: Response, v: Floats, jacobian: Floats) -> Floats:
    unit = np.eye(33)[OUTER].astype(complex)
    rows = []
    for order, moment in zip(ORDERS, _moments(v), strict=True):
        s, receptance = response.receptance(order * v[7] * _SCALE / (2.0 * np.pi))
        slope = s * response.slope(s, receptance, unit, OUTER) * moment
        rows += [slope.real, slope.imag]
    moved = -np.linalg.solve(jacobian, np.array(rows))
    width = 1e-6
    by_unknown = np.column_stack([(_figures(v + width * unit) - _figures(v)) / width for unit in np.eye(8)])
    return by_unknown @ moved
