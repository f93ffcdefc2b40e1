"""Where a mode becomes unstable: root of its real part over the parameter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from scipy.optimize import brentq

__all__ = ["Root", "find_root", "sign_of"]

Pole = Callable[[float], tuple[complex, float]]

_MOST = 80


@dataclass(frozen=True)
class Root:
    """A value of the parameter at which a mode leaves or enters stability.

    Attributes:
        value: of the parameter.
        pole: there [1/s].
        evaluations: of the model, needed for it.
    """

    value: float
    pole: complex
    evaluations: int


def sign_of(pole: complex, uncertain: float) -> int:
    """Return the sign of a pole's real part; 0 where rounding decides it.

    Args:
        pole: [1/s].
        uncertain: how far rounding may have moved it [1/s].
    """
    return 0 if abs(pole.real) <= uncertain else 1 if pole.real > 0.0 else -1


def find_root(pole: Pole, low: float, high: float, *, tolerance: float) -> Root:
    """Return the value between two at which the mode's real part passes zero, or leaves it.

    Brent's method where the real part has both signs. A mode that is neutral on one side, such as those of an undamped
    structure before they coalesce, has no sign there: bisection, for the last value at which it is neutral.

    Args:
        pole: parameter → pole of this mode and its uncertainty [1/s].
        low: at one end of the bracket.
        high: at the other.
        tolerance: of the value.

    Source: Brent, Algorithms for Minimization without Derivatives, chapter 4.
    """
    count = 0

    def real(value: float) -> float:
        nonlocal count
        count += 1
        return pole(value)[0].real

    ends = [sign_of(*pole(v)) for v in (low, high)]
    if ends[0] * ends[1] < 0:
        value = float(brentq(real, low, high, xtol=tolerance, rtol=1e-15, maxiter=_MOST, disp=False))
        return Root(value, pole(value)[0], count)
    neutral, moving = (low, high) if ends[0] == 0 else (high, low)
    while abs(moving - neutral) > tolerance and count < _MOST:
        middle = 0.5 * (neutral + moving)
        count += 1
        if sign_of(*pole(middle)) == 0:
            neutral = middle
        else:
            moving = middle
    beyond = pole(moving)[
        0
    ]  # real: an undamped pair that slows down to a standstill and parts diverges, without flutter
    return Root(0.5 * (neutral + moving), beyond if beyond.imag == 0.0 else pole(neutral)[0], count)
