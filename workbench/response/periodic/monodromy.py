"""The derivative of a period map from the linearised model along one period."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.matrices import exponentials
from workbench.kernel.native_slopes import NativeSlopes

__all__ = ["Factors", "VariationalEquation", "instants", "tangent"]

# Abscissae of Gauss's rule with two points in an interval of length 1.
_FIRST, _SECOND = 0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0
_NODES = np.array([_FIRST, _SECOND])
# In an interval over which slopes change by more than this, times its length, the flow is that of held slopes.
_CHANGED = 1.0
_ALPHA, _BETA = 0.25 + math.sqrt(3.0) / 6.0, 0.25 - math.sqrt(3.0) / 6.0


Factors = tuple[NDArray[Any], NDArray[Any]]


@dataclass(frozen=True, eq=False)
class VariationalEquation:
    """What a small change at the begin of a period does.

    Attributes:
        Phi: to the states at its end, the monodromy matrix where the motion is periodic, shape (n, n).
        rows: to mean, in-phase and quadrature part of the fundamental of the output, shape (3, n).
        stretch: what a longer period does to the states at its end, the forcing stretched with it, shape (n,) [1/s].
        through: largest |∂y/∂x| along the period, shape (n,); None: not known.
        others: multipliers that count, where they are known besides or are not all of its eigenvalues; None: they are.
        coarse: Φ by a rule of lower order; None: there is none.
        off: error of the multipliers, where `others` hold them.
        factors: U, shape (n, r), and W, shape (r, n), with Φ = U·W and r < n; None: there are none.
    """

    Phi: Floats
    rows: Floats
    stretch: Floats
    through: Floats | None = None
    others: Complex | None = None
    coarse: Floats | None = None
    off: float = 0.0
    factors: Factors | None = None

    @cached_property
    def doubt(self) -> float:
        """Error of the multipliers, about: how far a rule of lower order has the largest elsewhere."""
        return self.off if self.coarse is None else _apart(self.Phi, self.coarse)

    @cached_property
    def multipliers(self) -> Complex:
        """Floquet multipliers, largest first, shape (n,)."""
        with one_thread():
            result = np.linalg.eigvals(self.Phi).astype(np.complex128) if self.others is None else self.others
        return result[np.argsort(-np.abs(result))]

    @property
    def kept(self) -> tuple[complex, ...]:
        """The largest multipliers, as records keep them; a pair is not parted."""
        every = self.multipliers
        parted = len(every) > _KEPT and every[_KEPT - 1].imag != 0.0 and every[_KEPT] == every[_KEPT - 1].conjugate()
        return tuple(every[: _KEPT + parted].tolist())


_KEPT = 6
_FEW = 5  # states: of so few many matrices at once are as fast


def instants(begin: float, period: float, intervals: int) -> Floats:
    """Return the times at which the slopes of a period are needed, two in each interval, rising [s].

    Args:
        begin: of the period [s].
        period: [s].
        intervals: number of equal parts of the period.
    """
    times: Floats = begin + period * (np.arange(intervals)[:, None] + _NODES).ravel() / intervals
    return times


def tangent(
    slopes: NativeSlopes, period: float, unit: Floats, order: int = 1, *, rows: bool = True
) -> VariationalEquation | None:
    """Return the derivative of the period map; None where it is too large for numbers.

    Over an interval h with the slopes A₁, A₂ at its two Gauss points the flow is e^(h(αA₂ + βA₁))·e^(h(αA₁ + βA₂))
    with α, β = ¼ ± √3/6, of order 4, which remains right where the model is stiff. What the states put into the
    output's Fourier coefficients is integrated exactly with A and C held over each half. Jumps of the flow at events,
    which multiply the derivative by a saltation matrix, are not in it.

    Args:
        slopes: at the begin of the period, and at `instants`.
        period: of the motion [s].
        unit: how far each state moves, so that all are of one size in the exponentials, shape (n,).
        order: how many periods of the forcing it takes.
        rows: whether what the output does is wanted, and how far a rule of lower order is off; without, the rows are
            zero, at half the cost.

    Source: S. Blanes, P. C. Moan, Fourth- and sixth-order commutator-free Magnus integrators, Appl. Numer. Math. 56
    (2006); A. H. Nayfeh, B. Balachandran, Applied Nonlinear Dynamics, 3.3 (monodromy matrix).
    """
    k, n = len(slopes.x) - 1, slopes.x.shape[1]
    half = period / k
    if n > _FEW and (slopes.A[1:] == slopes.A[1]).all() and (slopes.C[1:, 0] == slopes.C[1, 0]).all():
        return _of_constant(slopes, period, unit, order, rows=rows)
    A = np.zeros((k, n + 1, n + 1))
    A[:, :n, :n] = slopes.A[1:] * unit / unit[:, None]
    A[:, :n, n] = slopes.dx[1:] / unit / period
    mixed = _mixed(A)
    # Where a limit is met within an interval, a quick mode comes or goes, and the negative weight would let it grow.
    quick = 2.0 * half * np.max(np.abs(A[1::2] - A[0::2])[:, :n, :n], axis=(1, 2), initial=0.0) > _CHANGED
    mixed[np.repeat(quick, 2)] = A[np.repeat(quick, 2)]
    with np.errstate(over="ignore", invalid="ignore"):
        both = exponentials(half * (np.concatenate([mixed, A]) if rows else mixed))
        flows, held = both[:k], both[k:]
        whole, starts = np.eye(n + 1), np.empty((k, n, n))
        for i in range(k):
            starts[i] = whole[:n, :n]
            whole = flows[i] @ whole
        if not np.isfinite(whole).all():
            return None
        Phi, stretch = whole[:n, :n] * unit[:, None] / unit, whole[:n, n] * unit
        through = np.max(np.abs(slopes.C[:, 0]), axis=0)
        if not rows:
            return VariationalEquation(Phi, np.zeros((3, n)), stretch, through)
        coarse = np.eye(n + 1)
        for part in held:
            coarse = part @ coarse
        result = _rows(A[:, :n, :n], slopes.C[1:, 0] * unit, (held[:, :n, :n], starts), period, order)
        if not (np.isfinite(coarse).all() and np.isfinite(result).all()):
            return None
    return VariationalEquation(Phi, result / unit, stretch, through, coarse=coarse[:n, :n] * unit[:, None] / unit)


def _mixed(at_nodes: Floats) -> Floats:
    """Return what both exponentials of each interval hold, by the values at its two Gauss points, shape (k, ...)."""
    first, second = at_nodes[0::2], at_nodes[1::2]
    result = np.empty_like(at_nodes)
    result[0::2] = 2.0 * (_ALPHA * first + _BETA * second)
    result[1::2] = 2.0 * (_ALPHA * second + _BETA * first)
    return result


def _of_constant(
    slopes: NativeSlopes, period: float, unit: Floats, order: int, *, rows: bool
) -> VariationalEquation | None:
    """Return the same where A and C are the same all along: one exponential E, and its powers, vector by vector."""
    k, n = len(slopes.x) - 1, slopes.x.shape[1]
    half, A = period / k, slopes.A[1] * unit / unit[:, None]
    driven = _mixed(slopes.dx[1:] / unit / period)
    with np.errstate(over="ignore", invalid="ignore"), one_thread():
        # e^(h[A, I; 0, 0]) holds e^(hA) and what a constant b adds, ∫e^(sA) ds.
        whole = exponentials(half * np.block([[A, np.eye(n)], [np.zeros((n, 2 * n))]])[None])[0]
        E, added = whole[:n, :n], whole[:n, n:] @ driven.T
        Phi, stretch = np.linalg.matrix_power(E, k), np.zeros(n)
        for i in range(k):
            stretch = E @ stretch + added[:, i]
        if not (np.isfinite(Phi).all() and np.isfinite(stretch).all()):
            return None
        through = np.max(np.abs(slopes.C[:, 0]), axis=0)
        outer = Phi * unit[:, None] / unit
        if not rows:
            return VariationalEquation(outer, np.zeros((3, n)), stretch * unit, through)
        omega, c = 2.0 * math.pi * order / period, slopes.C[1, 0] * unit
        integral = np.linalg.solve((A - 1j * omega * np.eye(n)).T, c)
        turning = np.exp(-1j * omega * half)
        first, part = np.zeros(n, dtype=np.complex128), integral @ E * turning - integral
        mean, row = np.zeros(n), c
        for i in range(k):
            first += part * turning**i
            part, following = part @ E, row @ E
            mean, row = mean + row + following, following
        result = np.array([0.5 / k * mean, *(2j / period * first).view(np.float64).reshape(n, 2).T])
        if not np.isfinite(result).all():
            return None
    return VariationalEquation(outer, result / unit, stretch * unit, through, coarse=outer)


def _apart(Phi: Floats, other: Floats) -> float:
    """Return by how much the largest multipliers of both differ."""
    sizes = [float(np.max(np.abs(np.linalg.eigvals(m)), initial=0.0)) for m in (Phi, other)]
    return abs(sizes[0] - sizes[1])


def _rows(A: Floats, c: Floats, flows: tuple[Floats, Floats], period: float, order: int) -> Floats:
    """Return mean, in-phase and quadrature part that a change of the states at the begin puts into the output.

    Args:
        A: slopes, held over each of k equal parts of the period, shape (k, n, n).
        c: of the output, likewise, shape (k, n).
        flows: over each part, and from the begin to each part's begin, shape (k, n, n).
        period: of the motion [s].
        order: how many periods of the forcing it takes.
    """
    k, n = c.shape
    held, starts = flows
    omega, part = 2.0 * math.pi * order / period, period / k
    turned = A - 1j * omega * np.eye(n)
    integral = np.linalg.solve(turned.transpose(0, 2, 1), c[:, :, None])[:, :, 0][:, None, :]
    parts = integral @ (held * np.exp(-1j * omega * part) - np.eye(n)) @ starts
    first = 2j / period * (parts[:, 0] * np.exp(-1j * omega * part * np.arange(k))[:, None]).sum(axis=0)
    # The mean by the trapezoidal rule: A has no inverse where the model integrates.
    ends = np.concatenate([starts[1:], held[-1:] @ starts[-1:]])
    mean = 0.5 / k * (c[:, None, :] @ (starts + ends))[:, 0].sum(axis=0)
    rows: Floats = np.array([mean, first.real, first.imag])
    return rows
