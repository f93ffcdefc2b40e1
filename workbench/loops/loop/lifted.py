"""A sampled loop over its basic period: the signal at the opened connection by its values at every instant of it.

With several rates the signal z passed on may act more than once in a basic period T. Its values there are one vector,
those of the signal y that returns another, and with both L is a matrix over z-transforms with period T (B. Friedland,
Sampled-data control systems containing periodically varying members, 1960; "lifting"). Instants at which z does
nothing, and those between which y stands still, are put together: where one is left, L is a transfer function as that
of a single rate, and exact.

Where several are left, a factor f on the signal, real or complex, multiplies the matrix, and the closed loop has the
poles of A − f B (I + f D)⁻¹ C. Margins are those of that factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear, LinearPart
from workbench.core.values.margins import GainCrossover, Margins, PhaseCrossover, disk_of
from workbench.core.values.matrices import resolvent
from workbench.loops.loop.stability import ClosedLoopStability
from workbench.point.lin.kalman_bertram import period_map
from workbench.point.lin.period_slopes import slopes_of
from workbench.point.lin.result import LinResult
from workbench.point.lin.task import LinTask

__all__ = ["Lifted", "lifted", "margins_of_lifted"]

_SAME = 1e-7  # relative to the largest: differences of runs are exact to that
_MOST = 64  # instants; each costs two runs over the basic period
_FACTORS = np.geomspace(1.0, 1e4, 401)  # between neighbours the loop is taken to become unstable once at most
_ANGLES = np.linspace(0.0, np.pi, 361)
_ROUND = np.linspace(0.0, np.pi, 721)  # of the unit circle, beside the poles


class Lifted(Linear):
    """L over a basic period; its inputs and outputs are the values at N instants of it."""

    @property
    def single(self) -> LinearPart | None:
        """L as a transfer function; None: the signal acts several times in a period."""
        return self.part() if self.D.size == 1 else None

    def closed(self, factor: complex = 1.0) -> Complex:
        """Return the poles of the closed loop with a factor on the signal, shape (n,).

        Raises:
            numpy.linalg.LinAlgError: the loop has no solution.
        """
        back = np.linalg.solve(np.eye(len(self.D)) + factor * self.D, self.C)
        return np.linalg.eigvals(self.A - factor * self.B @ back).astype(np.complex128)

    def values(self, angle: Floats) -> Complex:
        """Return the eigenvalues of L on the unit circle, shape (k, N); NaN on a pole.

        Args:
            angle: shape (k,) [rad].
        """
        at = np.exp(1j * angle)
        result = self.C @ resolvent(self.A, self.B, at) + self.D
        good = np.isfinite(result).all(axis=(1, 2))
        each = np.full(result.shape[:2], np.nan, dtype=np.complex128)
        each[good] = np.linalg.eigvals(result[good])
        return each


def lifted(task: LinTask, result: LinResult) -> Lifted | None:
    """Return L of a system opened by `cut`, from the signal passed on to the one returned.

    None: the signal acts between the instants too, or at too many of them.

    Args:
        task: of the opened system, which stays open: one input, one output.
        result: its linear model by Kalman and Bertram's method.
    """
    setting, inner = period_map(task)[0], result.intersample
    instants = setting.instants
    if inner is None or len(instants) > _MOST:
        return None
    at = [int(np.abs(inner.tau - t).argmin()) for t in instants]
    if not (inner.sampled or _stands(inner.C[:, :, 0], inner.D[:, :, 0], at)):
        return None
    slopes_of(setting)  # for its widths
    keep = [setting.names.index(name) for name in result.state_names]
    pulses = [setting.pulse(k) for k in range(len(instants))]
    B = np.column_stack([x[keep] for x, _ in pulses])
    D = np.column_stack([y[at, 0, 0] for _, y in pulses])
    return _shortest(Lifted(result.A, B, -inner.C[at, 0, 0], -D, dt=result.dt))


def _stands(C: Floats, D: Floats, at: Sequence[int]) -> bool:
    """Whether the signal returned stands still between the instants, shapes (k, 2, n) and (k, 2, m)."""
    both = np.concatenate([C, D], axis=2)
    size = _SAME * np.abs(both).max(initial=0.0)
    ends = np.array([k for k in range(1, len(both)) if k not in at], dtype=int)
    moves = [both[:, 0] - both[:, 1], both[ends, 0] - both[ends - 1, 1]]
    return all(np.abs(m).max(initial=0.0) <= size for m in moves)


def _shortest(whole: Lifted) -> Lifted:
    """Return L without instants at which the signal does nothing, and with those together at which it is the same."""
    columns = np.vstack([whole.B, whole.D])
    acts = np.abs(columns).max(axis=0) > _SAME * np.abs(columns).max(initial=0.0)
    kept = np.flatnonzero(acts) if acts.any() else np.array([0])
    rows = np.hstack([whole.C, whole.D[:, kept]])[kept]
    size = _SAME * np.abs(rows).max(initial=0.0)
    group = np.array(
        [next(i for i in range(k + 1) if np.abs(rows[i] - rows[k]).max() <= size) for k in range(len(kept))]
    )
    first = sorted(set(group.tolist()))
    sums = np.array([group == i for i in first], dtype=np.float64).T
    chosen = kept[first]
    B, D = whole.B[:, kept] @ sums, whole.D[np.ix_(chosen, kept)] @ sums
    return Lifted(whole.A, B, whole.C[chosen], D, dt=whole.dt)


# -- margins of a factor on the signal ---------------------------------------------------------------------------------


def margins_of_lifted(loop: Lifted, stability: ClosedLoopStability) -> Margins:
    """Return the margins of a factor on a signal that acts several times in a basic period.

    The gain margin is the real factor that brings a pole of the closed loop to the unit circle, the phase margin the
    angle φ of exp(−jφ) that does. Disk margin and the largest |S| and |T| are those over the eigenvalues λ of L on the
    unit circle: (1 − λ)/(1 + λ), 1/(1 + λ), λ/(1 + λ), which for a factor that is the same at all instants are exact.
    There is no delay margin: a delay is no factor. Frequencies are known up to multiples of 1/T only; the lowest is
    given.

    Args:
        loop: L.
        stability: of the closed loop.
    """
    up, down = _first(loop, _FACTORS, lambda k: k), _first(loop, 1.0 / _FACTORS, lambda k: k)
    turn = _first(loop, _ANGLES, lambda phi: complex(math.cos(phi), -math.sin(phi)))
    angle = np.unique(np.concatenate([_ROUND, np.abs(np.angle(stability.poles)), np.abs(np.angle(loop.closed(0.0)))]))
    sensitivity = _largest(loop, angle, lambda v: 1.0 / np.abs(1.0 + v))
    complementary = _largest(loop, angle, lambda v: np.abs(v / (1.0 + v)))
    return Margins(
        verdict=stability.verdict,
        words=stability.words,
        phase_crossovers=tuple(PhaseCrossover(f, k) for k, f in (down, up) if math.isfinite(k)),
        gain_crossovers=tuple(
            GainCrossover(f, math.degrees(phi), math.nan) for phi, f in (turn,) if math.isfinite(phi)
        ),
        disk=disk_of(*_largest(loop, angle, lambda v: np.abs((1.0 - v) / (1.0 + v)))) if stability.stable else None,
        peak_sensitivity=sensitivity[0],
        peak_sensitivity_hz=sensitivity[1],
        peak_complementary=complementary[0],
        peak_complementary_hz=complementary[1],
    )


def _first(loop: Lifted, values: Floats, factor: Callable[[float], complex]) -> tuple[float, float]:
    """Return the first of rising or falling values at which the closed loop changes its stability, and where [Hz]."""

    def outside(value: float) -> float:
        try:
            return float(np.abs(loop.closed(factor(value))).max(initial=0.0)) - 1.0
        except np.linalg.LinAlgError:  # no solution: a pole at infinity
            return math.inf

    before, begin = float(values[0]), outside(float(values[0]))
    for value in values[1:].tolist():
        if (outside(value) < 0.0) != (begin < 0.0):
            result = float(brentq(outside, before, value, xtol=1e-14, rtol=1e-13))
            poles = loop.closed(factor(result))
            return result, abs(float(np.angle(poles[np.abs(poles).argmax()]))) / (2.0 * math.pi * loop.dt)
        before = value
    return math.nan, math.nan


def _largest(loop: Lifted, angle: Floats, size: Callable[[Complex], Floats]) -> tuple[float, float]:
    """Return the largest size over the eigenvalues on the unit circle, and where it is [Hz]."""

    def at(angles: Floats) -> Floats:
        with np.errstate(all="ignore"):
            result = size(loop.values(angles)).max(axis=1)
        return np.where(np.isnan(result), -np.inf, result)

    sizes = at(angle)
    k = int(np.argmax(sizes))
    low, high = float(angle[max(k - 1, 0)]), float(angle[min(k + 1, len(angle) - 1)])
    better = minimize_scalar(
        lambda a: -at(np.array([a]))[0], bounds=(low, high), method="bounded", options={"xatol": 1e-10}
    )
    value, where = max((float(sizes[k]), float(angle[k])), (-float(better.fun), float(better.x)))
    return value, where / (2.0 * math.pi * loop.dt)
