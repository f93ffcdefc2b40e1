"""When something samples, as whole numbers that Python and the kernel share: instants.h."""

from __future__ import annotations

import ctypes

from workbench.core.values.calendar import Sampler
from workbench.errors import InputError

__all__ = ["Instants"]


class Instants(ctypes.Structure):
    """Instant k is (first + k · step) / denominator [s]; step 0: there are none.

    Whole numbers where the period is declared (beyond 2⁵³ rounded, which an instant shows in its last digits); an
    interval that an FMU tells while it runs is taken as it is, with denominator 1.
    """

    first: float
    step: float
    denominator: float
    _fields_ = (("first", ctypes.c_double), ("step", ctypes.c_double), ("denominator", ctypes.c_double))

    def at(self, k: float) -> float:
        """Return the time of instant k [s]."""
        return (self.first + k * self.step) / self.denominator

    @classmethod
    def of(cls, sampler: Sampler) -> Instants:
        """Return those of a sampler.

        Raises:
            InputError: its numbers are too large to be counted.
        """
        try:
            return cls(*map(float, sampler.integers))
        except OverflowError:
            period = float(sampler.period)
            raise InputError(f"a sample period of {period:.6g} s cannot be counted; give a longer one") from None
