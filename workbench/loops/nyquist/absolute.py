"""Absolute stability: the sectors for which circle and Popov criterion prove a loop stable, whatever is in them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import minimize_scalar

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.describing.sector import Sector, sector_of
from workbench.loops.nyquist.level_crossings import level_frequencies, real_crossings, scan
from workbench.loops.nyquist.part import part_of
from workbench.show.result import Result

if TYPE_CHECKING:
    from control import StateSpace, TransferFunction

    from workbench.point.lin.state_space import LinearModel

__all__ = ["AbsoluteStability", "absolute_stability", "lowest_real_part"]

REACH = 1e4
_CLOSE = 1e-9  # relative: how far below the smallest value found nothing lies for certain
_ROUNDS = 60
_SAME = 1e-13  # of the terms of a sum: rounding
_CUTS = 40
_LARGEST = 1e9  # of a multiplier, over the fastest pole's time: as good as infinite


@dataclass(frozen=True, eq=False, kw_only=True)
class AbsoluteStability(Result):
    """What sectors [low, k] a loop 1 + φ·L = 0 is proven stable for, and what a constant gain can have.

    Attributes:
        name: of the loop.
        sector: of the block; None: it was not given.
        low: lower end of the sectors.
        linear: largest k so that every constant gain in low … k is stable, which bounds the others: no criterion can
            reach farther, and a describing function predicts no cycle below; None: no bound.
        circle: largest k by the circle criterion: for every φ(v, t) in the sector; None: no bound.
        popov: largest k by Popov's criterion: for every φ(v) in the sector, not changing with time; None: no bound.
        circle_hz: frequency at which the circle is touched [Hz]; None: no bound, or at infinite frequency.
        popov_s: multiplier q of the criterion [s]; None: no bound.
        refused: why nothing is proven, as where the loop is not stable with the gain `low`; empty: it is.
    """

    _page = "workbench.loops.nyquist.page:absolute_page"

    name: str
    sector: Sector | None
    low: float
    linear: float | None
    circle: float | None
    popov: float | None
    circle_hz: float | None = None
    popov_s: float | None = None
    refused: str = ""

    @property
    def proven_by(self) -> str:
        """The criterion that proves the loop with the block's sector stable: "circle", "Popov"; empty: none does."""
        if self.sector is None or self.refused:
            return ""
        reaching = {"circle": self.circle, "Popov": self.popov}
        return next((n for n, k in reaching.items() if k is None or self.sector.high < k), "")

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each criterion."""
        yield ("criterion", "low", "high")
        for name, high in (("circle", self.circle), ("popov", self.popov), ("linear", self.linear)):
            yield (name, self.low, high)

    def derived(self) -> dict[str, str]:
        """Return which criterion proves the loop with the block stable."""
        return {"proven_by": self.proven_by}


def absolute_stability(
    loop: LinearPart | LinearModel | StateSpace | TransferFunction,
    block: DescribedBlock | Sector | None = None,
    *,
    reach: float = REACH,
    low: float = 0.0,
    name: str = "loop",
) -> AbsoluteStability:
    """Return the largest sectors for which a loop with negative feedback, v = −L φ(v), is proven stable.

    With G = L/(1 + low·L), which must be stable, and κ = k − low, the circle criterion asks for Re G(jω) > −1/κ at all
    ω, Popov's for a number q with Re (1 + jωq) G(jω) > −1/κ. The smallest real part is found by level sets: no
    frequency at which it takes a value is overlooked, as all of them are eigenvalues of a pencil, also at sharp
    resonances. As a function of q, of either sign, it is concave: its maximum is found by cutting planes. The bounds
    are on the safe side by 1e-9. Both criteria are sufficient: a larger sector may be stable all the same.

    Popov's criterion needs an L without direct part, else its bound is that of the circle. Not for sampled linear
    parts, and not for blocks with memory. About an operating point that is not at 0 the sector is that of the
    difference from it. A sector that holds up to some |v| only proves nothing beyond it.

    Args:
        loop: L, one input and one output, continuous.
        block: static block, or its sector, whose lower end replaces `low`; None: only the sectors are asked for.
        reach: largest |v| at which the block is looked at.
        low: lower end of the sectors.
        name: name of the loop.

    Raises:
        InputError: the block is not static; L is sampled or has several inputs or outputs; the lower end is not finite.

    Source: H. Khalil, Nonlinear Systems, 3rd ed., theorems 7.1 and 7.3; K. Narendra, J. Taylor, Frequency Domain
    Criteria for Absolute Stability, 1973 (q of either sign); level sets: S. Boyd, V. Balakrishnan, P. Kabamba, Math.
    Control Signals Systems 2 (1989) 207-219.

    Examples:
        1/(s + 1)³ is stable with constant gains below 8, and by Popov's criterion with any characteristic in that
        sector.

        >>> import control
        >>> found = wb.absolute_stability(control.tf([1], [1, 3, 3, 1]))
        >>> print(f"{found.linear:.4f} {found.popov:.4f} {found.circle:.4f}")
        8.0000 8.0000 4.0000
    """
    part = part_of(loop)
    if not reach > 0.0:
        raise InputError(f"reach: {reach:g} is not positive")
    sector = _sector(block, reach) if isinstance(block, DescribedBlock) else block
    low = low if sector is None else sector.low
    if not math.isfinite(low):
        raise InputError(f"sector: its lower end is {low:g}; give a finite one")
    common = {"name": name, "sector": sector, "low": low}
    refused = _refused(part, low)
    if refused:
        return AbsoluteStability(**common, linear=low, circle=low, popov=low, refused=refused)  # type: ignore[arg-type]
    closed = _closed(part, low)
    circle, hz = _bound(closed, low)
    q, popov = _popov(closed, low)
    return AbsoluteStability(
        **common,  # type: ignore[arg-type]
        linear=_hurwitz(closed, low),
        circle=circle,
        popov=popov if circle is not None else None,
        circle_hz=hz if circle is not None and math.isfinite(hz) else None,
        popov_s=q if popov is not None else None,
    )


def _sector(block: DescribedBlock, reach: float) -> Sector:
    try:
        return sector_of(block, reach)
    except NotImplementedError:
        raise InputError(f"block {block.name} is not static; the criteria are for static blocks") from None


def _refused(part: LinearPart, low: float) -> str:
    if not part.solvable(-low):
        return f"the loop has no solution with the gain {low:g}"
    if len(part.A) and not part.growth(-low) < 0.0:
        return f"the loop is not stable with the gain {low:.6g}, the lower end of the sector"
    return ""


def _closed(part: LinearPart, low: float) -> LinearPart:
    """Return L/(1 + low·L)."""
    by = 1.0 / (1.0 + low * part.d)
    return LinearPart(part.closed(-low), by * part.B, by * part.C, by * part.d)


# -- the smallest real part --------------------------------------------------------------------


def lowest_real_part(part: LinearPart) -> tuple[float, float]:
    """Return the frequency at which the real part is smallest [Hz], and that value, or a little less.

    Args:
        part: continuous, stable.

    Returns:
        Frequency, infinite where the value is only approached, and a lower bound of the real part, by 1e-9 relative.
    """
    if not len(part.A):
        return np.inf, part.d
    f = np.concatenate([[0.0], scan(part), [np.inf]])
    hz, value = _smallest(part, f)
    size = max(float(np.nanmax(np.abs(part.response(f).real))), 1e-300)
    for _ in range(_ROUNDS):
        floor = value - _CLOSE * max(abs(value), 1e-6 * size)
        level = level_frequencies(part, lambda p, floor=floor: _even_pencil(p, floor))  # type: ignore[misc]
        between = np.sqrt(level[1:] * level[:-1])
        there, lower = _smallest(part, np.concatenate([level, between, [level[0] / 2.0, level[-1] * 2.0]]))
        if lower >= floor:
            return hz, floor
        hz, value = _refined(part, there, lower)
    return hz, value - 1e-3 * size  # never seen: a margin that rounding cannot be above


def _smallest(part: LinearPart, f: Floats) -> tuple[float, float]:
    real = part.response(f).real
    k = int(np.nanargmin(real))
    return float(f[k]), float(real[k])


def _refined(part: LinearPart, hz: float, value: float) -> tuple[float, float]:
    """Return a place near by where the real part is smallest."""
    if not (0.0 < hz < np.inf):
        return hz, value
    ends = (math.log(hz) - 0.1, math.log(hz) + 0.1)
    result = minimize_scalar(
        lambda t: part.at(math.exp(t)).real, bounds=ends, method="bounded", options={"xatol": 1e-12}
    )
    return (math.exp(float(result.x)), float(result.fun)) if result.fun < value else (hz, value)


def _even_pencil(part: LinearPart, level: float) -> tuple[Floats, Floats]:
    """Return (a, b) whose generalised eigenvalues are the zeros of F(s) + F(−s) − 2·level."""
    n = len(part.A)
    size_b, size_c = (max(float(np.abs(x).max(initial=0.0)), 1e-300) for x in (part.B, part.C))
    B, C = part.B / size_b, part.C / size_c
    a = np.block([
        [part.A, np.zeros((n, n)), B],
        [np.zeros((n, n)), -part.A, B],
        [C, -C, np.array([[2.0 * (part.d - level) / (size_b * size_c)]])],
    ])  # fmt: skip
    return a, np.diag([1.0] * (2 * n) + [0.0])


# -- the criteria ------------------------------------------------------------------------------


def _bound(closed: LinearPart, low: float) -> tuple[float | None, float]:
    """Return the largest upper end of the sector by a real part, and where it is decided [Hz]; None: no bound."""
    hz, least = lowest_real_part(closed)
    size = float(np.nanmax(np.abs(closed.response(scan(closed))), initial=0.0)) if len(closed.A) else abs(closed.d)
    if least >= -_CLOSE * max(size, 1e-300):
        return None, hz
    return low - 1.0 / least, hz


def _popov(closed: LinearPart, low: float) -> tuple[float, float | None]:
    """Return q [s], and the largest upper end of the sector; None: no bound.

    The best q of some frequencies is exact. Where the real part with it is smaller elsewhere, that
    frequency is added, until it is nowhere (a cutting-plane method).
    """
    speeds = np.abs(closed.poles)
    if not len(speeds) or closed.d != 0.0:  # the criterion is for strictly proper G
        return 0.0, _bound(closed, low)[0]
    unit, q = 1.0 / float(speeds.max()), 0.0
    f = np.concatenate([[0.0], scan(closed)])
    for _ in range(_CUTS):
        q, level = _best_of(f, closed.response(f), unit)
        hz, least = lowest_real_part(_with_multiplier(closed, q))
        if least >= level - _CLOSE * abs(level) or not (0.0 < hz < np.inf):
            break
        f = np.append(f, hz)
    return q, _bound(_with_multiplier(closed, q), low)[0]


def _with_multiplier(closed: LinearPart, q: float) -> LinearPart:
    """Return what has the real part of (1 + qs) G(s) on the imaginary axis."""
    moved = closed.C + q * closed.C @ closed.A
    return LinearPart(closed.A, closed.B, moved, closed.d + q * float(closed.c @ closed.b))


def _best_of(f: Floats, value: Complex, unit: float) -> tuple[float, float]:
    """Return the q with the largest smallest Re (1 + jωq) G of some frequencies, and that real part.

    Over q each frequency gives a straight line. The lowest of all is highest where one that rises meets one that falls
    and none is lower; a lower one takes the place of that with the same direction. Several that meet in one point are
    lower than each other by rounding only.
    """
    real, slope = value.real, -2.0 * np.pi * f * unit * value.imag
    rising, falling = (int(np.argmin(real + q * slope)) for q in (-_LARGEST, _LARGEST))
    ends = {rising: -_LARGEST, falling: _LARGEST}
    for k, far in ends.items():
        if slope[k] * far > 0.0:  # the lowest line has one direction throughout
            return far * unit, float(real[k] + far * slope[k])
    while slope[rising] != slope[falling]:
        q = float((real[falling] - real[rising]) / (slope[rising] - slope[falling]))
        lowest = int(np.argmin(real + q * slope))
        level = float(real[lowest] + q * slope[lowest])
        met = float(real[rising] + q * slope[rising])
        rounding = _SAME * float(np.abs(real[[rising, lowest]]).max() + abs(q) * np.abs(slope[[rising, lowest]]).max())
        if lowest in (rising, falling) or slope[lowest] == 0.0 or level >= met - rounding:
            return q * unit, level
        rising, falling = (lowest, falling) if slope[lowest] > 0.0 else (rising, lowest)
    return 0.0, float(np.min(real))  # all are level


def _hurwitz(closed: LinearPart, low: float) -> float | None:
    """Return the largest constant gain up to which all above `low` are stable; None: no bound.

    The gains at which a pole is on the axis are −1/G where G is real, at 0 and at infinite frequency.
    """
    places = np.array([0.0, *real_crossings(closed), np.inf])
    real = closed.response(places).real
    gains = sorted(float(-1.0 / r) for r in real if r < 0.0)
    return low + gains[0] if gains else None
