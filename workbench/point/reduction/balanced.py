"""Balanced reduction of a linear system by its Hankel singular values."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.matrices import rounding_of_poles
from workbench.core.values.modal import poles_of
from workbench.errors import InputError, SimulationError, suggest
from workbench.requests.decorator import with_origin
from workbench.show.result import Result

if TYPE_CHECKING:
    import control

__all__ = ["METHODS", "BalancedReduction", "balanced_reduction"]

METHODS = ("match-dc", "truncate")
_ROUNDING = 100.0  # times that of the whole matrix
_KEPT = 1e-4  # Hankel singular values below this part of the largest are left out, unless told otherwise


@dataclass(frozen=True, eq=False, kw_only=True)
class BalancedReduction(Result):
    """A reduced system, and what was left out.

    Attributes:
        part: the reduced system; its states have no meaning of their own.
        method: "match-dc" or "truncate".
        order: number of its states, the unstable ones included.
        full_order: number of states before.
        unstable: how many poles lie right of, or on, the imaginary axis; all of them are kept.
        hankel: shape (full_order − unstable,), Hankel singular values of the stable part, falling, in units of
            output over input.
        bound: no gain of the difference exceeds this at any frequency: twice the sum of the values left out.
        tolerance: the least relative value kept that gives this order, hankel[kept − 1]/hankel[0].
    """

    _page = "workbench.point.reduction.page:reduction_page"

    part: LinearPart
    method: str
    order: int
    full_order: int
    unstable: int
    hankel: Floats
    bound: float
    tolerance: float

    def to_ss(self) -> control.StateSpace:
        """Return the reduced system for python-control."""
        return self.part.to_state_space()


@with_origin()
def balanced_reduction(
    part: LinearPart, *, order: int | None = None, tolerance: float | None = None, method: str = "match-dc"
) -> BalancedReduction:
    """Leave out the states of a balanced realisation that are hardest to reach and to see.

    The stable part is brought into coordinates in which both Gramians are equal and diagonal; what remains of the
    states with the smallest diagonal elements is nothing ("truncate") or their value at rest ("match-dc", singular
    perturbation: the gain at frequency 0 stays exact, a zero there stays a zero; a feed-through appears). The unstable
    part is split off before and put back untouched. Both reductions keep
    max |G − Gr| over all frequencies below `bound`. It is an absolute error: where |G| is small, such as at a zero,
    the relative one can be large, so compare both in the band that counts.

    Not for systems with poles on the imaginary axis that shall be reduced, too: they count as unstable and stay.

    Sources: K. Glover, All optimal Hankel-norm approximations of linear multivariable systems, Int. J. Control 39
    (1984), the bound; Y. Liu and B. D. O. Anderson, Singular perturbation approximation of balanced systems, Int. J.
    Control 50 (1989); SLICOT routines AB09MD and AB09ND, whose Gramians are square-root factors.

    Args:
        part: the system.
        order: number of states wanted, the unstable ones included; instead of `tolerance`.
        tolerance: keep Hankel singular values from this part of the largest on; None: 1e-4.
        method: "match-dc" or "truncate".

    Raises:
        InputError: unknown method, order out of range, both order and tolerance given.
        SimulationError: the decomposition failed: unstable and stable poles too near each other.

    Examples:
        The second mode contributes 0.01/(s + 100) to the response, at most 1e-4; it can be removed.

        >>> import numpy as np
        >>> part = wb.LinearPart(np.diag([-1.0, -100.0]), np.array([1.0, 1.0]), np.array([1.0, 0.01]), 0.0)
        >>> reduced = wb.balanced_reduction(part, order=1)
        >>> print(reduced.part.A.round(2), reduced.bound < 2e-4)
        [[-1.]] True
    """
    n = len(part.A)
    scaled, factor = part.of_unit_size()
    border = _border(scaled)
    unstable = int(np.sum(scaled.poles.real >= border))
    _check(n, unstable, order, tolerance, method)
    with warnings.catch_warnings():
        hankel = _run(scaled, n, "truncate", border)[1][: n - unstable] * factor
        wanted = order if order is not None else unstable + _count(hankel, _KEPT if tolerance is None else tolerance)
        reduced = scaled if wanted == n else _run(scaled, wanted, method, border)[0]
    kept = len(reduced.A) - unstable
    return BalancedReduction(
        part=replace(reduced, C=reduced.C * factor, D=reduced.D * factor) if wanted < n else part,
        method=method,
        order=len(reduced.A),
        full_order=n,
        unstable=unstable,
        hankel=hankel,
        bound=2.0 * float(np.sum(hankel[kept:])),
        tolerance=float(hankel[kept - 1] / hankel[0]) if kept > 0 and hankel[0] > 0.0 else math.inf,
    )


def _check(n: int, unstable: int, order: int | None, tolerance: float | None, method: str) -> None:
    if not n:
        raise InputError("the system has no states: there is nothing to reduce")
    if method not in METHODS:
        raise InputError(f"method: '{method}' is unknown; {suggest(method, METHODS)}")
    if order is not None and tolerance is not None:
        raise InputError("order and tolerance are both given; give only one of them")
    if tolerance is not None and not 0.0 < tolerance < 1.0:
        raise InputError(f"tolerance must be between 0 and 1, not {tolerance:g}: a part of the largest value")
    if order is not None and not max(1, unstable) <= order <= n:
        why = f" ({unstable} unstable poles stay)" if unstable else ""
        least = max(1, unstable)
        raise InputError(f"order must lie between {least}{why} and {n}, the order of the system, not {order}")


def _count(hankel: Floats, tolerance: float) -> int:
    return int(np.sum(hankel >= tolerance * hankel[0])) if len(hankel) else 0


def _border(part: LinearPart) -> float:
    """Return the real part from which on poles count as unstable: left of those that rounding may have moved there.

    An integrator that stands a rounding error left of the axis would have a Hankel singular value without bound.
    """
    poles = poles_of(part.A)
    real, reach = poles.value.real, 5.0 * poles.uncertain
    near = np.abs(real) <= reach
    rounding = rounding_of_poles(part.A, _ROUNDING)
    # Each algorithm moves them elsewhere within their reach; what is surely stable stays beyond.
    stable = real[~near & (real < 0.0)].max(initial=-np.inf)
    return min(-rounding, max(-float(reach[near].max(initial=0.0)), 0.5 * float(real[near].min(initial=0.0) + stable)))


def _run(part: LinearPart, order: int, method: str, border: float) -> tuple[LinearPart, Floats]:
    """Return the reduced system and the Hankel singular values of the stable part, zeros behind them."""
    import slycot  # noqa: PLC0415  slow to import

    n = len(part.A)
    warnings.simplefilter("ignore", slycot.exceptions.SlycotResultWarning)  # of states that are none: seen by the order
    A, B, C, D = part.A.copy(), part.B.copy(), part.C.copy(), part.D.copy()
    try:
        if method == "truncate":
            _, a, b, c, _, hankel = slycot.ab09md("C", "B", "N", n, 1, 1, A, B, C, alpha=border, nr=order)
            d = D
        else:
            _, a, b, c, d, _, hankel = slycot.ab09nd("C", "B", "N", n, 1, 1, A, B, C, D, alpha=border, nr=order)
    except slycot.exceptions.SlycotError as error:
        raise SimulationError(f"balanced reduction failed: {error}") from None
    size = len(a)
    result = LinearPart(np.array(a), np.array(b)[:size], np.array(c)[:, :size], np.array(d))
    return result, np.asarray(hankel, dtype=np.float64)
