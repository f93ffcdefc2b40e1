"""The period map: states at the begin of a period → states at its end, with what the output does on the way."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError, SimulationError
from workbench.kernel.native_slopes import NativeSlopes
from workbench.response.periodic.fourier import ORDERS, Period, fundamental
from workbench.response.periodic.monodromy import VariationalEquation, instants, tangent
from workbench.session.compiled import CompiledMeSession, Harmonics
from workbench.signals.kinds import Signal, Sine

__all__ = [
    "FEW_STATES",
    "NUDGE",
    "ROWS",
    "Lap",
    "PeriodMap",
    "PeriodRange",
    "correction",
    "differences",
    "period_of",
    "resolvent_rows",
]

# Rows per period at which the output is recorded; for co-simulation the communication points.
ROWS = 200

# Of so many rows in a period at most the sines are kept from period to period.
_MOST_KEPT = 2000

# Directions that a period turns by less than this, relative, are not corrected: an integrator stands where it is put.
_STANDS = 1e-9

# The flow at the begin is taken this part of a period after it.
_AT_ONCE = 1e-9

# A state that moves by no more than this part of its size is at rest.
_AT_REST = 1e-6

# What moves by less than this part of its smallest scale may move by rounding.
_SMALL = 1e-3
# It does if it moves nothing else by more than this part of its motion.
_NOTHING = 1e-4

# Of the motion of each state, or of the range of a parameter, for differences of whole periods; with more states than
# `FEW_STATES` they cost too many.
NUDGE = 1e-4
FEW_STATES = 24


@dataclass(frozen=True)
class PeriodRange:
    """The periods of the forcing that are run in one go.

    Attributes:
        begin: where the forcing has phase zero [s].
        frequency: of the forcing [Hz].
        rows: per period.
        k: which period since `begin` is the first one.
        order: number of periods.
    """

    begin: float
    frequency: float
    rows: int = ROWS
    k: int = 0
    order: int = 1

    @property
    def points(self) -> Floats:
        """Times of the rows, counted from the begin and not added up, so that they do not drift [s]."""
        parts: Floats = self.k + np.arange(1, self.order * self.rows + 1) / self.rows
        times: Floats = self.begin + parts / self.frequency
        return times

    def asked(self, output: str) -> dict[str, Any]:
        """Return what `CompiledSession.harmonics` is told besides the signals, to measure an output."""
        points, orders = self.points, max(1, min(ORDERS, self.rows // 4))
        return {
            "until": float(points[-1]),
            "record": (output,),
            "begin": self.begin,
            "frequency": self.frequency,
            "orders": orders,
            "points": points,
            "basis": _basis(self.rows, orders, self.order),
        }


def period_of(result: Harmonics) -> Period:
    """Return what the one output did in a period, and the one input, where there is one."""
    (output,), inputs = result.values, list(result.inputs.values())
    drive = fundamental(inputs[0]) if inputs else 0.0j
    return Period(result.values[output], drive, result.largest[output], result.rough[output], result.steps)


@lru_cache(maxsize=8)
def _basis(rows: int, orders: int, periods: int) -> Floats | None:
    """Return 1, sin, cos, sin 2, … at the rows, shape (rows·periods, 1 + 2·orders); None: too many to keep."""
    if rows * periods > _MOST_KEPT:
        return None
    angles = 2.0 * math.pi * np.outer(np.arange(1, rows * periods + 1) / rows, np.arange(1, orders + 1))
    basis: Floats = np.ones((rows * periods, 1 + 2 * orders))
    basis[:, 1::2], basis[:, 2::2] = np.sin(angles), np.cos(angles)
    return basis


@dataclass(frozen=True, eq=False)
class Lap:
    """One period from given states.

    Attributes:
        x0, x1: states at its begin and at its end, shape (n,).
        period: what the output did.
        events: how many events there were on the way.
        unit: how far each state moves, shape (n,).
        tangent: derivative of the map here; None: it was not asked for, or could not be had.
        flow: dx/dt at the begin, shape (n,); None: as `tangent`.
    """

    x0: Floats
    x1: Floats
    period: Period
    events: int
    unit: Floats
    tangent: VariationalEquation | None = None
    flow: Floats | None = None

    @property
    def defect(self) -> Floats:
        """By how much the period does not close, shape (n,)."""
        return self.x1 - self.x0


@dataclass
class PeriodMap:
    """Runs periods of a forced model, or of one that moves by itself, in one session.

    Time goes on from period to period; the forcing begins each with phase zero. Discrete states are those that the
    period before has left.

    Attributes:
        session: of model exchange.
        output: what is measured.
        input: what is forced; "": nothing.
        centre: about which the forcing moves.
        rows: per period.
        order: how many periods of the forcing the motion takes, more than 1 for a subharmonic.
        derived: whether the derivative of what the output does is wanted, too.
    """

    session: CompiledMeSession
    output: str
    input: str = ""
    centre: float = 0.0
    rows: int = ROWS
    order: int = 1
    derived: bool = True

    def __post_init__(self) -> None:
        """Refuse what has no period map of its states.

        Raises:
            InputError: the model has a transport delay.
        """
        if self.session.instance.has_history:
            raise InputError(
                "the model has a transport delay: what is in it at the end of a period does not follow from the states "
                "at its begin, so periodic motions cannot be solved for; nfr waits until they have settled"
            )

    @cached_property
    def smallest(self) -> Floats:
        """Smallest scale of the error of each state, shape (n,), see `CompiledMeSession.scales`."""
        return self.session.scales()[0]

    def lap(self, frequency: float, amplitude: float = 0.0, x: Floats | None = None, *, intervals: int = 0) -> Lap:
        """Run one period.

        Args:
            frequency: [Hz].
            amplitude: of the forcing.
            x: where to begin; None: where the session stands.
            intervals: in so many the derivative of the map is found; 0: it is not.

        Raises:
            SimulationError: the model cannot be run there.
        """
        session = self.session
        if x is not None:
            session.jump(x)
        begin, x0, events = session.time, session.stand(), session.events
        signals: dict[str, Signal] = {}
        if self.input:
            signals[self.input] = Sine(amplitude=amplitude, frequency=frequency, offset=self.centre, start=begin)
        span, slopes = PeriodRange(begin, frequency, self.rows, order=self.order), None
        length = self.order / frequency
        with ExitStack() as stack:
            if intervals and len(x0):
                times = instants(begin, length, intervals * self.order)
                slopes = stack.enter_context(
                    session.slopes(np.append(begin + _AT_ONCE * length, times), (self.output,))
                )
            period = period_of(session.harmonics(signals=signals, **span.asked(self.output)))
        if not np.isfinite(period.harmonics).all():
            raise SimulationError(f"{self.output} is not finite", time=session.time)
        lap = Lap(x0, session.stand(), period, session.events - events, np.maximum(np.abs(x0), 1e-12))
        if slopes is None or not slopes.complete or not np.isfinite(slopes.A).all():
            return lap
        unit = self._motion(slopes, np.vstack([slopes.x, x0, lap.x1]), length, period)
        result = tangent(slopes, length, unit, self.order, rows=self.derived)
        return replace(lap, unit=unit, tangent=result, flow=slopes.dx[0])

    def _motion(self, slopes: NativeSlopes, x: Floats, length: float, period: Period) -> Floats:
        """Return how far each state moves in a period; where it is at rest, its size; 1 where that is zero, too.

        States that move by much less than their smallest scale, and neither the output nor any other state by a
        part of its motion that matters, are at rest too: what is not driven at all moves by rounding. Their
        smallest scale counts.

        Args:
            slopes: along the period.
            x: states along it, shape (k, n).
            length: of it [s].
            period: what the output does.
        """
        swing, size = np.ptp(x, axis=0), np.max(np.abs(x), axis=0)
        still, low = swing <= _AT_REST * size, swing < _SMALL * self.smallest
        result: Floats = np.where(still, np.where(size > 0.0, size, 1.0), swing)
        if (low & ~still).any():
            others = length * np.max(np.abs(slopes.A), axis=0)[np.ix_(~low, low)] @ swing[low]
            output = np.max(np.abs(slopes.C[:, 0]), axis=0)[low] @ swing[low]
            if (others <= _NOTHING * swing[~low]).all() and output <= _NOTHING * abs(fundamental(period.harmonics)):
                result[low] = np.maximum(size, self.smallest)[low]
        return result

    def by_differences(self, lap: Lap, frequency: float, amplitude: float = 0.0) -> Lap:
        """Return a lap with the derivative of the map by differences of whole periods: right with jumps of the flow.

        It costs a period for each state.

        Args:
            lap: whose derivative is wanted.
            frequency: [Hz].
            amplitude: of the forcing.
        """
        return replace(lap, tangent=differences(lap, lambda x: self.lap(frequency, amplitude, x)))


def differences(lap: Lap, run: Callable[[Floats], Lap], part: float = NUDGE) -> VariationalEquation:
    """Return the derivative of the period map by differences of whole periods, one for each state.

    Args:
        lap: whose derivative is wanted.
        run: runs a period from other states.
        part: of its motion by which each state is moved.
    """
    n = len(lap.x0)
    Phi, rows = np.empty((n, n)), np.empty((3, n))
    for i in range(n):
        x, step = lap.x0.copy(), part * lap.unit[i]
        x[i] += step
        moved = run(x)
        Phi[:, i] = (moved.x1 - lap.x1) / step
        rows[:, i] = (moved.period.harmonics[:3] - lap.period.harmonics[:3]) / step
    before = lap.tangent
    stretch, through = (np.zeros(n), None) if before is None else (before.stretch, before.through)
    return VariationalEquation(Phi, rows, stretch, through)


def correction(lap: Lap, at: VariationalEquation) -> tuple[Floats, float]:
    """Return what takes the begin of a lap to the periodic motion, to first order, and what of the defect is left.

    (I − Φ)·e = x1 − x0, in units of each state's motion. A direction that a period leaves as it is, as an integrator
    does, is not corrected; what the defect has in it is left.

    Args:
        lap: one period.
        at: derivative of its map.

    Returns:
        e, shape (n,), and the part of the defect that no e removes, relative to it.
    """
    unit = lap.unit
    aim = lap.defect / unit
    if at.factors is not None:
        closing = _by_factors(at.factors[0] / unit[:, None], at.factors[1] * unit, aim)
        if closing is not None:
            return closing * unit, 0.0
    matrix = np.eye(len(unit)) - at.Phi * unit / unit[:, None]
    regular = _regular_solution(matrix, aim)
    result = np.linalg.lstsq(matrix, aim, rcond=_STANDS)[0] if regular is None else regular
    size = float(np.linalg.norm(aim))
    left = float(np.linalg.norm(matrix @ result - aim)) / size if size > 0.0 else 0.0
    return result * unit, left


def _by_factors(U: NDArray[Any], W: NDArray[Any], aim: Floats) -> Floats | None:
    """Return the solution of (I − U·W)·x = b; None: the matrix may turn directions by less than `_STANDS`.

    Its inverse is I + U·(I − W·U)⁻¹·W. Source: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., 2.1.4.
    """
    try:
        inner = np.linalg.solve(np.eye(len(W)) - W @ U, np.column_stack([W @ aim, W]))
    except np.linalg.LinAlgError:
        return None
    one, size = math.sqrt(len(aim)), np.linalg.norm(U)
    condition = (one + size * np.linalg.norm(W)) * (one + size * np.linalg.norm(inner[:, 1:]))  # or less
    return aim + (U @ inner[:, 0]).real if condition * _STANDS < 1.0 else None


def _regular_solution(matrix: Floats, aim: Floats) -> Floats | None:
    """Return the solution of M·x = b; None: M may turn directions by less than `_STANDS`, by ‖M⁻¹‖ and ‖M‖."""
    if not len(aim):
        return np.zeros(0)
    try:
        solved = np.linalg.solve(matrix, np.column_stack([aim, np.eye(len(aim))]))
    except np.linalg.LinAlgError:
        return None
    condition = np.linalg.norm(matrix) * np.linalg.norm(solved[:, 1:])  # of Frobenius: no less than that by σ
    return np.asarray(solved[:, 0], dtype=np.float64) if condition * _STANDS < 1.0 else None


def resolvent_rows(lap: Lap, at: VariationalEquation) -> Complex:
    """Return by how much a defect of each state is wrong in the fundamental, shape (n,), complex."""
    unit = lap.unit
    matrix = np.eye(len(unit)) - at.Phi * unit / unit[:, None]
    rows = (at.rows[1] + 1j * at.rows[2]) * unit
    solution, *_ = np.linalg.lstsq(matrix.T.astype(np.complex128), rows, rcond=_STANDS)
    result: Complex = solution / unit
    return result
