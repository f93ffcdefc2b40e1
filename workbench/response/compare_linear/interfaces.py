"""How a co-simulation interface departs from the equations of the same FMU, in words and numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.point.lin.result import LinResult

__all__ = ["InterfaceDifference", "compare_interfaces"]

Poles = NDArray[np.complex128]

# What one step of length h makes of dx/dt = s x (Hairer, Nørsett, Wanner, Solving Ordinary Differential
# Equations I, section II.1, and II, section IV.3).
RULES: Mapping[str, Callable[[Poles], Poles]] = {
    "the exact solution": np.exp,
    "explicit Euler": lambda z: 1.0 + z,
    "implicit Euler": lambda z: 1.0 / (1.0 - z),
    "the trapezoidal rule": lambda z: (1.0 + z / 2.0) / (1.0 - z / 2.0),
}
FITS = 0.02  # of what a rule does differently from the exact solution: how well it must explain the poles
ALIKE = 0.01
VANISHED = 1e-3  # discrete poles smaller than this are over within a period


@dataclass(frozen=True)
class InterfaceDifference(RecordPart):
    """A co-simulation against the equations of the same FMU.

    Attributes:
        step: communication step [s].
        response_difference: largest relative difference of the two frequency responses where they were compared.
        rule: integration rule that explains the discrete poles; None: none of the known ones, or not needed.
        pole_error: largest distance of a discrete pole from what the rule makes of the equations' poles.
        shift: largest relative difference ln(z)/h against s over the poles that co-simulation shows.
        agreeing_step: longest step at which that shift stays within 1 % [s]; None: not known.
    """

    step: float
    response_difference: float
    rule: str | None
    pole_error: float
    shift: float
    agreeing_step: float | None

    @property
    def words(self) -> str:
        """The comparison in one sentence."""
        percent = f"{100.0 * self.response_difference:.3g} % of the response"
        who = f"at its step of {self.step:.6g} s the co-simulation interface"
        if self.rule is None and self.response_difference <= ALIKE:
            return f"{who} agrees with the model exchange interface within {percent}"
        text = f"{who} differs from the model exchange interface by up to {percent}"
        if self.rule is None:
            return text
        text += f": it integrates by {self.rule}, which moves poles by up to {100.0 * self.shift:.3g} %"
        if self.agreeing_step is None:
            return text
        return f"{text}; poles agree within 1 % for steps up to {self.agreeing_step:.4g} s"

    def derived(self) -> dict[str, Any]:
        """Return the sentence."""
        return {"words": self.words}


def compare_interfaces(
    equations: LinResult, stepped: LinResult, *, step: float, frequencies: Floats
) -> InterfaceDifference | None:
    """Explain how a co-simulation departs from the equations.

    Args:
        equations: continuous linear model.
        stepped: discrete linear model of the co-simulation.
        step: communication step, of which the period of `stepped` is a multiple [s].
        frequencies: where to compare the responses [Hz].

    Returns:
        None where there are no poles to compare.
    """
    s, z = equations.poles, stepped.poles
    z = z[np.abs(z) > VANISHED]
    if not len(s) or not len(z):
        return None
    times = max(1, round(stepped.dt / step))
    errors = {name: _distance(rule(s * step) ** times, z) for name, rule in RULES.items()}
    name = min(errors, key=lambda n: errors[n].max())
    rule = RULES[name]
    seen = s[_nearest(rule(s * step) ** times, z)]
    own = np.abs(
        rule(seen * step) ** times - np.exp(seen * step * times)
    )  # what tells this rule from the exact solution
    explained = name != "the exact solution" and bool((errors[name] <= FITS * own + 1e-9).all())
    return InterfaceDifference(
        step=step,
        response_difference=_apart(equations, stepped, frequencies),
        rule=name if explained else None,
        pole_error=float(errors[name].max()),
        shift=_shift(z, seen, stepped.dt),
        agreeing_step=_agreeing(rule, seen) if explained else None,
    )


def _apart(equations: LinResult, stepped: LinResult, frequencies: Floats) -> float:
    """Return the largest relative difference of two frequency responses below 0.4 of the Nyquist frequency."""
    grid = frequencies[frequencies < 0.2 / stepped.dt]
    a, b = equations.fundamental(grid), stepped.fundamental(grid)
    good = np.isfinite(a) & np.isfinite(b) & (np.abs(a) > 0.0)
    return float((np.abs(b - a)[good] / np.abs(a)[good]).max(initial=0.0))


def _distance(expected: Poles, result: Poles) -> Floats:
    distances: Floats = np.abs(result[:, None] - expected[None, :]).min(axis=1)
    return distances


def _nearest(expected: Poles, result: Poles) -> NDArray[np.intp]:
    return np.asarray(np.abs(result[:, None] - expected[None, :]).argmin(axis=1), dtype=np.intp)


def _shift(discrete: Poles, seen: Poles, period: float) -> float:
    """Return the largest relative shift of ln(z)/h from s; poles at 0 have none."""
    moving = (np.abs(seen * period) > 1e-9) & (np.abs(discrete) > 1e-12)
    if not moving.any():
        return 0.0
    result = np.log(discrete[moving]) / period
    return float((np.abs(result - seen[moving]) / np.abs(seen[moving])).max())


def _agreeing(rule: Callable[[Poles], Poles], seen: Poles) -> float | None:
    """Return the longest step up to which the rule moves no pole by more than 1 % [s], by bisection."""

    def apart(h: float) -> float:
        return _shift(rule(seen * h), seen, h)

    largest = float(np.abs(seen).max())
    if largest == 0.0:
        return None
    low, high = 1e-6 / largest, 1.0 / largest
    if apart(low) > ALIKE or apart(high) < ALIKE:
        return None
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if apart(middle) <= ALIKE else (low, middle)
    return low
