"""Whether a closed loop is stable, from its poles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex
from workbench.core.values.linear import Linear, LinearPart
from workbench.core.values.margins import BORDER, STABLE, UNKNOWN, UNSTABLE
from workbench.core.values.matrices import rounding_of_poles
from workbench.core.values.poles import sides

__all__ = ["ClosedLoopStability", "judged", "same_poles", "stability_of", "unknown", "words_of"]

_RELATIVE = 1e-7  # of a pole's size (of 1 for sampled ones): what its distance from the border is known to
_KNOWN = 1e-5  # relative: what differences of runs know a characteristic polynomial to
_SAME = 1e-6  # an open and a closed pole as near as this, relative, are one


@dataclass(frozen=True, eq=False)
class ClosedLoopStability(RecordPart):
    """A loop's poles, closed and open.

    Attributes:
        verdict: "stable", "unstable" or "at the border" (a pole on it, as near as it is known).
        poles: of the closed loop, shape (n,) [1/s]; of a sampled one in z.
        open_unstable: number of poles of the open loop outside the stable region.
        unstable: number of such poles of the closed loop.
        words: verdict and reason in one line.
    """

    verdict: str
    poles: Complex
    open_unstable: int = field(metadata=entry(key="open_unstable_poles"))
    unstable: int = field(metadata=entry(key="unstable_poles"))
    words: str

    @property
    def stable(self) -> bool:
        """Whether margins mean anything."""
        return self.verdict == STABLE


def stability_of(loop: LinearPart) -> ClosedLoopStability:
    """Return whether 1/(1 + L) is stable, all states of the realisation counted, hidden ones too.

    Args:
        loop: L, negative feedback.

    Raises:
        InputError: the closed loop has no solution.
    """
    return judged(loop.sensitivity(), loop)


def judged(closed: Linear, loop: Linear) -> ClosedLoopStability:
    """Return whether a closed loop is stable.

    Args:
        closed: the closed loop.
        loop: the open one.
    """
    poles, before = closed.poles, loop.poles
    outside, border = _sides(poles, closed)
    beyond, _ = _sides(before, loop)
    verdict = UNSTABLE if outside.any() else BORDER if border.any() else STABLE
    bad = poles[outside] if outside.any() else poles[border]
    words = words_of(verdict, poles, bad, before, loop.dt)
    return ClosedLoopStability(verdict, poles, int(beyond.sum()), int(outside.sum()), words)


def same_poles(one: Complex, other: Complex) -> bool:
    """Whether two sampled models of one period have the same poles, but for some at 0.

    Their characteristic polynomials are compared outside of all poles, where multiple poles, which rounding moves far,
    do no harm.

    Args:
        one: poles in z, shape (n,).
        other: likewise, shape (m,).
    """
    largest = max(float(np.abs(p).max(initial=1.0)) for p in (one, other))
    z = 1.5 * largest * np.exp(1j * np.linspace(0.3, 2.9, 5))
    a, b = (np.prod(1.0 - p[:, None] / z, axis=0) for p in (one, other))
    return bool(np.abs(a - b).max() <= _KNOWN * np.abs(a).max())


def unknown(result: ClosedLoopStability, why: str) -> ClosedLoopStability:
    """Return that nothing is known of the stability of the closed loop.

    Args:
        result: what would be said.
        why: what speaks against it.
    """
    return replace(result, verdict=UNKNOWN, words=f"whether the closed loop is stable is not known: {why}")


def _sides(poles: Complex, f: Linear) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which poles lie outside the stable region, and which on its border."""
    return sides(poles, f.dt, relative=_RELATIVE, rounding=rounding_of_poles(f.A))


def words_of(verdict: str, poles: Complex, bad: Complex, before: Complex, dt: float) -> str:
    """Return a verdict and its reason in one line.

    Args:
        verdict: see `ClosedLoopStability`.
        poles: of the closed loop.
        bad: those for which it is not stable.
        before: poles of the open loop.
        dt: period [s]; 0: continuous.
    """
    unit = "" if dt > 0.0 else " 1/s"
    if verdict == STABLE:
        if not len(poles):
            return "the closed loop is stable: it has no states"
        nearest = poles[np.argmax(np.abs(poles) if dt > 0.0 else poles.real)]
        return f"the closed loop is stable: its pole nearest to the border is {_number(nearest)}{unit}"
    listed = ", ".join(dict.fromkeys(_number(p) for p in bad[:4]))
    what = "unstable" if verdict == UNSTABLE else "at the border of stability"
    text = (
        f"the closed loop is {what}: pole{'s' if len(bad) > 1 else ''} {listed}{unit}; the margins are then meaningless"
    )
    kept = [p for p in bad if len(before) and np.abs(before - p).min() <= _SAME * (1.0 + abs(p))]
    if kept:
        text += f"; {_number(kept[0])} is there with the loop open too: this loop does not affect it"
    return text


def _number(p: complex) -> str:
    real = 0.0 if abs(p.real) <= 1e-9 * abs(p) else p.real
    if abs(p.imag) <= 1e-9 * abs(p):
        return f"{real:.4g}"
    return f"{real:.4g} ± {abs(p.imag):.4g}j"
