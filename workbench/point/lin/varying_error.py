"""How far an interpolated linear model is from the one found at the same point."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear
from workbench.core.values.matrices import held, resolvent

__all__ = ["SLOW", "ReferenceModel", "VaryingErrors"]

SLOW = 1e-4  # of the fastest pole: slower ones are compared with that, as a double pole at 0 is known to 1e-8 only
_SMALL = 1e-3  # of a channel's largest gain: what is below is compared with that
_ROUNDING = 1e-9  # of what cancels in a channel: what is below is no response
_PER_BAND, _DOUBLINGS = 60, 8  # frequencies over the band; a step response has 2⁸ instants
_BESIDE = (0.95, 1.0, 1.05)  # of the frequency of each oscillation: where its peak is, and its flanks


@dataclass(frozen=True)
class VaryingErrors(RecordPart):
    """Relative errors of a parameter-varying model.

    Attributes:
        poles: of a pole, relative to its distance from 0 (at least 1e-4 of that of the fastest).
        response: of a frequency response, relative to its gain (at least 1e-3 of the channel's largest gain).
        step: of a step response, relative to its largest value.
        equilibrium: of a state, input or output at the operating point, relative to its range over the box (at least
            1e-6 of its size there, and of its motion in a unit step of an input).
    """

    poles: float
    response: float
    step: float
    equilibrium: float

    @property
    def largest(self) -> float:
        """The largest of them."""
        return max(self.values)

    @property
    def values(self) -> tuple[float, ...]:
        """All, in their order."""
        return tuple(getattr(self, f.name) for f in fields(self))


class ReferenceModel:
    """A linear model that was found at a point, which interpolated ones are compared with.

    Args:
        linear: the model, continuous.
        rest: its states, inputs and outputs at the operating point, shape (k,).
    """

    def __init__(self, linear: Linear, rest: Floats) -> None:
        self.linear, self.rest = linear, rest

    def errors(self, other: Linear, rest: Floats, scale: Floats) -> VaryingErrors:
        """Return the errors of an interpolated model.

        Args:
            other: the interpolated model.
            rest: its operating point, shape (k,).
            scale: what its errors are compared with, shape (k,).
        """
        apart = np.abs(rest - self.rest)
        moved = float(np.max(np.divide(apart, scale, out=np.zeros_like(apart), where=scale > 0.0), initial=0.0))
        return VaryingErrors(self._poles(other), self._response(other), self._step(other), moved)

    @cached_property
    def motion(self) -> Floats:
        """Largest motions of states, inputs and outputs in unit steps of the inputs, shape (k,)."""
        states, outputs, _ = _steps(self.linear, self._horizon)
        each = [np.abs(table).max(axis=(0, 2), initial=0.0) for table in (states, outputs)]
        return np.concatenate([each[0], np.ones(self.linear.B.shape[1]), each[1]])

    def _poles(self, other: Linear) -> float:
        from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - slow to import

        size = np.abs(self.linear.poles)
        apart = np.abs(self.linear.poles[:, None] - other.poles)
        rows, columns = linear_sum_assignment(apart)
        least = SLOW * float(np.max(size, initial=0.0))
        return float(np.max(apart[rows, columns] / np.maximum(size[rows], least or 1.0), initial=0.0))

    @cached_property
    def _speeds(self) -> Floats:
        """Distances of the poles from 0, without those at 0, shape (k,) [1/s]."""
        size = np.abs(self.linear.poles)
        return np.asarray(size[size > 1e-9 * max(1e-3, float(np.max(size, initial=0.0)))])

    @cached_property
    def _points(self) -> Complex:
        """Points jω: a band around the poles, and each oscillation, shape (k,) [rad/s]."""
        speeds = self._speeds if len(self._speeds) else np.ones(1)
        band = np.geomspace(0.1 * speeds.min(), 10.0 * speeds.max(), _PER_BAND)
        poles = self.linear.poles
        turning = poles[(poles.imag > 0.0) & (np.abs(poles.real) > 1e-4 * np.abs(poles))].imag
        return np.asarray(1j * np.concatenate([band, np.outer(turning, _BESIDE).ravel()]))

    @cached_property
    def _gains(self) -> tuple[Complex, Floats]:
        """Frequency response and what its errors are compared with, both of shape (k, q, m)."""
        model = self.linear
        states = resolvent(model.A, model.B, self._points)
        found = model.C @ states + model.D
        parts = np.abs(model.C) @ np.abs(states) + np.abs(model.D)
        return found, _least(np.abs(found), parts, _SMALL)

    def _response(self, other: Linear) -> float:
        found, scale = self._gains
        apart = np.abs(other.C @ resolvent(other.A, other.B, self._points) + other.D - found)
        return _largest(apart, scale)

    @cached_property
    def _horizon(self) -> float:
        """How long steps are looked at: until the slowest mode has decayed, or the fastest growth is e⁵ [s]."""
        poles = self.linear.poles[np.isin(np.abs(self.linear.poles), self._speeds)]
        decays = np.maximum(np.abs(poles.real), 0.02 * np.abs(poles))
        growth = float(np.max(poles.real, initial=0.0))
        slowest = 5.0 / float(decays.min()) if len(poles) else 1.0
        return min(slowest, 5.0 / growth) if growth > 0.0 else slowest

    @cached_property
    def _steps(self) -> tuple[Floats, Floats]:
        """Step responses, shape (k, q, m), and what their errors are compared with, shape (1, q, m)."""
        _, found, parts = _steps(self.linear, self._horizon)
        return found, np.maximum(np.abs(found).max(axis=0), _ROUNDING * parts.max(axis=0))[None]

    def _step(self, other: Linear) -> float:
        found, scale = self._steps
        return _largest(np.abs(_steps(other, self._horizon)[1] - found), np.broadcast_to(scale, found.shape))


def _least(size: Floats, parts: Floats, small: float) -> Floats:
    """Return sizes, at least a small part of a channel's largest, and more than what rounding leaves of its parts."""
    least: Floats = np.maximum(size, np.maximum(small * size.max(axis=0), _ROUNDING * parts.max(axis=0)))
    return least


def _largest(apart: Floats, scale: Floats) -> float:
    ratio = np.divide(apart, scale, out=np.zeros_like(apart), where=scale > 0.0)
    return float(np.max(ratio[np.isfinite(ratio)], initial=0.0))


def _steps(model: Linear, horizon: float) -> tuple[Floats, Floats, Floats]:
    """Return step responses: states (k, n, m), outputs, and the sizes of their parts, both (k, q, m)."""
    power, states = held(model.A, model.B, horizon / 2**_DOUBLINGS)
    states = states[None]
    for _ in range(_DOUBLINGS):  # x(k + N) = A^N x(k) + x(N)
        states = np.concatenate([states, power @ states + states[-1]])
        power = power @ power
    parts = np.abs(model.C) @ np.abs(states) + np.abs(model.D)
    return states, np.asarray(model.C @ states + model.D), np.asarray(parts)
