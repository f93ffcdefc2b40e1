"""The communication step, controlled by step doubling: each step once, and again in two halves.

Source: E. Hairer, S. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., section II.4; M. Busch,
B. Schweizer, Numerical stability and accuracy of different co-simulation techniques, IMSD 2010, for its use here.
Not for components whose state cannot be saved, nor where a constant step is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["StepControl"]


_SAFETY, _SHRINK, _GROW = 0.8, 0.2, 2.0
_LOCAL_ORDER = 3.0  # of a step's error with linear inputs; with held ones 2, and the steps are refused more often


@dataclass(frozen=True, eq=False)
class StepControl:
    """What is known about the step.

    Attributes:
        tolerance: of one step, relative to the largest magnitude that each value has had.
        step: to be tried next [s].
        scale: those magnitudes, at first the least that count, shape (number of values,).
    """

    tolerance: float
    step: float
    scale: Floats

    def judged(self, span: float, coarse: Floats, fine: Floats) -> tuple[bool, StepControl]:
        """Return whether a step is good enough, and what is known now.

        Args:
            span: length of the step [s].
            coarse: values at its end in one step.
            fine: in two steps.
        """
        seen = np.maximum(np.abs(coarse), np.abs(fine))
        scale = np.maximum(self.scale, seen)
        error = self._error(fine - coarse, scale)
        factor = _GROW if error == 0.0 else _SAFETY * error ** (-1.0 / _LOCAL_ORDER)
        step = span * min(max(factor, _SHRINK), _GROW)
        if error > 1.0:
            return False, replace(self, step=step)
        # A last piece before a point is short for no reason of accuracy.
        return True, replace(self, step=max(step, self.step) if span < self.step else step, scale=scale)

    def _error(self, difference: Floats, scale: Floats) -> float:
        """Return the largest difference in terms of the tolerance."""
        used = scale > 0.0
        return float(np.max(np.abs(difference[used]) / scale[used], initial=0.0)) / self.tolerance
